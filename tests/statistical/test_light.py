"""Punctual lights: sampling against density, irradiance against closed forms, power against what is emitted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from destello import _core
from stats import assert_mean, chi2_directions

testing = _core.testing
Array = NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
COLOR = (3.0, 2.0, 0.5)

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    # every light of the list with its defaults, and what shows more of it
    **{name: (name, {}) for name in testing.LIGHTS},
    "point by power": ("point", {"position": (1, 2, 3), "intensity": COLOR, "quantity": "power"}),
    "spot tilted": (
        "spot",
        {"position": (1, 2, 3), "target": (2, 0, 1), "intensity": COLOR, "cone_angle": 50, "edge": 1},
    ),
    "spot narrow": ("spot", {"cone_angle": 0.5, "edge": 0.5}),
    "spot hard": ("spot", {"cone_angle": 90, "edge": 0, "quantity": "power"}),
    "sun": ("directional", {"direction": (1, -2, 0.5), "irradiance": COLOR, "angular_diameter": 0.53}),
    "half the sky": ("directional", {"direction": (0.3, -1, 0.5), "irradiance": COLOR, "angular_diameter": 180}),
    "wide": ("directional", {"direction": (0, 0, 7), "angular_diameter": 60}),
    "tiny": ("directional", {"direction": (3, 1, 1), "angular_diameter": 0.02}),
}
EXTENDED = [name for name, (kind, params) in CASES.items() if not testing.light_power(kind, params)[1]]


def on_grid(u: Array) -> NDArray[np.float32]:
    return np.ascontiguousarray((np.floor(u * 2**24) / 2**24).astype(np.float32))


def rows(*vectors: Any) -> NDArray[np.float32]:
    return np.ascontiguousarray(vectors, dtype=np.float32)


def sample(case: str, p: Any, u: Array, transform: Any = None) -> dict[str, Array]:
    kind, params = CASES[case]
    points = np.ascontiguousarray(np.broadcast_to(np.asarray(p, np.float32), (len(u), 3)))
    drawn = testing.light_sample(kind, params, points, on_grid(u), transform)
    return {k: v if v.dtype == bool else v.astype(np.float64) for k, v in drawn.items()}


@pytest.mark.parametrize("case", CASES)
def test_samples_keep_their_promises(case: str, rng: np.random.Generator) -> None:
    kind, params = CASES[case]
    u = np.concatenate([rng.random((20_000, 2)), np.array([[0, 0], [1, 1], [0, 1], [1, 0]]) * (1 - 2.0**-24)])
    s = sample(case, rng.normal(0, 3, (len(u), 3)), u)
    good = s["pdf"] > 0
    assert np.all(s["radiance"][~good] == 0)
    assert good.any() or kind == "spot"  # a narrow beam may miss every point
    assert np.allclose(np.linalg.norm(s["wi"][good], axis=1), 1, atol=1e-6)
    assert np.isfinite(s["radiance"]).all()
    assert s["radiance"].min() >= 0
    assert np.all(s["pdf"][s["delta"]] == 1)
    _, is_delta = testing.light_power(kind, params)
    assert np.all(s["delta"][good] == is_delta)
    if kind == "directional":
        assert good.all()
        assert np.all(np.isinf(s["distance"]))


@pytest.mark.parametrize("case", [c for c in CASES if c not in EXTENDED])
def test_delta_lights_cannot_be_hit(case: str) -> None:
    kind, params = CASES[case]
    w = testing.equirect_to_direction(on_grid(np.random.default_rng(0).random((1000, 2))))
    radiance, pdf = testing.light_eval(kind, params, w)
    assert not radiance.any()
    assert not pdf.any()


@pytest.mark.parametrize("case", EXTENDED)
def test_direction_sampling_follows_the_density(case: str) -> None:
    kind, params = CASES[case]
    result = chi2_directions(
        lambda u: sample(case, (0, 0, 0), u)["wi"],
        lambda w: testing.light_eval(kind, params, w)[1],
        seed=3,
        samples=100_000,
        dimensions=2,
    )
    result.check(comparisons=len(EXTENDED))


@pytest.mark.parametrize("case", EXTENDED)
def test_rays_see_what_was_sampled(case: str, rng: np.random.Generator) -> None:
    kind, params = CASES[case]
    s = sample(case, (0, 0, 0), rng.random((50_000, 2)))
    radiance, pdf = testing.light_eval(kind, params, np.ascontiguousarray(s["wi"].astype(np.float32)))
    # A sample on the rim itself may round to the other side of it.
    half_angle = np.radians(params["angular_diameter"] / 2)
    axis = -np.asarray(params["direction"]) / np.linalg.norm(params["direction"])
    from_axis = 2 * np.arcsin(np.linalg.norm(s["wi"] - axis, axis=1) / 2)
    inside = from_axis < half_angle - 1e-6
    assert inside.mean() > 0.97
    assert np.array_equal(pdf[inside], s["pdf"][inside].astype(np.float32))
    assert np.array_equal(radiance[inside], s["radiance"][inside].astype(np.float32))
    just_outside = np.ascontiguousarray(
        (axis * np.cos(half_angle + 1e-4) + perpendicular(axis) * np.sin(half_angle + 1e-4))[None]
    )
    assert not testing.light_eval(kind, params, just_outside.astype(np.float32))[1].any()


def perpendicular(axis: Array) -> Array:
    v = np.cross(axis, [0.3, 0.5, 0.9])
    return v / np.linalg.norm(v)


# --- irradiance -------------------------------------------------------------------------------------------------------


def test_point_light_falls_off_with_distance_squared() -> None:
    params = {"position": (1, 2, 3), "intensity": COLOR}
    p = rows((1, 0, 3), (1, 2, 8), (4, 6, 3), (1, 2, 3))
    s = testing.light_sample("point", params, p, np.zeros((4, 2), np.float32))
    distance = np.array([2, 5, 5])
    assert np.allclose(s["distance"][:3], distance)
    assert np.allclose(s["radiance"][:3], np.outer(1 / distance**2, COLOR), rtol=1e-6)
    assert np.allclose(s["wi"][:3], [(0, 1, 0), (0, 0, -1), (-0.6, -0.8, 0)], atol=1e-6)
    assert s["pdf"][3] == 0  # on the light itself there is no direction


def test_point_light_works_from_millimetres_to_kilometres() -> None:
    for scale in (1e-3, 1, 1e6):
        p = rows((0.6 * scale, 0, 0.8 * scale))
        s = testing.light_sample("point", {"intensity": COLOR}, p, np.zeros((1, 2), np.float32))
        assert np.allclose(s["radiance"][0] * scale**2, COLOR, rtol=1e-5)


def smoothstep(x: Array) -> Array:
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


@pytest.mark.parametrize(("cone", "edge"), [(30, 0.2), (60, 1), (89, 0.01), (1, 0.5), (40, 0)])
def test_spot_light_has_the_cone_it_declares(cone: float, edge: float) -> None:
    angles = np.radians(np.linspace(0, 120, 601))
    p = np.stack([np.sin(angles), np.zeros_like(angles), -np.cos(angles)], -1) * 2
    params = {"intensity": COLOR, "cone_angle": cone, "edge": edge}
    s = testing.light_sample("spot", params, rows(*p), np.zeros((len(p), 2), np.float32))
    cos_outer, cos_inner = np.cos(np.radians(cone)), np.cos(np.radians(cone * (1 - edge)))
    if edge > 0:
        expected = smoothstep((np.cos(angles) - cos_outer) / (cos_inner - cos_outer))
    else:
        expected = (angles < np.radians(cone)).astype(np.float64)
    away = np.abs(angles - np.radians(cone)) > 1e-4  # from a hard rim
    assert np.allclose(s["radiance"][away], np.outer(expected, COLOR)[away] / 4, atol=2e-3 if cone == 1 else 2e-5)
    assert np.array_equal(s["pdf"] > 0, s["radiance"].any(axis=1))


@pytest.mark.parametrize("case", [c for c, (kind, _) in CASES.items() if kind in ("point", "spot")])
def test_power_is_what_the_light_emits(case: str, rng: np.random.Generator) -> None:
    kind, params = CASES[case]
    position = np.asarray(params.get("position", (0, 0, 0)))
    # Cells of a grid about the beam; a spot shines nowhere else.
    axis = np.asarray(params.get("target", (0, 0, -1))) - position
    axis = axis / np.linalg.norm(axis)
    reach = 1 - np.cos(np.radians(params.get("cone_angle", 30))) if kind == "spot" else 2
    h, turn = (rng.random(400_000) * reach, rng.random(400_000) * 2 * np.pi)
    side = perpendicular(axis)
    r = np.sqrt(h * (2 - h))
    w = (
        (1 - h)[:, None] * axis
        + (r * np.cos(turn))[:, None] * side
        + (r * np.sin(turn))[:, None] * np.cross(axis, side)
    )
    s = sample(case, (position + w).astype(np.float32), rng.random((len(w), 2)))
    emitted = s["radiance"] @ LUMINANCE * (s["distance"] ** 2) * 2 * np.pi * reach
    power, _ = testing.light_power(kind, params)
    assert_mean(np.where(s["pdf"] > 0, emitted, 0), power, slack=3e-3 if case == "spot narrow" else 1e-4)
    if params.get("quantity") == "power":
        assert power == pytest.approx(float(LUMINANCE @ params.get("intensity", (1, 1, 1))), rel=1e-5)


@pytest.mark.parametrize("case", [c for c, (kind, _) in CASES.items() if kind == "directional"])
def test_directional_light_gives_its_irradiance(case: str, rng: np.random.Generator) -> None:
    _, params = CASES[case]
    toward = -np.asarray(params.get("direction", (0, -1, 0)), np.float64)
    toward /= np.linalg.norm(toward)
    irradiance = np.asarray(params.get("irradiance", (1, 1, 1)))
    s = sample(case, (5, 6, 7), rng.random((100_000, 2)))
    estimates = s["radiance"] / s["pdf"][:, None]
    diameter = params.get("angular_diameter", 0)
    for tilt in (0, 40):  # of the plane; the whole disk stays above it
        if tilt + diameter / 2 > 90:
            continue
        normal = toward * np.cos(np.radians(tilt)) + perpendicular(toward) * np.sin(np.radians(tilt))
        cosine = np.maximum(s["wi"] @ normal, 0)[:, None]
        assert_mean(estimates * cosine, irradiance * np.cos(np.radians(tilt)), comparisons=10, slack=1e-4)


def test_directional_power_is_what_enters_the_scene() -> None:
    params = {"irradiance": COLOR}
    power, is_delta = testing.light_power("directional", params, 3.0)
    assert power == pytest.approx(np.pi * 9 * float(LUMINANCE @ COLOR), rel=1e-6)
    assert is_delta


def test_a_small_disk_is_as_bright_as_its_rays_together() -> None:
    params = {"irradiance": COLOR, "angular_diameter": 0.53}
    radiance, pdf = testing.light_eval("directional", params, rows((0, 1, 0)))
    solid_angle = 2 * np.pi * (1 - np.cos(np.radians(0.265)))
    assert pdf[0] == pytest.approx(1 / solid_angle, rel=1e-5)
    assert np.allclose(radiance[0], np.asarray(COLOR) / (np.pi * np.sin(np.radians(0.265)) ** 2), rtol=1e-5)


# --- transforms and bad parameters ------------------------------------------------------------------------------------


def test_transforms_move_lights_and_leave_their_strength_alone() -> None:
    matrix = rows((0, 0, 2, 10), (0, 2, 0, 0), (-2, 0, 0, 0))  # scale by 2, quarter turn about y, shift
    zero = np.zeros((1, 2), np.float32)
    point = testing.light_sample("point", {"position": (1, 0, 0), "intensity": COLOR}, rows((10, 0, 0)), zero, matrix)
    assert np.allclose(point["wi"], (0, 0, -1), atol=1e-6)
    assert np.allclose(point["radiance"], np.asarray(COLOR) / 4)
    spot = testing.light_sample("spot", {"intensity": COLOR}, rows((7, 0, 0)), zero, matrix)  # it shines along -x now
    assert np.allclose(spot["radiance"], np.asarray(COLOR) / 9)
    sun = testing.light_sample("directional", {"direction": (0, 0, -1)}, rows((0, 0, 0)), zero, matrix)
    assert np.allclose(sun["wi"], (1, 0, 0), atol=1e-6)
    assert np.allclose(sun["radiance"], 1)


@pytest.mark.parametrize(
    ("kind", "params", "message"),
    [
        ("spot", {"position": (1, 2, 3), "target": (1, 2, 3)}, "target must differ"),
        ("directional", {"direction": (0, 0, 0)}, "direction must not be 0"),
    ],
)
def test_contradictory_parameters_are_told(kind: str, params: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        testing.light_power(kind, params)
