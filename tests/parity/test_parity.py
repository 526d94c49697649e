"""The CUDA backend against the CPU backend: the same samples, hence the same pictures but for rounding."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from destello import _core, scenes
from parity_scenes import MADE
from stats import z_threshold

pytestmark = pytest.mark.cuda

WIDTH, SPP = 96, 64
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

SCENES = [*scenes.names(), *MADE]


def compiled(name: str) -> tuple[Any, dict[str, Any], int]:
    scene = MADE[name]() if name in MADE else scenes.build(name)
    settings = {
        "seed": 7,
        "max_depth": min(scene.render.max_depth, 12),
        "max_volume_depth": min(scene.render.max_volume_depth, 12),
        "time0": scene.render.shutter[0],
        "time1": scene.render.shutter[1],
    }
    return scene.compile().core, settings, max(1, round(WIDTH * scene.film.height / scene.film.width))


def film(
    core: Any,
    device: str,
    height: int,
    settings: dict[str, Any],
    parts: tuple[int, ...] = (0, SPP),
    features: bool = False,
) -> Any:
    """With `features` CUDA takes the fused kernel, without the queue kernel."""
    renderer = _core.Renderer(core, device)
    total = _core.Film(WIDTH, height, features)
    for first, last in itertools.pairwise(parts):
        renderer.render(total, 0, first, last, settings)
    return total


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("sampling", ["auto", "mis", "bsdf"])
@pytest.mark.parametrize("features", [False, True])
def test_same_picture(name: str, sampling: str, features: bool) -> None:
    core, settings, height = compiled(name)
    settings["light_sampling"] = sampling
    cpu, gpu = (film(core, device, height, settings, features=features) for device in ("cpu", "cuda:0"))
    a, b = cpu.mean() @ LUMINANCE, gpu.mean() @ LUMINANCE
    deviation = np.sqrt(np.maximum(cpu.variance() + gpu.variance(), 1e-10))
    assert np.abs(a - b).max() > 0 or np.array_equal(a, b)
    assert (np.abs(a - b) / deviation).max() < z_threshold(a.size)
    # The samples are the same ones: most pixels agree far better than two independent pictures would.
    assert np.median(np.abs(a - b) / deviation) < 0.3
    for aov in ("albedo", "normal", "depth") if features else ():
        difference = np.abs(cpu.aov(aov) - gpu.aov(aov))
        assert np.median(difference) <= 1e-4 * max(1.0, float(np.abs(cpu.aov(aov)).max()))


@pytest.mark.parametrize(
    "name",
    ["origin", "book1", "cornell", "cornell-smoke", "textures and media", "clouds", "placed clouds", "a large tree"],
)
def test_bits_do_not_depend_on_the_split(name: str) -> None:
    core, settings, height = compiled(name)
    whole = film(core, "cuda:0", height, settings).state()
    parts = film(core, "cuda:0", height, settings, (0, 1, 7, 32, 33, SPP)).state()
    again = film(core, "cuda:0", height, settings).state()
    for key in whole:
        assert np.array_equal(whole[key], parts[key])
        assert np.array_equal(whole[key], again[key])


MEDIA = ("book2", "cornell-smoke", "cloud", "fire")
CLEAR = [n for n in scenes.names() if n not in MEDIA]  # shadow rays pass neither media nor holes


@pytest.mark.parametrize("name", [*CLEAR, "normal maps and mixtures", "a large tree"])
def test_queues_and_fused_render_the_same(name: str) -> None:
    """The same stages on the same numbers; but the compiler may fuse other multiplications and additions in each."""
    core, settings, height = compiled(name)
    states = [film(core, "cuda:0", height, {**settings, "execution": e}).state() for e in ("queues", "fused")]
    a, b = (s["sums"] for s in states)
    same = float(np.mean(np.all(a == b, axis=-1)))
    print(f"{name}: {same:.4f} of the pixels agree to the bit")
    films = [_core.Film.from_state(s) for s in states]
    difference = np.abs(films[0].mean() - films[1].mean()) @ LUMINANCE
    deviation = np.sqrt(np.maximum(films[0].variance() + films[1].variance(), 1e-10))
    assert np.median(difference / deviation) < 0.05
    assert (difference / deviation).max() < z_threshold(difference.size)


def test_queues_are_for_opaque_shadows_without_features() -> None:
    for name, features in (("cornell", True), ("cornell-smoke", False)):
        core, settings, height = compiled(name)
        with pytest.raises(ValueError, match="execution 'queues'"):
            film(core, "cuda:0", height, {**settings, "execution": "queues"}, features=features)
    core, settings, height = compiled("cornell")
    with pytest.raises(ValueError, match="expected auto, fused or queues"):
        film(core, "cuda:0", height, {**settings, "execution": "quickly"})


def test_few_samples_and_odd_sizes() -> None:
    """Work that fills no block: the queue kernel must end, and count each sample once."""
    core, settings, _ = compiled("cornell")
    renderer = _core.Renderer(core, "cuda:0")
    for width, height, samples, crop in [
        (1, 1, 1, None),
        (3, 5, 7, None),
        (33, 9, 65, (5, 2, 6, 9)),
        (64, 1, 200, None),
    ]:
        target = _core.Film(width, height)
        counts = renderer.render(target, 0, 0, samples, settings, crop)
        x0, y0, x1, y1 = crop or (0, 0, width, height)
        assert counts["samples"] == (x1 - x0) * (y1 - y0) * samples
        assert target.weight().sum() == counts["samples"]


def test_a_crop_is_a_part_of_the_whole() -> None:
    core, settings, height = compiled("book1")
    whole = film(core, "cuda:0", height, settings).mean()
    part = _core.Film(WIDTH, height)
    _core.Renderer(core, "cuda:0").render(part, 0, 0, SPP, settings, (13, 5, 60, 40))
    assert np.array_equal(part.mean()[5:40, 13:60], whole[5:40, 13:60])
    assert part.weight()[:5].max() == 0


def test_cancel_stops_a_long_render() -> None:
    import threading
    import time

    core, settings, _ = compiled("book2")
    renderer, target = _core.Renderer(core, "cuda:0"), _core.Film(800, 800)
    renderer.render(target, 0, 0, 1, settings)  # warm
    timer = threading.Timer(0.2, renderer.cancel)
    start = time.monotonic()
    timer.start()
    result = renderer.render(target, 0, 0, 1_000_000, settings)
    assert result["cancelled"]
    assert time.monotonic() - start < 5
