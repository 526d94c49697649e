"""Rays a second on the CPU, without any shading: one JSON line for each scene and kind of ray.

    python benches/rays.py mesh1m terrain:0.1 > rays.json

Each entry is SCENE[:DETAIL]. Kinds: `primary` (the camera's, by line of the picture; its lens is left out), `ao` (any
hit within --ao metres, from what the camera sees), `bounce` (diffuse, from there, in the order of the pixels),
`shuffled` (the same in random order), `random` (from anywhere in the bounds, anywhere).

Rays go through the binding that the tests use: one thread, and arrays are copied on the way in and out. What that costs
is measured with rays that miss everything and is in `binding_ns` (nanoseconds a ray; it is part of the rates). Batches
are large, so nothing else counts.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import Error, _core, scenes
from destello.device import choose
from destello.machine import about

if TYPE_CHECKING:
    from numpy.typing import NDArray

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


def camera_rays(scene: Scene, width: int, height: int, rng: np.random.Generator) -> Rays:
    """One ray a pixel, at a random place in it, line by line."""
    view = scene.camera
    if view is None or view.type != "perspective":
        raise SystemExit(f"rays.py: {scene.name}: expected a perspective camera")
    forward = unit(np.subtract(view["target"], view["origin"])[None])[0]
    right = unit(np.cross(forward, view["up"])[None])[0]
    up = np.cross(right, forward)
    half = np.tan(np.radians(view["vfov"]) / 2)
    number = np.arange(width * height)
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


def ray_sets(scene: Scene, core: Any, width: int, height: int, ao: float, seed: int = 0) -> Iterator[Rays]:
    """Rays of every kind."""
    rng = np.random.default_rng(seed)
    first = camera_rays(scene, width, height, rng)
    yield first
    yield from secondary(core, first, ao, rng)
    low, high = np.array(core.stats()["bounds"])
    starts = rng.uniform(low, high, (width * height, 3)).astype(np.float32)
    yield Rays("random", starts, unit(sphere(rng, len(starts))))


def measure(core: Any, rays: Rays, method: str, repeat: int) -> dict[str, Any]:
    """Median rate in Mrays/s, binding included, and what part of the rays hit."""
    runs = []
    for _ in range(repeat + 1):
        began = time.perf_counter()
        hits = trace(core, rays, method)
        runs.append(time.perf_counter() - began)
    count = len(rays.origins)
    seconds = statistics.median(runs[1:])
    return {
        "kind": rays.kind,
        "method": method,
        "count": count,
        "hit": float((hits["leaf"] >= 0).mean()),
        "Mrays_s": count / seconds / 1e6,
        "ns_per_ray": seconds / count * 1e9,
        "repeat": repeat,
    }


def binding_ns(core: Any, count: int, repeat: int) -> float:
    """Nanoseconds a ray that the binding itself takes: of rays beside the scene, which touch its tree's root only."""
    low, high = np.array(core.stats()["bounds"])
    origins = np.tile((2 * high - low + 1).astype(np.float32), (count, 1))
    away = Rays("", origins, np.full_like(origins, 3**-0.5))
    return float(measure(core, away, "simd", repeat)["ns_per_ray"])


def main() -> int:
    """Prints the lines; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["mesh1m"])
    parser.add_argument("--size", default="1280x720", help="of the picture whose rays are taken (1280x720)")
    parser.add_argument("--ao", type=float, default=0.5, help="length of ambient occlusion's rays in metres (0.5)")
    parser.add_argument("--method", default="simd", choices=["simd", "packet", "baseline", "groups"])
    parser.add_argument("--repeat", type=int, default=3)
    args = parser.parse_args()
    width, height = (int(n) for n in args.size.split("x"))
    machine = {**about(choose("cpu"), 1), "threads": 1}
    for entry in args.scenes:
        name, _, detail = entry.partition(":")
        try:
            scene = scenes.build(name, float(detail or 1))
        except (Error, ValueError) as error:
            print(f"rays.py: {entry}: {error}", file=sys.stderr)
            return 2
        core = scene.compile().core
        cost = binding_ns(core, width * height, args.repeat)
        for rays in ray_sets(scene, core, width, height, args.ao):
            result = measure(core, rays, args.method, args.repeat)
            shared = {"scene": name, "detail": float(detail or 1), "triangles": core.stats()["triangles"]}
            print(json.dumps(shared | result | {"binding_ns": cost} | machine), flush=True)
            words = f"{result['Mrays_s']:.3g} Mrays/s ({result['ns_per_ray']:.0f} ns, {cost:.0f} of them the binding)"
            print(f"{entry}, {rays.kind}: {words}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
