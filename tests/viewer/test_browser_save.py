"""The page in a real browser: what it saves, denoising, and the final render; one page for all."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import destello as dl
from destello.denoise import available
from destello.viewer.server import Viewer
from destello.viewer.session import Session
from viewer_browser import (
    FREE,
    SAME,
    converged,
    error,
    opened,
    press,
    ready,
    rendered,
    set_number,
    shot,
    tab,
    until,
)  # fmt: skip

pytestmark = pytest.mark.slow

Desk = tuple[Any, Viewer, Session]


@pytest.fixture(scope="module")
def desk(browser: Any) -> Iterator[Desk]:
    """The Cornell box in a page, and the page's session."""
    with dl.view(dl.scenes.build("cornell"), port=0, device="cpu") as viewer:
        page = opened(browser, viewer)
        yield page, viewer, ready(page, viewer)
        page.context.close()


def saved(page: Any, button: str, folder: Path) -> Path:
    """The file that the browser gets for a button of the tab `Save`."""
    tab(page, "Save")
    with page.expect_download() as download:
        press(page, button)
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def test_the_picture_is_saved_as_png_and_exr(desk: Desk, tmp_path: Path) -> None:
    page, viewer, session = desk
    converged(page, viewer)
    size = (session.view.height, session.view.width)
    assert session.film is not None
    wanted = rendered(session, viewer.scene, session.film.samples)
    png = np.asarray(Image.open(saved(page, "Picture (PNG)", tmp_path)))
    assert png.shape[:2] == size
    assert error(png[..., :3].astype(float), wanted) < SAME
    exr = dl.Image.load(saved(page, "Picture (EXR)", tmp_path))
    assert exr.array.shape == (*size, 3)
    assert np.abs(exr.to_uint8().astype(int) - png[..., :3]).max() <= 1  # the same picture, but for half floats
    assert exr.aovs.keys() == {"albedo", "normal"}
    for layer in (exr.array, *exr.aovs.values()):
        assert np.isfinite(layer).all()
    lengths = np.linalg.norm(exr.aovs["normal"], axis=-1)
    assert np.allclose(lengths[180, 300:600].max(), 1, atol=0.01)  # the back wall
    assert exr.aovs["albedo"][180, 300:600].max() > 0.5
    assert exr.array[..., 0].max() > 5  # the lamp, which a PNG clips


def test_the_camera_is_saved(desk: Desk, tmp_path: Path) -> None:
    page, _, session = desk
    loaded = dl.load(saved(page, "Camera", tmp_path)).cameras["view"]
    camera = session.camera
    for name in ("origin", "target", "up", "vfov", "aperture_radius", "focus_distance"):
        assert np.allclose(loaded[name], camera[name], rtol=1e-5), name


@pytest.mark.skipif(not available(), reason="the extra destello[denoise] is not installed")
def test_noise_is_removed_and_comes_back(desk: Desk) -> None:
    page, viewer, _ = desk
    before, session = converged(page, viewer)
    tab(page, "View")
    noise = page.get_by_label("Denoise", exact=True)
    noise.check()
    until(page, lambda: session.denoised and roughness(shot(page)) < 0.4 * roughness(before))
    clean = shot(page)
    assert abs(clean[FREE].mean() - before[FREE].mean()) < 4
    assert error(clean, before) < 12  # the same picture
    noise.uncheck()
    until(page, lambda: not session.denoised)
    converged(page, viewer, also=lambda seen: error(seen, before) < SAME)


def roughness(seen: np.ndarray) -> float:
    """How much neighbours differ, at the median: edges are few."""
    return float(np.median(np.abs(np.diff(seen[205:300, 350:440], axis=1))))


def test_a_final_render_shows_its_progress_and_the_session_lives(desk: Desk, tmp_path: Path) -> None:
    page, viewer, session = desk
    tab(page, "Save")
    panel = viewer._pages[session.client.client_id].save

    def number(label: str, field: Any, value: int) -> None:
        set_number(page, label, value)
        until(page, lambda: field.value == value)  # the page sends one widget's value at a time

    number("Samples a pixel", panel._spp, 4096)
    number("Width", panel._width, 64)
    number("Height", panel._height, 48)
    press(page, "Render final")
    bar = page.get_by_role("progressbar")
    until(page, lambda: bar.count() and 0 < float(bar.first.get_attribute("aria-valuenow") or 0) < 100)
    press(page, "Cancel")
    page.get_by_text("Cancelled.").wait_for()
    assert not viewer._app.final_running
    number("Samples a pixel", panel._spp, 8)
    press(page, "Render final")
    page.get_by_text("Done: 8 samples").wait_for()
    image = dl.Image.load(saved(page, "Final picture (EXR)", tmp_path))
    scene = viewer.scene.copy()
    scene.cameras = {"view": session.camera}
    same = dl.render(scene, spp=8, size=(64, 48), device="cpu", progress=False)
    assert np.allclose(image.array, same.array, rtol=2e-3, atol=1e-4)  # EXR has half floats
    _, after = converged(page, viewer)
    assert after is session
