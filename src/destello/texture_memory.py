"""What a scene's image textures need in memory, and how they fit into a budget."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from destello.assets import Assets
from destello.errors import InputError
from destello.files import MARK
from destello.image_table import StoredImage
from destello.memory import words
from destello.udim import read_tiles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.nodes import Node
    from destello.scene import Scene

_UNITS = {"": 1, "b": 1, "k": 1 << 10, "m": 1 << 20, "g": 1 << 30, "t": 1 << 40}


def stored_images(scene: Scene, assets: Assets) -> list[StoredImage]:
    """The image textures of a scene and of its mesh files, each content once; missing ones left out."""
    found: dict[tuple[str, bool], StoredImage] = {}
    for texture, inner in _image_textures(scene, assets, "scene"):
        for name, texels in _texels(texture, inner):
            image = StoredImage.of(name, texels, texture)
            found.setdefault((image.digest, image.mips), image)
    return list(found.values())


def _image_textures(scene: Scene, assets: Assets, place: str) -> Iterator[tuple[Node, Assets]]:
    environment = scene.environment["image"] if scene.environment and "image" in scene.environment.params else None
    yield from ((node, assets) for node in scene.textures() if node.type == "image" and node is not environment)
    for where, shape in scene.all_shapes():
        if shape.type == "mesh_file":
            inner = assets.mesh_file(shape, f"{place}.{where}")
            if inner is not None:
                yield from _image_textures(inner.scene, inner.assets, where)


def _texels(texture: Node, assets: Assets) -> Iterator[tuple[str, NDArray[Any]]]:
    path = texture["path"]
    if path is None:
        yield texture.name or "an array", assets.array(texture, "an array")
    elif MARK in path:
        tiles = read_tiles(assets, path, path)
        yield from ((path, tile) for tile in (tiles.texels if tiles else ()) if tile is not None)
    else:
        read = assets.texels(path, path)
        if read is not None:
            yield path, read[1]


def fit(images: list[StoredImage], budget: int) -> dict[str, int]:
    """How often each image must be halved, by digest, so that all need at most `budget` bytes: always the largest next.

    Raises InputError if a texel each is still too much.
    """
    halvings = dict.fromkeys((image.digest for image in images), 0)
    sizes = {image: image.bytes() for image in images}
    while sum(sizes.values()) > budget:
        largest = max(images, key=lambda image: sizes[image])
        if max(largest.size(halvings[largest.digest])) == 1:
            raise InputError(
                "textures do not fit into so little",
                place="texture_budget",
                value=words(budget),
                expected=f"at least {words(sum(sizes.values()))}",
            )
        halvings[largest.digest] += 1
        for image in images:
            if image.digest == largest.digest:
                sizes[image] = image.bytes(halvings[image.digest])
    return {key: count for key, count in halvings.items() if count}


def shrunk(images: list[StoredImage], halvings: dict[str, int], budget: int) -> str:
    """In words, what a budget has done."""
    parts = [
        f"{image.name} from {image.width}x{image.height} to {'x'.join(map(str, image.size(halvings[image.digest])))}"
        for image in images
        if image.digest in halvings
    ]
    return f"texture budget of {words(budget)}: {', '.join(parts)}"


def largest(images: list[StoredImage], count: int = 4) -> str:
    """In words, what needs most."""
    order = sorted(images, key=lambda image: -image.bytes())
    parts = [f"{image.name} {image.width}x{image.height} {words(image.bytes())}" for image in order[:count]]
    return ", ".join([*parts, f"{len(order) - count} more"] if len(order) > count else parts)


def read_size(value: object) -> int | None:
    """`512M`, `1.5 GiB`, a number of bytes; None stays None. Raises InputError."""
    if value is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d*)?)\s*([kmgt]?)(?:i?b)?", str(value).strip().lower(), re.ASCII)
    if isinstance(value, bool) or found is None or float(found[1]) == 0:
        raise InputError("wrong value", place="texture_budget", value=value, expected="a size such as 512M or 2G")
    return int(float(found[1]) * _UNITS[found[2]])
