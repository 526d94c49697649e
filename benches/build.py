"""Building trees: time, size and quality, one JSON line a scene. Needs an installed destello.

    python benches/build.py mesh1m:0.001 mesh1m:0.01 mesh1m:0.1 mesh1m > build.json

Each entry is SCENE[:DETAIL], DETAIL the triangles as a factor (of scenes for benchmarks). `build_seconds` is the core's
own time from checked arrays to a finished scene, light tables included; the median of --repeat builds counts, after one
to warm up. The surface area heuristic's cost counts a node as 1 and a primitive as 1, in the world's tree only.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from typing import Any

from destello import Error, scenes
from destello.device import choose
from destello.machine import about


def measure(entry: str, repeat: int) -> dict[str, Any]:
    """The figures of one entry. Raises destello.Error for a name or detail that there is not."""
    name, _, detail = entry.partition(":")
    scene = scenes.build(name, float(detail or 1))
    stats = [scene.compile().stats for _ in range(repeat + 1)][1:]
    last = stats[-1]
    seconds = statistics.median(s["build_seconds"] for s in stats)
    counts = ("triangles", "spheres", "instances", "bvh_nodes", "bvh_depth", "sah_cost", "geometry_bytes", "bvh_bytes")
    triangles = last["triangles"]
    return {
        "scene": name,
        "detail": float(detail or 1),
        "kind": "build",
        **{count: last[count] for count in counts},
        "build_seconds": seconds,
        "build_Mtris_s": triangles / max(seconds, 1e-9) / 1e6,
        "bvh_bytes_per_triangle": last["bvh_bytes"] / triangles if triangles else None,
        "geometry_bytes_per_triangle": last["geometry_bytes"] / triangles if triangles else None,
        "repeat": repeat,
    }


def words(result: dict[str, Any]) -> str:
    """The figures for people."""
    text = f"{result['triangles']} triangles in {result['build_seconds']:.4g} s, SAH cost {result['sah_cost']:.4g}"
    if result["triangles"]:
        text += f", {result['build_Mtris_s']:.3g} Mtris/s, {result['bvh_bytes_per_triangle']:.1f} bytes a triangle"
    return text


def main() -> int:
    """Prints the lines; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["mesh1m", "instances", "interior", "terrain"])
    parser.add_argument("--repeat", type=int, default=3)
    args = parser.parse_args()
    machine = about(choose("cpu"), 0)
    for entry in args.scenes:
        try:
            result = measure(entry, max(1, args.repeat))
        except (Error, ValueError) as error:
            print(f"build.py: {entry}: {error}", file=sys.stderr)
            return 2
        print(json.dumps(result | machine), flush=True)
        print(f"{entry}: {words(result)}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
