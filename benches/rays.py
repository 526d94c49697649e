"""Rays a second without any shading: one JSON line for each scene and kind of ray.

    python benches/rays.py mesh1m terrain:0.1 > rays.json
    python benches/rays.py --device cuda --spp 16 mesh1m > rays-cuda.json

Each entry is SCENE[:DETAIL]. Kinds: `primary` (the camera's, by line of the picture, those of a pixel side by side; its
lens is left out), `ao` (any hit within --ao metres, from what the camera sees), `bounce` (diffuse, from there, in the
order of the pixels), `shuffled` (the same in random order), `random` (from anywhere in the bounds, anywhere).

Seconds are those of traversal: on a GPU the kernel's, with rays and hits in its memory; on the CPU from arrays to
arrays, with as many threads as wanted.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import Error, _core, scenes
from destello.device import choose
from destello.machine import about

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.device import Device
    from destello.scene import Scene

    Floats = NDArray[np.float32]


TESTING: Any = _core.testing  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Rays:
    """Rays of one kind: origins and unit directions (N, 3), the length in metres, and whether any hit will do."""

    kind: str
    origins: Floats
    directions: Floats
    length: float = np.inf
    any: bool = False


def camera_rays(scene: Scene, width: int, height: int, rng: np.random.Generator, spp: int = 1) -> Rays:
    """`spp` rays a pixel, at random places in it, line by line."""
    view = scene.camera
    if view is None or view.type != "perspective":
        raise SystemExit(f"rays.py: {scene.name}: expected a perspective camera")
    forward = unit(np.subtract(view["target"], view["origin"])[None])[0]
    right = unit(np.cross(forward, view["up"])[None])[0]
    up = np.cross(right, forward)
    half = np.tan(np.radians(view["vfov"]) / 2)
    number = np.arange(width * height * spp) // spp
    jitter = rng.random((len(number), 2))
    x = ((number % width + jitter[:, 0]) / width * 2 - 1) * half * width / height
    y = (1 - (number // width + jitter[:, 1]) / height * 2) * half
    directions = unit(forward + x[:, None] * right + y[:, None] * up)
    origins = np.broadcast_to(np.float32(view["origin"]), directions.shape)
    return Rays("primary", np.ascontiguousarray(origins), directions)


def unit(vectors: NDArray[Any]) -> Floats:
    """The vectors at length 1."""
    return np.ascontiguousarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), np.float32)


def sphere(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Directions in all directions alike."""
    v = rng.normal(size=(count, 3))
    directions: NDArray[np.float64] = v / np.linalg.norm(v, axis=1, keepdims=True)
    return directions


def trace(core: Any, rays: Rays, method: str) -> dict[str, Any]:
    """Hits of the rays, as the testing binding gives them."""
    count = len(rays.origins)
    ends, times = np.full(count, rays.length, np.float32), np.zeros(count, np.float32)
    hits: dict[str, Any] = TESTING.trace(core, method, rays.origins, rays.directions, ends, times, rays.any)
    return hits


def secondary(core: Any, first: Rays, ao: float, rng: np.random.Generator) -> Iterator[Rays]:
    """What goes on from where the camera's rays end."""
    hits = trace(core, first, "simd")
    found = np.flatnonzero(hits["leaf"] >= 0)
    if len(found) == 0:
        return
    origins, directions = first.origins[found], first.directions[found]
    values = [np.ascontiguousarray(hits[name][found]) for name in ("t", "u", "v", "leaf", "instance")]
    at = TESTING.surfaces(core, origins, directions, np.zeros(len(found), np.float32), *values)
    facing = np.where(np.einsum("ij,ij->i", at["ng"], directions)[:, None] > 0, -at["ng"], at["ng"])
    outwards = unit(facing + 0.9999 * sphere(rng, len(found)))
    starts = TESTING.offset_origins(at["p"], at["error"], at["ng"], outwards)
    order = rng.permutation(len(found))
    yield Rays("ao", starts, outwards, ao, any=True)
    yield Rays("bounce", starts, outwards)
    yield Rays("shuffled", np.ascontiguousarray(starts[order]), np.ascontiguousarray(outwards[order]))


def ray_sets(
    scene: Scene, core: Any, width: int, height: int, ao: float, *, spp: int = 1, seed: int = 0
) -> Iterator[Rays]:
    """Rays of every kind; of the camera's, `spp` a pixel."""
    rng = np.random.default_rng(seed)
    first = camera_rays(scene, width, height, rng, spp)
    yield first
    yield from secondary(core, first, ao, rng)
    low, high = np.array(core.stats()["bounds"])
    starts = rng.uniform(low, high, (width * height * spp, 3)).astype(np.float32)
    yield Rays("random", starts, unit(sphere(rng, len(starts))))


def ray_seconds(core: Any, rays: Rays, method: str, threads: int, repeat: int) -> list[float]:
    """Seconds of `repeat` runs, after one to warm up. `method`: a traversal of the CPU, or a CUDA device.

    `threads`: of the CPU; 0: one a core.
    """
    threads = threads or len(os.sched_getaffinity(0))
    ends = np.full(len(rays.origins), rays.length, np.float32)
    seconds = TESTING.time_rays(core, rays.origins, rays.directions, ends, rays.any, method, threads, repeat + 1)
    return [float(s) for s in seconds[1:]]


def measure(core: Any, rays: Rays, method: str, threads: int, repeat: int) -> dict[str, Any]:
    """Median rate in Mrays/s, and what part of the rays hit."""
    seconds = statistics.median(ray_seconds(core, rays, method, threads, repeat))
    count = len(rays.origins)
    step = max(1, count >> 19)
    some = Rays(rays.kind, rays.origins[::step].copy(), rays.directions[::step].copy(), rays.length, rays.any)
    return {
        "kind": rays.kind,
        "method": method,
        "count": count,
        "hit": float((trace(core, some, method)["leaf"] >= 0).mean()),
        "seconds": seconds,
        "Mrays_s": count / seconds / 1e6,
        "ns_per_ray": seconds / count * 1e9,
        "repeat": repeat,
    }


def run(entry: str, device: Device, args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The figures of an entry. Raises destello.Error or ValueError for a name or detail that there is not."""
    name, _, detail = entry.partition(":")
    scene = scenes.build(name, float(detail or 1))
    core = scene.compile(build=args.build, device=device.name).core
    cuda = device.kind == "cuda"
    stats = core.stats()
    shared = {"scene": name, "detail": float(detail or 1), "spp": args.spp, "size": args.size, "build": args.build}
    shared |= {key: stats[key] for key in ("triangles", "bvh_bytes", "geometry_bytes", "sah_cost")}
    method, threads = (device.name, 0) if cuda else (args.method, args.threads)
    for rays in ray_sets(scene, core, *args.size, args.ao, spp=args.spp):
        yield shared | measure(core, rays, method, threads, args.repeat)


def main() -> int:
    """Prints the lines; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["mesh1m"])
    parser.add_argument("--device", default="cpu", help="cpu, or a CUDA device (cpu)")
    parser.add_argument("--threads", type=int, default=0, help="of the CPU; 0: one a core (0)")
    size = "of the picture whose rays are taken (1280x720)"
    parser.add_argument("--size", type=lambda text: [int(n) for n in text.split("x")], default=[1280, 720], help=size)
    parser.add_argument("--spp", type=int, default=1, help="camera rays a pixel (1); a GPU needs more to be busy")
    parser.add_argument("--ao", type=float, default=0.5, help="length of ambient occlusion's rays in metres (0.5)")
    methods = "of the CPU: auto, simd (one by one), stream (in turns), packet, baseline (auto)"
    parser.add_argument("--method", default="auto", help=methods)
    parser.add_argument("--build", default="balanced", help="quality of the tree: fast, balanced, high (balanced)")
    parser.add_argument("--repeat", type=int, default=5)
    args = parser.parse_args()
    for entry in args.scenes:
        try:
            device = choose(args.device)
            for result in run(entry, device, args):
                print(json.dumps(result | about(device, args.threads)), flush=True)
                words = f"{result['Mrays_s']:.4g} Mrays/s ({result['ns_per_ray']:.3g} ns), {result['hit']:.0%} hit"
                print(f"{entry}, {result['kind']}: {words}", file=sys.stderr)
        except (Error, ValueError) as error:
            print(f"rays.py: {entry}: {error}", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
