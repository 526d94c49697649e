"""Rays in Warp's tree (its best one, `cubql`, on a GPU; on the CPU `sah`), for `peers.py`. Imported only with Warp."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp


@wp.kernel
def closest(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    ways: wp.array(dtype=wp.vec3),
    end: float,
    hit: wp.array(dtype=int),
):
    i = wp.tid()
    found = wp.mesh_query_ray(mesh, origins[i], ways[i], end)
    hit[i] = 0
    if found.result:
        hit[i] = 1


@wp.kernel
def occluded(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    ways: wp.array(dtype=wp.vec3),
    end: float,
    hit: wp.array(dtype=int),
):
    i = wp.tid()
    hit[i] = 0
    if wp.mesh_query_ray_anyhit(mesh, origins[i], ways[i], end):
        hit[i] = 1


def tracer(positions: Any, triangles: Any, device: str) -> Callable[[Any], tuple[Callable[[], Any], Callable[[], Any]]]:
    """A function that makes, of a set of rays, a call that traces them and one that tells which hit."""
    wp.config.quiet = True
    wp.init()
    wp.set_device(device)
    points = wp.array(positions, dtype=wp.vec3)
    constructor = "cubql" if device.startswith("cuda") else "sah"
    mesh = wp.Mesh(points=points, indices=wp.array(triangles.ravel(), dtype=int), bvh_constructor=constructor)
    wp.synchronize()

    def prepare(rays: Any) -> tuple[Callable[[], Any], Callable[[], Any]]:
        count = len(rays.origins)
        origins, ways = wp.array(rays.origins, dtype=wp.vec3), wp.array(rays.directions, dtype=wp.vec3)
        hit = wp.zeros(count, dtype=int)
        end = float(min(rays.length, 1e30))

        def run() -> None:
            wp.launch(occluded if rays.any else closest, count, [mesh.id, origins, ways, end, hit])
            wp.synchronize()

        return run, lambda: np.asarray(hit.numpy())

    return prepare
