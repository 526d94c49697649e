"""Rays alone with destello, Embree (embreex) and Warp, for `peers.py`: the same triangles and the same rays.

A tracer is made of the scene's triangles; `measure` traces a set of rays `repeat` times after once to warm up.
"""

from __future__ import annotations

import argparse
import importlib
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import rays as ray_sets

from destello.geometry import mesh_arrays

if TYPE_CHECKING:
    from destello.scene import Scene

AO_METRES = 0.5
_SAMPLE = 1 << 19  # rays at most that tell which part hits, where the tracer is slow to say


class Tracer(Protocol):
    """A peer with its tree built: how long that took, and with how many threads it traces (0: a GPU)."""

    build_seconds: float
    threads: int

    def measure(self, rays: Any, repeat: int) -> tuple[list[float], float]:
        """Seconds of each run, and the part of the rays that hit."""


class Destello:
    """destello's own traversal, on the CPU or on a CUDA device, without anything around it."""

    def __init__(self, scene: Scene, method: str, threads: int) -> None:
        self.method, self.threads = method, threads
        compiled = scene.compile(device=method if method.startswith("cuda") else "cpu")
        self.core, self.build_seconds = compiled.core, compiled.stats["build_seconds"]

    def measure(self, rays: Any, repeat: int) -> tuple[list[float], float]:
        """See Tracer."""
        seconds = ray_sets.ray_seconds(self.core, rays, self.method, self.threads, repeat)
        step = max(1, len(rays.origins) // _SAMPLE)
        some = ray_sets.Rays(
            rays.kind,
            np.ascontiguousarray(rays.origins[::step]),
            np.ascontiguousarray(rays.directions[::step]),
            rays.length,
            rays.any,
        )
        return seconds, float((ray_sets.trace(self.core, some, self.method)["leaf"] >= 0).mean())


class Embreex:
    """Embree through embreex: its fast build, single rays, one thread, a call from Python for all rays."""

    threads = 1

    def __init__(self, positions: Any, triangles: Any) -> None:
        began = time.perf_counter()
        self.scene = importlib.import_module("embreex.rtcore_scene").EmbreeScene()
        self.mesh = importlib.import_module("embreex.mesh_construction").TriangleMesh(self.scene, positions, triangles)
        self.scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds
        self.build_seconds = time.perf_counter() - began

    def measure(self, rays: Any, repeat: int) -> tuple[list[float], float]:
        """See Tracer."""
        options: dict[str, Any] = {}
        if rays.any:
            options = {"query": "OCCLUDED", "dists": np.full(len(rays.origins), rays.length, np.float32)}
        seconds, hits = [], np.zeros(0)
        for _ in range(repeat + 1):
            began = time.perf_counter()
            hits = self.scene.run(rays.origins, rays.directions, **options)
            seconds.append(time.perf_counter() - began)
        return seconds[1:], float((np.asarray(hits) >= 0).mean())


def make(peer: str, scene: Scene, cuda: bool) -> Tracer:
    """The tracer that `peers.py` calls `peer`."""
    if peer.startswith("destello"):
        return Destello(scene, "cuda:0" if cuda else "auto", 0 if cuda or peer == "destello rays" else 1)
    positions, triangles = triangles_of(scene)
    if peer == "embreex":
        return Embreex(positions, triangles)
    made: Tracer = importlib.import_module("warp_rays").Warp(positions, triangles, peer.partition(":")[2], cuda)
    return made


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


def rates(peer: str, scene: Scene, args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Figures of every kind of ray with one peer; the folder `args.rays` keeps the rays for the next peer."""
    triangles_of(scene)  # or it is none of the scenes for this
    folder, spp = Path(args.rays), args.ray_spp
    if not any(folder.iterdir()):
        core = scene.compile().core
        for number, rays in enumerate(ray_sets.ray_sets(scene, core, *args.size, AO_METRES, spp=spp)):
            fields = {"kind": rays.kind, "origins": rays.origins, "directions": rays.directions}
            np.savez(folder / f"{number}.npz", **fields, length=rays.length, any=rays.any)
    tracer = make(peer, scene, args.device == "cuda")
    for path in sorted(folder.iterdir()):
        with np.load(path) as found:
            length, any_hit = float(found["length"]), bool(found["any"])
            rays = ray_sets.Rays(str(found["kind"]), found["origins"], found["directions"], length, any_hit)
        runs, hit = tracer.measure(rays, args.repeat)
        seconds, count = statistics.median(runs), len(rays.origins)
        yield {
            "kind": rays.kind,
            "count": count,
            "spp": spp,
            "hit": hit,
            "seconds": seconds,
            "Mrays_s": count / seconds / 1e6,
            "ray_threads": tracer.threads,
            "prepare_seconds": tracer.build_seconds,
            "repeat": args.repeat,
        }
