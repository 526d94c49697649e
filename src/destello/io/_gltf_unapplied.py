"""What a glTF file asks for that has no place in a path tracer, with the reason: one note a file."""

from __future__ import annotations

from collections.abc import Iterable

from destello.io._gltf_json import Document, Item
from destello.io._gltf_textures import LINEAR, NEAREST_WHEN_SMALL


def unapplied(document: Document) -> list[str]:
    """The note, in a list; empty if the file asks for nothing of the kind."""
    materials = document.table("materials")
    volumes = _present(item.extension("KHR_materials_volume") for item in materials)
    lights = document.extension_table("KHR_lights_punctual", "lights")
    found = (
        (_holding(materials, "occlusionTexture"), "occlusionTexture", "what light does not reach is found by tracing"),
        (_holding(volumes, "thicknessTexture"), "thicknessTexture", "the way through a volume is found by tracing"),
        (
            sum(map(_blurred, document.table("samplers"))),
            "minFilter NEAREST",
            "magFilter and mip maps by ray cones decide",
        ),
        (_holding(lights, "range"), "range of lights", "they fall off by the square of the distance alone"),
    )
    parts = [f"{what} ({count} times; {why})" for count, what, why in found if count]
    return [f"not applied: {', '.join(parts)}"] if parts else []


def _blurred(sampler: Item) -> bool:
    """Whether a sampler wants single texels from afar, but smooth ones from near."""
    smooth = "magFilter" in sampler and sampler.integer("magFilter") == LINEAR
    return smooth and sampler.integer("minFilter", LINEAR) in NEAREST_WHEN_SMALL


def _present(items: Iterable[Item | None]) -> list[Item]:
    return [item for item in items if item is not None]


def _holding(items: Iterable[Item], key: str) -> int:
    return sum(1 for item in items if key in item)
