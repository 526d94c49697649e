"""Colour: the curves against their formulas, the clamp, the tone curves' promises, what is not finite."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from destello.color import CURVES, Display, count_nonfinite, decode, encode, exposure_of_camera, luminance
from destello.color_spaces import PRIMARIES, WhiteBalance, rgb_to_xyz, white_xyz
from destello.errors import InputError
from destello.settings import RenderSettings
from destello.tones import TONES, tone_agx, tone_filmic, tone_neutral

GREYS = np.concatenate([[0.0], np.geomspace(1e-6, 1e4, 4000)]).astype(np.float32)


def grey(values: np.ndarray) -> np.ndarray:
    return np.repeat(values[:, None, None], 3, axis=2)


@pytest.mark.parametrize("x", [0.0, 0.001, 0.0031308, 0.0031309, 0.18, 0.5, 1.0])
def test_srgb_curve_is_iec_61966(x):
    expected = 12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055
    assert float(encode(x, "srgb")) == pytest.approx(expected, abs=2e-7)


@pytest.mark.parametrize(("curve", "power"), [("gamma2", 2.0), ("gamma2.2", 2.2), ("linear", 1.0)])
def test_gamma_curves(curve, power):
    x = np.linspace(0, 1, 257)
    assert np.allclose(encode(x, curve), x ** (1 / power), atol=1e-6)


@pytest.mark.parametrize("curve", CURVES)
def test_decode_inverts_encode_for_every_code(curve):
    codes = np.arange(65536, dtype=np.float32) / 65535
    assert np.array_equal(np.rint(encode(decode(codes, curve), curve) * 65535), np.arange(65536))


def test_eight_bit_codes_of_known_values():
    shown = Display().quantise(grey(np.array([0.0, 0.2140, 0.5, 1.0, 2.0, -1.0], dtype=np.float32)))
    assert shown[:, 0, 0].tolist() == [0, 127, 188, 255, 255, 0]
    assert shown.dtype == np.uint8


def test_gamma2_is_the_books_square_root():
    x = np.linspace(0, 1, 100, dtype=np.float32)
    shown = Display(curve="gamma2").quantise(grey(x))[:, 0, 0]
    assert np.array_equal(shown, np.floor(np.sqrt(x) * 255 + 0.5))


def test_sixteen_bits_round_to_nearest():
    x = np.array([0.5, 1.0, 1.5 / 65535, 1.4 / 65535], dtype=np.float32)
    assert Display(curve="linear").quantise(grey(x), 16)[:, 0, 0].tolist() == [32768, 65535, 2, 1]


def test_exposure_multiplies_before_the_clamp():
    x = grey(np.array([0.25, 0.01], dtype=np.float32))
    assert np.array_equal(Display(exposure=1).quantise(x), Display().quantise(2 * x))
    assert Display(exposure=3).quantise(x)[0, 0, 0] == 255


@pytest.mark.parametrize("tone", TONES)
@pytest.mark.parametrize("bits", [8, 16])
def test_what_is_not_finite_is_shown_and_counted(tone, bits):
    x = np.zeros((1, 5, 3), dtype=np.float32)
    x[0, :4, 0] = [math.nan, math.inf, -math.inf, 3e38]
    x[0, 4] = math.nan
    shown = Display(exposure=2, tone=tone).quantise(x, bits)
    assert count_nonfinite(x) == 4
    assert shown[0, 0].tolist() == [0, 0, 0]
    assert shown[0, 2].tolist() == [0, 0, 0]
    assert shown[0, 4].tolist() == [0, 0, 0]
    assert shown[0, 1, 0] == 2**bits - 1 or tone == "aces2"  # whose red primary is not at the corner
    assert np.array_equal(shown[0, 1], shown[0, 3])


@pytest.mark.parametrize("tone", TONES)
def test_tone_curves_rise_stay_bounded_and_keep_grey(tone):
    values = Display(tone=tone, curve="linear").code_values(grey(GREYS))
    assert np.all(values >= 0)
    assert np.all(values <= 1)
    assert np.ptp(values, axis=2).max() < 2e-6
    assert np.all(np.diff(values[:, 0, 1]) >= -1e-6)
    assert values[0, 0, 0] < 1e-6
    assert values[-1, 0, 0] > 0.99


@pytest.mark.parametrize("tone", TONES)
def test_tone_curves_stay_bounded_for_any_colour(tone):
    rng = np.random.default_rng(7)
    colours = np.exp(rng.uniform(-12, 12, (500, 40, 3))).astype(np.float32) * (rng.random((500, 40, 3)) > 0.2)
    values = Display(tone=tone, curve="linear").code_values(colours)
    assert np.isfinite(values).all()
    assert values.min() >= 0
    assert values.max() <= 1


def test_neutral_by_hand():
    """Below the start of compression only the 4 % of Fresnel reflection goes; above it the specification's formula."""
    assert np.allclose(tone_neutral([0.5, 0.3, 0.2]), [0.46, 0.26, 0.16], atol=1e-6)
    assert np.allclose(tone_neutral([0.04, 0.2, 0.2]), [0.01, 0.17, 0.17], atol=1e-6)
    peak = 2.0 - 0.04
    compressed = 1 - 0.24**2 / (peak + 0.24 - 0.76)
    white = 1 - 1 / (0.15 * (peak - compressed) + 1)
    low = (1.0 - 0.04) * compressed / peak
    expected = [compressed, low + (compressed - low) * white, low + (compressed - low) * white]
    assert np.allclose(tone_neutral([2.0, 1.0, 1.0]), expected, atol=1e-6)


def test_agx_middle_grey_and_published_matrix():
    assert np.allclose(tone_agx([0.18, 0.18, 0.18]), 0.5**2.2, atol=1e-5)
    assert np.allclose(tone_agx([0.18 * 2**-11] * 3), 0, atol=1e-6)
    assert np.allclose(tone_agx([0.18 * 2**7] * 3), 1, atol=1e-6)
    from destello.tones import _agx_matrices

    inset, outset = _agx_matrices()  # the published matrix is rounded differently by 1e-4
    assert np.allclose(inset[:, 0], [0.8425, 0.0423, 0.0424], atol=2e-4)
    assert np.allclose(inset.sum(axis=1), 1, atol=1e-6)
    assert np.allclose(inset @ outset, np.eye(3), atol=1e-6)


def test_filmic_by_hand():
    """Hable's curve with his constants, twice the radiance, 11.2 to white."""

    def curve(x):
        return (x * (0.22 * x + 0.03) + 0.002) / (x * (0.22 * x + 0.3) + 0.06) - 0.01 / 0.3

    for value in (0.0, 0.05, 0.18, 1.0, 4.0):
        expected = curve(2 * value) / curve(11.2)
        assert np.allclose(tone_filmic([value, 0, 0]), [expected, 0, 0], atol=1e-6)
    assert float(tone_filmic([5.6] * 3)[0]) == pytest.approx(1)


def test_raw_stores_the_numbers():
    x = np.array([[[0.25, 0.5, 2.0]]], dtype=np.float32)
    assert Display(tone="raw").quantise(x)[0, 0].tolist() == [64, 128, 255]


def test_exposure_of_a_camera():
    """ISO 12232's saturation: 1.2 times 2^EV100 is the brightest luminance."""
    sunny = exposure_of_camera(f_number=16, exposure_time=1 / 100)
    brightest = 78 / (0.65 * 100) * 16**2 * 100
    assert 2**sunny * brightest == pytest.approx(1)
    assert exposure_of_camera(f_number=16, exposure_time=1 / 50) == pytest.approx(sunny + 1)
    assert exposure_of_camera(f_number=16, exposure_time=1 / 100, iso=400) == pytest.approx(sunny + 2)
    assert exposure_of_camera(f_number=8, exposure_time=1 / 100) == pytest.approx(sunny + 2)


@pytest.mark.parametrize("value", [0, -1, math.inf, math.nan])
def test_wrong_camera_settings(value):
    with pytest.raises(InputError, match="f_number: out of range"):
        exposure_of_camera(f_number=value, exposure_time=1)


def test_the_look_of_a_scene():
    settings = RenderSettings(exposure=1, f_number=8, exposure_time=0.01, temperature=3000, tone="aces2")
    look = Display.of(settings)
    assert look.exposure == pytest.approx(1 + exposure_of_camera(f_number=8, exposure_time=0.01))
    assert (look.tone, look.white_balance) == ("aces2", WhiteBalance(3000))
    assert look.changed(exposure=2).white_balance == WhiteBalance(3000)
    with pytest.raises(InputError, match=r"^a.yaml: render: half a camera.*f_number"):
        Display.of(RenderSettings(exposure_time=0.01), Path("a.yaml"))
    with pytest.raises(InputError, match="half a camera"):
        Display.of(RenderSettings(iso=200))
    with pytest.raises(InputError, match="tint without a temperature"):
        Display.of(RenderSettings(tint=5))


def test_white_balance_makes_its_light_neutral_and_keeps_exposure():
    to_rgb = np.linalg.inv(rgb_to_xyz(*PRIMARIES["rec709"]))
    for balance in (WhiteBalance(2856), WhiteBalance(4000, -20), WhiteBalance(9000, 30)):
        light = to_rgb @ white_xyz(balance.white)
        shown = Display(tone="raw", white_balance=balance).code_values(0.5 * light)
        assert np.allclose(shown, 0.5, atol=1e-5)
        assert np.ptp(light) > 0.1


def test_agx_bleaches_bright_saturated_light():
    dim, bright = tone_agx([0.5, 0.0, 0.0]), tone_agx([50.0, 0.0, 0.0])
    assert bright[1] / bright[0] > dim[1] / dim[0] + 0.1


def test_bands_do_not_show():
    rng = np.random.default_rng(1)
    tall = rng.random((700, 3000, 3), dtype=np.float32) * 2
    shown = Display(tone="agx").quantise(tall)
    assert np.array_equal(shown[349:351], Display(tone="agx").quantise(tall[349:351]))


def test_luminance_of_white_is_one():
    assert float(luminance([1, 1, 1])) == pytest.approx(1)
    assert luminance(np.zeros((2, 3, 3))).shape == (2, 3)


@pytest.mark.parametrize(
    "options",
    [{"exposure": math.nan}, {"exposure": "bright"}, {"exposure": 1000}, {"tone": "aces"}, {"curve": "rec2020"}],
)
def test_wrong_options_are_named(options):
    with pytest.raises(InputError, match=str(next(iter(options.values()))).replace(".", r"\.")) as caught:
        Display(**options)
    assert "accepted" in str(caught.value)
