"""Textures: images, patterns, noise; ``dir()`` lists them, ``help()`` explains them."""

from __future__ import annotations

from os import PathLike
from typing import Any

from destello.factories import Factories
from destello.nodes import Node

_factories = Factories("texture", __name__)


def image(source: Any = None, *, name: str | None = None, **params: Any) -> Node:
    """An image texture from a file's path or from an array of texels.

    Args:
        source: a path (relative to the scene file), or an array of shape (height, width) or (height, width, 1 to 4),
            top row first, of uint8, uint16 or float32.
        name: label for people and scene files.
        **params: color_space ("auto", "srgb", "linear"), wrap_u, wrap_v ("repeat", "clamp", "mirror"), filter
            ("bilinear", "nearest"), uv_scale, uv_offset (2 numbers), uv_rotation (degrees), uv_set ("first", "second").

    Raises:
        SceneError: if a value is not accepted.
    """
    if source is not None:
        params["path" if isinstance(source, (str, PathLike)) else "pixels"] = source
    return Node("texture", "image", params, name=name)


__getattr__ = _factories.get
__dir__ = _factories.names
