"""A destello scene as Mitsuba 3 takes it: the same triangles, spheres, instances, camera, light and depth.

Meshes go through PLY files in a folder of the caller's. What Mitsuba has nothing equal for is refused by name, but for
the books' `fuzzy_metal`, which becomes GGX with alpha = fuzz: as much work, not the same picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import environments
from destello.geometry import mesh_arrays
from destello.materials import diffuse

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene

_NO_ROULETTE = 100_000
_SMOOTH = 1e-4  # GGX alpha, below which both renderers take a mirror


class Untranslatable(Exception):
    """Something that Mitsuba has nothing equal for."""


def translate(mi: Any, scene: Scene, folder: Path, size: tuple[int, int], spp: int, max_depth: int) -> dict[str, Any]:
    """The dictionary for `mi.load_dict`, without Russian roulette, with a box filter. Raises Untranslatable.

    `mi`: the module mitsuba, its variant set. `size` in pixels; `spp` samples a pixel; `max_depth` in segments.
    """
    return _Translation(mi, folder).scene(scene, size, spp, max_depth)


class _Translation:
    def __init__(self, mi: Any, folder: Path) -> None:
        self.mi = mi
        self.folder = folder
        self.parts: dict[str, Any] = {}
        self._materials: dict[Node, str] = {}

    def scene(self, scene: Scene, size: tuple[int, int], spp: int, max_depth: int) -> dict[str, Any]:
        self.parts = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": _NO_ROULETTE},
            "sensor": self.camera(scene.camera, size, spp),
        }
        for name, group in scene.groups.items():
            members = {f"member{i}": self.shape(shape) for i, shape in enumerate(group.shapes)}
            self.parts[f"group_{name}"] = {"type": "shapegroup", "id": f"group_{name}", **members}
        for i, shape in enumerate(scene.shapes):
            if shape.type in ("sphere", "spheres"):
                self.spheres(f"shape{i}", shape)
            else:
                self.parts[f"shape{i}"] = self.shape(shape)
        for i, light in enumerate(scene.lights):
            self.parts[f"light{i}"] = self.light(light)
        self.parts["environment"] = self.environment(scene.environment or environments.constant(radiance=0))
        return self.parts

    def camera(self, camera: Node | None, size: tuple[int, int], spp: int) -> dict[str, Any]:
        if camera is None or camera.type != "perspective":
            raise Untranslatable(f"camera {camera and camera.type}")
        place = {name: list(camera[name]) for name in ("origin", "target", "up")}
        film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
        made = {
            "type": "perspective",
            "fov": camera["vfov"],
            "fov_axis": "y",
            "near_clip": 1e-2,
            "far_clip": 1e6,
            "to_world": self.mi.ScalarTransform4f().look_at(**place),
            "film": {**film, "pixel_format": "rgb", "component_format": "float32"},
            "sampler": {"type": "independent", "sample_count": spp},
        }
        if camera["aperture_radius"] > 0:
            focus = camera["focus_distance"] or float(np.linalg.norm(np.subtract(camera["target"], camera["origin"])))
            made |= {"type": "thinlens", "aperture_radius": camera["aperture_radius"], "focus_distance": focus}
        return made

    def shape(self, shape: Node) -> dict[str, Any]:
        if shape.type == "instance":
            return {
                "type": "instance",
                "to_world": self.matrix(shape),
                "group": {"type": "ref", "id": f"group_{shape['group']}"},
            }
        if shape.type not in ("mesh", "quad", "box"):
            raise Untranslatable(f"shape {shape.type}")
        arrays = mesh_arrays(shape)
        path = self.folder / f"{len(list(self.folder.iterdir()))}.ply"
        write_ply(path, arrays["positions"], arrays["indices"], arrays.get("normals"))
        flat = "normals" not in arrays
        return {
            "type": "ply",
            "filename": str(path),
            "face_normals": flat,
            "to_world": self.matrix(shape),
            **self.surface(shape),
        }

    def spheres(self, name: str, shape: Node) -> None:
        many = shape.type == "spheres"
        centers, radii = (shape["centers"], shape["radii"]) if many else ([shape["center"]], [shape["radius"]])
        if shape.params.get("centers1" if many else "center1") is not None:
            raise Untranslatable("a moving sphere")
        for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
            place = {"center": [float(x) for x in center], "radius": float(radius)}
            self.parts[f"{name}_{i}"] = {"type": "sphere", **place, **self.surface(shape)}

    def matrix(self, shape: Node) -> Any:
        if shape["transform1"] is not None or shape["animation"] is not None:
            raise Untranslatable(f"a moving {shape.type}")
        transform = shape["transform"]
        return self.mi.ScalarTransform4f(np.eye(4) if transform is None else np.array(transform.matrix, np.float64))

    def surface(self, shape: Node) -> dict[str, Any]:
        """Material, and emitter where it shines."""
        material: Node = shape["material"] or diffuse()
        if material not in self._materials:
            self._materials[material] = f"material{len(self._materials)}"
            self.parts[self._materials[material]] = {**self.bsdf(material), "id": self._materials[material]}
        made: dict[str, Any] = {"bsdf": {"type": "ref", "id": self._materials[material]}}
        if material.type == "emissive":
            if material["two_sided"] or material["power"]:
                raise Untranslatable("emission on two sides, or by power")
            made["emitter"] = {"type": "area", "radiance": rgb(material["radiance"])}
        return made

    def bsdf(self, m: Node) -> dict[str, Any]:
        if m.type == "emissive":
            return {"type": "diffuse", "reflectance": rgb(0)}
        if m.type == "diffuse" and m["roughness"] == 0:
            return two_sided({"type": "diffuse", "reflectance": rgb(m["reflectance"])})
        if m.type == "conductor" and m["fresnel"] == "none" and m["anisotropy"] == 0:
            return metal(m["reflectance"], m["roughness"] ** 2)
        if m.type == "fuzzy_metal":
            return metal(m["albedo"], m["fuzz"])
        if m.type == "dielectric" and m["roughness"] == 0:
            return {"type": "dielectric", "int_ior": m["ior"], "ext_ior": 1.0}
        raise Untranslatable(f"material {m.type}")

    def light(self, light: Node) -> dict[str, Any]:
        if light.type != "directional" or light["angular_diameter"] > 0 or light["transform"] is not None:
            raise Untranslatable(f"light {light.type}")
        return {"type": "directional", "direction": list(light["direction"]), "irradiance": rgb(light["irradiance"])}

    def environment(self, sky: Node) -> dict[str, Any]:
        if sky.type == "constant":
            return {"type": "constant", "radiance": rgb(sky["radiance"])}
        if sky.type != "gradient":
            raise Untranslatable(f"environment {sky.type}")
        rows = (np.cos((np.arange(256) + 0.5) / 256 * np.pi)[:, None] + 1) / 2
        row = (1 - rows) * np.array(sky["bottom"]) + rows * np.array(sky["top"])
        texels = np.repeat(row[:, None], 512, axis=1).astype(np.float32)
        return {"type": "envmap", "bitmap": self.mi.Bitmap(texels)}


def rgb(color: Any) -> dict[str, Any]:
    """A colour, which must not be a texture."""
    try:
        return {"type": "rgb", "value": [float(x) for x in np.broadcast_to(np.asarray(color, np.float64), 3)]}
    except (TypeError, ValueError) as error:
        raise Untranslatable("a texture") from error


def metal(color: Any, alpha: float) -> dict[str, Any]:
    """A mirror or GGX, without a Fresnel term."""
    look = {"material": "none", "specular_reflectance": rgb(color)}
    if alpha < _SMOOTH:
        return two_sided({"type": "conductor", **look})
    return two_sided({"type": "roughconductor", "distribution": "ggx", "alpha": alpha, **look})


def two_sided(bsdf: dict[str, Any]) -> dict[str, Any]:
    """The same on both sides."""
    return {"type": "twosided", "inner": bsdf}


def write_ply(path: Path, positions: Any, indices: Any, normals: Any) -> None:
    """A binary PLY of triangles; `normals` may be None."""
    columns = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals is not None else [])
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    head += [f"property float {column}" for column in columns]
    head += [f"element face {len(indices)}", "property list uchar int vertex_indices", "end_header", ""]
    vertices = positions if normals is None else np.concatenate([positions, normals], axis=1)
    faces = np.empty(len(indices), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, indices
    with path.open("wb") as out:
        out.write("\n".join(head).encode("ascii"))
        out.write(np.ascontiguousarray(vertices, "<f4").tobytes())
        out.write(faces.tobytes())
