"""Building trees: time, size and quality, one JSON line a scene. Needs an installed destello.

    python benches/build.py mesh1m:0.001 mesh1m:0.01 mesh1m:0.1 mesh1m > build.json
    python benches/build.py --device cuda --build fast,balanced mesh1m terrain > build-cuda.json

Each entry is SCENE[:DETAIL], DETAIL the triangles as a factor (of scenes for benchmarks). `build_seconds` is the core's
own time from checked arrays to a finished scene, light tables included; the median of --repeat builds counts, after one
to warm up. With a CUDA device, that one builds the trees of large scenes, and the time holds the copies to it and back.
The surface area heuristic's cost counts a node as 1 and a primitive as 1, in the world's tree only.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from typing import TYPE_CHECKING, Any

from destello import Error, scenes
from destello.device import Device, choose
from destello.machine import about
from destello.memory import forget_peaks, peaks

if TYPE_CHECKING:
    from destello.scene import Scene


def measure(scene: Scene, build: str, device: Device, threads: int, repeat: int) -> dict[str, Any]:
    """The figures of one scene with one quality. Raises destello.Error for a quality that there is not."""
    forget_peaks()
    options = {"build": build, "device": device.name, "threads": threads}
    stats = [scene.compile(**options).stats for _ in range(repeat + 1)][1:]
    last = stats[-1]
    seconds = statistics.median(s["build_seconds"] for s in stats)
    counts = ("triangles", "spheres", "instances", "bvh_nodes", "bvh_depth", "sah_cost", "geometry_bytes", "bvh_bytes")
    triangles = last["triangles"]
    return {
        "kind": "build",
        "build": build,
        **{count: last[count] for count in counts},
        "build_seconds": seconds,
        "build_Mtris_s": triangles / max(seconds, 1e-9) / 1e6,
        "bvh_bytes_per_triangle": last["bvh_bytes"] / triangles if triangles else None,
        "geometry_bytes_per_triangle": last["geometry_bytes"] / triangles if triangles else None,
        **peaks(),
        "repeat": repeat,
    }


def words(result: dict[str, Any]) -> str:
    """The figures for people."""
    text = f"{result['triangles']} triangles in {result['build_seconds']:.4g} s, SAH cost {result['sah_cost']:.4g}"
    if result["triangles"]:
        each = result["bvh_bytes_per_triangle"] + result["geometry_bytes_per_triangle"]
        text += f", {result['build_Mtris_s']:.3g} Mtris/s, {each:.1f} bytes a triangle"
    return text


def main() -> int:
    """Prints the lines; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["mesh1m", "instances", "interior", "terrain"])
    parser.add_argument("--device", default="cpu", help="cpu, or a CUDA device (cpu)")
    parser.add_argument("--threads", type=int, default=0, help="of the CPU; 0: one a core (0)")
    parser.add_argument("--build", default="balanced", help="qualities, with commas: fast, balanced, high (balanced)")
    parser.add_argument("--repeat", type=int, default=3)
    args = parser.parse_args()
    for entry in args.scenes:
        name, _, detail = entry.partition(":")
        try:
            device = choose(args.device)
            scene = scenes.build(name, float(detail or 1))
            shared = {"scene": name, "detail": float(detail or 1)}
            for quality in args.build.split(","):
                result = measure(scene, quality, device, args.threads, max(1, args.repeat))
                print(json.dumps(shared | result | about(device, args.threads)), flush=True)
                print(f"{entry}, {quality}: {words(result)}", file=sys.stderr)
        except (Error, ValueError) as error:
            print(f"build.py: {entry}: {error}", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
