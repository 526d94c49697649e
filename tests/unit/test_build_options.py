"""How trees are built can be chosen everywhere, reaches the core, and changes neither pictures nor fingerprints."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import destello as dl
from destello import _core
from destello.cli import app
from destello.compile import QUALITIES, TreeOptions


@pytest.fixture
def built(monkeypatch):
    """The arguments of every build from here on."""
    calls = []

    class Builder:
        def __init__(self):
            self._core = _core_builder()

        def __getattr__(self, name):
            return getattr(self._core, name)

        def build(self, **options):
            calls.append(options)
            return self._core.build(**{**options, "cuda_device": -1})

    _core_builder = _core.SceneBuilder
    monkeypatch.setattr(_core, "SceneBuilder", Builder)
    return calls


def test_options_reach_the_core(built):
    scene = dl.scenes.build("cornell")
    scene.compile()
    scene.compile(build="high", device="cuda:2", threads=3)
    dl.render(scene, size=(4, 4), spp=1, device="cpu", threads=2, build="fast", progress=False)
    assert built == [
        {"quality": "balanced", "threads": 0, "cuda_device": -1},
        {"quality": "high", "threads": 3, "cuda_device": 2},
        {"quality": "fast", "threads": 2, "cuda_device": -1},
    ]
    assert TreeOptions(device="cuda").for_core()["cuda_device"] == 0


def test_on_the_command_line(built, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--device", "cpu", "--size", "4x4", "--spp", "1", "--build", "fast"]
    done = CliRunner().invoke(app, ["render", "cornell", *small, "--json"])
    assert done.exit_code == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["build"] == "fast"
    assert sum(figures["triangle_bytes"].values()) > 36
    assert figures["peak_host_bytes"] > 1 << 20
    assert "memory: geometry and trees " in done.stderr
    done = CliRunner().invoke(app, ["bench", "cornell", *small, "--seeds", "0", "-q", "--json", "-"])
    assert json.loads(done.stdout)["results"][0]["build"] == "fast"
    assert {call["quality"] for call in built} == {"fast"}


@pytest.mark.parametrize("value", ["best", "", None, 3])
def test_unknown_qualities_are_refused(value):
    scene = dl.scenes.build("cornell")
    for call in (scene.compile, lambda build: dl.render(scene, build=build, spp=1, progress=False)):
        with pytest.raises(dl.InputError, match="balanced") as caught:
            call(build=value)
        assert "build" in str(caught.value)


@pytest.mark.parametrize("name", ["book1", "cornell", "mesh1m", "instances", "interior"])
def test_pictures_and_fingerprints_do_not_depend_on_the_tree(name):
    scene = dl.scenes.build(name, 0.01)
    scenes = [scene.compile(build=quality) for quality in QUALITIES]
    assert len({compiled.fingerprint for compiled in scenes}) == 1
    pictures = []
    for compiled in scenes:
        film = _core.Film(48, 27)
        _core.Renderer(compiled.core, "cpu", 0).render(film, 0, 0, 4, {"max_depth": 8})
        pictures.append(film.state()["sums"])
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures)


def test_a_film_goes_on_with_another_tree(tmp_path):
    scene, film = dl.scenes.build("cornell"), tmp_path / "a.film"
    shared = {"size": (8, 8), "device": "cpu", "progress": False}
    dl.render(scene, spp=2, build="fast", resume=film, **shared)
    resumed = dl.render(scene, spp=4, build="high", resume=film, **shared)
    assert np.array_equal(resumed.array, dl.render(scene, spp=4, **shared).array)
