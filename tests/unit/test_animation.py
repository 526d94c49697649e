"""Keyframes: values between them against closed forms, words, refusals."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

import destello as dl
from destello.animation import Keys
from destello.errors import SceneError
from destello.transform import NotInvertible

TIMES = np.linspace(-1, 6, 71)


def shift(times: Any, values: Any, interpolation: str = "linear", **tangents: Any) -> dl.Animation:
    fields = {"times": times, "values": values, "interpolation": interpolation, **tangents}
    return dl.Animation.of({"translate": fields})


def spin(*keys: tuple[float, Any], interpolation: str = "linear") -> dl.Animation:
    return dl.keyframes("rotate", dict(keys), interpolation)


def about(axis: Any, angle: float) -> dict[str, Any]:
    return {"axis": axis, "angle": angle}


# --- between keyframes ------------------------------------------------------------------------------------------------


def test_linear_is_piecewise_linear_and_holds_beyond_its_ends() -> None:
    times, values = [0.5, 1.0, 4.0], np.array([[0, 1, 2], [3, -1, 2], [4, 5, 6.5]])
    animation = shift(times, values.tolist())
    for t in TIMES:
        expected = [np.interp(t, times, column) for column in values.T]
        np.testing.assert_allclose(animation.at(t).matrix[:3, 3], expected, atol=1e-12)
    assert animation.at(1.0).words == (("translate", (3.0, -1.0, 2.0)),), "exact at a keyframe"


def test_step_holds_until_the_next_keyframe() -> None:
    animation = shift([0, 1, 2], [[1, 0, 0], [2, 0, 0], [3, 0, 0]], "step")
    found = [animation.at(t).matrix[0, 3] for t in (-5, 0, 0.999, 1, 1.5, 2, 99)]
    assert found == [1, 1, 1, 2, 2, 3, 3]


def test_a_step_at_a_time_that_float32_rounds_up_is_not_a_frame_late() -> None:
    for frame in range(1, 200):
        animation = shift([0, float(np.float32(frame / 24))], [[0, 0, 0], [1, 0, 0]], "step")
        assert [animation.at(f / 24).matrix[0, 3] for f in (frame - 1, frame)] == [0, 1]


def test_two_keyframes_at_one_time_are_a_jump() -> None:
    animation = shift([0, 1, 1, 2], [[0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 0, 0]])
    assert animation.at(1 - 1e-9).matrix[0, 3] == pytest.approx(1)
    assert [animation.at(t).matrix[0, 3] for t in (0.5, 1, 1.5)] == [0.5, 5, 5.5]


def test_rotations_about_one_axis_turn_by_their_angle_any_number_of_times() -> None:
    animation = spin((0, about("y", 10)), (2, about("y", 730)))
    for t in np.linspace(0, 2, 21):
        assert animation.at(t).words == (("rotate", about((0.0, 1.0, 0.0), pytest.approx(10 + 360 * t))),)


@pytest.mark.parametrize("flipped", [1, -1])
def test_other_rotations_take_the_shorter_way_at_constant_speed(flipped: int) -> None:
    turns = Rotation.random(5, rng=3)
    quaternions = turns.as_quat() * np.array([1, flipped, 1, flipped, 1])[:, None]
    animation = spin(*((float(i), tuple(q)) for i, q in enumerate(quaternions)))
    theirs = Slerp(range(5), turns)
    for t in np.linspace(0, 4, 41):
        np.testing.assert_allclose(animation.at(t).matrix[:3, :3], theirs(t).as_matrix(), atol=1e-9)


def test_slerp_in_closed_form() -> None:
    """From no turn to 90 degrees about x, after 90 about y: both are 120 degrees about a diagonal."""
    q = Rotation.from_euler("yx", [90, 90], degrees=True).as_quat()
    animation = spin((0, about("z", 0)), (1, tuple(q)))
    axis = q[:3] / np.linalg.norm(q[:3])
    for u in (0.0, 0.25, 0.5, 1.0):
        expected = dl.rotate(axis, 120 * u).matrix
        np.testing.assert_allclose(animation.at(u).matrix, expected, atol=1e-12)
    assert math.degrees(2 * math.acos(abs(q[3]))) == pytest.approx(120)


def test_axis_and_angle_mix_with_quaternions() -> None:
    half = math.sqrt(0.5)
    mixed = spin((0, about("y", 0)), (1, (0, half, 0, half)), (2, about("x", 90)))
    np.testing.assert_allclose(mixed.at(0.5).matrix, dl.rotate("y", 45).matrix, atol=1e-12)
    np.testing.assert_allclose(mixed.at(1).matrix, dl.rotate("y", 90).matrix, atol=1e-12)
    assert mixed.at(2) == dl.rotate("x", 90)
    nearly = spin((0, (0, 0, 0, 1)), (1, (1e-8, 0, 0, 1)))
    np.testing.assert_allclose(nearly.at(0.5).matrix, np.eye(4), atol=1e-7)


def test_cubic_is_the_hermite_spline(rng: np.random.Generator) -> None:
    times = np.array([0, 0.5, 2, 5])
    values, into, out = rng.standard_normal((3, 4, 3))
    animation = shift(times, values.tolist(), "cubic", in_tangents=into.tolist(), out_tangents=out.tolist())
    for i in range(3):
        theirs = CubicHermiteSpline(times[i : i + 2], values[i : i + 2], [out[i], into[i + 1]])
        for t in np.linspace(times[i], times[i + 1], 17):
            np.testing.assert_allclose(animation.at(t).matrix[:3, 3], theirs(t), atol=1e-12)
    assert np.array_equal(animation.at(-1).matrix[:3, 3], values[0])
    assert np.array_equal(animation.at(9).matrix[:3, 3], values[3])


def test_cubic_rotations_are_normalized_splines_of_quaternions(rng: np.random.Generator) -> None:
    values = Rotation.random(2, rng=rng).as_quat()
    into, out = rng.standard_normal((2, 2, 4))
    fields = {"times": [1, 3], "values": values.tolist(), "interpolation": "cubic"}
    animation = dl.Animation.of({"rotate": {**fields, "in_tangents": into.tolist(), "out_tangents": out.tolist()}})
    theirs = CubicHermiteSpline([1, 3], values, [out[0], into[1]])
    for t in np.linspace(1, 3, 9):
        np.testing.assert_allclose(animation.at(t).matrix[:3, :3], Rotation(theirs(t)).as_matrix(), atol=1e-12)


def test_scales_are_numbers_or_triples() -> None:
    animation = dl.keyframes("scale", {0: 1, 2: (3, 1, 5)})
    assert np.array_equal(np.diag(animation.at(1).matrix), [2, 1, 3, 1])
    with pytest.raises(NotInvertible):
        dl.keyframes("scale", {0: 0, 1: 1}).at(0)


# --- words ------------------------------------------------------------------------------------------------------------


def test_words_apply_first_to_last() -> None:
    around = spin((0, about("y", 0)), (1, about("y", 90)))
    orbit = around @ dl.translate(1, 0, 0)  # first out, then around
    np.testing.assert_allclose(orbit.at(1).matrix[:3, 3], [0, 0, -1], atol=1e-12)
    inside = dl.translate(1, 0, 0) @ around
    assert np.array_equal(inside.at(1).matrix[:3, 3], [1, 0, 0])
    both = dl.keyframes("translate", {0: (0, 0, 0), 1: (0, 2, 0)}) @ orbit
    np.testing.assert_allclose(both.at(1).matrix, dl.translate(0, 2, 0).matrix @ orbit.at(1).matrix)
    assert (both.seconds, len(both.keys)) == (1, 2)
    with pytest.raises(TypeError):
        both @ 3
    with pytest.raises(TypeError):
        3 @ both


def test_they_are_values() -> None:
    a = spin((0, about("y", 0)), (1.5, (0, 0, 0, 1)))
    assert a == pickle.loads(pickle.dumps(a)) == dl.Animation.of(a) == dl.Animation.of(a.to_list())
    assert hash(a) == hash(dl.Animation.of(a.to_list()))
    assert a != spin((0, about("y", 0)), (1, (0, 0, 0, 1)))
    assert a != dl.rotate("y", 0)
    assert eval(repr(a), {"Animation": dl.Animation, "Keys": Keys}) == a
    with pytest.raises(AttributeError, match="do not change"):
        a.words = ()


def test_what_steps_keeps_the_value_that_it_had_when_the_frame_began() -> None:
    keys = {0: (0, 0, 0), 1: (1, 0, 0)}
    animation = dl.keyframes("translate", keys) @ dl.keyframes("translate", keys, "step")
    assert animation.words_at(1.0, opened=0.5) == (("translate", (0.0, 0.0, 0.0)), ("translate", (1.0, 0.0, 0.0)))


KEYS = {"times": [0, 1], "values": [[0, 0, 0], [1, 0, 0]]}
REFUSED: list[tuple[Any, str]] = [
    (3, "not an animation: 3 (accepted: a list of words, of which translate, rotate, scale may have keyframes)"),
    ([], "no keyframes"),
    ({"translate": [0, 0, 0]}, "no keyframes: ['translate'] (accepted: translate, rotate, scale with {times, values})"),
    ({"shear": KEYS}, "cannot have keyframes: 'shear' (accepted: translate, rotate, scale)"),
    ({"trnslate": [1, 2, 3]}, "did you mean 'translate'?"),
    ({"translate": {**KEYS, "tims": 1}}, "translate: unknown name: 'tims' (accepted: did you mean 'times'?"),
    ({"translate": {"times": [0]}}, "translate: values is missing"),
    ({"translate": {**KEYS, "times": []}}, "translate.times: no keyframes"),
    ({"translate": {**KEYS, "times": 3}}, "translate.times: not a list: 3"),
    ({"translate": {**KEYS, "times": [0, "1"]}}, "translate.times[1]: not a number: '1'"),
    ({"translate": {**KEYS, "times": [0, math.nan]}}, "translate.times[1]: not a finite number"),
    ({"translate": {**KEYS, "times": [1, 0.5]}}, "translate.times[1]: times run backwards: 0.5 (accepted: at least 1"),
    ({"translate": {**KEYS, "times": [0]}}, "translate.values: wrong number of values: 2 (accepted: 1, one a time)"),
    ({"translate": {"times": [0], "values": [[1, 2]]}}, "translate.values[0]: not 3 numbers: [1, 2]"),
    ({"translate": {**KEYS, "interpolation": "linaer"}}, "translate.interpolation: unknown choice: 'linaer'"),
    (
        {"translate": {**KEYS, "interpolation": "cubic"}},
        "translate.in_tangents: wrong number of values: 0 (accepted: 2",
    ),
    ({"translate": {**KEYS, "in_tangents": [[0, 0, 0]]}}, "translate.in_tangents: wrong number of values: 1"),
    ([{"scale": 2}, {"rotate": {"times": [0], "values": [90]}}], "[1].rotate.values[0]: not a rotation: 90"),
    ({"rotate": {"times": [0], "values": [about("w", 1)]}}, "rotate.values[0].axis: unknown axis: 'w'"),
    ({"rotate": {"times": [0], "values": [[0, 0, 0, 0]]}}, "rotate.values[0]: a rotation without direction"),
    (
        {"rotate": {"times": [0], "values": [about("x", 1)], "interpolation": "cubic"}},
        "not a rotation: {'axis': 'x', 'angle': 1} (accepted: a quaternion [x, y, z, w])",
    ),
    ([("translate", Keys("scale", (0,), (1,)))], "not an animation"),
]


@pytest.mark.parametrize(("value", "message"), REFUSED)
def test_refusals_name_place_value_and_what_would_do(value: Any, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        dl.Animation.of(value)
    assert message in str(caught.value)


def test_keys_belong_to_their_word() -> None:
    with pytest.raises(SceneError, match="keyframes of another word: 'scale'"):
        dl.Animation([("translate", Keys("scale", (0.0,), (1.0,)))])
