"""Rays in Warp's tree, for `peers_rays.py`: on a GPU kernel seconds by CUDA events. Imported only with Warp."""

import time
from typing import Any

import numpy as np
import warp as wp


@wp.kernel
def closest(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    ways: wp.array(dtype=wp.vec3),
    end: float,
    distance: wp.array(dtype=float),
    face: wp.array(dtype=int),
):
    i = wp.tid()
    found = wp.mesh_query_ray(mesh, origins[i], ways[i], end)
    if found.result:
        distance[i] = found.t
        face[i] = found.face
    else:
        distance[i] = -1.0
        face[i] = -1


@wp.kernel
def occluded(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    ways: wp.array(dtype=wp.vec3),
    end: float,
    face: wp.array(dtype=int),
):
    i = wp.tid()
    if wp.mesh_query_ray_anyhit(mesh, origins[i], ways[i], end):
        face[i] = 0
    else:
        face[i] = -1


class Warp:
    """See `peers_rays.Tracer`. `constructor`: cubql, sah, lbvh or median; empty: the best for the device."""

    def __init__(self, positions: Any, triangles: Any, constructor: str, cuda: bool) -> None:
        wp.config.quiet = True
        wp.init()
        wp.set_device("cuda:0" if cuda else "cpu")
        self.cuda, self.threads = cuda, 0 if cuda else 1
        points = wp.array(positions, dtype=wp.vec3)
        indices = wp.array(triangles.ravel(), dtype=int)
        constructor = constructor or ("cubql" if cuda else "sah")
        for _ in range(2):  # the first one pays for what happens once
            wp.synchronize()
            began = time.perf_counter()
            self.mesh = wp.Mesh(points=points, indices=indices, bvh_constructor=constructor)
            wp.synchronize()
            self.build_seconds = time.perf_counter() - began

    def measure(self, rays: Any, repeat: int) -> tuple[list[float], float]:
        """See `peers_rays.Tracer`."""
        count = len(rays.origins)
        origins, ways = wp.array(rays.origins, dtype=wp.vec3), wp.array(rays.directions, dtype=wp.vec3)
        distance, face = wp.zeros(count, dtype=float), wp.zeros(count, dtype=int)
        end = float(min(rays.length, 1e30))
        inputs = [self.mesh.id, origins, ways, end, *([] if rays.any else [distance]), face]
        kernel = occluded if rays.any else closest
        seconds = [self._seconds(kernel, count, inputs) for _ in range(repeat + 1)]
        return seconds[1:], float((np.asarray(face.numpy()) >= 0).mean())

    def _seconds(self, kernel: Any, count: int, inputs: list[Any]) -> float:
        if not self.cuda:
            began = time.perf_counter()
            wp.launch(kernel, count, inputs)
            return time.perf_counter() - began
        start, end = wp.Event(enable_timing=True), wp.Event(enable_timing=True)
        wp.record_event(start)
        wp.launch(kernel, count, inputs)
        wp.record_event(end)
        return float(wp.get_event_elapsed_time(start, end)) / 1e3
