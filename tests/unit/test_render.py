"""`render` on the real core: the same bits however the work is divided, what is kept when it stops, what is refused."""

from __future__ import annotations

import signal
import sys
from importlib import import_module
from itertools import count, pairwise

import numpy as np
import pytest

import destello as dl
from destello.errors import InputError, RenderError
from destello.film import Film

SIZE = (24, 16)
passes = import_module("destello.passes")
rendering = import_module("destello.render")  # the module; dl.render is its function


def render(**options):
    return dl.render("cornell", **{"size": SIZE, "spp": 8, "progress": False, **options})


def same_sums(a, b) -> bool:
    a, b = a.film.core.state(), b.film.core.state()
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


def one_sample_passes(monkeypatch):
    monkeypatch.setattr(passes.Pacer, "next", lambda self: 1)


# The same bits ------------------------------------------------------------------------------------------------------


def test_bits_do_not_depend_on_the_passes(device, monkeypatch):
    whole = render(device=device, spp=20, aov=("albedo",))
    for lengths in ([1], [3, 1, 7], [100]):
        pattern = count()
        monkeypatch.setattr(passes.Pacer, "next", lambda self, ls=lengths, p=pattern: ls[next(p) % len(ls)])
        again = render(device=device, spp=20, aov=("albedo",))
        assert np.array_equal(again.array, whole.array)
        assert same_sums(again, whole)


@pytest.mark.parametrize("cuts", [[0, 5, 8], [0, 1, 2, 3, 8], [0, 7, 8]])
def test_any_split_of_the_samples_adds_to_the_same_bits(device, cuts):
    whole = render(device=device)
    parts = [render(device=device, spp=None, samples=span).film for span in pairwise(cuts)]
    film = parts.pop()
    for part in parts:
        film.add(part)
    assert film.spans == ((0, 8),)
    assert np.array_equal(film.core.mean(), whole.array)


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_bits_do_not_depend_on_threads(threads):
    assert same_sums(render(threads=threads), render())


def test_crop_is_cut_from_the_whole(device):
    whole = render(device=device, aov=("depth",))
    part = render(device=device, crop=(3, 2, 11, 9), aov=("depth",))
    assert part.array.shape == (7, 8, 3)
    assert np.array_equal(part.array, whole.array[2:9, 3:11])
    assert np.array_equal(part.aovs["depth"], whole.aovs["depth"][2:9, 3:11])
    assert part.metadata["crop"] == "3:11,2:9"
    assert part.metadata["full_size"] == "24x16"


def test_a_cropped_exr_knows_its_place(tmp_path):
    import OpenImageIO as oiio

    part = render(crop=(3, 2, 11, 9))
    for name in ("a.exr", "a.png"):
        part.save(tmp_path / name)
        assert dl.Image.load(tmp_path / name).array.shape == (7, 8, 3)
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert (spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (3, 2, 0, 0, 24, 16)


def test_seed_and_samples_change_the_noise_but_not_the_picture():
    a, b = render(spp=64), render(spp=64, seed=5)
    assert not np.array_equal(a.array, b.array)
    assert a.array.mean() == pytest.approx(b.array.mean(), rel=0.1)


# Resuming -----------------------------------------------------------------------------------------------------------


def test_resume_gives_the_bits_of_an_uninterrupted_render(device, tmp_path):
    path = tmp_path / "a.film"
    first = render(device=device, spp=5, resume=path)
    assert path.is_file()
    assert first.metadata["film"] == str(path)
    second = render(device=device, spp=13, resume=path)
    whole = render(device=device, spp=13)
    assert np.array_equal(second.array, whole.array)
    assert same_sums(second, whole)
    assert second.metadata["spp"] == 13
    assert second.metadata["rays"] == whole.metadata["rays"]
    assert Film.load(path).spans == ((0, 13),)


def test_resume_of_a_finished_film_renders_nothing(tmp_path):
    path = tmp_path / "a.film"
    first = render(resume=path)
    again = render(resume=path)
    assert np.array_equal(again.array, first.array)
    assert again.metadata["stopped_by"] == "samples"
    assert again.metadata["seconds"] < 0.5


def test_resume_fills_gaps(tmp_path):
    path = tmp_path / "a.film"
    render(spp=None, samples=(3, 5), resume=path)
    assert same_sums(render(resume=path), render())


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"seed": 1}, "seed"),
        ({"size": (8, 8)}, "size"),
        ({"max_depth": 3}, "max_depth"),
        ({"max_volume_depth": 3}, "max_volume_depth"),
        ({"crop": (0, 0, 4, 4)}, "crop"),
        ({"aov": ("depth",)}, "aovs"),
    ],
)
def test_resume_of_another_render_is_refused(tmp_path, options, name):
    path = tmp_path / "a.film"
    render(resume=path)
    before = path.read_bytes()
    with pytest.raises(InputError, match=f"its {name} differs"):
        render(resume=path, **options)
    assert path.read_bytes() == before


def test_resume_of_another_scene_is_refused(tmp_path):
    path = tmp_path / "a.film"
    render(resume=path)
    scene = dl.scenes.build("cornell")
    scene.add(dl.shapes.sphere(center=(1, 1, 1), radius=0.5))
    with pytest.raises(InputError, match="its scene differs"):
        dl.render(scene, size=SIZE, spp=8, resume=path, progress=False)


def test_resume_with_fewer_samples_is_refused(tmp_path):
    path = tmp_path / "a.film"
    render(resume=path)
    with pytest.raises(InputError, match=r"'0:8'.*within 0:4"):
        render(spp=4, resume=path)


def test_the_film_is_saved_now_and_then(tmp_path, monkeypatch):
    path = tmp_path / "a.film"
    one_sample_passes(monkeypatch)
    monkeypatch.setattr(rendering, "CHECKPOINT_SECONDS", 0.0)
    seen = []

    def look(status):
        if path.exists() and not status.finished:
            seen.append(Film.load(path).spp)

    render(resume=path, spp=64, progress=look)
    assert len(seen) >= 2
    assert seen == sorted(seen)
    assert seen[0] < 64


# Stopping early -----------------------------------------------------------------------------------------------------


def test_time_limit():
    image = render(spp=None, time=0.4)
    assert image.metadata["stopped_by"] == "time"
    assert 0.1 < image.metadata["seconds"] < 3
    assert np.array_equal(image.array, render(spp=image.metadata["spp"]).array)


def test_the_first_of_several_ends_stops():
    image = render(spp=3, time=1000.0)
    assert (image.metadata["spp"], image.metadata["stopped_by"]) == (3, "samples")


def test_target_error_stops_at_the_same_sample_for_any_passes(device, monkeypatch):
    first = render(device=device, spp=None, target_error=0.25)
    assert first.metadata["stopped_by"] == "error"
    assert first.metadata["relative_error"] <= 0.25
    assert first.film.relative_error() == pytest.approx(first.metadata["relative_error"])
    one_sample_passes(monkeypatch)
    again = render(device=device, spp=None, target_error=0.25)
    assert again.metadata["spp"] == first.metadata["spp"]
    assert np.array_equal(again.array, first.array)


def test_error_checks_are_fixed_and_ever_rarer():
    checks = passes.error_checks()
    found = [next(checks) for _ in range(12)]
    assert found[:4] == [16, 20, 25, 31]
    assert found[-1] > 150


def interrupt_after(spp: int):
    def progress(status):
        if status.done >= spp and not status.finished:
            signal.raise_signal(signal.SIGINT)

    return progress


def test_interrupt_keeps_the_work_and_the_film_goes_on_from_there(device, tmp_path, monkeypatch):
    one_sample_passes(monkeypatch)
    path = tmp_path / "a.film"
    with pytest.raises(KeyboardInterrupt) as caught:
        render(device=device, spp=200, rescue=path, progress=interrupt_after(3))
    image = caught.value.image
    assert image.metadata["stopped_by"] == "interrupt"
    assert image.metadata["spp"] == 3
    assert image.metadata["film"] == str(path)
    assert np.array_equal(image.array, render(device=device, spp=3).array)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert same_sums(render(device=device, spp=6, resume=path), render(device=device, spp=6))


def test_rescue_never_replaces_an_older_film(tmp_path, monkeypatch):
    one_sample_passes(monkeypatch)
    path = tmp_path / "a.film"
    path.write_bytes(b"of another render")
    with pytest.raises(KeyboardInterrupt) as caught:
        render(spp=200, rescue=path, progress=interrupt_after(2))
    assert path.read_bytes() == b"of another render"
    assert caught.value.image.metadata["film"] is None


def test_no_rescue_film_without_need(tmp_path):
    render(rescue=tmp_path / "a.film")
    assert not (tmp_path / "a.film").exists()


def test_at_a_prompt_the_interrupted_picture_is_returned(monkeypatch):
    one_sample_passes(monkeypatch)
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    image = render(spp=200, progress=interrupt_after(2))
    assert (image.metadata["spp"], image.metadata["stopped_by"]) == (2, "interrupt")


def test_a_failed_render_keeps_the_passes_that_were_whole(tmp_path, monkeypatch):
    from destello import _core

    one_sample_passes(monkeypatch)
    calls, real = count(), _core.Renderer

    class Failing:
        def __init__(self, *args, **kwargs):
            self._real = real(*args, **kwargs)

        def render(self, *args, **kwargs):
            if next(calls) == 4:
                raise RuntimeError("the device fell off the bus")
            return self._real.render(*args, **kwargs)

        def cancel(self):
            self._real.cancel()

    with monkeypatch.context() as patch:
        patch.setattr(_core, "Renderer", Failing)
        with pytest.raises(RenderError, match=r"fell off the bus; the 4 spp so far are in .*a\.film") as caught:
            render(rescue=tmp_path / "a.film")
    assert caught.value.exit_code == 1
    assert same_sums(render(resume=tmp_path / "a.film"), render())


# What is told -------------------------------------------------------------------------------------------------------


def test_metadata_says_how_it_was_made():
    image = render(seed=7, max_depth=5, max_volume_depth=9)
    expected = {"scene": "cornell", "spp": 8, "samples": "0:8", "width": 24, "height": 16, "seed": 7, "max_depth": 5}
    expected["max_volume_depth"] = 9
    assert expected.items() <= image.metadata.items()
    assert image.metadata["version"] == dl.__version__
    assert image.metadata["device"] in ("cpu", "cuda:0")
    assert image.metadata["device_reason"]
    assert image.metadata["rays"] > 8 * 24 * 16
    rate = 8 * 24 * 16 / image.metadata["seconds"]
    assert image.metadata["samples_per_second"] == pytest.approx(rate)
    assert image.metadata["nonfinite_samples"] == 0


def test_progress_is_told_every_pass(monkeypatch):
    one_sample_passes(monkeypatch)
    seen = []
    render(progress=seen.append)
    assert [status.done for status in seen] == [1, 2, 3, 4, 5, 6, 7, 8, 8]
    assert [status.finished for status in seen] == [False] * 8 + [True]
    assert all(status.total == 8 for status in seen)
    assert seen[3].eta is not None
    assert seen[-1].fraction == 1
    assert "8/8 spp" in seen[-1].text()
    assert "Mrays/s" in seen[-1].text()


def test_preview_is_a_whole_picture_each_time(tmp_path, monkeypatch):
    one_sample_passes(monkeypatch)
    monkeypatch.setattr(rendering, "PREVIEW_SECONDS", 0.0)
    path = tmp_path / "p.png"
    seen = []

    def look(status):
        if path.exists():
            seen.append(dl.Image.load(path).array.shape)

    image = render(spp=64, preview=path, progress=look)
    assert len(seen) >= 2
    assert set(seen) == {(16, 24, 3)}
    assert np.array_equal(dl.Image.load(path).to_uint8(), image.to_uint8()), "the last preview is the picture"


def test_messages_and_silence(capsys):
    said = []
    render(messages=said.append)
    assert len(said) == 1
    assert said[0].startswith("device: ")
    render()
    assert capsys.readouterr() == ("", "")


def test_scene_display_settings_are_the_images(tmp_path):
    scene = dl.scenes.build("cornell")
    scene.render.exposure, scene.render.tone = 1.5, "agx"
    image = dl.render(scene, size=SIZE, spp=2, progress=False)
    image.save(tmp_path / "a.png")
    image.save(tmp_path / "b.png", exposure=1.5, tone="agx")
    image.save(tmp_path / "c.png", exposure=0, tone="none")
    pixels = [dl.Image.load(tmp_path / f"{name}.png").array for name in "abc"]
    assert np.array_equal(pixels[0], pixels[1])
    assert not np.array_equal(pixels[0], pixels[2])
    image.save(tmp_path / "a.exr", bits=32)
    assert np.array_equal(dl.Image.load(tmp_path / "a.exr").array, image.array)


def test_layers(device):
    image = render(device=device, aov=["albedo", "normal", "depth"])
    assert {name: layer.shape for name, layer in image.aovs.items()} == {
        "albedo": (16, 24, 3), "normal": (16, 24, 3), "depth": (16, 24)
    }  # fmt: skip
    lengths = np.linalg.norm(image.aovs["normal"], axis=2)
    assert lengths.max() <= 1.0001
    assert image.aovs["albedo"].min() >= 0
    assert 500 < image.aovs["depth"].max() < 3000
    assert render(device=device, aov="depth").aovs.keys() == {"depth"}


def test_denoise_guides_are_not_kept_unless_asked_for():
    pytest.importorskip("pyoidn")
    image = render(denoise=True)
    assert image.metadata["denoised"] is True
    assert image.aovs == {}
    assert not np.array_equal(image.array, render().array)
    assert np.array_equal(image.film.core.mean(), render().array)
