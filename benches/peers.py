"""destello beside Mitsuba 3, embreex and Warp: the same geometry, camera and depth, in one run.

    pip install mitsuba==3.9.1 embreex warp-lang==1.19.0      # those wanted; what is missing is said and left out
    python benches/peers.py --device cpu --size 320x180 cornell mesh1m:0.1 > peers.json

Prints lines of JSON, then, on standard error, ratios. Each entry is SCENE[:DETAIL]. Whole renders (Mitsuba): 8
segments, no Russian roulette, box filter, wall time of a render with its copy to the host, the median of --repeat
after one to warm up. Rays alone (embreex, Warp), in scenes of meshes without instances: the rays of `rays.py`.
embreex, Warp's CPU device and destello's testing binding each use one thread. On a GPU destello's tracer can only be
measured by renders. Every measurement runs in a process of its own, so one that crashes or hangs does not end the
others.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import Error, _core, filters, scenes
from destello.device import choose
from destello.geometry import mesh_arrays
from destello.machine import about

if TYPE_CHECKING:
    from destello.scene import Scene

NEEDS = {"mitsuba": "mitsuba==3.9.1", "embreex": "embreex", "warp": "warp-lang==1.19.0"}
RENDERERS = {
    "cpu": ("destello", "mitsuba:llvm_ad_rgb", "mitsuba:scalar_rgb"),
    "cuda": ("destello", "mitsuba:cuda_ad_rgb"),
}
TRACERS = {"cpu": ("destello rays", "embreex", "warp"), "cuda": ("warp",)}
AO_METRES = 0.5
NO_ROULETTE = 65535


def timed(call: Callable[[], Any], repeat: int) -> float:
    """Median seconds of a call, after one to warm up."""
    runs = []
    for _ in range(repeat + 1):
        began = time.perf_counter()
        call()
        runs.append(time.perf_counter() - began)
    return statistics.median(runs[1:])


# --- whole renders ----------------------------------------------------------------------------------------------------


def render_destello(scene: Scene, args: argparse.Namespace) -> dict[str, Any]:
    """Rate and mean colour of destello's render."""
    began = time.perf_counter()
    compiled = scene.compile()
    renderer = _core.Renderer(compiled.core, args.device_name, 0)
    load = time.perf_counter() - began
    width, height = args.size
    shared = {"max_depth": args.depth, "rr_depth": NO_ROULETTE, "filter": {"type": "box"}}
    means: list[Any] = []

    def once() -> None:
        film = _core.Film(width, height)
        renderer.render(film, 0, 0, args.spp, {**shared, "seed": len(means)})
        means.append(film.mean())

    return whole(timed(once, args.repeat), load, means[-1], args)


def render_mitsuba(scene: Scene, args: argparse.Namespace, variant: str) -> dict[str, Any]:
    """The same of Mitsuba's."""
    mi = importlib.import_module("mitsuba")
    mi.set_variant(variant)
    translate = importlib.import_module("mitsuba_scene").translate
    means: list[Any] = []
    with tempfile.TemporaryDirectory(prefix="destello-peers-") as folder:
        made = translate(mi, scene, Path(folder), args.size, args.spp, args.depth)
        began = time.perf_counter()
        loaded = mi.load_dict(made)
        load = time.perf_counter() - began

    def once() -> None:
        means.append(np.array(mi.render(loaded, spp=args.spp, seed=len(means))))

    return whole(timed(once, args.repeat), load, means[-1], args)


def whole(seconds: float, load: float, picture: Any, args: argparse.Namespace) -> dict[str, Any]:
    """Figures of a render."""
    width, height = args.size
    return {
        "kind": "render",
        "spp": args.spp,
        "max_depth": args.depth,
        "load_seconds": load,
        "seconds": seconds,
        "Msamples_s": width * height * args.spp / seconds / 1e6,
        "mean": [round(float(x), 4) for x in picture.mean((0, 1))],
    }


# --- rays alone -------------------------------------------------------------------------------------------------------


def triangles_of(scene: Scene) -> tuple[Any, Any]:
    """Positions (N, 3) float32 and triangles (M, 3) int32 of a scene of meshes; SystemExit for other scenes."""
    positions, indices, count = [], [], 0
    for shape in scene.shapes:
        if shape.type not in ("mesh", "quad", "box"):
            raise SystemExit(f"rays alone: not in a scene with a shape of type {shape.type}")
        arrays, transform = mesh_arrays(shape), shape["transform"]
        points = arrays["positions"].astype(np.float64)
        if transform is not None:
            points = points @ transform.matrix[:3, :3].T + transform.matrix[:3, 3]
        positions.append(points)
        indices.append(arrays["indices"].astype(np.int64) + count)
        count += len(points)
    return np.concatenate(positions).astype(np.float32), np.concatenate(indices).astype(np.int32)


def trace_rays(scene: Scene, args: argparse.Namespace, peer: str) -> Iterator[dict[str, Any]]:
    """Rates of every kind of ray in the peer's tree."""
    rays = importlib.import_module("rays")
    positions, triangles = triangles_of(scene)
    core = scene.compile().core
    sets = list(rays.ray_sets(scene, core, *args.size, AO_METRES))
    began = time.perf_counter()
    if peer == "embreex":
        tracer = embreex_tracer(positions, triangles)
    elif peer == "warp":
        warp = importlib.import_module("warp_rays")
        tracer = warp.tracer(positions, triangles, "cuda:0" if args.device == "cuda" else "cpu")
    else:
        tracer = destello_tracer(core)
    build = time.perf_counter() - began
    for ray_set in sets:
        call, hit = tracer(ray_set)
        seconds = timed(call, args.repeat)
        count = len(ray_set.origins)
        rate = {"Mrays_s": count / seconds / 1e6, "hit": float(np.mean(hit()))}
        yield {"kind": ray_set.kind, "count": count, **rate, "prepare_seconds": build}


def destello_tracer(core: Any) -> Callable[[Any], tuple[Callable[[], Any], Callable[[], Any]]]:
    """Destello's own traversal, through the testing binding."""
    trace = importlib.import_module("rays").trace

    def prepare(rays: Any) -> tuple[Callable[[], Any], Callable[[], Any]]:
        return lambda: trace(core, rays, "simd"), lambda: trace(core, rays, "simd")["leaf"] >= 0

    return prepare


def embreex_tracer(positions: Any, triangles: Any) -> Callable[[Any], tuple[Callable[[], Any], Callable[[], Any]]]:
    """Embree through embreex."""
    scene = importlib.import_module("embreex.rtcore_scene").EmbreeScene()
    mesh = importlib.import_module("embreex.mesh_construction").TriangleMesh(scene, positions, triangles)

    def prepare(rays: Any) -> tuple[Callable[[], Any], Callable[[], Any]]:
        options: dict[str, Any] = {}
        if rays.any:
            options = {"query": "OCCLUDED", "dists": np.full(len(rays.origins), rays.length, np.float32)}

        def run() -> Any:
            assert mesh is not None  # the scene does not keep it
            return scene.run(rays.origins, rays.directions, **options)

        return run, lambda: np.asarray(run()) >= 0

    return prepare


# --- running them all -------------------------------------------------------------------------------------------------


def child(args: argparse.Namespace) -> int:
    """Measures one scene with one peer; prints its lines."""
    name, _, detail = args.scenes[0].partition(":")
    scene = scenes.build(name, float(detail or 1))
    scene.film.filter = filters.box()
    peer, _, variant = args.child.partition(":")
    if peer == "mitsuba":
        results = iter([render_mitsuba(scene, args, variant)])
    elif peer == "destello":
        results = iter([render_destello(scene, args)])
    else:
        results = trace_rays(scene, args, peer)
    shared = {"scene": name, "detail": float(detail or 1), "peer": args.child, "size": list(args.size)}
    machine = about(choose(args.device_name), 0)
    for result in results:
        print(json.dumps(shared | result | {"repeat": args.repeat} | machine), flush=True)
    return 0


def in_a_process(peer: str, entry: str, args: argparse.Namespace) -> list[dict[str, Any]]:
    """The measurements of a peer on a scene; what went wrong goes to standard error."""
    options = {"--device": args.device, "--size": "x".join(map(str, args.size)), "--spp": args.spp}
    options |= {"--depth": args.depth, "--repeat": args.repeat, "--child": peer}
    words = [str(word) for pair in options.items() for word in pair]
    command = [sys.executable, str(Path(__file__).resolve()), *words, entry]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=args.timeout, check=False)
    except subprocess.TimeoutExpired:
        print(f"{entry}, {peer}: not finished after {args.timeout:g} s", file=sys.stderr)
        return []
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        if "llvm" in peer:
            last += " (it wants libLLVM 19; DRJIT_LIBLLVM_PATH says where)"
        print(f"{entry}, {peer}: failed (exit code {done.returncode}): {last}", file=sys.stderr)
    sys.stdout.write(lines := "".join(f"{line}\n" for line in done.stdout.splitlines() if line.startswith("{")))
    sys.stdout.flush()
    return [json.loads(line) for line in lines.splitlines()]


def available(peers: tuple[str, ...]) -> list[str]:
    """Those that are installed; says which are not."""
    found = []
    for peer in peers:
        module = peer.partition(":")[0]
        if module in NEEDS and importlib.util.find_spec(module) is None:
            print(f"{peer}: not installed, left out (pip install {NEEDS[module]})", file=sys.stderr)
        else:
            found.append(peer)
    return found


def ratios(results: list[dict[str, Any]]) -> Iterator[str]:
    """Lines that set each peer against destello."""

    def measured(result: dict[str, Any]) -> tuple[Any, ...]:
        return result["scene"], result["detail"], result["kind"]

    own = {measured(r): r for r in results if r["peer"].startswith("destello")}
    for r in results:
        figure = "Msamples_s" if "Msamples_s" in r else "Mrays_s"
        line = f"{r['scene']:<12}{r['kind']:<10}{r['peer']:<22}{r[figure]:>9.3g} {figure[:-2]}/s"
        mine = own.get(measured(r))
        if mine is not None and mine is not r:
            line += f"   destello: {mine[figure] / r[figure]:.2f} times that"
            if not np.allclose(mine.get("hit", 0), r.get("hit", 0), atol=0.01):
                line += f", BUT {r['hit']:.1%} of the rays hit instead of {mine['hit']:.1%}"
        yield line


def main() -> int:
    """Measures everything; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["book1", "cornell", "mesh1m", "interior"])
    parser.add_argument("--device", default="cpu", choices=["cpu", "cuda"])
    parser.add_argument("--size", type=lambda text: tuple(int(n) for n in text.split("x")), default=(640, 360))
    parser.add_argument("--spp", type=int, default=8, help="samples a pixel of each render (8)")
    parser.add_argument("--depth", type=int, default=8, help="segments of a path (8)")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--timeout", type=float, default=300, help="seconds for a peer on a scene (300)")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args()
    try:
        args.device_name = choose(args.device).name
        if args.child:
            return child(args)
        for entry in args.scenes:
            scenes.build(entry.partition(":")[0], 1e-6)
    except Error as error:
        print(f"peers.py: {error}", file=sys.stderr)
        return 2
    peers = available((*RENDERERS[args.device], *TRACERS[args.device]))
    results = [found for entry in args.scenes for peer in peers for found in in_a_process(peer, entry, args)]
    for line in ratios(results):
        print(line, file=sys.stderr)
    return 0 if results else 1


if __name__ == "__main__":
    sys.exit(main())
