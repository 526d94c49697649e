"""OpenPBR's parameters one by one: what each does to its lobe, in closed form.

White furnaces and reciprocity hold whatever a parameter does to colours; here each has the value that it should have.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bsdf_cases import Case, direction
from openpbr_reference import fresnel, ggx, mean_over_cosines, single_scattering
from stats import assert_mean, integrate_sphere

Floats = NDArray[np.float64]

COLOUR, TINT = np.array([0.9, 0.5, 0.1]), np.array([0.3, 0.6, 1.0])
BARE = {"specular_weight": 0.0}
"""A dielectric base without gloss: all light reaches the diffuse base."""
BLACK = {"base_metalness": 1.0, "specular_weight": 0.0}
"""A metal that reflects nothing, under the other layers."""
WO = direction(0.7, 0.1)
WI = np.array([direction(c, t) for c in (0.15, 0.5, 0.8, 0.97) for t in (0.05, 0.4, 0.62)], np.float64)
DOWN = WI * [1, 1, -1]


def case(words: dict[str, Any], **surroundings: Any) -> Case:
    plain = {k: tuple(v) if isinstance(v, np.ndarray) else v for k, v in words.items()}
    return Case("openpbr", plain, **surroundings)


def lobes(c: Case, wo: Any) -> tuple[Floats, Floats]:
    """Of delta lobes, by the middle of each of 4096 steps of the first number: power reflected, power passed (3,)."""
    n = 4096
    s = c.sample(wo, np.stack([(np.arange(n) + 0.5) / n, *np.full((2, n), 0.5)], -1))
    assert s.delta.all()
    down = s.transmitted[:, None]
    return np.where(down, 0, s.power()).mean(axis=0), np.where(down, s.power(), 0).mean(axis=0)


def numbers(n: int) -> NDArray[np.float32]:
    return np.random.default_rng(3).random((n, 3)).astype(np.float32).clip(0, 1 - 2**-24)


# --- base ------------------------------------------------------------------------------------------------------------


def test_base_weight_and_colour() -> None:
    got = case({**BARE, "base_weight": 0.5, "base_color": COLOUR}).eval(WO, WI)
    np.testing.assert_allclose(got, 0.5 * COLOUR / np.pi * WI[:, 2:], rtol=1e-5)


def test_shares_of_the_base() -> None:
    """Metal 0.3 of all; of the rest half passes; of what is left 0.4 is subsurface, here that of a sheet."""
    words = {
        **BARE, "specular_roughness": 0.0, "geometry_thin_walled": True, "base_metalness": 0.3, "base_color": COLOUR,
        "transmission_weight": 0.5, "subsurface_weight": 0.4, "subsurface_color": TINT,
        "subsurface_scatter_anisotropy": 0.2,
    }  # fmt: skip
    diffuse, below = 0.7 * 0.5 * 0.6 * COLOUR, 0.7 * 0.5 * 0.4 * TINT
    even = WI[:, 2:] / np.pi
    np.testing.assert_allclose(case(words).eval(WO, WI), (diffuse + 0.4 * below) * even, rtol=1e-4)
    np.testing.assert_allclose(case(words).eval(WO, DOWN), 0.6 * below * even, rtol=1e-4)
    _, passed = lobes(case({**words, "subsurface_weight": 0.0, "base_weight": 0.0, "transmission_weight": 1.0}), WO)
    np.testing.assert_allclose(passed, 0.7, rtol=1e-4)


# --- metal -----------------------------------------------------------------------------------------------------------


def f82(cosine: Any, f0: Floats, tint: Floats) -> Floats:
    """Schlick's curve less a bump that leaves `tint` of it at 1/7 (Kutz, Hasan and Edmondson 2021)."""
    c = np.asarray(cosine, np.float64)[..., None]

    def schlick(x: Any) -> Any:
        return f0 + (1 - f0) * (1 - x) ** 5

    bump = c * (1 - c) ** 6 / (1 / 7 * (6 / 7) ** 6)
    return np.asarray(schlick(c) - bump * schlick(1 / 7) * (1 - tint))


@pytest.mark.parametrize("cosine", [1.0, 0.6, 1 / 7, 0.05])
def test_f82_tint(cosine: float) -> None:
    words = {"base_metalness": 1.0, "base_color": COLOUR, "specular_color": TINT, "specular_roughness": 0.0}
    up, _ = lobes(case({**words, "specular_weight": 0.8}), direction(cosine, 0.1))
    np.testing.assert_allclose(up, 0.8 * np.maximum(f82(cosine, COLOUR, TINT), 0), rtol=1e-3)


@pytest.mark.parametrize("cosine", [0.9, 0.3])
def test_light_among_metal_facets_is_coloured(cosine: float) -> None:
    """What single scattering loses comes back by Kulla and Conty's sum over the bounces, of the mean reflectance."""
    f0, tint = np.array([0.9, 0.6, 0.3]), np.array([0.8, 0.5, 0.9])
    words = {"base_metalness": 1.0, "base_color": f0, "specular_color": tint, "specular_roughness": 1.0}
    wo = direction(cosine, 0.2).astype(np.float64)
    mean = mean_over_cosines(lambda c: f82(c, f0, tint))
    lost = mean_over_cosines(lambda c: np.array([1 - single_scattering(direction(x, 0), 1.0) for x in c])[:, None])
    again = mean**2 * (1 - lost) / (1 - mean * lost)
    expected = single_scattering(wo, 1.0, lambda c: f82(c, f0, tint)) + again * (1 - single_scattering(wo, 1.0))
    got = [integrate_sphere(lambda d, k=k: case(words).eval(wo, d)[:, k], hemisphere=True) for k in range(3)]
    np.testing.assert_allclose(got, expected, atol=3e-3)


def test_anisotropy_keeps_the_mean_square() -> None:
    """alpha_x = alpha sqrt(2 / (1 + a^2)), alpha_y = a alpha_x with a = 1 - anisotropy.

    What the facets lose, 0.9 % of the light, comes back evenly on top of single scattering.
    """
    words = {"base_metalness": 1.0, "base_color": 1.0, "specular_roughness": 0.3, "specular_roughness_anisotropy": 0.6}
    ax = 0.09 * np.sqrt(2 / (1 + 0.4**2))
    wi = np.array([direction(c, t) for c in (0.995, 0.97, 0.9) for t in (0, 0.1, 0.25)], np.float64)
    single = ggx((0, 0, 1), wi, ax, 0.4 * ax)
    np.testing.assert_allclose(case(words).eval((0, 0, 1), wi)[:, 0], single, rtol=0.01, atol=0.002)


# --- gloss and glass -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weight", [0.25, 1.0, 2.0])
def test_specular_weight_multiplies_the_reflectance_head_on(weight: float) -> None:
    words = {"transmission_weight": 1.0, "specular_roughness": 0.0, "specular_weight": weight}
    for front in (True, False):
        up, down = lobes(case(words, front=front), direction(1.0, 0))
        np.testing.assert_allclose(up, 0.04 * weight, rtol=5e-3)
        np.testing.assert_allclose(down, 1 - up, rtol=1e-3)


def test_specular_colour_tints_what_dielectrics_reflect_outwards() -> None:
    gloss = {"base_color": 0.0, "specular_roughness": 0.4}
    white = case(gloss).eval(WO, WI)
    np.testing.assert_allclose(case({**gloss, "specular_color": TINT}).eval(WO, WI), white * TINT, rtol=1e-5)
    glass = {"transmission_weight": 1.0, "specular_roughness": 0.8}
    for front, expected in ((True, TINT), (False, np.ones(3))):
        white = case(glass, front=front).eval(WO, WI)
        got = case({**glass, "specular_color": TINT}, front=front).eval(WO, WI)
        np.testing.assert_allclose(got, white * expected, rtol=1e-5)


@pytest.mark.parametrize("front", [True, False])
def test_transmission_colour_tints_what_passes(front: bool) -> None:
    """With a depth it is the medium's."""
    glass = {"transmission_weight": 1.0, "specular_roughness": 0.8}
    white = case(glass, front=front)
    tinted = case({**glass, "transmission_color": TINT}, front=front)
    np.testing.assert_allclose(tinted.eval(WO, DOWN), white.eval(WO, DOWN) * TINT, rtol=1e-5)
    np.testing.assert_allclose(tinted.eval(WO, WI), white.eval(WO, WI), rtol=1e-5)
    deep = case({**glass, "transmission_color": TINT, "transmission_depth": 2.0}, front=front)
    np.testing.assert_allclose(deep.eval(WO, DOWN), white.eval(WO, DOWN), rtol=1e-5)


@pytest.mark.parametrize("cosine", [1.0, 0.5, 0.15])
def test_a_sheet_reflects_to_and_fro(cosine: float) -> None:
    """Both sides of a smooth sheet: R = 2 F / (1 + F) comes back, by specular_color; the rest passes, straight."""
    words = {"geometry_thin_walled": True, "transmission_weight": 1.0, "specular_roughness": 0.0}
    f = fresnel(cosine, 1.5)
    r = 2 * f / (1 + f)
    up, down = lobes(case({**words, "transmission_color": COLOUR, "specular_color": TINT}), direction(cosine, 0.1))
    np.testing.assert_allclose(up, r * TINT, rtol=5e-3)
    np.testing.assert_allclose(down, (1 - r) * COLOUR, rtol=5e-3)


def test_a_rough_sheet_shares_out_what_its_facets_lose() -> None:
    """Back goes the mean over directions of what a sheet reflects of diffuse light, of the mean F."""
    words = {"geometry_thin_walled": True, "transmission_weight": 1.0, "specular_roughness": 1.0}
    wo = direction(0.5, 0.2).astype(np.float64)
    f = float(mean_over_cosines(lambda c: fresnel(c, 1.5)[:, None])[0])

    def both(c: Floats) -> Floats:
        return np.asarray(2 * fresnel(c, 1.5) / (1 + fresnel(c, 1.5)))[:, None]

    expected = single_scattering(wo, 1.0, both)[0] + 2 * f / (1 + f) * (1 - single_scattering(wo, 1.0))
    up = integrate_sphere(lambda d: case(words).eval(wo, d)[:, 0], hemisphere=True)
    assert up == pytest.approx(expected, abs=3e-3)


# --- coat and fuzz ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("outside", [1.0, 1.33])
@pytest.mark.parametrize("weight", [0.4, 1.0])
def test_a_coat_absorbs_along_the_refracted_ways(weight: float, outside: float) -> None:
    """coat_color is what two ways straight through leave; slanted ways are longer; what the coat reflects is gone."""
    coat = {"coat_weight": weight, "coat_color": COLOUR, "coat_ior": 1.7, "coat_darkening": 0.0}
    eta = 1.7 / outside

    def way(z: Any) -> Any:
        return 1 / np.sqrt(1 - (1 - np.asarray(z) ** 2) / eta**2)

    left = COLOUR ** (0.5 * (way(WO[2]) + way(WI[:, 2:]))) * (1 - fresnel(float(WO[2]), eta))
    expected = 0.6 / np.pi * WI[:, 2:] * (1 - weight + weight * left)
    got = case({**BARE, **coat, "base_color": 0.6}, outside_ior=outside).eval(WO, WI)
    np.testing.assert_allclose(got, expected, rtol=2e-3)


def test_a_coat_colours_what_leaves_the_glass_below_it() -> None:
    glass = {"transmission_weight": 1.0, "specular_roughness": 0.0, "coat_weight": 1.0, "coat_ior": 1.4}
    wo = direction(0.9, 0.1)
    _, white = lobes(case(glass, front=False), wo)
    _, got = lobes(case({**glass, "coat_color": COLOUR}, front=False), wo)
    outside = np.sqrt(1 - 1.5**2 * (1 - 0.9**2))
    np.testing.assert_allclose(got / white, COLOUR ** (0.5 / np.sqrt(1 - (1 - outside**2) / 1.4**2)), rtol=1e-3)


def dark(base: dict[str, Any], amount: float = 1.0, **coat: Any) -> Floats:
    """What darkening leaves of a base under a smooth coat (3,); the same for all directions of light."""
    words = {**base, "coat_weight": 1.0, "coat_ior": 1.6, **coat}
    with_it, without = (case({**words, "coat_darkening": d}).eval(WO, WI) for d in (amount, 0.0))
    ratio = with_it / without
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[0], ratio.shape), rtol=1e-4)
    return ratio[0]


def test_coat_darkening() -> None:
    """(1 - K) / (1 - A K): K of the light below is sent back by the coat, A of that by the base (specification)."""
    rough = 1 - (1 - float(mean_over_cosines(lambda c: fresnel(c, 1.6)[:, None])[0])) / 1.6**2
    straight = fresnel(float(WO[2]), 1.6)

    def left(albedo: Any, base_roughness: float) -> Any:
        k = straight + (rough - straight) * base_roughness
        return (1 - k) / (1 - np.asarray(albedo) * k)

    np.testing.assert_allclose(dark({**BARE, "base_color": COLOUR}), left(COLOUR, 1), rtol=3e-3)
    half = dark({**BARE, "base_color": COLOUR}, 0.5)
    np.testing.assert_allclose(half, 0.5 + 0.5 * left(COLOUR, 1), rtol=3e-3)
    metal = {"base_metalness": 1.0, "base_color": COLOUR, "specular_roughness": 0.5}
    np.testing.assert_allclose(dark(metal), left(COLOUR, 0.5), rtol=3e-3)
    f0 = ((2.0 / 1.5 - 1) / (2.0 / 1.5 + 1)) ** 2  # the gloss under a coat of 1.5
    rough = 1 - (1 - float(mean_over_cosines(lambda c: fresnel(c, 1.5)[:, None])[0])) / 1.5**2
    straight = fresnel(float(WO[2]), 1.5)
    glossy = {"base_color": COLOUR, "specular_ior": 2.0, "specular_roughness": 0.4}
    expected = left(f0 + COLOUR * (1 - f0), 1 + f0 * (0.4 - 1))
    np.testing.assert_allclose(dark(glossy, coat_ior=1.5), expected, rtol=3e-3)
    np.testing.assert_allclose(dark({"transmission_weight": 1.0, "specular_roughness": 0.6}), 1, rtol=1e-4)


COAT = {"coat_weight": 1.0, "coat_roughness": 0.3, "coat_ior": 1.5, "coat_darkening": 0.0}


def test_a_rough_coat_reflects_as_glass_does() -> None:
    glass = Case("dielectric", {"roughness": 0.3, "ior": 1.5})
    np.testing.assert_allclose(case({**BLACK, **COAT}).eval(WO, WI), glass.eval(WO, WI), rtol=1e-4)


METAL = {"base_metalness": 1.0, "base_color": COLOUR, "specular_roughness": 0.4}


@pytest.mark.parametrize(
    ("coated", "bare", "surroundings"),
    [
        (METAL, {**METAL, "specular_roughness": (0.4**4 + 2 * 0.3**4) ** 0.25}, {}),
        (
            {"base_color": 0.0, "specular_ior": 1.8},
            {"base_color": 0.0, "specular_ior": 1.2, "specular_roughness": (2 * 0.3**4 + 0.3**4) ** 0.25},
            {},
        ),
        (
            {**METAL, "thin_film_weight": 1.0, "coat_roughness": 0.0},
            {**METAL, "thin_film_weight": 1.0},
            {"outside_ior": 1.5},
        ),
    ],
    ids=["roughens what is below", "gloss by the index below it", "film below it"],
)
def test_what_lies_under_a_coat(coated: dict[str, Any], bare: dict[str, Any], surroundings: dict[str, Any]) -> None:
    """The base below looks like a base without coat that is rougher, or that is in the coat's material."""
    below = case({**COAT, **coated}).eval(WO, WI)
    if coated.get("coat_roughness") != 0.0:
        below = below - case({**BLACK, **COAT}).eval(WO, WI)
    ratio = below / case(bare, **surroundings).eval(WO, WI)
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[0], ratio.shape), rtol=0.01)


@pytest.mark.parametrize("roughness", [0.05, 0.5, 1.0])
def test_fuzz_is_the_sheen_of_its_papers(roughness: float) -> None:
    """D of Estevez and Kulla 2017, V of Neubelt and Pettineo 2013, alpha = roughness^2; never more than came."""
    words = {**BLACK, "fuzz_weight": 1.0, "fuzz_roughness": roughness, "fuzz_color": COLOUR}
    alpha = max(roughness, 0.1) ** 2
    h = WO + WI
    sine = np.sqrt(1 - (h[:, 2] / np.linalg.norm(h, axis=1)) ** 2)
    d = (2 + 1 / alpha) * sine ** (1 / alpha) / (2 * np.pi)
    expected = d / (4 * (WO[2] + WI[:, 2] - WO[2] * WI[:, 2])) * WI[:, 2]
    np.testing.assert_allclose(case(words).eval(WO, WI), expected[:, None] * COLOUR, rtol=2e-3, atol=1e-9)
    grazing = direction(0.05, 0.1)
    total = integrate_sphere(lambda v: case({**words, "fuzz_color": 1.0}).eval(grazing, v)[:, 0], hemisphere=True)
    assert total < 1.01


@pytest.mark.parametrize("cosine", [1.0, 0.2])
def test_a_smooth_coat_below_fuzz(cosine: float) -> None:
    """It reflects F of what the fuzz leaves."""
    fuzz = {"fuzz_weight": 0.7, "fuzz_roughness": 0.8}
    wo = direction(cosine, 0.3)
    left = 1 - integrate_sphere(lambda d: case({**BLACK, **fuzz}).eval(wo, d)[:, 0], hemisphere=True)
    s = case({**BLACK, **fuzz, "coat_weight": 0.6, "coat_ior": 1.8}).sample(wo, numbers(100_000))
    got = np.where(s.delta[:, None], s.weight, 0)
    assert_mean(got, left * 0.6 * fresnel(cosine, 1.8), comparisons=2, slack=0.01)


def test_what_is_nothing_but_mirrors() -> None:
    """Lights are not sampled for what has delta lobes alone: none of the layers may be forgotten."""
    mirror = {"base_metalness": 1.0, "specular_roughness": 0.0}
    rough_coat, rough_fuzz = {"coat_weight": 0.005, "coat_roughness": 0.5}, {"fuzz_weight": 0.1}
    for words, front, expected in (
        (mirror, True, True),
        ({**mirror, "coat_weight": 0.5}, True, True),
        ({**mirror, "specular_roughness": 0.2}, True, False),
        ({**mirror, "base_metalness": 0.9}, True, False),
        ({**mirror, **rough_coat}, True, False),
        ({**mirror, **rough_fuzz}, True, False),
        ({**mirror, "base_metalness": 1 - 1e-6}, True, True),  # shares of next to nothing are nothing
        ({**mirror, "fuzz_weight": 9e-6}, True, True),
        ({**mirror, "fuzz_weight": 2e-5}, True, False),
        ({**mirror, "base_metalness": 0.0, "transmission_weight": 1.0}, False, True),
        ({**mirror, "base_metalness": 0.0, "transmission_weight": 1.0, "coat_weight": 0.1, **rough_fuzz}, False, True),
        ({**mirror, "base_metalness": 0.0, "subsurface_weight": 0.2}, False, False),
    ):
        assert case(words, front=front).traits()["is_delta"] == expected, words


# --- thin film -------------------------------------------------------------------------------------------------------


def film_on(cosine: float, film: float, nanometres: float, wavelength: float, below: Callable[[float], Floats]) -> Any:
    """Airy's sum in complex numbers; `below`: the amplitudes of s and p, by the cosine inside the film."""
    inside = np.sqrt(1 - (1 - cosine**2) / film**2)
    above = [(cosine - film * inside) / (cosine + film * inside), (film * cosine - inside) / (film * cosine + inside)]
    turn = np.exp(4j * np.pi * film * nanometres * inside / wavelength)
    pairs = zip(above, below(inside), strict=True)
    return sum(np.abs((a + b * turn) / (1 + a * b * turn)) ** 2 for a, b in pairs) / 2


@pytest.mark.parametrize("cosine", [1.0, 0.4])
@pytest.mark.parametrize("nanometres", [120.0, 430.0])
def test_film_on_metal(nanometres: float, cosine: float) -> None:
    """The metal's amplitude is that of a denser medium of its reflectance; a film that covers half is half of it."""
    f0, tint = np.array([0.7, 0.5, 0.3]), np.array([0.9, 0.7, 1.0])
    words = {
        "base_metalness": 1.0, "base_color": f0, "specular_color": tint, "specular_roughness": 0.0,
        "thin_film_ior": 1.6, "thin_film_thickness": nanometres / 1000,
    }  # fmt: skip
    wo = direction(cosine, 0.1)

    def metal(c: float) -> Floats:
        return np.stack([-np.sqrt(f82(c, f0, tint)), np.sqrt(f82(c, f0, tint))])

    for nm in (440.0, 620.0):
        expected = film_on(cosine, 1.6, nanometres, nm, metal)
        got, _ = lobes(case({**words, "thin_film_weight": 1.0}, wavelength=nm), wo)
        np.testing.assert_allclose(got, expected, rtol=2e-3)
        half, _ = lobes(case({**words, "thin_film_weight": 0.5}, wavelength=nm), wo)
        np.testing.assert_allclose(half, 0.5 * expected + 0.5 * f82(cosine, f0, tint), rtol=2e-3)


@pytest.mark.parametrize("weight", [0.5, 1.0])
def test_film_on_glass_from_both_sides(weight: float) -> None:
    """The same share comes back along the same way, whichever side it comes from."""
    words = {
        "transmission_weight": 1.0, "specular_roughness": 0.0, "thin_film_weight": weight, "thin_film_ior": 1.8,
        "thin_film_thickness": 0.25,
    }  # fmt: skip
    for cosine in (1.0, 0.5):
        inside = np.sqrt(1 - (1 - cosine**2) / 1.5**2)
        out, _ = lobes(case(words, wavelength=510.0), direction(cosine, 0.1))
        back, _ = lobes(case(words, front=False, wavelength=510.0), direction(inside, 0.1))
        np.testing.assert_allclose(out, back, rtol=5e-3)
        if cosine == 1:
            covered = film_on(1.0, 1.8, 250.0, 510.0, lambda _: np.array([1, -1]) * (1.8 - 1.5) / (1.8 + 1.5))
            np.testing.assert_allclose(out, weight * covered + (1 - weight) * 0.04, rtol=5e-3)


@pytest.mark.parametrize("roughness", [0.1, 0.4, 0.8])
def test_the_base_gets_what_a_film_on_its_gloss_leaves(roughness: float) -> None:
    """White stays white within a twentieth, where the film reflects up to half of a colour and bare gloss a 25th."""
    film = {"thin_film_weight": 1.0, "thin_film_ior": 2.5, "thin_film_thickness": 0.3}
    words = {"base_color": 1.0, "specular_roughness": roughness, **film}
    for cosine in (1.0, 0.5, 0.15):
        wo = direction(cosine, 0.1)
        power = case(words).sample(wo, numbers(40_000)).power()
        np.testing.assert_allclose(power.mean(axis=0), 1, atol=0.06)
        gloss = case({**words, "base_color": 0.0}).sample(wo, numbers(40_000)).power()
        assert gloss.mean(axis=0).max() > 0.15
