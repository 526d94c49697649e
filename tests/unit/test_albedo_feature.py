"""The albedo that denoisers are shown of OpenPBR: the colours of all lobes by their shares."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
from destello import _core

BASE, BELOW, OTHER = (np.array(c) for c in ((0.2, 0.4, 0.6), (0.9, 0.5, 0.3), (0.3, 0.8, 0.5)))
COLOURS = {"base_color": tuple(BASE), "subsurface_color": tuple(BELOW)}


def albedo(device: str, words: dict[str, Any]) -> np.ndarray:
    """Of a square that fills the picture (4, 8, 3)."""
    scene = dl.Scene()
    material = dl.materials.openpbr(**words)
    scene.add(dl.shapes.quad((-2, -1, 0), (4, 0, 0), (0, 2, 0), material=material))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 1), target=(0, 0, 0), height=2)
    scene.environment = dl.environments.constant(radiance=1)
    image = dl.render(scene, spp=1, size=(8, 4), filter=dl.filters.box(), aov="albedo", device=device, progress=False)
    return np.asarray(image.aovs["albedo"], np.float64)


LOOKS: dict[str, tuple[dict[str, Any], Any]] = {
    "diffuse": ({"base_weight": 0.5}, 0.5 * BASE),
    "skin": ({"subsurface_weight": 1.0}, BELOW),
    "some skin": ({"subsurface_weight": 0.7}, 0.3 * BASE + 0.7 * BELOW),
    "metal and skin": ({"base_metalness": 0.25, "subsurface_weight": 1.0}, 0.25 * BASE + 0.75 * BELOW),
    "glass": ({"transmission_weight": 1.0}, np.ones(3)),
    "tinted glass": ({"transmission_weight": 0.5, "transmission_color": tuple(OTHER)}, 0.5 * (BASE + OTHER)),
    "jade": (
        {"transmission_weight": 0.5, "transmission_color": tuple(OTHER), "transmission_depth": 0.1}
        | {"subsurface_weight": 1.0},
        0.5 * (BELOW + OTHER),
    ),
    "leaf": ({"geometry_thin_walled": True, "subsurface_weight": 1.0}, BELOW),
    "coat": ({"coat_weight": 0.5, "coat_color": tuple(OTHER)}, BASE * (0.5 + 0.5 * OTHER)),
}


@pytest.mark.parametrize("look", LOOKS)
def test_colours_by_their_shares(look: str, device: str) -> None:
    words, expected = LOOKS[look]
    np.testing.assert_allclose(albedo(device, COLOURS | words), np.broadcast_to(expected, (4, 8, 3)), rtol=1e-4)


def test_fuzz_covers_what_it_reflects(device: str) -> None:
    words = {"fuzz_weight": 0.8, "fuzz_color": tuple(OTHER), "fuzz_roughness": 0.6}
    share = 0.8 * _core.testing.openpbr_fuzz_albedo(1.0, 0.6)
    expected = (1 - share) * BASE + share * OTHER
    assert 0.02 < share < 0.8
    np.testing.assert_allclose(albedo(device, COLOURS | words)[1, 3], expected, rtol=1e-4)


@pytest.mark.parametrize("name", ["subsurface_color", "transmission_color", "base_color"])
def test_textures_show(name: str, device: str) -> None:
    """Left one colour, right another: as each of them alone."""
    words: dict[str, Any] = COLOURS | {"subsurface_weight": 0.5, "transmission_weight": 0.4, "transmission_depth": 0.2}
    texels = np.float32([[BELOW, OTHER]])
    image = dl.textures.image(texels, color_space="linear", filter="nearest", wrap_u="clamp")
    got = albedo(device, words | {name: image})
    for half, colour in ((got[:, :4], BELOW), (got[:, 4:], OTHER)):
        np.testing.assert_allclose(half, albedo(device, words | {name: tuple(colour)})[:, :4], rtol=1e-4)
    assert np.abs(got[:, :4] - got[:, 4:]).max() > 0.05
