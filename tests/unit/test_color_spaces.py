"""Colour spaces, texels, white points and OpenColorIO: against published numbers and OpenColorIO itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PyOpenColorIO as OCIO
import pytest

from destello.color import Display
from destello.color_spaces import (
    ENCODINGS,
    PRIMARIES,
    WORKING_SPACES,
    WhiteBalance,
    adaptation,
    camera_decode,
    conversion,
    converted,
    srgb_decode,
    texels_in,
    white_xyz,
)
from destello.errors import InputError
from destello.ocio import View, tone_aces2
from destello.python_types import RENDER
from destello.schema import schema
from destello.tones import TONES

COLORS = np.array([[0.2, 0.5, 0.8], [1, 0, 0], [0, 1, 0.1], [4, 0.3, 0.02], [0.18, 0.18, 0.18]], np.float32)
OCIO_NAMES = {
    "rec709": "Linear Rec.709 (sRGB)",
    "rec2020": "Linear Rec.2020",
    "p3": "Linear P3-D65",
    "acescg": "ACEScg",
    "aces2065-1": "ACES2065-1",
}
CONFIG = "cg-config-v4.0.0_aces-v2.0_ocio-v2.5"


def ocio(transform_or_source, target=None):
    """OpenColorIO's own processor, applied to COLORS."""
    config = OCIO.Config.CreateFromBuiltinConfig(CONFIG)
    processor = config.getProcessor(transform_or_source, *([] if target is None else [target]))
    pixels = COLORS.copy()
    processor.getDefaultCPUProcessor().applyRGB(pixels)
    return pixels


@pytest.mark.parametrize("source", PRIMARIES)
@pytest.mark.parametrize("target", PRIMARIES)
def test_matrices_are_opencolorios(source, target):
    expected = ocio(OCIO_NAMES[source], OCIO_NAMES[target])
    np.testing.assert_allclose(converted(COLORS, source, target), expected, atol=2e-5, rtol=2e-5)
    np.testing.assert_allclose(conversion(source, target) @ conversion(target, source), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(conversion(source, target) @ [1, 1, 1], 1, atol=1e-12)


def test_rec709_lies_within_acescg():
    assert conversion("rec709", "acescg").min() > 0


def test_adaptation_moves_the_white():
    a, b = (0.44758, 0.40745), (0.3127, 0.3290)
    np.testing.assert_allclose(adaptation(a, b) @ white_xyz(a), white_xyz(b), atol=1e-12)


def test_known_whites():
    np.testing.assert_allclose(WhiteBalance(2856).white, (0.44758, 0.40745), atol=4e-4)  # CIE illuminant A
    np.testing.assert_allclose(WhiteBalance(6504, 10).white, (0.3127, 0.3290), atol=3e-4)  # D65
    assert WhiteBalance(5000, 20).white[1] > WhiteBalance(5000).white[1]


@pytest.mark.parametrize("values", [(999,), (15001,), (5000, 151), (float("nan"),)])
def test_wrong_white_balance(values):
    with pytest.raises(InputError, match="accepted: from"):
        WhiteBalance(*values)


def test_camera_curve_at_its_joint_and_ends():
    assert float(camera_decode(0.081)) == pytest.approx(0.018, abs=1e-4)
    assert float(camera_decode(1.0)) == pytest.approx(1)
    assert float(camera_decode(0.5)) == pytest.approx(((0.5 + 0.0993) / 1.0993) ** (1 / 0.45), abs=1e-5)


# --- texels -----------------------------------------------------------------------------------------------------------


def linear_of(texels, srgb):
    values = texels.astype(np.float32) / (np.iinfo(texels.dtype).max if texels.dtype.kind == "u" else 1)
    values[..., :3] = srgb_decode(values[..., :3]) if srgb else values[..., :3]
    return values


@pytest.mark.parametrize("working", WORKING_SPACES)
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_texels_mean_the_same_colour(rng, encoding, working, dtype):
    values = rng.random((5, 7, 4), dtype=np.float32)
    texels = values if dtype is np.float32 else np.rint(values * np.iinfo(dtype).max).astype(dtype)
    made, srgb = texels_in(texels, encoding, working)
    given = linear_of(texels, srgb=False)
    primaries, decode = ENCODINGS[encoding]
    expected = np.maximum(converted(decode(given[..., :3]), primaries, working), 0)
    if dtype is not np.float32:
        expected = np.minimum(expected, 1)
    np.testing.assert_allclose(linear_of(made, srgb)[..., :3], expected, atol=2e-5)
    np.testing.assert_allclose(linear_of(made, srgb)[..., 3], given[..., 3], atol=2e-5)


def test_texels_that_the_core_can_read_are_left_alone(rng):
    texels = rng.integers(0, 256, (3, 3, 3), dtype=np.uint8)
    for encoding, srgb in (("srgb", True), ("linear", False)):
        made, is_srgb = texels_in(texels, encoding, "rec709")
        assert made is texels
        assert is_srgb == srgb
    assert texels_in(texels[..., :1], "display_p3", "acescg")[0].shape == (3, 3, 1)
    assert not texels_in(texels.astype(np.float32), "acescg", "acescg")[1]


# --- OpenColorIO ------------------------------------------------------------------------------------------------------


def test_aces2_is_opencolorios():
    transform = OCIO.DisplayViewTransform(
        src=OCIO_NAMES["rec709"], display="sRGB - Display", view="ACES 2.0 - SDR 100 nits (Rec.709)"
    )
    expected = np.clip(ocio(transform), 0, 1)
    np.testing.assert_allclose(Display(tone="aces2").code_values(COLORS), expected, atol=2e-4)
    assert tone_aces2(COLORS).dtype == np.float32


@pytest.mark.parametrize("view", ["Un-tone-mapped", "ACES 2.0 - SDR 100 nits (Rec.709)"])
def test_a_view_is_opencolorios(view):
    display = "Display P3 - Display"
    chosen = view if view == "Un-tone-mapped" else "ACES 2.0 - SDR 100 nits (P3 D65)"
    transform = OCIO.DisplayViewTransform(src=OCIO_NAMES["rec709"], display=display, view=chosen)
    look = Display(view=View(f"ocio://{CONFIG}", display, chosen), exposure=0)
    np.testing.assert_allclose(look.code_values(COLORS), np.clip(ocio(transform), 0, 1), atol=2e-4)
    assert look.code_values(COLORS.reshape(1, -1, 3)).shape == (1, 5, 3)


def test_defaults_of_a_configuration():
    view = View()
    assert (view.display, view.view) == ("sRGB - Display", "ACES 2.0 - SDR 100 nits (Rec.709)")


OWN = """ocio_profile_version: 2
environment: {{}}
search_path: ""
roles: {{default: ap0, {roles}}}
displays:
  mine:
    - !<View> {{name: root, colorspace: out}}
colorspaces:
  - !<ColorSpace> {{name: ap0}}
  - !<ColorSpace> {{name: xyz}}
  - !<ColorSpace> {{name: out, from_scene_reference: !<ExponentTransform> {{value: [2, 2, 2, 1]}}}}
"""


def test_a_configuration_of_ones_own(tmp_path: Path):
    """Its reference space is ACES2065-1, by the interchange role; squared."""
    path = tmp_path / "own.ocio"
    path.write_text(OWN.format(roles="aces_interchange: ap0"))
    shown = Display(view=View(str(path))).code_values(COLORS)
    expected = np.clip(np.maximum(converted(COLORS, "rec709", "aces2065-1"), 0) ** 2, 0, 1)
    np.testing.assert_allclose(shown, expected, atol=1e-4)


def test_wrong_configurations(tmp_path: Path):
    path = tmp_path / "own.ocio"
    path.write_text(OWN.format(roles="scene_linear: ap0"))
    with pytest.raises(InputError, match="aces_interchange"):
        View(str(path))
    bad = tmp_path / "bad.ocio"
    bad.write_text("no: config")
    with pytest.raises(InputError, match="not a usable OpenColorIO configuration"):
        View(str(bad))
    for given, message in (
        ({"config": str(tmp_path / "none.ocio")}, "no such OpenColorIO configuration"),
        ({"config": "ocio://none"}, "none"),
        ({"display": "sRGB Display"}, "did you mean 'sRGB - Display'"),
        ({"view": "Raww"}, "did you mean 'Raw'"),
    ):
        with pytest.raises(InputError, match=message):
            View(**given)
    broken = tmp_path / "broken.ocio"
    broken.write_text(OWN.format(roles="aces_interchange: ap0").replace("colorspace: out", "colorspace: gone"))
    with pytest.raises(InputError, match="cannot show this"):
        View(str(broken))
    with pytest.raises(InputError, match="its own tone"):
        Display(tone="agx", view=View())


def test_a_view_and_a_tone_take_each_others_place():
    look = Display(tone="agx").changed(view=View())
    assert look.view is not None
    assert look.changed(tone="neutral").view is None
    assert look.changed(exposure=1).view is not None


# --- the tables of scene files ----------------------------------------------------------------------------------------


def test_names_in_scene_files_are_those_that_exist():
    image = schema().type("texture", "image")
    assert set(image.params["color_space"].choices) == {"auto", "raw", *ENCODINGS}
    assert RENDER.params["working_space"].choices == WORKING_SPACES
    assert RENDER.params["tone"].choices == tuple(TONES)
