"""Live scenes from several threads: cancelling, edits between passes, films of several clients; and denoised frames."""

from __future__ import annotations

import importlib.util
import threading
import time

import numpy as np
import pytest

import destello as dl
from destello import denoise
from destello.color import Display
from destello.errors import InputError
from destello.live import LiveScene
from destello.live_film import show
from live_scenes import SIZE, picture, studio

MANY = 1_000_000  # samples that would take hours


class Worker(threading.Thread):
    """Calls something and keeps what it returned or raised."""

    def __init__(self, work: object) -> None:
        super().__init__(daemon=True)
        self.work = work
        self.result: object = None
        self.start()

    def run(self) -> None:
        self.result = self.work()  # type: ignore[operator]

    def finished(self) -> object:
        self.join(60)
        assert not self.is_alive()
        return self.result


def test_cancel_ends_a_pass_and_the_film_goes_on(device: str) -> None:
    live = LiveScene(studio(), device)
    film = live.film(320, 200)
    live.render(film, 1)
    worker = Worker(lambda: live.render(film, MANY))
    film.cancel()  # before it has begun or after
    done = worker.finished()
    assert done.cancelled  # type: ignore[attr-defined]
    assert film.samples == 1
    assert np.isfinite(film.mean()).all()
    assert film.next_sample == 1 + MANY
    again = live.film(*SIZE)
    assert live.render(again, 2).cancelled is False


def test_a_cancelled_pass_is_not_biased(device: str) -> None:
    """Pixels that were cut short have fewer samples, each with its own weight."""
    scene = dl.Scene("furnace")
    scene.camera = dl.cameras.perspective(origin=(0, 0, 5), target=(0, 0, 0))
    scene.environment = dl.environments.constant(radiance=0.25)
    live = LiveScene(scene, device)
    film = live.film(400, 300)
    worker = Worker(lambda: live.render(film, MANY))
    film.cancel()
    worker.finished()
    live.render(film, 1)
    assert film.mean() == pytest.approx(0.25, abs=1e-6)


def test_an_edit_does_not_wait_for_a_pass(device: str) -> None:
    live = LiveScene(studio(), device)
    film = live.film(320, 200)
    worker = Worker(lambda: live.render(film, MANY))
    while not live.busy:
        time.sleep(0.001)
    edit = live.set_material("ball", {"reflectance": (0.1, 0.2, 0.3)})
    assert worker.finished().cancelled  # type: ignore[attr-defined]
    assert live.version == edit.version
    assert np.array_equal(picture(live), picture(LiveScene(live.scene, device)))


def test_clients_edits_and_questions_at_the_same_time(device: str) -> None:
    live = LiveScene(studio(), device)
    cameras = [live.camera().replace(vfov=v) for v in (25, 60)]
    stop = threading.Event()

    def client(camera: dl.Node) -> int:
        film, passes = live.film(*SIZE), 0
        while not stop.is_set():
            passes += not live.render(film, 1, camera=camera).cancelled
            live.pick(5, 5, SIZE, camera)
            live.ids(SIZE, camera)
        return passes

    workers = [Worker(lambda camera=camera: client(camera)) for camera in cameras]
    for i in range(30):
        live.set_transform("box", dl.translate(0.05 * i, 0.2, 0.5))
        live.set_light("point", {"intensity": 1 + i})
    stop.set()
    for worker in workers:
        worker.finished()
    for camera in cameras:
        films = [live.film(*SIZE), (fresh := LiveScene(live.scene, device)).film(*SIZE)]
        live.render(films[0], 2, camera=camera)
        fresh.render(films[1], 2, camera=camera)
        assert np.array_equal(films[0].mean(), films[1].mean())


def test_quick_pictures_of_arrays_are_those_of_the_display(rng: np.random.Generator) -> None:
    radiance = rng.exponential(1.0, (40, 30, 3)).astype(np.float32)
    radiance[0, 0] = np.nan, np.inf, -1
    for display in (Display(1, "agx"), Display(0, "none", "linear"), Display(0, "aces2"), Display(0, "filmic")):
        difference = show(radiance, display).astype(int) - display.quantise(radiance)
        assert np.abs(difference).max() <= 1


def test_denoised_frames_are_nearer_to_the_truth(device: str) -> None:
    pytest.importorskip("pyoidn")
    live = LiveScene(studio(), device)
    size = (96, 64)
    truth = picture(live, 512, size)
    plain, guided = live.film(*size), live.film(*size, guides=True)
    live.render(plain, 8)
    live.render(guided, 4, guides=True)
    live.render(guided, 4)

    def error(image: np.ndarray) -> float:
        return float(np.mean(np.abs(np.minimum(image, 2) - np.minimum(truth, 2))))

    noisy, once = error(plain.mean()), error(plain.denoised())
    with_guides = error(guided.denoised())
    assert once < 0.8 * noisy
    assert with_guides < once
    first = guided.denoised()
    assert np.array_equal(first, guided.denoised())  # buffers are used again, nothing of the last frame stays
    live.render(guided, 4)
    assert not np.array_equal(first, guided.denoised())
    guided.close()


def test_a_missing_denoiser_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(denoise.importlib.util, "find_spec", lambda name: None if name == "pyoidn" else find(name))
    film = LiveScene(studio(), "cpu").film(*SIZE)
    with pytest.raises(InputError, match=r"destello\[denoise\]"):
        film.denoised()
