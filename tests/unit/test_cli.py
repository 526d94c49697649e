"""The command line, in this process and as a real one: exit codes, one-line errors, what goes to which stream."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import destello as dl
from destello.cli import app, options
from destello.errors import InputError
from destello.film import Film

SMALL = ["--size", "24x16", "--spp", "4"]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Every test works in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DESTELLO_DEBUG", raising=False)


def run(*args: object):
    return CliRunner().invoke(app, [str(arg) for arg in args])


def process(*args: object, **options):
    command = [sys.executable, "-m", "destello", *map(str, args)]
    return subprocess.run(command, capture_output=True, check=False, timeout=120, **options)


def one_line_error(stderr: str) -> str:
    lines = stderr.splitlines()
    assert len(lines) == 1, stderr
    assert lines[0].startswith("destello: ")
    return lines[0]


# What works ---------------------------------------------------------------------------------------------------------


def test_render_writes_the_picture_of_the_api():
    done = run("render", "cornell", *SMALL, "-o", "a.png", "--seed", 3)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert lines[0].startswith("device: ")
    assert "because: " in lines[0]
    assert lines[-1].startswith("a.png: 24x16, 4 spp in ")
    assert "Msamples/s" in lines[-1]
    assert "Mrays/s" in lines[-1]
    image = dl.render("cornell", size=(24, 16), spp=4, seed=3, progress=False)
    assert np.array_equal(dl.Image.load("a.png").to_uint8(), image.to_uint8())
    assert [p.name for p in Path().iterdir()] == ["a.png"]


def test_default_name_and_settings_are_the_scenes():
    scene = dl.Scene("spheres")
    scene.add(dl.shapes.sphere(center=(0, 0, 0), radius=1))
    scene.film.width, scene.film.height, scene.render.spp = 12, 10, 3
    scene.save("small.yaml")
    done = run("render", "small.yaml", "--json", "--quiet")
    assert done.exit_code == 0, done.stderr
    figures = json.loads(done.stdout)
    assert (figures["output"], figures["width"], figures["height"], figures["spp"]) == ("small.png", 12, 10, 3)
    assert dl.Image.load("small.png").array.shape == (10, 12, 3)


def test_json_is_all_that_standard_output_gets():
    done = process("render", "cornell", *SMALL, "-o", "a.ppm", "--json")
    assert done.returncode == 0
    figures = json.loads(done.stdout)
    assert figures["scene"] == "cornell"
    assert figures["spp"] == 4
    assert figures["rays"] > 24 * 16 * 4
    assert figures["device"] == "cpu" or figures["device"].startswith("cuda")
    assert figures["samples_per_second"] > 0
    done = process("render", "cornell", *SMALL, "-o", "a.ppm", "--json-file", "a.json", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    assert json.loads(Path("a.json").read_text())["spp"] == 4


def test_dash_writes_a_ppm_and_nothing_else_to_standard_output():
    done = process("render", "cornell", *SMALL, "-o", "-")
    assert done.returncode == 0
    assert done.stderr.startswith(b"device: ")
    head, pixels = done.stdout[:3], done.stdout[-24 * 16 * 3 :]
    assert head == b"P6\n"
    assert b"\n24 16\n255\n" in done.stdout
    image = dl.render("cornell", size=(24, 16), spp=4, progress=False)
    assert pixels == image.to_uint8().tobytes()
    assert list(Path().iterdir()) == []


def test_standard_output_into_a_file_as_the_original_did():
    done = process("render", "cornell", *SMALL, "-q", "-o", "-", "--p3")
    Path("test.ppm").write_bytes(done.stdout)
    image = dl.render("cornell", size=(24, 16), spp=4, progress=False)
    assert np.array_equal(dl.Image.load("test.ppm").to_uint8(), image.to_uint8())


def test_text_ppm_and_other_formats():
    for name, extra, magic in [
        ("a.ppm", ["--p3"], b"P3"),
        ("b.jpg", ["--quality", "80"], b"\xff\xd8"),
        ("c.exr", ["--bits", "32", "--aov", "albedo,depth", "--aov", "normal"], b"\x76\x2f\x31\x01"),
        ("d.hdr", [], b"#?R"),
        ("e.dat", ["--format", "png", "--bits", "16"], b"\x89PNG"),
    ]:
        done = run("render", "cornell", *SMALL, "-q", "-o", name, *extra)
        assert done.exit_code == 0, done.stderr
        assert Path(name).read_bytes().startswith(magic)
    assert dl.Image.load("c.exr").aovs.keys() == {"albedo", "depth", "normal"}


def test_a_device_as_output():
    done = run("render", "cornell", *SMALL, "-q", "-o", "/dev/null", "--format", "png")
    assert done.exit_code == 0, done.stderr
    assert not Path("/dev/null.film").exists()
    done = run("render", "cornell", *SMALL, "-q", "-o", "/dev/null", "--format", "png", "--resume")
    assert "'/dev/null' (accepted: -o FILE)" in one_line_error(done.stderr)
    assert Path("/dev/null").is_char_device()


def test_crop_samples_filter_camera_and_limits():
    done = run(
        "render", "cornell", "--size", "24x16", "--crop", "2:10,3:9", "--samples", "2:5", "--camera", "default",
        "--filter", "gaussian:sigma=0.5", "--max-depth", "3", "--max-volume-depth", "0", "--threads", "1", "--json",
        "-q", "-o", "a.exr", "--bits", "32",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    figures = json.loads(done.stdout)
    assert (figures["samples"], figures["spp"], figures["width"], figures["height"]) == ("2:5", 3, 8, 6)
    assert figures["max_volume_depth"] == 0
    image = dl.render(
        "cornell", size=(24, 16), crop=(2, 3, 10, 9), samples=(2, 5), filter=dl.filters.gaussian(sigma=0.5),
        max_depth=3, progress=False,
    )  # fmt: skip
    assert np.array_equal(dl.Image.load("a.exr").array, image.array)


def test_time_and_error_limits():
    done = run("render", "cornell", "--size", "24x16", "--time", "0.3s", "-q", "--json", "-o", "a.png")
    assert json.loads(done.stdout)["stopped_by"] == "time"
    done = run("render", "cornell", "--size", "24x16", "--target-error", "0.3", "-q", "--json", "-o", "a.png")
    assert json.loads(done.stdout)["stopped_by"] == "error"
    assert json.loads(done.stdout)["relative_error"] <= 0.3


def test_info_devices_scenes_version_help():
    done = run("info", "cornell")
    assert done.exit_code == 0
    assert "600x600" in done.stdout
    assert json.loads(run("info", "cornell", "--json").stdout)["triangles"] == 36
    done = run("devices")
    assert done.exit_code == 0
    assert "cpu" in done.stdout
    assert "auto is " in done.stdout
    assert json.loads(run("devices", "--json").stdout)["devices"][0]["name"] == "cpu"
    books, benchmarks = run("scenes").stdout.split("\n\nFor destello bench:\n")
    assert [line.split()[0] for line in books.splitlines()] == dl.scenes.names()
    assert [line.split()[0] for line in benchmarks.splitlines()] == list(dl.scenes.describe_benchmarks())
    assert json.loads(run("scenes", "--json").stdout).keys() == {*dl.scenes.names(), *dl.scenes.describe_benchmarks()}
    assert run("--version").stdout == f"destello {dl.__version__}\n"
    for command in ([], ["render"], ["info"], ["convert"]):
        done = run(*command, "--help")
        assert done.exit_code == 0
        assert "Usage" in done.stdout


def test_info_lists_the_extensions_that_are_ignored(tmp_path):
    from scene_files import Gltf

    g = Gltf()
    g.extend("VENDOR_glitter")
    for _ in range(2):
        g.node(mesh=g.quad())
    done = run("info", str(g.gltf(tmp_path)))
    assert done.exit_code == 0
    assert (done.stdout + done.stderr).count("VENDOR_glitter") == 1
    g.extend("VENDOR_needed", required=True)
    done = run("info", str(g.gltf(tmp_path)))
    assert done.exit_code == 2
    assert "VENDOR_needed" in done.stderr


def test_convert_writes_a_scene_that_renders_the_same():
    done = run("convert", "cornell", "-o", "c.yaml")
    assert done.exit_code == 0, done.stderr
    assert done.stdout == ""
    assert dl.load("c.yaml") == dl.scenes.build("cornell")


def test_help_is_quick():
    """No NumPy, no core: the command line imports only what it needs."""
    code = (
        "import sys, destello.cli; print([m for m in ('numpy', 'destello._core', 'OpenImageIO') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


# Interruption and resuming ------------------------------------------------------------------------------------------


def interrupted(name: str, *extra: str, with_signal: int = signal.SIGINT) -> subprocess.CompletedProcess[str]:
    """Starts a long render and interrupts it as soon as it shows a preview."""
    command = [sys.executable, "-m", "destello", "render", "cornell", "--size", "40x30", "--time", "60s"]
    child = subprocess.Popen(
        [*command, "-o", name, "--preview", "preview.png", *extra],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        deadline = time.monotonic() + 50
        while not Path("preview.png").exists() and time.monotonic() < deadline and child.poll() is None:
            time.sleep(0.02)
        child.send_signal(with_signal)
        began = time.monotonic()
        out, err = child.communicate(timeout=30)
        assert time.monotonic() - began < 10
    finally:
        child.kill()
    return subprocess.CompletedProcess(command, child.returncode, out, err)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("with_signal", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_writes_the_picture_and_resume_goes_on(with_signal):
    done = interrupted("a.png", with_signal=with_signal)
    assert done.returncode == 130, done.stderr
    assert done.stdout == ""
    assert "--resume goes on from a.film" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    film = Film.load(Path("a.film"))
    assert dl.Image.load("a.png").array.shape == (30, 40, 3)
    goal = film.spp + 5
    again = run("render", "cornell", "--size", "40x30", "--spp", goal, "-o", "a.png", "--resume", "--json")
    assert again.exit_code == 0, again.stderr
    assert f"going on from a.film: {film.spp} spp done" in again.stderr
    assert json.loads(again.stdout)["spp"] == goal
    run("render", "cornell", "--size", "40x30", "--spp", goal, "-o", "b.png", "-q")
    assert np.array_equal(dl.Image.load("a.png").array, dl.Image.load("b.png").array)
    assert Film.load(Path("a.film")).spp == goal


def test_resume_twice_gives_the_bits_of_one_run():
    for spp in (3, 4, 9):
        done = run("render", "cornell", "--size", "24x16", "--spp", spp, "-o", "a.exr", "--bits", 32, "--resume", "-q")
        assert done.exit_code == 0, done.stderr
    image = dl.render("cornell", size=(24, 16), spp=9, progress=False)
    assert np.array_equal(dl.Image.load("a.exr").array, image.array)
    done = run("render", "cornell", "--size", "24x16", "--spp", 9, "--seed", 1, "-o", "a.exr", "--resume", "-q")
    assert done.exit_code == 2
    assert "a.film: the film belongs to another render: its seed differs: 0 (accepted: 1" in one_line_error(done.stderr)


# What goes wrong ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["nosuch.gltf"], "nosuch.gltf"),
        (["nosuch"], "nosuch (accepted: a scene file, or a built-in scene"),
        (["cornel"], "did you mean 'cornell'?"),
        (["notes.txt"], "unknown scene format: '.txt'"),
        (["broken.json"], "broken.json"),
        (["cornell", "-o", "a.bmpx"], "a.bmpx: unknown image format: '.bmpx'"),
        (["cornell", "-o", "no/such/a.png"], "no such folder"),
        (["cornell", "-o", "folder.png"], "it is a folder"),
        (["cornell", "--spp", "0"], "spp: out of range: 0"),
        (["cornell", "--spp", "-5"], "spp: out of range: -5"),
        (["cornell", "--spp", "many"], "--spp"),
        (["cornell", "--size", "0x0"], "0 (accepted: a whole number from 1"),
        (["cornell", "--size", "-4x4"], "--size: wrong value: '-4x4' (accepted: WxH"),
        (["cornell", "--size", "60000x60000"], "'60000x60000' (accepted: about"),
        (["cornell", "--size", "99999999x1"], "99999999"),
        (["cornell", "--crop", "1:2"], "--crop: wrong value: '1:2'"),
        (["cornell", "--size", "8x8", "--crop", "0:9,0:8"], "not within the picture"),
        (["cornell", "--samples", "5"], "--samples: wrong value: '5'"),
        (["cornell", "--samples", "5:5"], "samples: wrong range: '5:5'"),
        (["cornell", "--samples", "0:5", "--spp", "4"], "exclude each other"),
        (["cornell", "--time", "soon"], "--time: wrong value: 'soon'"),
        (["cornell", "--target-error", "0"], "target_error: out of range: 0"),
        (["cornell", "--device", "gpu"], "device: unknown device: 'gpu' (accepted: auto, cpu"),
        (["cornell", "--device", "cuda:77"], "cuda:77"),
        (["cornell", "--camera", "top"], "unknown camera: 'top'"),
        (["cornell", "--filter", "sinc"], "'sinc'"),
        (["cornell", "--filter", "gaussian:sigma=wide"], "--filter: wrong value"),
        (["cornell", "--filter", "gaussian:width=1"], "width"),
        (["cornell", "--bits", "12"], "no such bits a channel: 12 (accepted: 8 or 16)"),
        (["cornell", "--p3"], "P3"),
        (["cornell", "--aov", "depth"], "--aov needs layers"),
        (["cornell", "-o", "a.exr", "--aov", "height"], "unknown layer: 'height'"),
        (["cornell", "-o", "-", "--json"], "standard output"),
        (["cornell", "-o", "-", "--resume"], "--resume"),
        (["cornell", "--preview", "no/such/p.png"], "no such folder"),
        (["cornell", "--json-file", "no/such/a.json"], "no such folder"),
        (["cornell", "--wrong-option"], "--wrong-option"),
        ([], "SCENE"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(args, message):
    Path("notes.txt").write_text("not a scene")
    Path("broken.json").write_text('{"shapes": [')
    Path("folder.png").mkdir()
    before = sorted(Path().iterdir())
    done = run("render", *args)
    assert done.exit_code == 2, done.stderr
    assert done.stdout == ""
    assert message in one_line_error(done.stderr)
    assert sorted(Path().iterdir()) == before, "nothing is written"


def test_the_real_process_reports_the_same_way():
    done = process("render", "nosuch.glb", "-o", "a.png")
    assert done.returncode == 2
    assert done.stdout == b""
    assert "nosuch.glb" in one_line_error(done.stderr.decode())
    assert "Traceback" in process("render", "nosuch.glb", env={**os.environ, "DESTELLO_DEBUG": "1"}).stderr.decode()


def test_a_failed_render_is_exit_code_1(monkeypatch):
    from destello import _core

    def fail(*args, **kwargs):
        raise RuntimeError("no such\nluck")

    monkeypatch.setattr(_core, "Renderer", fail)
    done = run("render", "cornell", *SMALL, "-q", "-o", "a.png")
    assert done.exit_code == 1
    assert "no such luck" in one_line_error(done.stderr)
    assert not Path("a.png").exists()


def test_a_mistake_of_ours_is_exit_code_1_and_says_so(monkeypatch):
    monkeypatch.setattr(import_module("destello.render"), "plan", lambda *args: 1 / 0)
    done = run("render", "cornell", *SMALL, "-q")
    assert done.exit_code == 1
    assert "a mistake in destello" in one_line_error(done.stderr)


def test_a_reader_that_goes_away_is_no_traceback():
    command = f"{sys.executable} -m destello render cornell --size 400x300 --spp 1 -q -o - | head -c 10"
    done = subprocess.run(["sh", "-c", command], capture_output=True, check=False, timeout=120)
    assert done.stdout.startswith(b"P6\n")
    assert b"Traceback" not in done.stderr
    assert b"Exception" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_behind_standard_output():
    with Path("/dev/full").open("wb") as full:
        command = [sys.executable, "-m", "destello", "render", "cornell", *SMALL, "-q", "-o", "-"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120)
    assert done.returncode == 1
    assert "No space left on device" in one_line_error(done.stderr)


# Reading of options -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("60s", 60), ("90", 90), ("1.5h", 5400), ("1h30m", 5400), ("2m5s", 125), (".5s", 0.5), ("1m30", 90)],
)
def test_read_time(text, seconds):
    assert options.read_time(text) == seconds


@pytest.mark.parametrize("text", ["", "0s", "-5s", "s", "1d", "5 minutes", "infs", "1e3s", "٣s"])
def test_read_time_refuses(text):
    with pytest.raises(InputError, match="--time"):
        options.read_time(text)


def test_read_the_others():
    assert options.read_size("1280X720") == (1280, 720)
    assert options.read_crop("1:3,2:4") == (1, 2, 3, 4)
    assert options.read_samples("0:7") == (0, 7)
    assert options.read_filter("mitchell").type == "mitchell"
    assert options.read_filter("gaussian:sigma=0.7")["sigma"] == pytest.approx(0.7)
    assert options.film_path(Path("a/b.tar.png")) == Path("a/b.tar.film")
