"""Samples and rays per second of whole renders, one JSON line a scene. Needs an installed destello.

    python benches/render.py --device cuda:0 origin:1280x720:200 book1:1200x800:100 > render.json

Each entry is SCENE[:SIZE[:SPP]]; the median of --repeat runs counts, after one to warm up. `device` rates leave out the
copy of the film to the host, as the predecessors' kernel times do. `--surface` makes all that is diffuse in the scene
of another model, with the same colours: that is what OpenPBR costs.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import sys

import numpy as np

from destello import Scene, __version__, _core, materials, scenes, textures
from destello.bench import rate_figures
from destello.memory import peaks
from destello.nodes import Node

# What --surface knows, beside "as-it-is": a material of the same colour as a diffuse one.
SURFACES = {
    "openpbr": lambda color: materials.openpbr(base_color=color),
    "coat": lambda color: materials.openpbr(base_color=color, coat_weight=0.5),
    "coat-and-fuzz": lambda color: materials.openpbr(base_color=color, coat_weight=0.5, fuzz_weight=0.3),
    "metallic_roughness": lambda color: materials.metallic_roughness(base_color=color, metallic=0),
    "normal-map": lambda color: materials.metallic_roughness(base_color=color, metallic=0, normal_map=_waves()),
    "mix": lambda color: materials.mix(first=materials.diffuse(color), second=materials.diffuse(color)),
}


def _waves() -> Node:
    x = np.sin(np.linspace(0, 40 * np.pi, 256))
    normals = np.stack(np.broadcast_arrays(128 + 50 * x[:, None], 128 + 50 * x, 255), -1)
    return textures.image(normals.astype(np.uint8), color_space="linear")


def resurface(scene: Scene, surface: str) -> None:
    """Replaces each diffuse material of the scene's own shapes by one of `SURFACES`."""

    def other(material: Node) -> Node:
        return SURFACES[surface](material["reflectance"]) if material.type == "diffuse" else material

    scene.shapes[:] = [shape.replace(material=other(shape["material"])) for shape in scene.shapes]


def measure(entry: str, args: argparse.Namespace) -> dict[str, object]:
    name, _, rest = entry.partition(":")
    size, _, spp = rest.partition(":")
    scene = scenes.build(name)
    if args.surface != "as-it-is":
        resurface(scene, args.surface)
    width, height = (int(n) for n in size.split("x")) if size else (scene.film.width, scene.film.height)
    samples = int(spp) if spp else scene.render.spp
    core = scene.compile(build=args.build, device=args.device, threads=args.threads).core
    renderer = _core.Renderer(core, args.device, args.threads)
    settings = {
        "max_depth": scene.render.max_depth,
        "time0": scene.render.shutter[0],
        "time1": scene.render.shutter[1],
        "execution": args.execution,
    }
    runs = []
    for i in range(args.repeat + 1):
        film = _core.Film(width, height)
        runs.append(renderer.render(film, 0, 0, samples, {**settings, "seed": args.seed + i}))
    runs = runs[1:]
    walls, rays = ([r[key] for r in runs] for key in ("seconds", "rays"))
    kernels = [r["device_seconds"] or r["seconds"] for r in runs]
    return {
        "scene": name,
        "size": [width, height],
        "spp": samples,
        "max_depth": scene.render.max_depth,
        "execution": args.execution,
        "build": args.build,
        **({"surface": args.surface} if args.surface != "as-it-is" else {}),
        **{name: runs[0][name] for name in ("paths", "path_bytes", "path_device_bytes")},
        **peaks(),
        **rate_figures(runs[0]["samples"], walls, kernels, rays),
        "repeat": args.repeat,
        "first_seed": args.seed + 1,
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
    parser.add_argument("--surface", default="as-it-is", choices=["as-it-is", *SURFACES], help="of all that is diffuse")
    args = parser.parse_args()
    label = next((d["label"] for d in _core.devices() if d["name"] == args.device), args.device)
    for entry in args.scenes:
        result = measure(entry, args)
        result |= {"device": label, "version": __version__, "date": dt.date.today().isoformat()}
        print(json.dumps(result), flush=True)
        print(
            f"{entry}: {result['kernel_Msamples_s']:.1f} Msamples/s, {result['kernel_Mrays_s']:.1f} Mrays/s",
            file=sys.stderr,
        )


if __name__ == "__main__":
    main()
