"""A material gallery: rows of spheres, each sweeping one parameter of OpenPBR from left to right.

Usage: python examples/material_gallery.py [-o gallery] [--spp 128] [--size 1200] [--only base coat ...]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import destello as dl

GOLD, RED, GREEN, BLUE = (1.0, 0.77, 0.34), (0.7, 0.1, 0.08), (0.15, 0.5, 0.2), (0.1, 0.25, 0.7)
SKIN = (0.9, 0.55, 0.4)
STEPS = 7


def orange_peel() -> dl.nodes.Node:
    """Return a normal map of shallow waves, which repeats."""
    y, x = 2 * np.pi * (np.indices((64, 128)) + 0.5) / 64
    slopes = 0.15 * np.stack([np.sin(3 * x + np.cos(2 * y)), np.sin(4 * y + np.cos(x))], -1)
    normals = np.concatenate([slopes, np.ones((64, 128, 1))], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return dl.textures.image(((normals + 1) / 2).astype(np.float32), color_space="linear", uv_scale=(4, 4))


ORANGE_PEEL = orange_peel()

SHEETS: dict[str, list[tuple[str, dict[str, Any], list[Any]]]] = {
    "base": [
        ("base_diffuse_roughness", {"base_color": RED, "specular_weight": 0.0}, [0, 1]),
        ("specular_roughness", {"base_color": RED}, [0, 1]),
        ("specular_ior", {"base_color": BLUE, "specular_roughness": 0.1}, [1, 3]),
        ("base_metalness", {"base_color": GOLD, "specular_roughness": 0.2}, [0, 1]),
        ("specular_roughness", {"base_color": GOLD, "base_metalness": 1.0}, [0, 1]),
        (
            "specular_roughness_anisotropy",
            {"base_color": GOLD, "base_metalness": 1.0, "specular_roughness": 0.4},
            [0, 0.95],
        ),
    ],
    "layers": [
        ("coat_weight", {"base_color": RED, "specular_roughness": 0.6}, [0, 1]),
        ("coat_roughness", {"base_color": GOLD, "base_metalness": 1.0, "coat_weight": 1.0}, [0, 1]),
        (
            "coat_darkening",
            {"base_color": (0.6, 0.35, 0.15), "coat_weight": 1.0, "coat_ior": 1.8, "coat_color": (0.9, 0.7, 0.5)},
            [0, 1],
        ),
        (
            "geometry_coat_normal_scale",
            {"base_color": RED, "specular_roughness": 0.5, "coat_weight": 1.0, "geometry_coat_normal": ORANGE_PEEL},
            [0, 1],
        ),
        ("fuzz_weight", {"base_color": BLUE, "specular_roughness": 0.7, "fuzz_roughness": 0.4}, [0, 1]),
        ("fuzz_roughness", {"base_color": (0.05, 0.05, 0.08), "fuzz_weight": 1.0, "fuzz_color": RED}, [0, 1]),
        (
            "thin_film_thickness",
            {"base_color": (0.6, 0.6, 0.6), "base_metalness": 1.0, "thin_film_weight": 1.0, "specular_roughness": 0.15},
            [0, 1],
        ),
    ],
    "inside": [
        ("transmission_weight", {"base_color": GREEN, "specular_roughness": 0.0}, [0, 1]),
        ("specular_roughness", {"transmission_weight": 1.0}, [0, 0.8]),
        (
            "transmission_depth",
            {"transmission_weight": 1.0, "transmission_color": GREEN, "specular_roughness": 0.0},
            [3, 0.2],
        ),
        (
            "transmission_scatter",
            {"transmission_weight": 1.0, "specular_roughness": 0.05, "transmission_color": (0.5, 0.6, 0.7)}
            | {"transmission_depth": 0.5},
            [0, 1],
        ),
        ("subsurface_weight", {"base_color": SKIN, "subsurface_color": SKIN, "subsurface_radius": 0.2}, [0, 1]),
        ("subsurface_radius", {"subsurface_weight": 1.0, "subsurface_color": SKIN}, [0.01, 0.8]),
    ],
    "more": [
        ("specular_color", {"base_color": GOLD, "base_metalness": 1.0, "specular_roughness": 0.2}, [0, 1]),
        (
            "transmission_dispersion_scale",
            {"transmission_weight": 1.0, "specular_roughness": 0.0, "specular_ior": 1.7},
            [0, 1],
        ),
        (
            "transmission_weight",
            {"geometry_thin_walled": True, "base_color": GREEN, "transmission_color": (0.5, 0.9, 0.6)},
            [0, 1],
        ),
        (
            "subsurface_scatter_anisotropy",
            {"geometry_thin_walled": True, "subsurface_weight": 1.0, "subsurface_color": (0.4, 0.8, 0.3)},
            [-0.9, 0.9],
        ),
        ("geometry_opacity", {"base_color": RED}, [1, 0]),
        ("emission_luminance", {"base_color": (0.1, 0.1, 0.1), "emission_color": GOLD}, [0, 600]),
    ],
}


def sheet(rows: list[tuple[str, dict[str, Any], list[Any]]], width: int) -> dl.Scene:
    """Return a scene of one row of spheres for each (parameter, others, [first, last])."""
    s = dl.Scene(name="material gallery")
    columns, lines = STEPS, len(rows)
    s.film.width, s.film.height = width, round(width * lines / columns)
    s.camera = dl.cameras.orthographic(origin=(0, 0, 20), target=(0, 0, 0), height=lines)
    sky = np.full((64, 128, 3), 0.25, np.float32)
    sky[8:26, 84:106] = 6.0  # a window on the upper right,
    sky[14:30, 20:34] = 2.5  # a smaller one behind on the left
    sky[40:] = (0.12, 0.11, 0.1)
    s.environment = dl.environments.image(sky)
    grey = dl.textures.checker(even=(0.45, 0.45, 0.45), odd=(0.22, 0.22, 0.22), scale=0.25)
    wall = dl.materials.diffuse(reflectance=grey)
    s.add(dl.shapes.quad(corner=(-8, -8, -1.5), u=(16, 0, 0), v=(0, 16, 0), material=wall))
    for j, (name, others, (first, last)) in enumerate(rows):
        for i in range(columns):
            value = first + (last - first) * i / (columns - 1)
            material = dl.materials.openpbr(**{**others, name: value})
            center = (i - (columns - 1) / 2, (lines - 1) / 2 - j, 0)
            s.add(dl.shapes.sphere(center=center, radius=0.44, material=material))
    return s


def main() -> None:
    """Render the sheets."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("gallery"), help="folder for the pictures")
    parser.add_argument("--spp", type=int, default=128)
    parser.add_argument("--size", type=int, default=1200, help="width in pixels")
    parser.add_argument("--only", nargs="*", choices=list(SHEETS), default=list(SHEETS))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    for name in args.only:
        print(name + ":", ", ".join(row[0] for row in SHEETS[name]))
        dl.render(sheet(SHEETS[name], args.size), spp=args.spp).save(args.output / f"materials-{name}.jpg")


if __name__ == "__main__":
    main()
