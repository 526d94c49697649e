"""destello beside Mitsuba 3, Cycles, Embree and Warp: the same geometry, camera and depth, in one run.

    pip install mitsuba==3.9.1 embreex warp-lang==1.19.0      # those wanted; what is missing is said and left out
    python benches/peers.py --device cpu --scale 0.25 cornell mesh1m:0.1 > peers.json

Prints lines of JSON, then, on standard error, the ratios, which `compare.py peers.json` prints again. An entry is
SCENE[:DETAIL[:WxH]]; without a size it is the scene's own times --scale.

Whole renders (`peers_render.py`): 8 segments, no Russian roulette, box filter, the same samples a pixel; wall time of a
render with the copy of its picture, the median of --repeat after one to warm up. Of destello twice where the sky is
even or a gradient: as it comes, and with a shadow ray to the sky at every hit, as the others do (`destello mis`).

Rays alone (`peers_rays.py`), in scenes of meshes without instances: the rays of `rays.py`. Threads are as said:
embreex and Warp's CPU device have one, so destello is measured with one and with all.

Cycles runs in the Python that has bpy: this one, or that of --cycles-python. Every measurement runs in a process of its
own, so one that crashes or hangs does not end the others.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from destello import Error, scenes
from destello.device import choose
from destello.machine import about

if TYPE_CHECKING:
    from destello.scene import Scene

NEEDS = {"mitsuba": "mitsuba==3.9.1", "embreex": "embreex", "warp": "warp-lang==1.19.0", "cycles": "bpy==5.0.*"}
MODULES = {"cycles": "bpy"}
RENDERERS = {
    "cpu": ("destello", "destello mis", "mitsuba:llvm_ad_rgb", "mitsuba:scalar_rgb", "cycles"),
    "cuda": ("destello", "destello mis", "mitsuba:cuda_ad_rgb"),
}
TRACERS = {
    "cpu": ("destello rays", "destello rays (1 thread)", "embreex", "warp:sah"),
    "cuda": ("destello rays", "warp:cubql", "warp:sah", "warp:lbvh"),
}
NOT_SAMPLED_BY_ITSELF = ("constant", "gradient")  # skies towards which destello sends no shadow rays


@dataclass(frozen=True)
class Entry:
    """A scene to measure: its name, its detail, and the size of the picture."""

    name: str
    detail: float
    size: tuple[int, int]

    @staticmethod
    def of(text: str, scale: float) -> Entry:
        """Raises destello.Error or ValueError."""
        name, _, rest = text.partition(":")
        detail, _, size = rest.partition(":")
        number = float(detail or 1)
        if not size:
            film = scenes.build(name, min(number, 1e-4)).film
            return Entry(name, number, (max(1, round(film.width * scale)), max(1, round(film.height * scale))))
        width, _, height = size.partition("x")
        scenes.build(name, min(number, 1e-4))
        return Entry(name, number, (int(width), int(height)))

    def __str__(self) -> str:
        return f"{self.name}:{self.detail:g}:{self.size[0]}x{self.size[1]}"


def child(args: argparse.Namespace) -> int:
    """Measures one scene with one peer; prints its lines."""
    entry = Entry.of(args.scenes[0], 1)
    args.size = entry.size
    scene = scenes.build(entry.name, entry.detail)
    if args.child in TRACERS[args.device]:
        results = importlib.import_module("peers_rays").rates(args.child, scene, args)
    else:
        results = iter([render(args.child, scene, args)])
    shared = {"scene": entry.name, "detail": entry.detail, "peer": args.child, "size": list(entry.size)}
    machine = about(choose(args.device), 0)
    for result in results:
        print(json.dumps(shared | result | machine), flush=True)
    return 0


def render(peer: str, scene: Scene, args: argparse.Namespace) -> dict[str, Any]:
    """Figures of a whole render."""
    renderers = importlib.import_module("peers_render")
    work = renderers.Work(
        args.size, args.spp, args.depth, args.repeat, choose(args.device).name, args.pictures and Path(args.pictures)
    )
    name, _, variant = peer.partition(":")
    scene = renderers.prepared(scene)
    if name == "mitsuba":
        found = renderers.mitsuba(scene, work, variant)
    elif name == "cycles":
        found = renderers.cycles(scene, work, args.cycles_python)
    else:
        if name == "destello mis" and getattr(scene.environment, "type", None) not in NOT_SAMPLED_BY_ITSELF:
            raise SystemExit("the same as destello here: all lights are sampled")
        found = renderers.destello(scene, work, "mis" if name == "destello mis" else "auto")
    figures: dict[str, Any] = found
    return figures


def in_a_process(peer: str, entry: Entry, args: argparse.Namespace, rays: str) -> list[dict[str, Any]]:
    """The measurements of a peer on a scene; what went wrong goes to standard error."""
    options = {"--device": args.device, "--spp": args.spp, "--ray-spp": args.ray_spp, "--depth": args.depth}
    options |= {"--repeat": args.repeat, "--cycles-python": args.cycles_python, "--child": peer, "--rays": rays}
    if args.pictures:
        options["--pictures"] = args.pictures
    words = [str(word) for pair in options.items() for word in pair]
    command = [sys.executable, str(Path(__file__).resolve()), *words, str(entry)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, start_new_session=True, **pipes) as process:
        try:
            output, errors = process.communicate(timeout=args.timeout)
        except BaseException as error:
            os.killpg(process.pid, signal.SIGKILL)  # with what it has started itself
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            print(f"{entry}, {peer}: not finished after {args.timeout:g} s", file=sys.stderr)
            return []
    if process.returncode != 0:
        last = (errors.strip().splitlines() or ["no message"])[-1]
        if "llvm" in peer:
            last += " (it wants libLLVM 19; DRJIT_LIBLLVM_PATH says where)"
        print(f"{entry}, {peer}: left out (exit code {process.returncode}): {last}", file=sys.stderr)
    sys.stdout.write(lines := "".join(f"{line}\n" for line in output.splitlines() if line.startswith("{")))
    sys.stdout.flush()
    return [json.loads(line) for line in lines.splitlines()]


def available(peers: tuple[str, ...], cycles_python: str = sys.executable) -> list[str]:
    """Those that are installed; says which are not."""
    found = []
    for peer in peers:
        name = peer.partition(":")[0]
        elsewhere = name == "cycles" and cycles_python != sys.executable
        if name in NEEDS and not elsewhere and importlib.util.find_spec(MODULES.get(name, name)) is None:
            print(f"{peer}: not installed, left out (pip install {NEEDS[name]})", file=sys.stderr)
        else:
            found.append(peer)
    return found


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["book1", "cornell", "mesh1m", "instances", "interior"])
    parser.add_argument("--device", default="cpu", choices=["cpu", "cuda"])
    parser.add_argument("--scale", type=float, default=1.0, help="of the scenes' own sizes (1)")
    parser.add_argument("--spp", type=int, default=16, help="samples a pixel of each render (16)")
    parser.add_argument("--ray-spp", type=int, default=1, help="camera rays a pixel where rays alone are traced (1)")
    parser.add_argument("--depth", type=int, default=8, help="segments of a path (8)")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--only", choices=["renders", "rays"], help="leaves out the others")
    parser.add_argument("--peers", help="these only, with commas between them")
    parser.add_argument("--pictures", metavar="DIR", help="writes every renderer's picture there")
    parser.add_argument("--cycles-python", default=sys.executable, metavar="PYTHON", help="a Python with bpy")
    parser.add_argument("--timeout", type=float, default=300, help="seconds for a peer on a scene (300)")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--rays", help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    """Measures everything; returns the exit code."""
    args = arguments()
    try:
        if args.child:
            return child(args)
        choose(args.device)
        entries = [Entry.of(text, args.scale) for text in args.scenes]
    except (Error, ValueError) as error:
        print(f"peers.py: {error}", file=sys.stderr)
        return 2
    wanted = (*(RENDERERS if args.only != "rays" else {}).get(args.device, ()),)
    wanted += (*(TRACERS if args.only != "renders" else {}).get(args.device, ()),)
    if args.peers:
        wanted = tuple(peer for peer in wanted if peer in args.peers.split(","))
    results = []
    peers = available(wanted, args.cycles_python)
    for entry in entries:
        with tempfile.TemporaryDirectory(prefix="destello-rays-") as rays:
            results += [found for peer in peers for found in in_a_process(peer, entry, args, rays)]
    for line in importlib.import_module("compare").peer_ratios(results):
        print(line, file=sys.stderr)
    return 0 if results else 1


if __name__ == "__main__":
    sys.exit(main())
