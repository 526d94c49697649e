"""The scripts in benches/: what they compare and measure, on tiny scenes. No times are judged."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import destello as dl

BENCHES = Path(__file__).resolve().parents[2] / "benches"


def script(name):
    if str(BENCHES) not in sys.path:
        sys.path.append(str(BENCHES))  # they import one another
    spec = importlib.util.spec_from_file_location(f"benches_{name}", BENCHES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def run(name, *args):
    command = [sys.executable, BENCHES / f"{name}.py", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def lines(text):
    return [json.loads(line) for line in text.splitlines()]


# --- compare ----------------------------------------------------------------------------------------------------------

ENTRY = {
    "scene": "book1",
    "size": [12, 8],
    "spp": 4,
    "device": "CPU",
    "kernel_Msamples_s": 2.0,
    "seconds_to_error": 1.0,
}


@pytest.fixture
def files(tmp_path):
    def write(*runs):
        paths = [tmp_path / f"{i}.json" for i in range(len(runs))]
        for path, text in zip(paths, runs, strict=True):
            path.write_text(text if isinstance(text, str) else "\n".join(map(json.dumps, text)) + "\n")
        return paths

    return write


def test_ratios_say_what_is_better_and_the_worst_comes_first(files):
    after = {**ENTRY, "kernel_Msamples_s": 3.0, "seconds_to_error": 1.25}
    done = run("compare", *files([ENTRY], [after]))
    assert done.returncode == 0
    rows = [line.split() for line in done.stdout.splitlines()]
    assert [(row[0], row[1]) for row in rows] == [("0.800", "seconds_to_error"), ("1.500", "kernel_Msamples_s")]
    assert rows[0][2:5] == ["1", "->", "1.25"]


@pytest.mark.parametrize(("threshold", "code"), [(0.1, 1), (0.25, 0)])
def test_threshold_decides_the_exit_code(files, threshold, code):
    before, after = files([ENTRY], [{**ENTRY, "kernel_Msamples_s": 1.6}])
    assert run("compare", before, after, "--threshold", threshold).returncode == code
    assert run("compare", after, before, "--threshold", threshold).returncode == 0


@pytest.mark.parametrize("change", [{"size": [13, 8]}, {"spp": 5}, {"device": "GPU"}, {"scene": "x"}, {"detail": 0.5}])
def test_only_the_same_measurement_is_compared(files, change):
    done = run("compare", *files([ENTRY], [{**ENTRY, **change}]))
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("only in") == 2
    assert "no measurement in common" in done.stderr


def test_files_of_destello_bench_are_understood(files):
    module = script("compare")
    whole = {"device": "CPU", "version": "1", "results": [{k: v for k, v in ENTRY.items() if k != "device"}]}
    bench, plain = files(json.dumps(whole, indent=2), [ENTRY])
    (ratio, other) = module.compare(module.read(bench), module.read(plain))
    assert ratio.ratio == other.ratio == 1
    done = run("compare", bench, bench)
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) == 2


@pytest.mark.parametrize("text", ["", "no json", '{"scene": "a"}\n{', "[1, 2]", '{"results": 3}'])
def test_files_without_measurements_are_refused(files, text):
    done = run("compare", *files(text, [ENTRY]))
    assert done.returncode == 2
    assert done.stderr.startswith("compare.py: ")
    assert len(done.stderr.splitlines()) == 1
    assert run("compare", "no-such-file", "no-such-file").returncode == 2


# --- render ---------------------------------------------------------------------------------------------------------


def test_render_measures_the_scene_in_another_model_of_surface():
    module = script("render")
    scene = dl.scenes.build("cornell")
    colors = [s["material"]["reflectance"] for s in scene.shapes if s["material"].type == "diffuse"]
    module.resurface(scene, "coat")
    coated = [s["material"] for s in scene.shapes if s["material"].type == "openpbr"]
    assert [m["base_color"] for m in coated] == colors
    assert {m["coat_weight"] for m in coated} == {0.5}
    assert sorted({s["material"].type for s in scene.shapes}) == ["emissive", "openpbr"]
    done = run("render", "cornell:8x8:1", "--repeat", 1, "--surface", "coat-and-fuzz")
    (entry,) = lines(done.stdout)
    assert (entry["scene"], entry["surface"]) == ("cornell", "coat-and-fuzz")
    assert entry["kernel_Msamples_s"] > 0


# --- build and rays ---------------------------------------------------------------------------------------------------


def test_build_reports_sizes(files):
    done = run("build", "mesh1m:0.002", "book1", "--repeat", 1)
    assert done.returncode == 0, done.stderr
    mesh, spheres = lines(done.stdout)
    assert (mesh["scene"], mesh["detail"], mesh["triangles"]) == ("mesh1m", 0.002, 2000)
    assert mesh["bvh_nodes"] > 0
    assert mesh["sah_cost"] > 1
    assert mesh["build_seconds"] > 0
    assert mesh["geometry_bytes_per_triangle"] > 36
    assert spheres["bvh_bytes_per_triangle"] is None
    assert mesh["device"] == "CPU"
    assert "mesh1m:0.002, balanced: 2000 triangles" in done.stderr
    (path,) = files(done.stdout)
    assert run("compare", path, path).returncode == 0


@pytest.mark.parametrize("name", ["build", "rays"])
def test_unknown_scenes_are_refused_in_one_line(name):
    for entry in ("mesh1", "mesh1m:none", "mesh1m:-1"):
        done = run(name, entry)
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1
        assert done.stderr.startswith(f"{name}.py: {entry}: ")


def test_rays_of_every_kind():
    done = run("rays", "interior:0.01", "--size", "16x9", "--repeat", 1)
    assert done.returncode == 0, done.stderr
    found = {entry["kind"]: entry for entry in lines(done.stdout)}
    assert list(found) == ["primary", "ao", "bounce", "shuffled", "random"]
    assert found["primary"]["count"] == 16 * 9
    assert found["primary"]["hit"] == found["bounce"]["hit"] == found["shuffled"]["hit"] == 1  # the room is closed
    assert 0 < found["ao"]["hit"] < 1
    assert all(entry["Mrays_s"] > 0 and entry["seconds"] > 0 and entry["spp"] == 1 for entry in found.values())


def test_camera_rays_are_the_cameras():
    """Their mean distance is that of the renderer's depth layer."""
    rays = script("rays")
    scene = dl.scenes.build("mesh1m", 0.002)
    core = scene.compile().core
    found = rays.camera_rays(scene, 64, 36, np.random.default_rng(0))
    hits = rays.trace(core, found, "simd")
    hit = (hits["leaf"] >= 0).reshape(36, 64)
    depth = dl.render(scene, size=(64, 36), spp=4, aov="depth", device="cpu", progress=False).aovs["depth"]
    seen = np.isfinite(depth) & (depth > 0)
    assert (seen == hit).mean() > 0.93  # but at the edges
    both = hit & seen
    assert np.median(np.abs(hits["t"].reshape(36, 64)[both] / depth[both] - 1)) < 0.05


# --- plots ------------------------------------------------------------------------------------------------------------


def points(figure, **shared):
    return [
        {"scene": "a", "device": "X", "device_name": "cpu", "triangles": n, figure: n / 7, **shared} for n in (9, 4)
    ]


def test_curves_go_from_few_triangles_to_many():
    plot = script("plot")
    entries = [*points("Mrays_s", kind="ao"), *points("Mrays_s", kind="primary"), {"kind": "ao", "triangles": 0}]
    found = plot.curves(entries, "Mrays_s", "kind")
    assert found == {("ao",): [(4, 4 / 7), (9, 9 / 7)], ("primary",): [(4, 4 / 7), (9, 9 / 7)]}
    again = {**entries[0], "Mrays_s": 5.0}
    assert plot.curves([*entries, again], "Mrays_s", "kind")["ao",] == [(4, 4 / 7), (9, 5.0)]


@pytest.mark.filterwarnings("ignore")
def test_a_plot_for_each_device_and_one_of_builds(files, tmp_path):
    pytest.importorskip("matplotlib")
    shared = {"cpu": "Some CPU", "cores": 2, "threads": 0}
    rays = [*points("Mrays_s", kind="ao", method="simd", **shared)]
    rays += [{**entry, "device": "H100", "device_name": "cuda:0", "method": "cuda:0"} for entry in rays]
    builds = points("build_seconds", kind="build", build="fast", **shared)
    paths = files([{**entry, "detail": i} for i, entry in enumerate(rays + builds)])
    done = run("plot", *paths, "-o", tmp_path / "plots")
    assert done.returncode == 0, done.stderr
    names = ["build.svg", "rays-cpu.svg", "rays-cuda.svg"]
    assert sorted(p.name for p in (tmp_path / "plots").iterdir()) == names
    assert "Some CPU, 2 threads, fast" in (tmp_path / "plots" / "build.svg").read_text()
    before = [(tmp_path / "plots" / name).read_bytes() for name in names]
    run("plot", *paths, "-o", tmp_path / "plots")
    assert before == [(tmp_path / "plots" / name).read_bytes() for name in names]


# --- peers ------------------------------------------------------------------------------------------------------------


def test_peers_that_are_missing_are_named_and_left_out(monkeypatch, capsys):
    peers = script("peers")
    monkeypatch.setattr(peers.importlib.util, "find_spec", lambda name: None)
    assert peers.available(("destello", "mitsuba:scalar_rgb", "embreex")) == ["destello"]
    assert capsys.readouterr().err.splitlines() == [
        "mitsuba:scalar_rgb: not installed, left out (pip install mitsuba==3.9.1)",
        "embreex: not installed, left out (pip install embreex)",
    ]
    assert run("peers", "mesh1").returncode == 2


@pytest.mark.parametrize("peer", ["destello", "destello rays", "destello rays (1 thread)"])
def test_a_peer_measures_in_a_process_of_its_own(peer, tmp_path):
    options = ["--spp", 2, "--repeat", 1, "--rays", tmp_path, "--pictures", tmp_path / "pictures"]
    done = run("peers", "--child", peer, *options, "interior:0.01:8x6")
    assert done.returncode == 0, done.stderr
    found = lines(done.stdout)
    assert {entry["peer"] for entry in found} == {peer}
    assert all(entry.get("Msamples_s", entry.get("Mrays_s")) > 0 for entry in found)
    other = [{**entry, "peer": "other"} for entry in found]
    assert all("1.00 times" in line for line in list(script("compare").peer_ratios(found + other))[len(found) :])
    if peer == "destello":
        assert found[0]["size"] == [8, 6]
        assert found[0]["peak_host_bytes"] > 1 << 20
        assert [p.name for p in (tmp_path / "pictures").iterdir()] == ["interior-destello.png"]
    else:
        assert [entry["kind"] for entry in found] == ["primary", "ao", "bounce", "shuffled", "random"]
        again = run("peers", "--child", peer, *options, "interior:0.01:8x6")  # with the rays that were kept
        assert [entry["hit"] for entry in lines(again.stdout)] == [entry["hit"] for entry in found]


def test_one_run_of_peers_is_compared_with_itself(files):
    ours = {"scene": "a", "detail": 1.0, "kind": "ao", "peer": "destello rays", "Mrays_s": 2.0, "hit": 0.5}
    theirs = {**ours, "peer": "embreex", "hit": 0.6, "Mrays_s": 1.0}
    mine = {"scene": "a", "detail": 0.5, "kind": "render", "peer": "destello", "Msamples_s": 6.0, "mean": [1.0] * 3}
    other = {**mine, "peer": "cycles", "Msamples_s": 2.0, "mean": [1.0, 1.0, 1.1], "relative_mse": 0.2}
    (run_of_peers,) = files([ours, theirs, {**mine, "relative_mse": 0.1}, other])
    done = run("compare", run_of_peers)
    assert done.returncode == 0
    _, rays, _, renders = done.stdout.splitlines()
    assert "destello: 2.00 times that, BUT 60.0% of the rays hit instead of 50.0%" in rays
    assert "destello: 3.00 times that, 6.00 for the same noise, BUT the picture's mean is" in renders
    (nobody,) = files([ENTRY])
    assert run("compare", nobody).returncode == 2


def test_noise_is_the_relative_mean_squared_error_of_one_run(rng):
    render = script("peers_render")
    pictures = [2 + rng.normal(size=(64, 64, 1)).repeat(3, axis=2) * 0.2 for _ in range(4)]
    assert render.noise(pictures) == pytest.approx(0.01, rel=0.1)
    assert render.noise(pictures[:1]) is None


def test_all_peers_get_ggx_for_the_books_metal():
    scene = script("peers_render").prepared(dl.scenes.build("book1"))
    assert not any(material.type == "fuzzy_metal" for material in scene.materials())
    fuzz = {m["roughness"] ** 2 for m in scene.materials() if m.type == "conductor"}
    assert len(fuzz) > 10
    assert scene.film.filter.type == "box"


@pytest.mark.parametrize("name", ["book1", "interior", "instances", "terrain"])
def test_what_cycles_reads(name, tmp_path):
    """Arrays and indices belong together, and the camera looks at what it should."""
    module = script("cycles_scene")
    scene = script("peers_render").prepared(dl.scenes.build(name, 0.002))
    module.export(scene, tmp_path, (16, 9), 8)
    found = json.loads((tmp_path / "scene.json").read_text())
    assert found["size"] == [16, 9]
    assert found["max_depth"] == 8
    assert np.load(tmp_path / "places.npy").shape == (len(found["objects"]), 4, 4)
    for number in range(len(found["meshes"])):
        points = np.load(tmp_path / f"{number}-positions.npy")
        assert np.load(tmp_path / f"{number}-indices.npy").max() == len(points) - 1
    assert {entry["material"] for entry in found["objects"]} == set(range(len(found["materials"])))
    view = np.array(found["camera"]["matrix"])
    assert np.allclose(view[:3, :3] @ view[:3, :3].T, np.eye(3))
    towards = np.subtract(scene.camera["target"], scene.camera["origin"])
    assert np.allclose(-view[:3, 2], towards / np.linalg.norm(towards))


def test_the_grounds_cap_is_part_of_a_sphere_and_faces_outwards():
    points, faces = script("cycles_scene").cap()
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0).all()


def test_what_mitsuba_has_not_is_refused_by_name(tmp_path):
    module = script("mitsuba_scene")
    moving = dl.scenes.build("book2-bouncing")
    for scene in (moving, dl.scenes.build("book2-earth"), dl.scenes.build("cornell-smoke")):
        with pytest.raises(module.Untranslatable):
            module._Translation(FakeMitsuba, tmp_path).scene(scene, (8, 8), 1, 8)


class FakeMitsuba:
    """As much of the module as placing things takes."""

    class ScalarTransform4f:
        def __init__(self, matrix=None):
            self.matrix = matrix

        def look_at(self, **place):
            return place


@pytest.mark.mitsuba
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["book1", "mesh1m", "instances", "terrain"])
def test_mitsuba_renders_the_same_picture(name, tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    scene = dl.scenes.build(name, 0.002)
    made = script("mitsuba_scene").translate(mi, scene, tmp_path, (16, 9), 64, 8)
    theirs = np.array(mi.render(mi.load_dict(made), spp=64))
    ours = dl.render(scene, size=(16, 9), spp=64, max_depth=8, device="cpu", progress=False).array
    assert theirs.shape == ours.shape
    assert np.allclose(theirs.mean((0, 1)), ours.mean((0, 1)), rtol=0.04)
    assert np.abs(theirs - ours).mean() < 0.12 * ours.mean()
