"""The scenes of `test_mitsuba.py` as Mitsuba 3 sees them: described anew, with its own plug-ins and conventions.

Mitsuba's `moment` integrator also gives the mean of the square of the luminance, hence the variance of every pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Description = dict[str, Any]
SIZE = 128


def mitsuba() -> Any:
    """Mitsuba in its plain variant, which needs no LLVM. Raises ImportError where it is missing or does not load."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    return mi


@dataclass(frozen=True)
class Picture:
    """Linear RGB (H, W, 3), and the variance of the mean of the luminance (H, W)."""

    rgb: Floats
    variance: Floats


def render(scene: Description, *, spp: int, seed: int, max_depth: int, integrator: str = "path") -> Picture:
    """Renders a description that lacks only its integrator; channels are RGB, XYZ and the mean squares of XYZ."""
    mi = mitsuba()
    path = {"type": integrator, "max_depth": max_depth}
    loaded = mi.load_dict({"type": "scene", "integrator": {"type": "moment", "image": path}, **scene})
    channels = np.array(mi.render(loaded, spp=spp, seed=seed), np.float64)
    luminance, square = channels[..., 4], channels[..., 7]
    return Picture(channels[..., :3], np.maximum(square - luminance**2, 0) / (spp - 1))


def look_at(origin: ArrayLike, target: ArrayLike) -> Any:
    return mitsuba().ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=[0, 1, 0])


def camera(origin: ArrayLike, target: ArrayLike, vfov: float) -> Description:
    film = {
        "type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgb",
        "component_format": "float32",
    }  # fmt: skip
    sampler = {"type": "independent"}
    return {
        "type": "perspective", "fov": vfov, "fov_axis": "y", "to_world": look_at(origin, target), "film": film,
        "sampler": sampler, "near_clip": 1e-3, "far_clip": 1e5,
    }  # fmt: skip


def rgb(*value: float) -> Description:
    return {"type": "rgb", "value": list(value)}


def diffuse(*value: float) -> Description:
    return {"type": "diffuse", "reflectance": rgb(*value)}


def rectangle(center: ArrayLike, x: ArrayLike, y: ArrayLike, **more: Any) -> Description:
    """The parallelogram center +- x +- y, whose normal is along x times y."""
    x, y, center = (np.asarray(a, float) for a in (x, y, center))
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = x, y, np.cross(x, y), center
    matrix[:3, 2] /= np.linalg.norm(matrix[:3, 2])
    return {"type": "rectangle", "to_world": mitsuba().ScalarTransform4f(matrix.tolist()), **more}


# --- Cornell box ------------------------------------------------------------------------------------------------------


def cornell() -> Description:
    t = mitsuba().ScalarTransform4f
    white = diffuse(0.73, 0.73, 0.73)

    def block(size: ArrayLike, degrees: float, place: ArrayLike) -> Description:
        half = np.asarray(size, float) / 2
        turned = t().translate(list(place)).rotate([0, 1, 0], degrees)
        return {"type": "cube", "to_world": turned.translate(half.tolist()).scale(half.tolist()), "bsdf": white}

    h = 277.5
    both = {"type": "twosided", "bsdf": white}
    red = {"type": "twosided", "bsdf": diffuse(0.65, 0.05, 0.05)}
    green = {"type": "twosided", "bsdf": diffuse(0.12, 0.45, 0.15)}
    glow = {"type": "area", "radiance": rgb(15, 15, 15)}
    return {
        "sensor": camera((278, 278, -800), (278, 278, 0), 40),
        "green": rectangle((555, h, h), (0, h, 0), (0, 0, h), bsdf=green),
        "red": rectangle((0, h, h), (0, 0, h), (0, h, 0), bsdf=red),
        "floor": rectangle((h, 0, h), (h, 0, 0), (0, 0, h), bsdf=both),
        "ceiling": rectangle((h, 555, h), (h, 0, 0), (0, 0, h), bsdf=both),
        "back": rectangle((h, h, 555), (h, 0, 0), (0, h, 0), bsdf=both),
        "tall": block((165, 330, 165), 15, (265, 0, 295)),
        "short": block((165, 165, 165), -18, (130, 0, 65)),
        "lamp": rectangle((278, 554, 279.5), (65, 0, 0), (0, 0, 52.5), emitter=glow, bsdf=diffuse(0, 0, 0)),
    }


# --- glass and metal --------------------------------------------------------------------------------------------------

COPPER = ((0.200, 0.924, 1.102), (3.912, 2.452, 2.142))  # eta and k for red, green and blue


def glass_and_metal() -> Description:
    eta, k = (rgb(*values) for values in COPPER)
    smooth = {"type": "conductor", "eta": eta, "k": k}
    rough = {
        "type": "roughconductor", "distribution": "ggx", "alpha": 0.04, "eta": eta, "k": k, "sample_visible": True,
    }  # fmt: skip
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    glow = {"type": "area", "radiance": rgb(4, 3.5, 3)}

    def ball(x: float, y: float, z: float, radius: float, bsdf: Description) -> Description:
        return {"type": "sphere", "center": [x, y, z], "radius": radius, "bsdf": bsdf}

    return {
        "sensor": camera((0, 2.2, 6), (0, 0.7, 0), 32),
        "sky": {"type": "constant", "radiance": rgb(0.4, 0.5, 0.7)},
        "floor": rectangle((0, 0, 0), (6, 0, 0), (0, 0, -6), bsdf=diffuse(0.6, 0.5, 0.4)),
        "lamp": rectangle((0, 5, 0), (2, 0, 0), (0, 0, 2), emitter=glow, bsdf=diffuse(0, 0, 0)),
        "glass": ball(-1.1, 0.7, 0.6, 0.7, glass),
        "smooth": ball(0.9, 0.8, -0.6, 0.8, smooth),
        "rough": ball(0.8, 0.4, 1.1, 0.4, rough),
    }


# --- Disney's material, where glTF's is the same ----------------------------------------------------------------------

GOLD, STEEL = (1.0, 0.78, 0.34), (0.56, 0.57, 0.58)


def principled_metals() -> Description:
    def metal(color: tuple[float, ...], roughness: float) -> Description:
        return {"type": "principled", "base_color": rgb(*color), "metallic": 1.0, "roughness": roughness}

    made = glass_and_metal()
    del made["glass"]
    made["smooth"]["bsdf"], made["rough"]["bsdf"] = metal(GOLD, 0.12), metal(STEEL, 0.11)
    return made


# --- media ------------------------------------------------------------------------------------------------------------


def medium(extinction: ArrayLike, albedo: ArrayLike, g: float) -> Description:
    sigma = np.asarray(extinction, float)
    return {
        "type": "homogeneous", "sigma_t": rgb(*(sigma / sigma.max())), "scale": float(sigma.max()),
        "albedo": rgb(*np.asarray(albedo, float)), "phase": {"type": "hg", "g": g},
    }  # fmt: skip


def grid_medium(density: ArrayLike, to_world: Any, extinction: float, albedo: ArrayLike, g: float) -> Description:
    """Voxels (z, y, x) in the unit cube of `to_world`. Mitsuba's grids are grey: one extinction for all colours."""
    mi = mitsuba()
    voxels = mi.VolumeGrid(np.ascontiguousarray(density, np.float32)[..., None])
    grid = {"type": "gridvolume", "grid": voxels, "to_world": to_world, "raw": True, "filter_type": "trilinear"}
    return {
        "type": "heterogeneous", "albedo": {"type": "constvolume", "value": rgb(*np.asarray(albedo, float))},
        "sigma_t": grid, "scale": extinction, "phase": {"type": "hg", "g": g},
    }  # fmt: skip


def cloud_in_a_room(inside: Description) -> Description:
    """A cube of a medium over a floor, under a lamp and a sky."""
    t = mitsuba().ScalarTransform4f
    glow = {"type": "area", "radiance": rgb(6, 5, 4)}
    return {
        "sensor": camera((0, 1.6, 4.5), (0, 0.8, 0), 36),
        "sky": {"type": "constant", "radiance": rgb(0.2, 0.3, 0.5)},
        "floor": rectangle((0, 0, 0), (4, 0, 0), (0, 0, -4), bsdf=diffuse(0.6, 0.5, 0.4)),
        "lamp": rectangle((0.5, 3, 0.3), (0.6, 0, 0), (0, 0, 0.6), emitter=glow, bsdf=diffuse(0, 0, 0)),
        "cube": {
            "type": "cube", "to_world": t().translate([0, 0.9, 0]).rotate([0, 1, 0], 25).scale(0.7),
            "bsdf": {"type": "null"}, "interior": inside,
        },
    }  # fmt: skip


# --- a model under an HDR image ---------------------------------------------------------------------------------------


def sky(direction: Floats) -> Floats:
    """Radiance from unit directions (..., 3): a blue gradient, and a broad warm sun."""
    sun = np.array([0.5, 0.6, 0.624])
    up = direction[..., 1:2]
    lobe = np.exp(30 * (direction @ (sun / np.linalg.norm(sun)) - 1))[..., None]
    return np.asarray((0.6 + 0.4 * up) * np.array([0.3, 0.45, 0.8]) + lobe * np.array([14.0, 11.0, 7.0]))


def sky_image(width: int = 512, height: int = 256) -> NDArray[np.float32]:
    """Mitsuba's: +z in the centre, columns at texel centres, the first and the last row on the poles."""
    azimuth = (np.arange(width) + 0.5) / width * 2 * np.pi
    polar = np.arange(height) / (height - 1) * np.pi
    a, p = np.meshgrid(azimuth, polar)
    directions = np.stack([np.sin(p) * np.sin(a), np.cos(p), -np.sin(p) * np.cos(a)], -1)
    return sky(directions).astype(np.float32)


def write_ply(path: Path, positions: ArrayLike, normals: ArrayLike, uvs: ArrayLike, indices: ArrayLike) -> None:
    rows = np.hstack([np.asarray(a, np.float64) for a in (positions, normals, uvs)])
    faces = np.asarray(indices).reshape(-1, 3)
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v"))
    with path.open("w") as file:
        file.write(f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n{names}")
        file.write(f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
        file.writelines(" ".join(f"{x:.9g}" for x in row) + "\n" for row in rows)
        file.writelines(f"3 {a} {b} {c}\n" for a, b, c in faces)


def model(folder: Path, meshes: dict[str, Any], texels: NDArray[np.uint8]) -> Description:
    """`meshes`: name to (positions, normals, uvs, indices) in world space."""
    mi = mitsuba()
    painted = {"type": "bitmap", "bitmap": mi.Bitmap(texels), "filter_type": "bilinear", "wrap_mode": "repeat"}
    bsdfs = {
        "ground": {"type": "diffuse", "reflectance": painted},
        "matt": diffuse(0.7, 0.25, 0.1),
        "dull": {"type": "roughconductor", "distribution": "ggx", "alpha": 0.0144, "material": "none"},
        "mirror": {"type": "conductor", "material": "none"},
    }
    made: Description = {"sensor": camera((0, 2.2, 6), (0, 0.7, 0), 32)}
    for name, mesh in meshes.items():
        write_ply(folder / f"{name}.ply", *mesh)
        bsdf = {"type": "twosided", "bsdf": bsdfs[name]}
        made[name] = {"type": "ply", "filename": str(folder / f"{name}.ply"), "bsdf": bsdf}
    made["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(sky_image()), "scale": 1.0}
    return made
