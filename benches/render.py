"""Samples and rays per second of whole renders, one JSON line a scene. Needs an installed destello.

    python benches/render.py --device cuda:0 origin:1280x720:200 book1:1200x800:100 > render.json

Each entry is SCENE[:SIZE[:SPP]]; the median of --repeat runs counts, after one to warm up. `device` rates leave out the
copy of the film to the host, as the predecessors' kernel times do.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import sys

from destello import __version__, _core, scenes
from destello.bench import rate_figures
from destello.memory import peaks


def measure(
    entry: str, device: str, threads: int, repeat: int, seed: int, execution: str, build: str
) -> dict[str, object]:
    name, _, rest = entry.partition(":")
    size, _, spp = rest.partition(":")
    scene = scenes.build(name)
    width, height = (int(n) for n in size.split("x")) if size else (scene.film.width, scene.film.height)
    samples = int(spp) if spp else scene.render.spp
    core = scene.compile(build=build, device=device, threads=threads).core
    renderer = _core.Renderer(core, device, threads)
    settings = {
        "max_depth": scene.render.max_depth,
        "time0": scene.render.shutter[0],
        "time1": scene.render.shutter[1],
        "execution": execution,
    }
    runs = []
    for i in range(repeat + 1):
        film = _core.Film(width, height)
        runs.append(renderer.render(film, 0, 0, samples, {**settings, "seed": seed + i}))
    runs = runs[1:]
    walls, rays = ([r[key] for r in runs] for key in ("seconds", "rays"))
    kernels = [r["device_seconds"] or r["seconds"] for r in runs]
    return {
        "scene": name,
        "size": [width, height],
        "spp": samples,
        "max_depth": scene.render.max_depth,
        "execution": execution,
        "build": build,
        **{name: runs[0][name] for name in ("paths", "path_bytes", "path_device_bytes")},
        **peaks(),
        **rate_figures(runs[0]["samples"], walls, kernels, rays),
        "repeat": repeat,
        "first_seed": seed + 1,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--execution", default="auto", choices=["auto", "fused", "queues"], help="of CUDA devices")
    parser.add_argument("--build", default="balanced", help="quality of the trees: fast, balanced, high (balanced)")
    args = parser.parse_args()
    label = next((d["label"] for d in _core.devices() if d["name"] == args.device), args.device)
    for entry in args.scenes:
        result = measure(entry, args.device, args.threads, args.repeat, args.seed, args.execution, args.build)
        result |= {"device": label, "version": __version__, "date": dt.date.today().isoformat()}
        print(json.dumps(result), flush=True)
        print(
            f"{entry}: {result['kernel_Msamples_s']:.1f} Msamples/s, {result['kernel_Mrays_s']:.1f} Mrays/s",
            file=sys.stderr,
        )


if __name__ == "__main__":
    main()
