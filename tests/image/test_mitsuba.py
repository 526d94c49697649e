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
import stats
from scene_files import Gltf, encode_image

SIZE, SEEDS, BLOCK = theirs.SIZE, 4, 16
pytestmark = [pytest.mark.mitsuba, pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(autouse=True, scope="module")
def _needs_mitsuba():
    try:
        theirs.mitsuba()
    except ImportError as error:
        pytest.skip(f"no Mitsuba: {error}")


def blocks(image):
    """Means of blocks (..., H / BLOCK, W / BLOCK, 3)."""
    shape = (*image.shape[:-3], SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK, 3)
    return image.reshape(shape).mean((-4, -2))


def block_means(runs):
    """Means of the blocks over runs (N, H, W, 3) of different seeds, and the variance of these means."""
    runs = np.asarray(runs, np.float64)
    pixels = runs.var(0, ddof=1) / len(runs)  # of few runs, but a block has many pixels
    return blocks(runs.mean(0)), blocks(pixels) / BLOCK**2


def whole(means, variances):
    """The mean of all blocks and its variance."""
    return means.mean((0, 1)), variances.sum((0, 1)) / means[..., 0].size ** 2


def compare(scene, description, device, *, spp, max_depth, slack=2e-4):
    """`spp` in each of SEEDS runs. `slack`: what float32 and the renderers' weights of luminance may differ by."""
    options = {"spp": spp, "size": (SIZE, SIZE), "max_depth": max_depth, "filter": dl.filters.box()}
    ours = [dl.render(scene, seed=s, device=device, progress=False, **options) for s in range(SEEDS)]
    others = [theirs.render(description, spp=spp, seed=100 + s, max_depth=max_depth) for s in range(SEEDS)]
    mean_a = np.mean([dl.color.luminance(i.array.astype(np.float64)) for i in ours], 0)
    mean_b = np.mean([dl.color.luminance(p.rgb) for p in others], 0)
    variance_a = np.mean([i.film.core.variance() for i in ours], 0) / SEEDS
    variance_b = np.mean([p.variance for p in others], 0) / SEEDS
    stats.assert_means_agree(mean_a, variance_a, mean_b, variance_b, comparisons=9, slack=slack)
    blocks_a, blocks_b = block_means([i.array for i in ours]), block_means([p.rgb for p in others])
    stats.assert_means_agree(*blocks_a, *blocks_b, comparisons=9, slack=slack)
    whole_a, whole_b = (
        (mean.mean((0, 1)), variance.sum((0, 1)) / mean.shape[0] ** 4) for mean, variance in (blocks_a, blocks_b)
    )
    stats.assert_means_agree(*whole_a, *whole_b, comparisons=9, slack=slack)
    assert mean_a.mean() > 0.05
    # The test has eyes: a pixel's noise, and that of the whole picture.
    assert np.median(np.sqrt(variance_a + variance_b) / np.maximum(mean_a, 0.05)) < 0.08
    assert np.all(np.sqrt(whole_a[1] + whole_b[1]) < 2e-3 * whole_a[0])


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


# --- a glTF model under an HDR image ----------------------------------------------------------------------------------

MATERIALS = {
    "ground": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
    "matt": {"metallicFactor": 0.0, "roughnessFactor": 1.0, "baseColorFactor": [0.7, 0.25, 0.1, 1.0]},
    "dull": {"metallicFactor": 1.0, "roughnessFactor": 0.25},
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
