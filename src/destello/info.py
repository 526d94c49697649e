"""What is in a scene, in numbers and names: `destello info`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.assets import Assets
from destello.files import MARK
from destello.frames import animations
from destello.geometry import mesh_arrays, scene_bounds
from destello.images import missing_image
from destello.memory import per_triangle
from destello.nodes import Node
from destello.tangents import wanted_tangents
from destello.texture_memory import largest, stored_images
from destello.udim import read_tiles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.scene import Scene

# Bytes that the core takes for each element, in its leaf and in arrays, and about what its part of the tree takes.
TRIANGLE_BYTES = 60
MOVING_TRIANGLE_BYTES = 96
SPHERE_BYTES = 48
INSTANCE_BYTES = 212
TREE_BYTES = 12
_VERTEX_BYTES = {"normals": 12, "normals1": 12, "tangents": 16, "uvs": 8, "colors": 16, "second_uvs": 12}
_VERTEX_BYTES |= {"second_tangents": 16}


def scene_info(scene: Scene) -> dict[str, Any]:
    """Counts, bounds, names, missing files and an estimate of the memory needed, as plain data.

    Keys: name, size, spp, cameras, shapes (number of each type), triangles, spheres, instances, groups, lights,
    environment, animation (frames until the last keyframe, fps, number of animated objects; None: nothing moves),
    materials, textures (number of each type), images (width, height, channels, bytes of each file), bounds ([low, high]
    in metres, or None), texture_bytes (what image textures need, mip maps with them), largest_textures (in words),
    memory (bytes), triangle_bytes (bytes a triangle of geometry and of the tree, or None), missing
    (paths), notes.

    Raises:
        SceneError, FormatError: as `Scene.compile` would for values and files, except for missing ones.
    """
    scene.validate()
    assets = Assets(scene, allow_missing=True)
    counts = _Counts(scene, assets)
    images = _images(scene.textures(), assets)
    stored = stored_images(scene, assets)
    textures = sum(image.bytes() for image in stored)
    box = scene_bounds(scene, assets.mesh_scene)
    nodes = [*scene.nodes()]
    volumes = (node for node in nodes if node.kind == "volume")
    voxels = sum(voxel_bytes(assets.volume(v, "volume") if v.type == "volume_file" else v) for v in volumes)
    return {
        "name": scene.name,
        "size": [scene.film.width, scene.film.height],
        "spp": scene.render.spp,
        "cameras": {name: camera.type for name, camera in scene.cameras.items()},
        "shapes": _types(shape for _, shape in scene.all_shapes()),
        "triangles": counts.triangles,
        "spheres": counts.spheres,
        "instances": counts.instances,
        "groups": {name: len(group.shapes) for name, group in scene.groups.items()},
        "lights": _types(scene.lights),
        "environment": scene.environment.type if scene.environment is not None else None,
        "animation": _animation(scene),
        "materials": _types(node for node in nodes if node.kind == "material"),
        "textures": _types(node for node in nodes if node.kind == "texture"),
        "images": images,
        "bounds": None if box is None else [[float(v) for v in corner] for corner in box],
        "texture_bytes": textures,
        "largest_textures": largest(stored),
        "memory": counts.geometry() + counts.tree() + textures + voxels,
        "triangle_bytes": per_triangle(counts.triangles, counts.geometry(), counts.tree()),
        "missing": list(assets.files.missing),
        "notes": [*scene.notes, *assets.notes],
    }


def voxel_bytes(volume: Node) -> int:
    """What the core keeps of a volume's arrays: a temperature becomes three floats."""
    size = int(volume["density"][..., 0].size)
    glow = 12 * size if volume["temperature"] is not None else 0
    given = (volume[name] for name in ("density", "albedo", "emission"))
    return glow + sum(int(array.nbytes) for array in given if array is not None)


def _animation(scene: Scene) -> dict[str, Any] | None:
    animated = sum(1 for _ in animations(scene))
    return {"frames": scene.frames, "fps": scene.render.fps, "animated": animated} if animated else None


def _types(nodes: Iterable[Node]) -> dict[str, int]:
    return dict(sorted(Counter(node.type for node in nodes).items()))


class _Counts:
    """What the core will hold; meshes that share their arrays count once in memory."""

    def __init__(self, scene: Scene, assets: Assets) -> None:
        self.triangles = self.spheres = self.instances = self._triangles = 0
        self._bytes: dict[tuple[int, ...], int] = {}
        self._assets = assets
        for place, shape in scene.all_shapes():
            self._add(shape, place)

    def geometry(self) -> int:
        """Bytes of triangles, spheres, instances and vertices."""
        return (
            SPHERE_BYTES * self.spheres + INSTANCE_BYTES * self.instances + self._triangles + sum(self._bytes.values())
        )

    def tree(self) -> int:
        """Bytes of all trees."""
        return TREE_BYTES * (self.triangles + self.spheres + self.instances)

    def _add(self, shape: Node, place: str) -> None:
        if shape.type == "instance":
            self.instances += 1
        elif shape.type == "sphere":
            self.spheres += 1
        elif shape.type == "spheres":
            self.spheres += len(shape["centers"])
        elif shape.type == "mesh_file":
            found = self._assets.mesh_file(shape, place)
            for inner_place, inner in found.scene.all_shapes() if found else ():
                self._add(inner, f"{place}.{inner_place}")
        else:
            arrays = mesh_arrays(shape)
            self.triangles += len(arrays["indices"])
            key = tuple(id(arrays[name]) for name in sorted(arrays)) if shape.type == "mesh" else (id(shape),)
            moves = "positions1" in arrays or shape["transform1"] is not None
            self._triangles += len(arrays["indices"]) * (MOVING_TRIANGLE_BYTES if moves else TRIANGLE_BYTES)
            made = {} if moves else dict.fromkeys(wanted_tangents(arrays, shape["material"]), arrays["positions"])
            vertices = {**made, **arrays}
            self._bytes[key] = sum(_VERTEX_BYTES.get(name, 0) * len(array) for name, array in vertices.items())


def _images(textures: Iterable[Node], assets: Assets) -> dict[str, dict[str, Any]]:
    images: dict[str, dict[str, Any]] = {}
    for texture in textures:
        if texture.type == "image":
            path = texture["path"]
            parts = _parts(texture, assets)
            texels = parts[0]
            height, width, channels = texels.shape
            images[path or f"array {len(images)}"] = {
                "width": width,
                "height": height,
                "channels": channels,
                "type": str(texels.dtype),
                "bytes": sum(part.nbytes for part in parts),
                **({"tiles": len(parts)} if path and MARK in path else {}),
            }
    return images


def _parts(texture: Node, assets: Assets) -> list[NDArray[Any]]:
    """The texels of an image texture: one array, or one for each tile that there is."""
    path = texture["path"]
    if path is None:
        return [np.asarray(texture["pixels"])]
    if MARK in path:
        tiles = read_tiles(assets, path, path)
        found = [tile for tile in tiles.texels if tile is not None] if tiles else []
    else:
        read = assets.texels(path, path)
        found = [read[1]] if read else []
    return found or [missing_image()]
