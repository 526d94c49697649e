"""`destello render`: the look of the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import destello as dl
from destello.cli import app

SMALL = ["--size", "24x16", "--spp", "4"]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Every test works in a folder of its own."""
    monkeypatch.chdir(tmp_path)


def run(*args: object):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def test_look_options():
    run("render", "cornell", *SMALL, "-q", "-o", "a.png", "--exposure", "1", "--tone", "neutral", "--curve", "gamma2.2")
    image = dl.render("cornell", size=(24, 16), spp=4, progress=False)
    expected = image.to_uint8(exposure=1, tone="neutral", curve="gamma2.2")
    raw = dl.Image.load("a.png", curve="linear").array * 255
    assert np.array_equal(np.rint(raw), expected)


def test_graded_look():
    size = [*SMALL, "-q"]
    look = ["--exposure", "f/2,1/2s,iso400,+1", "--white-balance", "3200,5", "--working-space", "acescg"]
    done = run("render", "cornell", *size, "-o", "a.png", *look, "--ocio-view", "Un-tone-mapped")
    assert done.exit_code == 0, done.stderr
    image = dl.render("cornell", size=(24, 16), spp=4, progress=False, working_space="acescg")
    stops = dl.color.exposure_of_camera(f_number=2, exposure_time=0.5, iso=400) + 1
    balance = dl.color.WhiteBalance(3200, 5)
    expected = image.to_uint8(exposure=stops, white_balance=balance, view=dl.color.View(view="Un-tone-mapped"))
    assert np.array_equal(np.rint(dl.Image.load("a.png", curve="linear").array * 255), expected)
    assert np.ptp(expected) > 50


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--tone", "film"], "unknown tone curve: 'film'"),
        (["--curve", "log"], "unknown transfer curve: 'log'"),
        (["--exposure", "nan"], "wrong exposure"),
        (["--exposure", "f/8,1/0s"], "wrong exposure time: '1/0s'"),
        (["--exposure", "f/8"], "half a camera's exposure"),
        (["--exposure", "bright"], "wrong exposure: 'bright'"),
        (["--white-balance", "warm"], "--white-balance: wrong value: 'warm'"),
        (["--white-balance", "90"], "wrong temperature"),
        (["--ocio-view", "AgX"], "unknown view: 'AgX'"),
        (["--ocio-config", "none.ocio"], "no such OpenColorIO configuration"),
        (["--ocio-view", "Raw", "--tone", "agx"], "its own tone"),
        (["--working-space", "srgb"], "working_space"),
        (["-o", "a.exr", "--tone", "agx"], "linear radiance"),
    ],
)
def test_wrong_looks_are_one_line_and_exit_code_2(args, message):
    done = run("render", "cornell", *args)
    assert done.exit_code == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert message in line
    assert not list(Path().iterdir()), "nothing is written"


def test_errors_found_together_are_a_line_each():
    Path("a.yaml").write_text("materials:\n  m: {type: difuse}\n  n: {type: diffuse, reflectance: 2}\n")
    done = run("info", "a.yaml")
    assert done.exit_code == 2
    first, second = done.stderr.splitlines()
    assert first.startswith("destello: a.yaml:2: materials.m.type: unknown")
    assert second.startswith("destello: a.yaml:3: materials.n.reflectance: out of range: 2 ")
