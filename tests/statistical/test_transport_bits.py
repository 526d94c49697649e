"""Reproducibility: the bits of the film depend on the scene, the seed and the sample range, and on nothing else."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import destello as dl
from destello import _core

WIDTH, HEIGHT, SAMPLES = 37, 23, 24  # not multiples of the tiles
SETTINGS = {"seed": 7, "max_depth": 6, "filter": {"type": "mitchell"}, "time0": 0.0, "time1": 1.0}


@pytest.fixture(scope="module")
def scene():
    """Something of everything: motion, instances, glass, fog, textures, all kinds of light."""
    s = dl.Scene("everything")
    s.camera = dl.cameras.perspective(origin=(0, 2, 6), target=(0, 0.7, 0), vfov=40, aperture_radius=0.05)
    checker = dl.textures.checker_uv(count_u=8, count_v=8)
    matt = dl.materials.diffuse(reflectance=checker)
    metal = dl.materials.conductor(roughness=0.4, anisotropy=0.3)
    glass = dl.materials.dielectric(abbe=30, medium_absorption=(0.1, 0.3, 0.2))
    s.add(dl.shapes.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8), material=dl.materials.mix(first=matt, second=metal)))
    s.add(dl.shapes.sphere((-1.2, 0.6, 0), 0.6, material=glass, center1=(-1.2, 0.9, 0)))
    fog = dl.materials.interface(medium_density=(0.5, 1, 3), medium_albedo=0.8)
    s.add(dl.shapes.sphere((2.5, 1, -1), 0.9, material=fog))
    skin = dl.materials.openpbr(subsurface_weight=1, subsurface_radius=0.2, subsurface_color=checker)
    s.add(dl.shapes.sphere((0.6, 0.5, 1.5), 0.4, material=skin))
    puffs = np.random.default_rng(2).random((5, 9, 11), np.float32)
    cloud = dl.volumes.grid(density=puffs, emission=puffs[..., None] ** 8, min=(-3, 0.2, -1.5), max=(-1.8, 1.6, 0))
    s.add(dl.volumes.box(cloud, medium_density=(4, 2, 1), medium_albedo=0.8, medium_anisotropy=0.3))
    s.group("box", [dl.shapes.box((-0.3, 0, -0.3), (0.3, 1, 0.3), material=metal)])
    for i in range(3):
        s.add(dl.shapes.instance("box", transform=dl.translate(i, 0, -i) @ dl.rotate("y", 30 * i)))
    s.add(dl.shapes.sphere((0, 3, 0), 0.3, material=dl.materials.emissive(radiance=9)))
    s.add(dl.lights.spot(position=(3, 4, 3), target=(0, 0, 0), intensity=20))
    pixels = np.random.default_rng(1).uniform(0, 1, (4, 8, 3)).astype(np.float32)
    s.environment = dl.environments.image(pixels)
    return s.compile()


def render(scene, device, first=0, last=SAMPLES, threads=2, crop=None, film=None, **settings):
    film = film or _core.Film(WIDTH, HEIGHT, aovs=True)
    core = _core.Renderer(scene.core, device, threads)
    counts = core.render(film, 0, first, last, {**SETTINGS, **settings}, crop=crop)
    assert counts["nonfinite"] == 0
    return film


def same(a, b):
    state, other = a.state(), b.state()
    assert state.keys() == other.keys()
    return all(np.array_equal(state[name], other[name]) for name in state)


@pytest.fixture(scope="module")
def reference(scene):
    """Per device."""
    made = {}

    def get(device):
        if device not in made:
            made[device] = render(scene, device)
        return made[device]

    return get


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_threads_do_not_matter(threads, scene, reference, device):
    assert same(render(scene, device, threads=threads), reference(device))


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_any_split_added_in_any_order(parts, scene, reference, device):
    rng = np.random.default_rng(parts)
    cuts = [0, *sorted(rng.choice(np.arange(1, SAMPLES), parts, replace=False)), SAMPLES]
    spans = [(int(a), int(b)) for a, b in pairwise(cuts)]
    films = [render(scene, device, a, b, threads=1 + i % 3) for i, (a, b) in enumerate(spans)]
    for _ in range(3):
        total = _core.Film(WIDTH, HEIGHT, aovs=True)
        for i in rng.permutation(len(films)):
            total.add(films[i])
        assert same(total, reference(device))


def test_sample_after_sample_into_one_film(scene, reference, device):
    film = None
    for i in np.random.default_rng(3).permutation(SAMPLES):
        film = render(scene, device, int(i), int(i) + 1, film=film)
    assert same(film, reference(device))


def test_tiles_of_the_picture(scene, reference, device):
    film = None
    xs, ys = [0, 5, 16, 30, WIDTH], [0, 1, 20, HEIGHT]
    tiles = [(x0, y0, x1, y1) for x0, x1 in pairwise(xs) for y0, y1 in pairwise(ys)]
    for i in np.random.default_rng(4).permutation(len(tiles)):
        film = render(scene, device, crop=tiles[i], film=film)
    assert same(film, reference(device))


def test_a_crop_is_a_part_of_the_picture(scene, reference, device):
    x0, y0, x1, y1 = crop = (7, 3, 20, 19)
    film = render(scene, device, crop=crop)
    assert np.array_equal(film.mean()[y0:y1, x0:x1], reference(device).mean()[y0:y1, x0:x1])
    outside = np.ones((HEIGHT, WIDTH), bool)
    outside[y0:y1, x0:x1] = False
    assert not film.weight()[outside].any()


def test_same_seed_same_bits_other_seed_others(scene, reference, device):
    assert same(render(scene, device), reference(device))
    other = render(scene, device, seed=8)
    assert (other.mean() != reference(device).mean()).any(-1).mean() > 0.9


def test_state_round_trip(scene, reference, device):
    film = reference(device)
    copy = _core.Film.from_state(film.state())
    assert same(copy, film)
    assert np.array_equal(copy.mean(), film.mean())
