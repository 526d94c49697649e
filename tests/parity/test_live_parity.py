"""Edited scenes on CUDA against the CPU: the same ids, and the same samples but for rounding."""

from __future__ import annotations

import numpy as np
import pytest

from destello import scenes
from destello.color import Display
from destello.live import LiveScene
from live_scenes import picture, random_edit, studio
from stats import z_threshold

pytestmark = pytest.mark.cuda

SIZE, SPP = (96, 64), 64
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def assert_same_picture(cpu: LiveScene, gpu: LiveScene) -> None:
    halves = [picture(cpu, SPP, SIZE), picture(gpu, SPP, SIZE)]
    other = cpu.scene.copy()
    other.render.seed = 1
    apart = picture(LiveScene(other, "cpu"), SPP, SIZE)
    # How far independent pictures lie apart tells what rounding may do at most: the samples are the same ones.
    a, b, c = (x @ LUMINANCE for x in (*halves, apart))
    deviation = np.sqrt(np.mean((a - c) ** 2))
    assert np.median(np.abs(a - b)) < 0.05 * deviation
    assert abs(a.mean() - b.mean()) < z_threshold(1) * deviation / np.sqrt(a.size)


def test_random_edits(rng: np.random.Generator) -> None:
    cpu, gpu = (LiveScene(studio(), device) for device in ("cpu", "cuda:0"))
    for step in range(24):
        state = rng.bit_generator.state
        random_edit(cpu, rng)
        rng.bit_generator.state = state
        random_edit(gpu, rng)
        assert cpu.scene == gpu.scene
        if step % 6 == 5:
            assert np.mean(cpu.ids(SIZE) != gpu.ids(SIZE)) < 0.005  # rays along an edge
            assert_same_picture(cpu, gpu)


@pytest.mark.parametrize("name", ["book1", "cornell", "cornell-smoke"])
def test_ids_of_scenes(name: str) -> None:
    cpu, gpu = (LiveScene(scenes.build(name), device) for device in ("cpu", "cuda:0"))
    assert np.mean(cpu.ids((200, 150)) != gpu.ids((200, 150))) < 0.002


def test_device_pictures_and_guides() -> None:
    live = LiveScene(studio(), "cuda:0")
    film = live.film(*SIZE, guides=True)
    live.render(film, 2, guides=True)
    normals = film.normal()
    live.render(film, 6)
    assert np.array_equal(film.normal(), normals)  # later passes are without
    for tone in ("none", "agx", "neutral", "filmic"):
        difference = film.picture(Display(0.5, tone)).astype(int) - Display(0.5, tone).quantise(film.mean())
        assert np.abs(difference).max() <= 1
