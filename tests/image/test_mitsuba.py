"""Pictures against Mitsuba 3, an independent renderer, pixel by pixel.

Each scene is described twice: here for destello, in `mitsuba_scenes.py` with Mitsuba's own plug-ins. Luminance is
compared in every pixel by a z-test with the variances that both renderers estimate, corrected for the number of pixels;
besides, every channel is compared in blocks of 16 x 16 pixels and in the whole, where small differences add up.
"""

from __future__ import annotations

import numpy as np
import pytest

import destello as dl
import mitsuba_scenes as theirs
from gltf_scenes import material_of
from mitsuba_compare import compare
from scene_files import Gltf, encode_image

pytestmark = [
    pytest.mark.mitsuba,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.usefixtures("needs_mitsuba"),
]


def test_cornell_box(device):
    compare(dl.scenes.build("cornell"), theirs.cornell(), device, spp=64, max_depth=6)


# --- glass and metal --------------------------------------------------------------------------------------------------


def glass_and_metal():
    scene = dl.Scene("glass and metal")
    scene.camera = dl.cameras.perspective(origin=(0, 2.2, 6), target=(0, 0.7, 0), vfov=32)
    scene.environment = dl.environments.constant(radiance=(0.4, 0.5, 0.7))
    copper = {"fresnel": "eta_k", "eta": (0.200, 0.924, 1.102), "k": (3.912, 2.452, 2.142)}
    ground = dl.materials.diffuse(reflectance=(0.6, 0.5, 0.4))
    lamp = dl.materials.emissive(radiance=(4, 3.5, 3))
    scene.add(
        dl.shapes.quad((-6, 0, 6), (12, 0, 0), (0, 0, -12), material=ground),
        dl.shapes.quad((-2, 5, -2), (4, 0, 0), (0, 0, 4), material=lamp),
        dl.shapes.sphere((-1.1, 0.7, 0.6), 0.7, material=dl.materials.dielectric(ior=1.5)),
        dl.shapes.sphere((0.9, 0.8, -0.6), 0.8, material=dl.materials.conductor(**copper)),
        dl.shapes.sphere((0.8, 0.4, 1.1), 0.4, material=dl.materials.conductor(roughness=0.2, **copper)),
    )
    return scene


def test_glass_and_metal(device):
    """Rough metal at alpha 0.04, where height-correlated and separable masking (Mitsuba's) are the same."""
    compare(glass_and_metal(), theirs.glass_and_metal(), device, spp=256, max_depth=10)


def test_gltf_metals_are_disneys(device, tmp_path):
    """Schlick's Fresnel term on a GGX reflection of alpha roughness^2: `principled` without its other lobes.

    Mitsuba's scatters once among its facets: at such roughness that loses 0.2 % of a block at the rims.
    """
    scene = glass_and_metal()
    del scene.shapes[2]
    for i, (color, roughness) in ((2, (theirs.GOLD, 0.12)), (3, (theirs.STEEL, 0.11))):
        pbr = {"baseColorFactor": [*color, 1], "metallicFactor": 1, "roughnessFactor": roughness}
        scene.shapes[i] = scene.shapes[i].replace(material=material_of(Gltf(), tmp_path, pbrMetallicRoughness=pbr))
    compare(scene, theirs.principled_metals(), device, spp=64, max_depth=6, slack=1e-3)


# --- a glTF model under an HDR image ----------------------------------------------------------------------------------

MATERIALS = {
    "ground": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
    "matt": {"metallicFactor": 0.0, "roughnessFactor": 1.0, "baseColorFactor": [0.7, 0.25, 0.1, 1.0]},
    "dull": {"metallicFactor": 1.0, "roughnessFactor": 0.12},
    "mirror": {"metallicFactor": 1.0, "roughnessFactor": 0.0},
}


def ball(center, radius, rows=48):
    """A smooth sphere: positions, normals, uvs, indices."""
    u, v = np.meshgrid(np.linspace(0, 1, 2 * rows + 1), np.linspace(0, 1, rows + 1))
    a, p = 2 * np.pi * u.ravel(), np.pi * v.ravel()
    normals = np.stack([np.sin(p) * np.cos(a), np.cos(p), np.sin(p) * np.sin(a)], -1)
    i = np.arange(rows)[:, None] * (2 * rows + 1) + np.arange(2 * rows)
    upper = np.stack([i, i + 1, i + 2 * rows + 1], -1)[1:]
    lower = np.stack([i + 1, i + 2 * rows + 2, i + 2 * rows + 1], -1)[:-1]
    indices = np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])
    uvs = np.stack([u.ravel(), v.ravel()], -1)
    return normals * radius + np.asarray(center), normals, uvs, indices


def model_meshes():
    ground = np.array([[-5, 0, 5], [5, 0, 5], [5, 0, -5], [-5, 0, -5]], float)
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float) * 1.5
    return {
        "ground": (ground, np.tile((0.0, 1.0, 0.0), (4, 1)), uvs, np.array([[0, 1, 2], [0, 2, 3]])),
        "matt": ball((-1.1, 0.7, 0.6), 0.7),
        "dull": ball((0.8, 0.4, 1.1), 0.4),
        "mirror": ball((0.9, 0.8, -0.6), 0.8),
    }


def texels():
    return np.random.default_rng(8).integers(20, 230, (6, 8, 3), dtype=np.uint8)


def sky_image(width=512, height=256):
    """destello's: -z in the centre, texels at their centres."""
    azimuth = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    polar = (np.arange(height) + 0.5) / height * np.pi
    a, p = np.meshgrid(azimuth, polar)
    return theirs.sky(np.stack([np.sin(p) * np.sin(a), np.cos(p), -np.sin(p) * np.cos(a)], -1)).astype(np.float32)


def write_model(folder, meshes):
    g = Gltf()
    g.extend("KHR_materials_specular")
    paint = g.texture(encode_image(texels(), ".png", folder))
    for name, (positions, normals, uvs, indices) in meshes.items():
        pbr = dict(MATERIALS[name])
        if name == "ground":
            pbr["baseColorTexture"] = {"index": paint}
        bare = {"KHR_materials_specular": {"specularFactor": 0.0}}  # diffuse alone, as Mitsuba's
        material = g.add("materials", pbrMetallicRoughness=pbr, extensions=bare)
        center = positions.mean(0).astype(np.float32)
        attributes = {
            "POSITION": g.accessor((positions - center).astype(np.float32)),
            "NORMAL": g.accessor(normals.astype(np.float32)),
            "TEXCOORD_0": g.accessor(uvs.astype(np.float32)),
        }
        mesh = g.mesh(attributes, g.accessor(indices.ravel().astype(np.uint32)), material=material)
        g.node(mesh=mesh, translation=center.tolist())
    return g.glb(folder)


def test_gltf_under_an_hdr_image(device, tmp_path):
    meshes = model_meshes()
    scene = dl.load(write_model(tmp_path, meshes))
    scene.environment = dl.environments.image(sky_image())
    scene.camera = dl.cameras.perspective(origin=(0, 2.2, 6), target=(0, 0.7, 0), vfov=32)
    scene.lights.clear()
    compare(scene, theirs.model(tmp_path, meshes, texels()), device, spp=64, max_depth=6)
