"""Volumes: what varies a medium from place to place. Clouds, smoke, fire.

``dir()`` lists the types, ``help()`` explains them; `box` makes a shape that holds one.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from destello.errors import MissingFileError, SceneError
from destello.factories import Factories
from destello.nodes import Node
from destello.transform import matrix

_factories = Factories("volume", __name__)


def load(
    path: str | PathLike[str],
    *,
    density: str = "density",
    temperature: str | None = None,
    emission: str | None = None,
    emission_scale: float = 1.0,
    transform: Any = None,
) -> Node:
    """A `grid` from a file.

    Args:
        path: NanoVDB's .nvdb, OpenVDB's .vdb (needs ``pip install 'destello[volumes]'``), or .npy with densities
            (depth, height, width).
        density: the name of the file's grid of densities.
        temperature: the name of its grid of temperatures in K; None: it does not glow.
        emission: instead, the name of its grid of radiance in W/(sr m^2), grey or (.nvdb alone) three colours.
        emission_scale: factor of the emission; with temperatures the luminance of the hottest voxel's radiance.
        transform: from the file's own world to the space of the shape that holds it.

    Raises:
        InputError, FormatError: a file that cannot be read, or the package that reads it is missing. SceneError: if a
            value is not accepted.
    """
    grids = {"density": density, "temperature": temperature, "emission": emission}
    rest = {"emission_scale": emission_scale, "transform": transform}
    file = Node("volume", "volume_file", {"path": path, **grids, **rest})
    if not Path(path).is_file():
        raise MissingFileError([str(path)])
    return from_file(Path(path), file)


def from_file(path: Path, node: Node) -> Node:
    """The `grid` that a volume_file stands for, read from `path`. Raises InputError, FormatError, SceneError."""
    from destello.volume_files import read_volume

    names = {param: node[param] for param in ("density", "temperature", "emission") if node[param] is not None}
    found = read_volume(path, names)
    own = matrix(found.pop("transform")) if "transform" in found else None
    outer = node["transform"]
    place = own if outer is None else outer if own is None else outer @ own
    return Node("volume", "grid", {**found, "emission_scale": node["emission_scale"], "transform": place})


def box(volume: Node, *, name: str | None = None, **medium: Any) -> Node:
    """The box of a `grid` as a shape with an invisible boundary, filled by a medium that the grid varies.

    Args:
        volume: the grid.
        name: label for people and scene files.
        **medium: of the medium: medium_density (collisions per metre where the grid's density is 1), medium_albedo,
            medium_absorption, medium_anisotropy, priority; as for `materials.interface`.

    Raises:
        SceneError: if a value is not accepted.
    """
    if (volume.kind, volume.type) != ("volume", "grid"):
        raise SceneError("not a grid", place="volume", value=volume.type, expected="volumes.grid or volumes.load")
    inside = volume.replace(transform=None)  # it stands in its shape's space
    material = Node("material", "interface", {**medium, "medium_volume": inside})
    place = {"min": volume["min"], "max": volume["max"], "transform": volume["transform"], "material": material}
    return Node("shape", "box", place, name=name)


__getattr__ = _factories.get
__dir__ = _factories.names
