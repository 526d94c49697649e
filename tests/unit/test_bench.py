"""`destello bench`: what it measures, how it says so, and how it answers what it cannot do. No times are judged."""

from __future__ import annotations

import json
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import destello as dl
from destello import bench, device
from destello.cli import app

command = import_module("destello.cli.bench")  # `destello.cli.bench` is the function
TINY = ["--size", "12x8", "--spp", "2"]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Every test works in a folder of its own, and tiny references will do."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DESTELLO_DEBUG", raising=False)
    monkeypatch.setattr(command, "TARGETS", dict.fromkeys(command.SCENES, (0.5, 512)))
    monkeypatch.setattr(command, "OTHER_TARGET", (0.5, 512))
    monkeypatch.setattr(command, "QUICK_DETAIL", 0.002)


def run(*args: object):
    return CliRunner().invoke(app, ["bench", *map(str, args)])


def effort(**changes):
    values = {"device": device.choose("cpu"), "size": (12, 8), "spp": 4, "repeat": 1, "seeds": 2, "reference_spp": 256}
    return bench.Effort(**{**values, **changes})


# --- the error --------------------------------------------------------------------------------------------------------


def test_relative_mse_is_the_mean_square_of_relative_differences():
    reference = np.full((4, 5, 3), 2.0, np.float32)
    assert bench.relative_mse(reference, reference) == 0
    assert bench.relative_mse(reference * 1.1, reference) == pytest.approx(0.01, rel=1e-5)
    dark = np.full((1, 100, 3), 1.0, np.float32)
    dark[0, 0] = 0  # counts as a tenth of the mean
    off = dark.copy()
    off[0, 0] = 0.099
    assert bench.relative_mse(off, dark) == pytest.approx(0.01, rel=1e-4)
    assert bench.relative_mse(reference * 0, reference * 0) == 0
    assert math.isinf(bench.relative_mse(reference, reference * 0))


def test_measure_gives_all_figures(monkeypatch):
    said = []
    found = bench.measure(dl.scenes.build("mesh1m", 0.002), effort(target=0.05), said.append)
    assert found["size"] == [12, 8]
    assert found["spp"] == 4
    assert found["max_depth"] == 8
    assert found["triangles"] == 2000
    assert found["bvh_bytes"] > 0
    assert found["rays_per_sample"] >= 1
    assert 36 < sum(found["triangle_bytes"].values()) < 200
    assert found["paths"] % 32 == 0
    assert found["path_bytes"] > 100
    assert found["path_device_bytes"] == found["peak_device_bytes"] == 0
    assert found["peak_host_bytes"] > 1 << 20
    assert found["build"] == "balanced"
    for name in ("build_seconds", "build_Mtris_s", "Msamples_s", "kernel_Msamples_s", "kernel_Mrays_s"):
        assert 0 < found[name] < math.inf
    assert found["seeds"] == [1, 2]
    assert len(found["seconds_to_error_all"]) == 2
    assert 0 < found["spp_to_error"] <= 128
    assert found["seconds_to_error"] > 0
    assert any("reference of 256 spp" in line for line in said)
    json.dumps(found)


def test_the_samples_to_an_error_do_not_depend_on_time_or_calls():
    """They are a property of the scene and the seeds: the same however the work is cut."""
    scene = dl.scenes.build("cornell")
    first = bench.measure(scene, effort(target=0.3))
    second = bench.measure(scene, effort(target=0.3, threads=1, repeat=2, spp=3))
    assert first["spp_to_error"] == pytest.approx(second["spp_to_error"], rel=1e-12)
    assert first["spp_to_error"] > bench.measure(scene, effort(target=0.6))["spp_to_error"]


def test_an_error_that_is_not_reached_is_said(monkeypatch):
    found = bench.measure(dl.scenes.build("cornell"), effort(target=1e-6))
    assert found["seconds_to_error"] is None
    assert found["spp_to_error"] is None
    assert found["seconds_to_error_all"] == [None, None]
    assert "not reached with 128 spp" in command._error_words(found)


# --- the command ------------------------------------------------------------------------------------------------------


def test_table_on_standard_output_progress_on_standard_error():
    done = run("mesh1m", "book1", "--quick", "--device", "cpu", *TINY)
    assert done.exit_code == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].split()[:3] == ["scene", "size", "triangles"]
    assert [line.split()[:3] for line in lines[1:-1]] == [["mesh1m", "12x8", "2000"], ["book1", "12x8", "0"]]
    assert all("spp to MSE" in line for line in lines[1:-1])
    assert lines[-1].startswith("paths: ")
    assert done.stderr.startswith("device: cpu")
    assert "[2/2] book1: making the scene" in done.stderr
    assert list(Path().iterdir()) == []


def test_json_has_figures_device_versions_sizes_and_seeds():
    done = run("instances", "--quick", "--seeds", 1, "--json", "a.json", "-q", *TINY)
    assert done.exit_code == 0, done.stderr
    assert done.stderr == ""
    found = json.loads(Path("a.json").read_text())
    assert found["version"] == dl.__version__
    assert found["quick"] is True
    for name in ("date", "device", "device_name", "driver", "cpu", "cores", "threads", "python", "numpy", "system"):
        assert name in found
    (result,) = found["results"]
    assert result["scene"] == "instances"
    assert result["detail"] == command.QUICK_DETAIL
    assert result["seeds"] == [1]
    assert result["target_relative_mse"] == 0.5 * command.QUICK_ERROR
    assert result["reference_spp"] == 64
    assert [p.name for p in Path().iterdir()] == ["a.json"]


def test_json_to_standard_output_and_no_seeds():
    done = run("origin", "--seeds", 0, "--json", "-", *TINY)
    assert done.exit_code == 0, done.stderr
    (result,) = json.loads(done.stdout)["results"]
    assert "seconds_to_error" not in result
    assert result["detail"] == 1
    assert command._row(result).endswith("not measured")


def test_sizes_without_options(monkeypatch):
    asked = []

    def measure(scene, given, say):
        asked.append(given)
        raise KeyboardInterrupt

    monkeypatch.setattr(bench, "measure", measure)
    assert run("cornell", "--device", "cpu").exit_code == 130
    assert run("cornell", "--device", "cpu", "--quick").exit_code == 130
    assert [(e.size, e.repeat, e.seeds) for e in asked] == [((75, 75), 5, 5), ((30, 30), 3, 3)]


def test_what_was_measured_before_an_interruption_is_kept(monkeypatch):
    whole = bench.measure

    def measure(scene, given, say):
        if scene.name == "origin":
            raise KeyboardInterrupt
        return whole(scene, given, say)

    monkeypatch.setattr(bench, "measure", measure)
    done = run("cornell", "origin", "--seeds", 0, "--json", "a.json", *TINY)
    assert done.exit_code == 130
    assert done.stderr.splitlines()[-1] == "interrupted: finished scenes are kept"
    assert [r["scene"] for r in json.loads(Path("a.json").read_text())["results"]] == ["cornell"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["mesh1"], ["SCENE", "'mesh1'", "did you mean 'mesh1m'"]),
        (["book1", "--device", "gpu"], ["device", "'gpu'", "auto, cpu"]),
        (["book1", "--size", "big"], ["--size", "'big'", "1280x720"]),
        (["book1", "--size", "0x4"], ["0"]),
        (["book1", "--spp", "0"], ["--spp", "0", "from 1 to"]),
        (["book1", "--seeds", "-1"], ["--seeds", "-1", "from 0 to"]),
        (["book1", "--build", "best"], ["build", "'best'", "balanced"]),
        (["book1", "--threads", "-2"], ["--threads", "-2", "from 0 to"]),
        (["book1", "--json", "no/such/a.json"], ["no/such/a.json", "cannot be written"]),
        (["book1", "--quik"], ["--quik"]),
    ],
)
def test_what_is_wrong_is_said_in_one_line(arguments, words):
    done = run(*arguments)
    assert done.exit_code == 2, done.stderr
    line = done.stderr.splitlines()[-1]
    assert line.startswith("destello: ")
    assert all(word in line for word in words), line
    assert "Msamples" not in done.stderr
