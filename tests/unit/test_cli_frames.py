"""`destello render --frames`: names, figures, going on, interruption, one-line errors."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import destello as dl
from destello.cli import app, options
from destello.errors import InputError
from destello.progress import FrameStatus, Status, each_frame

SCENE = """\
film: {width: 12, height: 8}
render: {spp: 2, fps: 10}
camera: {type: perspective, origin: [0, 0, 5], target: [0, 0, 0]}
shapes:
  - type: box
    min: [-1, -1, -1]
    max: [1, 1, 1]
    animation: {translate: {times: [0, 1], values: [[-2, 0, 0], [2, 0, 0]]}}
"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Every test works in a folder of its own, with a scene of 10 frames."""
    monkeypatch.chdir(tmp_path)
    Path("moving.yaml").write_text(SCENE)


def run(*args: object):
    return CliRunner().invoke(app, ["render", "moving.yaml", "--device", "cpu", *map(str, args)])


def files() -> list[str]:
    return sorted(p.name for p in Path().iterdir() if p.name != "moving.yaml")


def pixels(name: str) -> np.ndarray:
    return dl.Image.load(name).array


def frame(number: int, spp: int = 2) -> np.ndarray:
    image = dl.render(dl.load("moving.yaml").at_frame(number), spp=spp, device="cpu", progress=False)
    image.save("expected.png")
    expected = pixels("expected.png")
    Path("expected.png").unlink()
    return expected


# --- what works -------------------------------------------------------------------------------------------------------


def test_every_frame_has_its_picture():
    done = run("--frames", "8:11", "-o", "out_##.png")
    assert done.exit_code == 0, done.stderr
    assert done.stdout == ""
    assert files() == ["out_08.png", "out_09.png", "out_10.png"]
    for number in (8, 9, 10):
        assert np.array_equal(pixels(f"out_{number:02}.png"), frame(number))
    lines = done.stderr.splitlines()
    assert [line.split(":")[0] for line in lines] == ["device", "note", *files()], "the device and notes once"


def test_one_frame_and_the_default_name():
    done = run("--frames", 7, "-q")
    assert (done.exit_code, done.stderr) == (0, "")
    assert files() == ["moving_0007.png"]
    assert run("--frames", 7, "-q", "-o", "seven.png").exit_code == 0
    assert np.array_equal(pixels("seven.png"), pixels("moving_0007.png"))
    assert run("--frames", "12345", "-q", "-o", "a_#_##.png").exit_code == 0
    assert Path("a_12345_12345.png").exists()


def test_without_frames_it_is_frame_0_and_a_name_is_a_name():
    assert run("-q", "-o", "a#.png").exit_code == 0
    assert np.array_equal(pixels("a#.png"), frame(0))


def test_one_frame_to_standard_output():
    command = [sys.executable, "-m", "destello", "render", "moving.yaml", "--frames", "3", "-o", "-", "-q"]
    done = subprocess.run(command, capture_output=True, check=True, timeout=120)
    assert done.stdout.startswith(b"P6\n")
    assert files() == []


def test_figures_are_a_list():
    done = run("--frames", "0:3", "-o", "f#.exr", "--json", "--json-file", "f.json", "--samples", "1:3")
    figures = json.loads(done.stdout)
    assert figures == json.loads(Path("f.json").read_text())
    assert [(f["output"], f["frame"], f["samples"]) for f in figures] == [
        (f"f{i}.exr", i, "1:3") for i in range(3)
    ]  # fmt: skip
    assert dl.Image.load("f2.exr").metadata["frame"] == 2
    assert isinstance(json.loads(run("--frames", "4", "--json", "-q").stdout), list)


def test_previews():
    assert run("--frames", "0:2", "-q", "-o", "f#.png", "--preview", "p#.png").exit_code == 0
    assert files() == ["f0.png", "f1.png", "p0.png", "p1.png"]
    assert run("--frames", "0:2", "-q", "-o", "f#.png", "--preview", "p.png").exit_code == 0
    assert np.array_equal(pixels("p.png"), pixels("f1.png"))


def test_a_scene_that_does_not_move_says_so():
    small = ["--size", "8x8", "--spp", "1"]
    done = CliRunner().invoke(app, ["render", "cornell", *small, "--frames", "0:2", "-o", "f#.png"])
    assert "note: nothing in the scene is animated: the frames are all the same" in done.stderr.splitlines()
    assert done.exit_code == 0


# --- going on ---------------------------------------------------------------------------------------------------------


def test_resume_leaves_finished_frames_alone_and_keeps_no_films():
    assert run("--frames", "1:3", "-q", "-o", "f#.png").exit_code == 0
    before = {name: (Path(name).stat().st_mtime_ns, Path(name).read_bytes()) for name in files()}
    done = run("--frames", "0:4", "-o", "f#.png", "--resume", "--json")
    assert done.exit_code == 0, done.stderr
    assert done.stderr.splitlines()[:2] == ["f1.png: already there", "f2.png: already there"]
    assert [f["frame"] for f in json.loads(done.stdout)] == [0, 3]
    assert [f["film"] for f in json.loads(done.stdout)] == [None, None]
    assert files() == ["f0.png", "f1.png", "f2.png", "f3.png"]
    assert {name: (Path(name).stat().st_mtime_ns, Path(name).read_bytes()) for name in before} == before
    again = run("--frames", "0:4", "-o", "f#.png", "--resume", "--json")
    assert (again.exit_code, json.loads(again.stdout)) == (0, [])


def test_a_frame_with_a_film_goes_on():
    image = dl.render(dl.load("moving.yaml").at_frame(5), spp=3, device="cpu", progress=False)
    image.save("f5.png")
    image.film.save(Path("f5.film"))
    done = run("--frames", "5:6", "-o", "f#.png", "--resume", "--spp", 7)
    assert done.exit_code == 0, done.stderr
    assert "going on from f5.film: 3 spp done" in done.stderr
    assert np.array_equal(pixels("f5.png"), frame(5, spp=7))
    assert files() == ["f5.png"]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_an_interruption_keeps_finished_frames_and_the_film_of_the_last():
    command = [sys.executable, "-m", "destello", "render", "moving.yaml", "--device", "cpu", "--frames", "0:5"]
    extra = ["-o", "f#.png", "--json", "--spp", "4000", "--preview", "p#.png", "--size", "100x80"]
    child = subprocess.Popen([*command, *extra], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 240
        while not (Path("f0.png").exists() and Path("p1.png").exists()) and time.monotonic() < deadline:
            time.sleep(0.02)
            assert child.poll() is None
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=30)
    finally:
        child.kill()
    assert child.returncode == 130, err
    assert "--resume goes on from f1.film" in err.splitlines()[-1]
    assert "Traceback" not in err
    assert files() == ["f0.png", "f1.film", "f1.png", "p0.png", "p1.png"]
    assert [f["stopped_by"] for f in json.loads(out)] == ["samples", "interrupt"]


# --- progress ---------------------------------------------------------------------------------------------------------


def test_one_progress_over_all_frames():
    told: list[FrameStatus] = []
    for number, progress in each_frame(told.append, [4, 6]):
        for done in (1, 2):
            progress(Status(done, 2, 9.0, None, 5e6, 1e7, finished=done == 2))
        assert told[-1].frame == number
    assert [status.fraction for status in told] == [0.25, 0.5, 0.75, 1.0]
    assert [status.finished for status in told] == [False, False, False, True]
    assert told[2].text().startswith("frame 6 (2 of 2), 1/2 spp, ")
    assert all(status.seconds < 9 for status in told), "the time is that of all frames"


# --- what goes wrong --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ("--frames 0:4 -o out.png", "-o: the frames need a number in their names: 'out.png' (accepted: a run of #"),
        ("--frames 0:4 -o a##/out.png", "-o: the frames need a number in their names: 'a##/out.png'"),
        ("--frames 0:4 -o -", "-o: several frames cannot go to standard output (accepted: -o out_####.png)"),
        ("--frames 4:4 -o f#.png", "--frames: wrong range: '4:4' (accepted: frames A:B, A < B, or one frame"),
        ("--frames 5:4 -o f#.png", "--frames: wrong range: '5:4'"),
        ("--frames four -o f#.png", "--frames: wrong value: 'four'"),
        ("--frames -1:4 -o f#.png", "--frames: wrong value: '-1:4'"),
        ("--frames 0:4:2 -o f#.png", "--frames: wrong value: '0:4:2'"),
        ("--frames 0:99999999999 -o f#.png", "--frames: wrong range: '0:99999999999'"),
        ("--frames 0:4 -o no/such/f#.png", "no such folder"),
        ("--frames 0:4 -o f#.png --preview no/such/p.png", "no such folder"),
        ("--frames 0:4 -o f#.png --aov depth", "--aov needs layers"),
        ("--frames 0:4 -o f#.bmpx", "unknown image format"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(args: str, message: str):
    done = run(*args.split())
    assert done.exit_code == 2, done.stderr
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert message in done.stderr
    assert files() == []


def test_a_broken_animation_names_file_line_place_and_value():
    Path("moving.yaml").write_text(SCENE.replace("times: [0, 1]", "times: [1, 0]"))
    done = run("--frames", "0:2", "-o", "f#.png")
    assert done.exit_code == 2
    assert done.stderr.startswith(
        "destello: moving.yaml:8: shapes[0].animation.translate.times[1]: times run backwards: 0"
    )


def test_a_frame_that_fails_leaves_the_others_and_their_figures():
    Path("moving.yaml").write_text(
        SCENE.replace("target: [0, 0, 0]", "target: [0, 0, 0], animation: {scale: {times: [0, 0.1], values: [1, 0]}}")
    )
    done = run("--frames", "0:3", "-o", "f#.png", "--json")
    assert done.exit_code == 2
    assert "cameras.default.animation at frame 1: the transform cannot be inverted" in done.stderr.splitlines()[-1]
    assert [f["frame"] for f in json.loads(done.stdout)] == [0]
    assert files() == ["f0.png"]


@pytest.mark.parametrize(("text", "frames"), [("0:48", range(48)), ("7", range(7, 8)), (" 3:5 ", range(3, 5))])
def test_read_frames(text: str, frames: Any):
    assert options.read_frames(text) == frames
    assert options.read_frames(None) is None


@pytest.mark.parametrize("text", ["", ":", "3:", ":3", "1-3", "٣", "2147483648"])
def test_read_frames_refuses(text: str):
    with pytest.raises(InputError, match="--frames"):
        options.read_frames(text)


def test_numbered():
    assert options.numbered("a#/out_####.tar.png", 7) == "a#/out_0007.tar.png"
    assert options.numbered("out_#.png", 123) == "out_123.png"
    assert options.numbered("out_#.png", None) == "out_#.png"
