"""destello: a physically based path tracer.

>>> import destello as dl
>>> scene = dl.load("helmet.glb")
>>> dl.render(scene, spp=256).save("helmet.png")
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from destello._version import __version__ as __version__

if TYPE_CHECKING:
    from destello import (
        cameras,
        color,
        environments,
        errors,
        filters,
        io,
        lights,
        materials,
        scenes,
        shapes,
        textures,
        volumes,
    )
    from destello.animation import Animation, keyframes
    from destello.errors import (
        DeviceError,
        Error,
        FormatError,
        ImageTooLarge,
        InputError,
        MissingFileError,
        OutputError,
        RenderError,
        SceneError,
    )
    from destello.image import Image
    from destello.io import load
    from destello.live import LiveScene
    from destello.nodes import Node
    from destello.render import render
    from destello.scene import Group, Scene
    from destello.spectrum import blackbody
    from destello.transform import Transform, look_at, matrix, rotate, scale, shear, translate
    from destello.viewer import view

# Public name: module it comes from; a name without one is a module itself.
_WHERE = {
    "DeviceError": "errors",
    "Error": "errors",
    "FormatError": "errors",
    "ImageTooLarge": "errors",
    "InputError": "errors",
    "MissingFileError": "errors",
    "OutputError": "errors",
    "RenderError": "errors",
    "SceneError": "errors",
    "Animation": "animation",
    "Group": "scene",
    "Image": "image",
    "LiveScene": "live",
    "Node": "nodes",
    "Scene": "scene",
    "Transform": "transform",
    "blackbody": "spectrum",
    "keyframes": "animation",
    "load": "io",
    "look_at": "transform",
    "matrix": "transform",
    "render": "render",
    "rotate": "transform",
    "scale": "transform",
    "shear": "transform",
    "translate": "transform",
    "view": "viewer",
    "cameras": "",
    "color": "",
    "environments": "",
    "errors": "",
    "filters": "",
    "io": "",
    "lights": "",
    "materials": "",
    "scenes": "",
    "shapes": "",
    "textures": "",
    "volumes": "",
}

__all__ = [  # noqa: RUF022
    "DeviceError", "Error", "FormatError", "ImageTooLarge", "InputError", "MissingFileError", "OutputError",
    "RenderError", "SceneError", "Animation", "Group", "Image", "LiveScene", "Node", "Scene", "Transform", "blackbody",
    "keyframes", "load", "look_at", "matrix", "render", "rotate", "scale", "shear", "translate", "view", "cameras",
    "color", "environments", "errors", "filters", "io", "lights", "materials", "scenes", "shapes", "textures",
    "volumes", "__version__",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Loads what is asked for: importing destello itself takes no time (PEP 562)."""
    if name not in _WHERE:
        raise AttributeError(f"module 'destello' has no attribute {name!r}")
    module = import_module(f"destello.{_WHERE[name] or name}")
    value = getattr(module, name) if _WHERE[name] else module
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(ModuleType):
    """Keeps `destello.render` the function although a module has the same name (importing it would replace it)."""

    def __setattr__(self, name: str, value: object) -> None:
        if name == "render" and isinstance(value, ModuleType):
            value = value.render
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
