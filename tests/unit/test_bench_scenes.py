"""The scenes of `destello bench`: their sizes, and that they are the common ones with which others are measured."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

import destello as dl
from destello.scenes import meshes
from tracing import Geometry, f32, trace

NAMES = list(dl.scenes.describe_benchmarks())
TINY = 0.002


@pytest.fixture
def common(shared):
    """The generator of the common scenes."""
    path = shared / "peers" / "scenes.py"
    if not path.is_file():
        pytest.skip("there is no ../shared/peers beside this checkout")
    spec = importlib.util.spec_from_file_location("common_scenes", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_they_are_apart_from_the_books_scenes():
    assert NAMES == ["mesh1m", "instances", "instances-100", "instances-100-large", "terrain", "interior"]
    assert not set(NAMES) & set(dl.scenes.names())
    assert all(line.endswith(".") and len(line) < 100 for line in dl.scenes.describe_benchmarks().values())
    with pytest.raises(dl.InputError, match="did you mean 'terrain'"):
        dl.scenes.build("terain")
    for detail in (0, -1, 17, float("nan")):
        with pytest.raises(dl.InputError, match="detail"):
            dl.scenes.build("mesh1m", detail)


@pytest.mark.parametrize("name", NAMES)
def test_settings_and_reproducibility(name):
    scene = dl.scenes.build(name, TINY)
    assert scene.name == name
    assert (scene.film.width, scene.film.height) == (1280, 720)
    assert scene.render.max_depth == 8
    assert scene.render.rr_depth > 8
    assert scene == dl.scenes.build(name, TINY)
    larger = dl.scenes.build(name, 8 * TINY).compile().stats["triangles"]
    assert larger > scene.compile().stats["triangles"]


@pytest.mark.parametrize("name", NAMES)
def test_a_small_picture_is_finite_and_neither_black_nor_flat(name):
    image = dl.render(dl.scenes.build(name, TINY), size=(32, 18), spp=8, device="cpu", progress=False)
    assert image.metadata["nonfinite_samples"] == 0
    assert 0.05 < image.array.mean() < 5
    assert image.array.std() > 0.02


def test_full_sizes():
    """Of the formulas, without building anything large."""
    from destello.scenes.benchmarks import scaled

    assert 20 * scaled(224, 1) ** 2 == 1_003_520
    assert 20 * scaled(32, 1) ** 2 == 20_480
    assert scaled(100, 1) ** 2 == 10_000
    assert 2 * scaled(2236, 1) ** 2 == 9_999_392
    assert scaled(224, 1e-9) == 1


@pytest.mark.parametrize("frequency", [1, 2, 5])
def test_icosphere_is_closed_and_faces_outwards(frequency):
    points, triangles = meshes.icosphere(frequency)
    assert points.shape == (10 * frequency**2 + 2, 3)
    assert triangles.shape == (20 * frequency**2, 3)
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    edges = {(int(t[k]), int(t[k - 2])) for t in triangles for k in range(3)}
    assert len(edges) == 60 * frequency**2  # each once ...
    assert edges == {(b, a) for a, b in edges}  # ... and once the other way round
    a, b, c = (points[triangles[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0).all()


def test_torus_is_closed_and_faces_outwards():
    points, triangles = meshes.torus(2, 0.5, 9, 7)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", np.cross(a, b), c) / 6
    assert 0.7 < volume / (2 * np.pi**2 * 2 * 0.5**2) < 1


def test_terrain_has_one_shape_whatever_its_resolution():
    coarse, _ = meshes.terrain(8, 100, 10)
    fine, triangles = meshes.terrain(32, 100, 10)
    assert np.allclose(coarse.reshape(9, 9, 3), fine.reshape(33, 33, 3)[::4, ::4], atol=1e-9)
    a, b, c = (fine[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 1] > 0).all()
    assert 0 <= fine[:, 1].min() < fine[:, 1].max() < 12


# --- against the common generator -------------------------------------------------------------------------------------


def common_core(found):
    """The core's scene of what the common generator made."""
    made = Geometry()
    for name, _ in found["objects"]:
        made.mesh(*found["meshes"][name][:2])
    if found["instances"]:
        group = made.group()
        made.mesh(*found["meshes"][found["instances"]["mesh"]][:2], group=group)
        for place in found["instances"]["transforms"]:
            made.instance(group, f32(place[:3]))
    return made.build()


@pytest.mark.parametrize(
    ("name", "detail", "arguments"),
    [
        ("mesh1m", (6 / 224) ** 2, {"f": 6}),
        ("instances", 0.01, {"n": 10, "f": 3}),
        ("instances-100", 0.01, {"n": 10, "f": 3}),
        ("interior", 1.0, {}),
    ],
)
def test_geometry_is_the_common_one(common, rng, name, detail, arguments):
    """The camera's rays and random ones hit the same surfaces at the same distances."""
    theirs = common.scene(name.removesuffix("-100"), **arguments)
    ours = dl.scenes.build(name, detail)
    core = ours.compile().core
    view = theirs["camera"]
    origins = np.tile(np.array(view["origin"], np.float32), (4000, 1))
    towards = np.array(view["target"]) + rng.normal(size=(4000, 3))
    origins[2000:] = np.array(view["target"]) + 0.8 * rng.normal(size=(2000, 3))
    directions = f32(towards - origins)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = trace(common_core(theirs), origins, directions).t
    got = trace(core, origins, directions).t
    hit = np.isfinite(expected)
    assert hit.mean() > 0.3
    assert (np.isfinite(got) == hit).mean() > 0.999
    both = hit & np.isfinite(got)
    assert (np.abs(got[both] - expected[both]) < 1e-4 * np.maximum(expected[both], 1)).mean() > 0.998
    triangles = {shape: len(arrays[1]) for shape, arrays in theirs["meshes"].items()}
    assert core.stats()["triangles"] == sum(triangles.values())
    if theirs["instances"]:
        assert core.stats()["instances"] == len(theirs["instances"]["transforms"])


@pytest.mark.parametrize("name", ["mesh1m", "instances", "interior"])
def test_camera_depth_and_materials_are_the_common_ones(common, name):
    theirs = common.scene(name, **({} if name == "interior" else {"f": 2}), **({"n": 2} if name == "instances" else {}))
    ours = dl.scenes.build(name, TINY)
    assert (ours.film.width, ours.film.height, ours.render.max_depth) == tuple(
        theirs[key] for key in ("width", "height", "max_depth")
    )
    assert ours.film.filter.type == "box"
    for key in ("origin", "target", "up", "vfov", "aperture_radius"):
        assert np.allclose(ours.camera[key], theirs["camera"][key])
    mine = {material.name: material for material in ours.materials()}
    for material, values in theirs["materials"].items():
        check_material(mine[material], values)
    assert len(mine) == len(theirs["materials"])


def check_material(got, wanted):
    if wanted["type"] == "diffuse":
        assert (got.type, got["roughness"]) == ("diffuse", 0)
        assert np.allclose(got["reflectance"], wanted["color"])
    elif wanted["type"] == "metal":
        assert (got.type, got["fresnel"]) == ("conductor", "none")
        assert np.allclose(got["reflectance"], wanted["color"])
        assert got["roughness"] ** 2 == pytest.approx(wanted["alpha"])
    elif wanted["type"] == "glass":
        assert (got.type, got["ior"]) == ("dielectric", wanted["ior"])
    else:
        assert (got.type, got["two_sided"]) == ("emissive", False)
        assert np.allclose(got["radiance"], wanted["radiance"])
