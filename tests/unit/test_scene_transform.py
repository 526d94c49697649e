"""Transforms: words, matrices, composition, refusals."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import destello as dl
from destello.errors import SceneError

CALLS = ("Transform", "translate", "rotate", "scale", "shear", "look_at", "matrix")
numbers = st.floats(-1e3, 1e3)
triples = st.tuples(numbers, numbers, numbers)
factors = st.floats(0.1, 10) | st.floats(-10, -0.1)


@st.composite
def transforms(draw: st.DrawFn) -> dl.Transform:
    """Any product of up to four words."""
    words = [
        triples.map(lambda v: dl.translate(*v)),
        st.builds(dl.rotate, st.sampled_from("xyz") | triples.filter(any), numbers),
        st.builds(dl.scale, factors) | st.builds(dl.scale, factors, factors, factors),
        st.builds(lambda v: dl.shear(xy=v), st.floats(-2, 2)),
        st.builds(dl.look_at, st.just((0.0, 0.0, 0.0)), triples.filter(lambda v: abs(v[0]) + abs(v[2]) > 1)),
    ]
    made = dl.Transform()
    for word in draw(st.lists(st.one_of(words), max_size=4)):
        made = made @ word
    return made


def apply(transform: dl.Transform, *point: float) -> Any:
    return (transform.matrix @ [*point, 1])[:3]


def test_words() -> None:
    assert np.array_equal(dl.Transform().matrix, np.eye(4))
    assert np.array_equal(apply(dl.translate(1, 2, 3), 1, 1, 1), [2, 3, 4])
    assert np.array_equal(apply(dl.scale(2), 1, 2, 3), [2, 4, 6])
    assert np.array_equal(apply(dl.scale(2, 1, -1), 1, 2, 3), [2, 2, -3])
    assert np.array_equal(apply(dl.shear(xy=0.5, zx=2), 1, 2, 3), [2, 2, 5])
    rows = [[1, 2, 0, 4], [0, 1, 0, 5], [0, 0, 1, 6]]
    assert np.array_equal(dl.matrix(rows).matrix[:3], rows)
    assert dl.matrix([*rows, [0, 0, 0, 1]]) == dl.matrix(np.array(rows))


@pytest.mark.parametrize(("axis", "point"), [("x", (0, 0, 1)), ("y", (1, 0, 0)), ("z", (0, 1, 0))])
def test_rotation_is_counter_clockwise_and_exact_for_right_angles(axis: str, point: tuple[int, int, int]) -> None:
    start = {"x": (0, 1, 0), "y": (0, 0, 1), "z": (1, 0, 0)}[axis]
    assert np.array_equal(apply(dl.rotate(axis, 90), *start), point)
    assert np.array_equal(dl.rotate(axis, 450).matrix, dl.rotate(axis, -270).matrix)
    assert np.array_equal(dl.rotate(axis, 360).matrix, np.eye(4))


def test_rotation_about_any_axis() -> None:
    turn = dl.rotate((1, 1, 1), 120).matrix[:3, :3]
    assert np.allclose(turn, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)
    assert np.allclose(turn, dl.rotate((1e-30, 1e-30, 1e-30), 120).matrix[:3, :3], atol=1e-15)


def test_look_at() -> None:
    placed = dl.look_at((1, 2, 3), (1, 2, 8)).matrix
    assert np.allclose(placed[:3, 2], [0, 0, 1])  # z towards the target
    assert np.allclose(placed[:3, 1], [0, 1, 0])
    assert np.allclose(placed[:3, 3], [1, 2, 3])
    assert np.isclose(np.linalg.det(dl.look_at((0, 0, 0), (3, -2, 1), (0, 0, 1)).matrix[:3, :3]), 1)


@given(transforms(), transforms())
def test_product_is_that_of_the_matrices(a: dl.Transform, b: dl.Transform) -> None:
    assert np.allclose((a @ b).matrix, a.matrix @ b.matrix, rtol=1e-9, atol=1e-6)


@given(transforms())
def test_words_tell_everything(transform: dl.Transform) -> None:
    again = dl.Transform.of(transform.to_list())
    assert again == transform
    assert hash(again) == hash(transform)
    assert np.array_equal(again.matrix, transform.matrix)
    assert pickle.loads(pickle.dumps(transform)) == transform
    assert eval(repr(transform), {name: getattr(dl, name) for name in CALLS}) == transform


def test_inverse() -> None:
    transform = dl.translate(1, 2, 3) @ dl.rotate("y", 33) @ dl.scale(2, 3, 4)
    assert np.allclose((transform @ transform.inverse()).matrix, np.eye(4), atol=1e-12)


def test_order_of_words_is_that_of_application() -> None:
    assert (dl.translate(1, 0, 0) @ dl.scale(2)).to_list() == [{"scale": 2.0}, {"translate": [1.0, 0.0, 0.0]}]


def test_of() -> None:
    assert dl.Transform.of({"scale": 2}) == dl.scale(2)
    assert dl.Transform.of([]) == dl.Transform()
    assert dl.Transform.of(np.eye(4)) == dl.matrix(np.eye(4))
    assert dl.Transform.of(np.eye(4).tolist()) == dl.matrix(np.eye(4))


def test_transforms_do_not_change() -> None:
    transform = dl.scale(2)
    with pytest.raises(AttributeError):
        transform.words = ()
    transform.matrix[0, 0] = 5
    assert transform.matrix[0, 0] == 2
    with pytest.raises(TypeError):
        _ = transform @ np.eye(4)


BAD: list[tuple[Any, str, str]] = [
    ([{"scale": 0}], "", "determinant is 0"),
    ([{"scale": [1, 0, 1]}], "", "determinant is 0"),
    ([{"scale": 1e-13}], "", "determinant is 1e-39"),
    ([{"matrix": [[1, 2, 0, 0], [2, 4, 0, 0], [0, 0, 1, 0]]}], "", "cannot be inverted"),
    ([{"scale": 1e20}, {"scale": 1e20}], "", "leaves the range"),
    ([{"translate": [1, 2]}], "[0].translate", "not 3 numbers"),
    ([{"translate": [1, 2, "x"]}], "[0].translate", "not a number"),
    ([{"translate": [1, 2, float("nan")]}], "[0].translate", "not a finite number"),
    ([{"translate": [1, 2, True]}], "[0].translate", "not a number"),
    ([{"translate": 1}], "[0].translate", "not 3 numbers"),
    ([{"scale": "big"}], "[0].scale", "not a number"),
    ([{"scale": 1}, {"rotate": {"axis": "w", "angle": 1}}], "[1].rotate.axis", "unknown axis"),
    ([{"rotate": {"axis": [0, 0, 0], "angle": 1}}], "[0].rotate.axis", "no length"),
    ([{"rotate": {"axis": "x"}}], "[0].rotate", "angle is missing"),
    ([{"rotate": {"axis": "x", "angel": 1}}], "[0].rotate", "unknown name"),
    ([{"rotate": 30}], "[0].rotate", "not a mapping"),
    ([{"shear": {"xx": 1}}], "[0].shear", "unknown name"),
    ([{"look_at": {"origin": [0, 0, 0], "target": [0, 0, 0]}}], "[0].look_at.target", "no length"),
    ([{"look_at": {"origin": [0, 0, 0], "target": [0, 5, 0]}}], "[0].look_at.up", "parallel"),
    ([{"matrix": [[1, 0], [0, 1]]}], "[0].matrix", "not a matrix"),
    ([{"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}], "[0].matrix[0]", "not 4 numbers"),
    ([{"matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]}], "[0].matrix[3]", "not an affine"),
    ([{"scal": 1}], "[0]", "unknown transform word"),
    ([{"scale": 1, "translate": [0, 0, 0]}], "[0]", "one name with its value"),
    ({}, "", "one name with its value"),
    ("scale", "", "not a transform"),
    (3, "", "not a transform"),
    (None, "", "not a transform"),
]


@pytest.mark.parametrize(("value", "place", "said"), BAD)
def test_bad_transforms(value: Any, place: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        dl.Transform.of(value)
    assert said in str(caught.value)
    assert (caught.value.place or "") == place
    assert caught.value.expected
