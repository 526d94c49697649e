"""A destello scene in a folder for `cycles_render.py`, which runs in another Python: arrays in .npy, the rest in JSON.

The same triangles, instances, camera, light and depth. Cycles has no spheres: small ones become instances of a ball of
20,480 triangles with smooth normals, the ground a cap of one. What Cycles has nothing equal for is refused by name.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mitsuba_scene import Untranslatable

from destello.geometry import mesh_arrays
from destello.materials import diffuse
from destello.scenes.meshes import icosphere

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene

_HUGE = 100.0  # metres: spheres from here on are the ground
_CAP = 0.12  # radians from the ground's top that are seen
_RINGS, _AROUND = 192, 384


def export(scene: Scene, folder: Path, size: tuple[int, int], max_depth: int) -> None:
    """Writes scene.json and its arrays. `size` in pixels, `max_depth` in segments. Raises Untranslatable."""
    _Export(folder).scene(scene, size, max_depth)


class _Export:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.meshes: list[dict[str, Any]] = []
        self.objects: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self._known: dict[Node, int] = {}
        self._ball: int | None = None

    def scene(self, scene: Scene, size: tuple[int, int], max_depth: int) -> None:
        """All of it."""
        members: dict[str, list[tuple[int, int, Any]]] = {}
        for name, group in scene.groups.items():
            members[name] = [(self.mesh(s), self.material(s), matrix(s)) for s in group.shapes]
        for shape in scene.shapes:
            if shape.type == "instance":
                for mesh, material, inner in members[shape["group"]]:
                    self.place(mesh, material, matrix(shape) @ inner)
            elif shape.type in ("sphere", "spheres"):
                self.spheres(shape)
            else:
                self.place(self.mesh(shape), self.material(shape), matrix(shape))
        np.save(self.folder / "places.npy", np.array([o.pop("matrix") for o in self.objects]))
        whole = {
            "size": size,
            "max_depth": max_depth,
            "camera": camera(scene.camera),
            "sky": sky(scene.environment),
            "suns": [sun(light) for light in scene.lights],
            "meshes": self.meshes,
            "objects": self.objects,
            "materials": self.materials,
        }
        (self.folder / "scene.json").write_text(json.dumps(whole), encoding="utf-8")

    def place(self, mesh: int, material: int, where: Any) -> None:
        self.objects.append({"mesh": mesh, "material": material, "matrix": where})

    def mesh(self, shape: Node) -> int:
        if shape.type not in ("mesh", "quad", "box"):
            raise Untranslatable(f"shape {shape.type}")
        arrays = mesh_arrays(shape)
        return self.arrays(arrays["positions"], arrays["indices"], "normals" in arrays)

    def arrays(self, positions: Any, indices: Any, smooth: bool) -> int:
        number = len(self.meshes)
        np.save(self.folder / f"{number}-positions.npy", np.ascontiguousarray(positions, np.float32))
        np.save(self.folder / f"{number}-indices.npy", np.ascontiguousarray(indices, np.int32))
        self.meshes.append({"smooth": smooth})
        return number

    def spheres(self, shape: Node) -> None:
        many = shape.type == "spheres"
        if shape.params.get("centers1" if many else "center1") is not None:
            raise Untranslatable("a moving sphere")
        centers, radii = (shape["centers"], shape["radii"]) if many else ([shape["center"]], [shape["radius"]])
        material = self.material(shape)
        for center, radius in zip(centers, radii, strict=True):
            where = np.diag([radius, radius, radius, 1.0]).astype(np.float64)
            where[:3, 3] = center
            if radius > _HUGE:
                self.place(self.arrays(*cap(), True), material, where)
                continue
            if self._ball is None:
                self._ball = self.arrays(*icosphere(32), True)
            self.place(self._ball, material, where)

    def material(self, shape: Node) -> int:
        node: Node = shape["material"] or diffuse()
        if node not in self._known:
            self._known[node] = len(self.materials)
            self.materials.append(bsdf(node))
        return self._known[node]


def matrix(shape: Node) -> Any:
    """A shape's placement, 4x4."""
    if shape["transform1"] is not None or shape["animation"] is not None:
        raise Untranslatable(f"a moving {shape.type}")
    return np.eye(4) if shape["transform"] is None else np.array(shape["transform"].matrix, np.float64)


def bsdf(m: Node) -> dict[str, Any]:
    """A material as plain data."""
    if m.type == "diffuse" and m["roughness"] == 0:
        return {"type": "diffuse", "color": color(m["reflectance"])}
    if m.type == "conductor" and m["fresnel"] == "none" and m["anisotropy"] == 0:
        return {"type": "metal", "color": color(m["reflectance"]), "alpha": m["roughness"] ** 2}
    if m.type == "dielectric" and m["roughness"] == 0:
        return {"type": "glass", "ior": m["ior"]}
    if m.type == "emissive" and not m["two_sided"] and not m["power"]:
        return {"type": "emissive", "color": color(m["radiance"])}
    raise Untranslatable(f"material {m.type}")


def color(value: Any) -> list[float]:
    """A colour, which must not be a texture."""
    try:
        return [float(x) for x in np.broadcast_to(np.asarray(value, np.float64), 3)]
    except (TypeError, ValueError) as error:
        raise Untranslatable("a texture") from error


def camera(view: Node | None) -> dict[str, Any]:
    """Axes (right, up, backwards) and lens."""
    if view is None or view.type != "perspective":
        raise Untranslatable(f"camera {view and view.type}")
    origin, target, up = (np.array(view[name], np.float64) for name in ("origin", "target", "up"))
    back = (origin - target) / np.linalg.norm(origin - target)
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    where = np.eye(4)
    where[:3] = np.stack([right, np.cross(back, right), back, origin], axis=1)
    focus = view["focus_distance"] or float(np.linalg.norm(origin - target))
    lens = {"vfov": view["vfov"], "aperture_radius": view["aperture_radius"], "focus_distance": focus}
    return {"matrix": where.tolist(), **lens}


def sky(environment: Node | None) -> dict[str, Any]:
    """Radiance below and above; between them it goes with the height of the direction."""
    if environment is None:
        return {"bottom": [0.0] * 3, "top": [0.0] * 3}
    if environment.type == "constant":
        return {"bottom": color(environment["radiance"]), "top": color(environment["radiance"])}
    if environment.type == "gradient":
        return {"bottom": color(environment["bottom"]), "top": color(environment["top"])}
    raise Untranslatable(f"environment {environment.type}")


def sun(light: Node) -> dict[str, Any]:
    """A parallel light."""
    if light.type != "directional" or light["angular_diameter"] > 0 or light["transform"] is not None:
        raise Untranslatable(f"light {light.type}")
    return {"direction": [float(x) for x in light["direction"]], "irradiance": color(light["irradiance"])}


def cap() -> tuple[Any, Any]:
    """The top of the unit sphere around the y axis, rings closer towards the top: points and triangles."""
    angle = _CAP * (np.arange(1, _RINGS + 1) / _RINGS) ** 1.5
    turn = np.arange(_AROUND) * (2 * np.pi / _AROUND)
    ring = np.stack(np.broadcast_arrays(np.sin(angle)[:, None] * np.cos(turn), np.cos(angle)[:, None],
                                        np.sin(angle)[:, None] * np.sin(turn)), axis=-1)  # fmt: skip
    points = np.concatenate([[[0.0, 1.0, 0.0]], ring.reshape(-1, 3)])
    k, k1 = np.arange(_AROUND), (np.arange(_AROUND) + 1) % _AROUND
    faces = [np.stack([0 * k, 1 + k1, 1 + k], axis=1)]
    for r in range(_RINGS - 1):
        inner, outer = 1 + r * _AROUND, 1 + (r + 1) * _AROUND
        faces += [np.stack([inner + k, inner + k1, outer + k], 1), np.stack([inner + k1, outer + k1, outer + k], 1)]
    return points, np.concatenate(faces)
