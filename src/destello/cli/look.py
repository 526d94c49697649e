"""`destello info`, `destello devices`, `destello scenes`: what there is, on standard output."""

from __future__ import annotations

import json
from typing import Annotated, Any

from typer import Option

from destello.cli import options as o
from destello.memory import words

_LABELS = {"triangle_bytes": "", "texture_bytes": "image memory", "largest_textures": "largest"}  # at most 12 letters

AsJson = Annotated[bool, Option("--json", help="As JSON.")]


def info(
    scene: o.SceneName, json_: AsJson = False, variant: o.Variant = None, allow_external: o.AllowExternal = False
) -> None:
    """Show what is in a scene, what was not understood, and how much memory it needs."""
    from destello import io

    found = io.load(scene, allow_missing=True, allow_external=allow_external, variant=variant).info()
    if json_:
        print(json.dumps(found, indent=2))
        return
    for key, value in found.items():
        if key not in ("notes", "missing") and value not in (None, "", {}, []):
            print(f"{_LABELS.get(key, key):<13}{_readable(key, value)}")
    for path in found["missing"]:
        print(f"missing      {path}")
    for note in found["notes"]:
        print(f"note         {note}")


def _readable(key: str, value: Any) -> str:
    """A value of `Scene.info` in words."""
    if key == "size":
        return f"{value[0]}x{value[1]}"
    if key in ("memory", "texture_bytes"):
        return words(value)
    if key == "triangle_bytes":
        return f"{sum(value.values()):.1f} bytes a triangle (geometry {value['geometry']}, tree about {value['tree']})"
    if key == "bounds":
        low, high = (" ".join(f"{x:.6g}" for x in corner) for corner in value)
        return f"({low}) to ({high}) m"
    if key == "images":
        return ", ".join(f"{name} {im['width']}x{im['height']}" for name, im in value.items())
    if isinstance(value, dict):
        return ", ".join(f"{name}: {entry}" for name, entry in value.items())
    return str(value)


def devices(json_: AsJson = False) -> None:
    """List the devices that can render, and which one is taken by itself."""
    from destello import device

    found = device.devices()
    chosen = device.choose("auto")
    if json_:
        answer = {"devices": found, "auto": chosen.name, "reason": chosen.reason, "cuda_problem": device.cuda_problem()}
        print(json.dumps(answer, indent=2))
        return
    for entry in found:
        detail = f", {entry['detail']}" if entry.get("detail") else ""
        memory = f", {words(entry['memory'])}" if entry.get("memory") else ""
        print(f"{entry['name']:<8}{entry['label']}{memory}{detail}")
    print(f"auto is {chosen.name}: {chosen.reason}")


def scenes(json_: AsJson = False) -> None:
    """List the built-in scenes."""
    from destello import scenes as built_in

    found, benchmarks = built_in.describe(), built_in.describe_benchmarks()
    if json_:
        print(json.dumps(found | benchmarks, indent=2))
        return
    width = max(map(len, (*found, *benchmarks))) + 2
    for name, doc in found.items():
        print(f"{name:<{width}}{doc}")
    print("\nFor destello bench:")
    for name, doc in benchmarks.items():
        print(f"{name:<{width}}{doc}")
