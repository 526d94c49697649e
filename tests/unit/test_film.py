"""Films: spans of samples, the error estimate against its definition, checkpoints whole, refused or damaged."""

from __future__ import annotations

import json

import numpy as np
import pytest

import destello as dl
from destello.errors import FormatError, InputError, MissingFileError
from destello.film import Film, add_spans, count_samples, relative_error, show_spans, subtract_spans

SIZE = (9, 5)


@pytest.fixture
def film() -> Film:
    return dl.render("cornell", size=SIZE, samples=(2, 6), progress=False).film


def test_spans_join_and_refuse_overlap():
    assert add_spans([(8, 9), (0, 4), (4, 8), (20, 20)]) == ((0, 9),)
    assert add_spans([(5, 6), (0, 2)]) == ((0, 2), (5, 6))
    assert count_samples([(0, 4), (10, 11)]) == 5
    assert show_spans([(0, 4), (10, 11)]) == "0:4,10:11"
    with pytest.raises(InputError, match="the same samples twice: '3:4'"):
        add_spans([(0, 4), (3, 8)])


@pytest.mark.parametrize(
    ("whole", "done", "left"),
    [
        ((0, 10), [], [(0, 10)]),
        ((0, 10), [(0, 10)], []),
        ((0, 10), [(2, 4), (6, 7)], [(0, 2), (4, 6), (7, 10)]),
        ((3, 8), [(0, 4), (7, 20)], [(4, 7)]),
        ((3, 8), [(0, 2), (9, 11)], [(3, 8)]),
        ((3, 8), [(0, 20)], []),
    ],
)
def test_what_is_left(whole, done, left):
    assert subtract_spans(whole, done) == left


def test_relative_error_by_hand():
    """Grey pixels of luminance 1 and 3: errors 0.1 / 1 and 0.6 / 3; a black one counts against 0.1 of the mean."""
    mean = np.array([[[1, 1, 1], [3, 3, 3]]], dtype=np.float32)
    variance = np.array([[0.1**2, 0.6**2]], dtype=np.float32)
    assert relative_error(mean, variance) == pytest.approx(np.sqrt((0.1**2 + 0.2**2) / 2), rel=1e-5)
    mean = np.array([[[3, 3, 3], [0, 0, 0]]], dtype=np.float32)
    variance = np.array([[0.3**2, 0.03**2]], dtype=np.float32)
    assert relative_error(mean, variance) == pytest.approx(np.sqrt((0.1**2 + 0.2**2) / 2), rel=1e-5)
    assert relative_error(np.zeros((2, 2, 3)), np.zeros((2, 2))) == 0
    assert relative_error(np.ones((2, 2, 3)), np.full((2, 2), np.nan)) == float("inf")


def test_relative_error_falls_with_the_square_root_of_the_samples():
    few = dl.render("cornell", size=(24, 24), spp=32, progress=False).film.relative_error()
    many = dl.render("cornell", size=(24, 24), spp=512, progress=False).film.relative_error()
    assert few / many == pytest.approx(4, rel=0.5)


def test_relative_error_is_about_the_true_one():
    """Against a reference of many more samples: never far below the truth; well-distributed samples do better."""
    picture = dl.render("cornell", size=(24, 24), spp=64, seed=1, progress=False)
    reference = dl.render("cornell", size=(24, 24), spp=2048, seed=2, progress=False)
    true = relative_error(reference.array, dl.color.luminance(picture.array - reference.array) ** 2)
    assert 0.7 * true < picture.film.relative_error() < 5 * true


def test_checkpoint_round_trip(tmp_path, film):
    film.save(tmp_path / "a.film")
    assert [p.name for p in tmp_path.iterdir()] == ["a.film"]
    back = Film.load(tmp_path / "a.film", film.identity)
    assert back.spans == ((2, 6),)
    assert (back.rays, back.nonfinite, back.seconds, back.devices) == (film.rays, 0, film.seconds, ["cpu"])
    for name, values in film.core.state().items():
        assert np.array_equal(back.core.state()[name], values)
    assert np.array_equal(back.core.mean(), film.core.mean())


def test_checkpoint_of_another_render_is_refused_by_name(tmp_path, film):
    film.save(tmp_path / "a.film")
    for change, name in [({"seed": 9}, "seed"), ({"scene": "0" * 32}, "scene"), ({"size": [10, 5]}, "size")]:
        with pytest.raises(InputError, match=rf"a\.film: the film belongs to another render: its {name} differs"):
            Film.load(tmp_path / "a.film", {**film.identity, **change})


def test_films_of_other_renders_or_the_same_samples_are_not_added(film):
    other = dl.render("cornell", size=SIZE, samples=(4, 8), progress=False).film
    before = film.core.mean()
    with pytest.raises(InputError, match="the same samples twice: '4:6'"):
        film.add(other)
    other = dl.render("cornell", size=SIZE, samples=(6, 8), seed=1, progress=False).film
    with pytest.raises(InputError, match="its seed differs"):
        film.add(other)
    assert np.array_equal(film.core.mean(), before)
    assert film.spans == ((2, 6),)


def test_damaged_checkpoints(tmp_path, film):
    path = tmp_path / "a.film"
    film.save(path)
    whole = path.read_bytes()
    for damaged in (b"", b"no film", whole[: len(whole) // 2], whole[:200] + b"\0" * 64 + whole[264:]):
        path.write_bytes(damaged)
        with pytest.raises(FormatError, match=r"a\.film: not a film, or damaged"):
            Film.load(path)
    with pytest.raises(MissingFileError, match=r"b\.film"):
        Film.load(tmp_path / "b.film")


def test_checkpoints_hold_no_pickles(tmp_path, film):
    """A film is data: loading one runs nothing."""
    state = {f"state.{name}": value for name, value in film.core.state().items()}
    meta = {"format": 1, "identity": {}, "spans": [], "seconds": 0, "rays": 0, "nonfinite": 0, "devices": []}
    with (tmp_path / "a.film").open("wb") as file:
        np.savez(file, destello=np.array(json.dumps(meta)), **{**state, "state.sums": np.array([print], dtype=object)})
    with pytest.raises(FormatError, match="damaged"):
        Film.load(tmp_path / "a.film")


def test_checkpoint_of_another_version_of_the_format(tmp_path, film):
    with (tmp_path / "a.film").open("wb") as file:
        np.savez(file, destello=np.array(json.dumps({"format": 99})))
    with pytest.raises(FormatError, match="film of another version: 99"):
        Film.load(tmp_path / "a.film")
