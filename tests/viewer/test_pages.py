"""What a page can do, without a browser: the picture, selecting, moving, editing, the final render."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import destello as dl
from destello.viewer.picture import OUTLINE
from destello.viewer.server import Viewer
from viewer_tests import SECONDS, SIZE, eventually, finished, first, look, message_of, select_short_box
from viser_page import Page, pixels


def test_a_page_gets_the_picture_that_render_makes(viewer: Viewer) -> None:
    with Page(viewer.url) as page:
        look(viewer, page)
        picture = finished(viewer, page, 32).astype(float)
    # The same samples: what differs is the JPEG.
    same = dl.render("cornell", spp=32, size=SIZE, device="cpu", progress=False).to_uint8().astype(float)
    assert picture.shape == same.shape
    assert np.sqrt(np.mean((picture - same) ** 2)) < 6
    assert abs(picture.mean() - same.mean()) < 0.5
    assert np.sqrt(np.mean((picture[:, ::-1] - same) ** 2)) > 20  # a mirrored one is far from it
    assert np.sqrt(np.mean((picture[::-1] - same) ** 2)) > 20


def test_the_picture_is_as_fine_as_the_canvas_and_coarser_while_it_moves(viewer: Viewer) -> None:
    session = None
    with Page(viewer.url) as page:
        look(viewer, page, size=(1600, 1000))
        page.frame()
        session = next(iter(viewer._app.sessions.values()))
        session.pacer.took(1, 1e-5)  # a slow machine
        for i in range(1, 6):
            look(viewer, page, replace(first(viewer), origin=(278.0 + i, 278.0, -800.0)), (1600, 1000))
            coarse = pixels(page.frame())
        assert coarse.shape[1] < 1600
        session.pacer.took(1, 1e-9)
        eventually(lambda: pixels(page.frame()).shape == (1000, 1600, 3))


def test_clicking_selects_and_the_gizmo_moves_what_is_saved(viewer: Viewer) -> None:
    with Page(viewer.url) as page:
        look(viewer, page)
        select_short_box(viewer, page)
        gizmo = eventually(lambda: message_of(page, "TransformControlsMessage"))
        eventually(lambda: outlined(pixels(page.frame())) > 40)
        before = viewer.scene.shapes[7]["transform"].matrix
        moved = {"type": "TransformControlsUpdateMessage", "name": "/selected", "owner": gizmo["owner"]}
        position = np.add(viewer._frame.page((186, 82.5, 169)), (0.5, 0, 0))  # half a unit along x
        page.send({**moved, "wxyz": [1.0, 0.0, 0.0, 0.0], "position": position.tolist()})
        eventually(lambda: not np.allclose(viewer.scene.shapes[7]["transform"].matrix, before))
        name, saved = viewer._app.call(lambda: scene_file(viewer))
        assert name == "cornell.yaml"
        assert b"short box" in saved
        assert viewer._app.call(viewer._app.undo) == "move"
        assert np.allclose(viewer.scene.shapes[7]["transform"].matrix, before)


def outlined(picture: np.ndarray) -> int:
    """How many pixels have the outline's colour."""
    return int((np.abs(picture.astype(int) - OUTLINE).max(axis=-1) < 60).sum())


def scene_file(viewer: Viewer) -> tuple[str, bytes]:
    from destello.viewer.panel_save import scene_file

    return scene_file(viewer.scene, "cornell")


def test_a_material_edit_changes_the_picture(viewer: Viewer) -> None:
    with Page(viewer.url) as page:
        look(viewer, page)
        before = finished(viewer, page, 8)
        page.click(0.1 + 0.15, 0.5)  # the green wall, as far left as it is seen
        session = next(iter(viewer._app.sessions.values()))
        assert eventually(lambda: session.selected is not None)
        wall = viewer.scene.shapes[session.selected]["material"]
        page.use("reflectance", [30, 60, 255])
        after = finished(viewer, page, 9)
    assert wall.name == "green"
    assert viewer.scene.shapes[0]["material"]["reflectance"][2] == 1
    assert after[..., 2].mean() > before[..., 2].mean() + 3


def test_a_script_edits_the_scene_that_is_shown(viewer: Viewer) -> None:
    with Page(viewer.url) as page:
        look(viewer, page)
        before = finished(viewer, page, 4)
        viewer.scene.shapes[:] = viewer.scene.shapes[:-2]  # without the boxes
        after = finished(viewer, page, 5)
        assert np.abs(after.astype(float) - before).mean() > 10
        viewer.scene.shapes.append(dl.shapes.instance(group="none such"))  # what cannot be shown is said
        eventually(lambda: any("none such" in str(m) for m in page.messages) or page.receive(SECONDS) is None)


def test_the_look_and_the_lens_are_the_pages_own(viewer: Viewer) -> None:
    with Page(viewer.url) as page, Page(viewer.url) as other:
        look(viewer, page)
        look(viewer, other)
        before = finished(viewer, page, 4)
        page.use("Exposure", -2.0)
        assert eventually(lambda: pixels(page.frame()).mean() < 0.7 * before.mean())
        assert pixels(other.frame()).mean() > 0.8 * before.mean()


def test_a_final_render_leaves_the_session_as_it_is(viewer: Viewer) -> None:
    with Page(viewer.url) as page:
        look(viewer, page)
        page.frame()
        for label, value in (("Samples a pixel", 4), ("Width", 40), ("Height", 30)):
            page.use(label, value)
        page.use("Render final", True)
        while not any("Done: 4 samples" in str(m.get("updates")) for m in page.messages):
            page.receive(SECONDS)
        page.use("Final picture (PNG)", True)
        parts = [m for m in page.messages if m["type"] == "FileTransferPart"]
        while not parts:
            parts = [m for m in page.receive(SECONDS) if m["type"] == "FileTransferPart"]
        assert bytes(parts[0]["content"]).startswith(b"\x89PNG")
        look(viewer, page, replace(first(viewer), vfov=30.0))
        assert pixels(page.frame()).size
