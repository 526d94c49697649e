"""What stands in a material's parameter: a glTF factor times a texture's channel times the vertex colours."""

from __future__ import annotations

from typing import Any

import destello.textures as textures
from destello.nodes import Node

Value = Any  # a number, three numbers or a texture node


def slot(factor: Value, texture: Node | None, *, channel: str = "r", colored: bool = False) -> Value:
    """`factor` times the texture's `channel` (all of it where a colour is wanted) times the vertex colours."""
    if factor in (0.0, (0.0, 0.0, 0.0)):
        return factor
    settings: dict[str, Value] = {}
    if factor not in (1.0, (1.0, 1.0, 1.0)):
        settings["scale"] = factor
    if channel != "r":
        settings["channel"] = channel
    if texture is None:
        return textures.vertex_color(**settings) if colored else factor
    if colored:
        settings["vertex_color"] = True
    return textures.scaled(texture, **settings) if settings else texture
