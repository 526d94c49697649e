"""The viewer's parts that need no page: cameras, sizes of pictures, undo, widgets, placing, access."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import destello as dl
from destello.errors import InputError, SceneError
from destello.schema import schema
from destello.viewer.access import Access, Refusal, address, is_local
from destello.viewer.camera import Frame, View, field_of_view, focal_length, quaternion, rotation_matrix
from destello.viewer.controls import changed, controls, from_picker, to_picker
from destello.viewer.document import Document, replace_material
from destello.viewer.history import History
from destello.viewer.placement import can_move, moved, pose_of, rotation_of, with_rotation, words_of_matrix
from destello.viewer.resolution import Pacer


# --- camera -----------------------------------------------------------------------------------------------------------
def page_camera(view: View, frame: Frame) -> SimpleNamespace:
    """What a page has when its camera stands at `view`: OpenCV axes, its own unit."""
    forward = np.array(view.target) - view.origin
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, view.up) / np.linalg.norm(np.cross(z, view.up))
    rotation = np.stack([x, np.cross(z, x), z], axis=1)
    return SimpleNamespace(
        wxyz=np.array(quaternion(rotation)), position=frame.page(view.origin), look_at=frame.page(view.target),
        fov=math.radians(view.vfov), image_width=view.width, image_height=view.height,
    )  # fmt: skip


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (0.3, 0.8, -0.2)])
def test_a_page_camera_and_back(up: tuple[float, float, float]) -> None:
    view = View((3.0, 2.0, 5.0), (0.5, 1.0, -1.0), up, 35.0, 640, 400)
    frame = Frame((0.5, 1.0, -1.0), 1.7)
    back = View.from_page(page_camera(view, frame), frame)
    assert np.allclose(back.origin, view.origin)
    assert np.allclose(back.target, view.target)
    assert back.vfov == pytest.approx(35)
    assert (back.width, back.height) == (640, 400)
    right = np.cross(np.array(view.target) - view.origin, up)
    assert abs(np.dot(back.up, right)) < 1e-9
    assert np.dot(back.up, up) > 0


def test_the_cameras_view_is_the_renderers() -> None:
    """A point that the page shows at some place is where the renderer has it: not mirrored, not upside down."""
    scene = dl.Scene()
    scene.environment = dl.environments.constant(radiance=0)
    red = dl.materials.emissive(radiance=(1, 0, 0))
    scene.add(dl.shapes.sphere((1, 1, 0), 0.5, material=red))  # to the right and above
    view = View((0, 0, 8), (0, 0, 0), (0, 1, 0), 40.0, 32, 32)
    frame = Frame.of(view.node())
    seen = View.from_page(page_camera(view, frame), frame)
    scene.camera = seen.node()
    picture = dl.render(scene, spp=4, size=(32, 32), device="cpu", progress=False).array[..., 0]
    rows, columns = np.nonzero(picture > 0.5)
    assert rows.mean() < 14
    assert columns.mean() > 18


def test_the_first_camera_is_four_units_from_what_it_turns_about() -> None:
    frame = Frame.of(dl.cameras.perspective(origin=(278, 278, -800), target=(278, 278, 0)))
    assert np.allclose(frame.page((278, 278, -800)), (0, 0, -4))
    assert np.allclose(frame.scene((0, 0, 0)), (278, 278, 0))


def test_focal_length_is_that_of_a_24_mm_high_sensor() -> None:
    assert focal_length(math.degrees(2 * math.atan(12 / 50))) == pytest.approx(50)
    assert field_of_view(focal_length(40)) == pytest.approx(40)


def test_quaternions_of_all_kinds_of_rotation(rng: np.random.Generator) -> None:
    turns = [np.array(q, float) for q in ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
    turns += [q / np.linalg.norm(q) for q in rng.normal(size=(200, 4))]
    for q in turns:
        again = np.array(quaternion(rotation_matrix(q)))
        assert np.abs(again @ q) == pytest.approx(1, abs=1e-12)


def test_without_viser_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"destello\[viewer\]"):
        dl.view("cornell")


# --- size of the picture ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("cost", [1e-5, 1e-6, 1e-7, 1e-9])  # seconds a sample
def test_frames_come_quickly_while_moving_and_fine_at_rest(cost: float) -> None:
    pacer = Pacer()
    for _ in range(12):
        plan = pacer.plan(1280, 800, moving=True)
        seconds = cost * plan.width * plan.height * plan.spp
        pacer.took(plan.width * plan.height * plan.spp, seconds)
    assert seconds < 0.1 or plan.width <= 128  # over 10 frames a second, or as coarse as it goes
    assert plan.width / plan.height == pytest.approx(1.6, rel=0.03)
    assert plan.full == (cost < 1e-7)
    first = pacer.plan(1280, 800, moving=False, shown=plan.width * plan.height)
    assert first.full == (cost * 1280 * 800 <= 0.5)
    assert first.full or cost * first.width * first.height <= 0.5  # something better soon, whatever it costs
    still = pacer.plan(1280, 800, moving=False, done=1000, shown=first.width * first.height)
    assert (still.width, still.height) == (1280, 800)
    assert cost * 1280 * 800 * (still.spp - 1) <= 0.2


def test_a_coarse_picture_is_never_empty() -> None:
    pacer = Pacer()
    pacer.took(100, 10.0)
    plan = pacer.plan(40, 3000, moving=True)
    assert plan.width >= 32
    assert plan.height == 300


# --- undo -------------------------------------------------------------------------------------------------------------
def test_undo_and_redo_are_each_others_inverse() -> None:
    history: History[int] = History()
    state = 0
    for new in (1, 2, 3):
        history.record(f"to {new}", state)
        state = new
    states = []
    while (back := history.undo(state)) is not None:
        state = back
        states.append(state)
    assert states == [2, 1, 0]
    assert history.can_redo == "to 1"
    assert history.redo(0) == 1
    assert history.can_undo == "to 1"
    history.record("other", 1)
    assert history.redo(9) is None  # what was undone is gone


def test_a_drag_is_one_step() -> None:
    history: History[int] = History()
    for state in range(5):
        history.record("drag", state, merge="drag")
    history.seal()
    history.record("drag", 5, merge="drag")
    assert history.undo(6) == 5
    assert history.undo(5) == 0
    assert history.undo(0) is None


def edit(document: Document, change: object, merge: object = None) -> None:
    document.edit("edit", change, lambda scene: scene.validate(), merge)  # type: ignore[arg-type]


def test_edits_change_the_callers_scene_and_are_undone_in_place() -> None:
    scene = dl.scenes.build("cornell")
    before = scene.copy()
    document = Document(scene)
    box = scene.shapes[6]
    edit(document, lambda s: s.shapes.__setitem__(6, box.replace(name="other")))
    assert scene.shapes[6].name == "other"
    assert document.revision == 1
    assert document.undo() == "edit"
    assert scene.shapes[6] is box
    assert scene == before
    assert document.redo() == "edit"
    assert scene.shapes[6].name == "other"


def test_an_edit_that_is_not_accepted_leaves_nothing() -> None:
    document = Document(dl.scenes.build("cornell"))
    shapes = list(document.scene.shapes)

    def change(scene: dl.Scene) -> None:
        scene.shapes.append(dl.shapes.instance(group="none such"))

    with pytest.raises(SceneError):
        edit(document, change)
    assert document.scene.shapes == shapes
    assert document.revision == 0
    assert document.undo() is None


def test_what_python_changes_is_noticed_and_can_be_undone() -> None:
    document = Document(dl.scenes.build("cornell"))
    assert not document.poll()
    document.scene.render.max_depth = 3
    document.scene.shapes.pop()
    assert document.poll()
    assert not document.poll()
    document.undo()
    assert len(document.scene.shapes) == 8
    assert document.scene.render.max_depth == 50


def test_a_material_is_replaced_wherever_it_is() -> None:
    scene = dl.scenes.build("cornell")
    white = scene.shapes[2]["material"]
    mixed = dl.materials.mix(white, dl.materials.conductor(), amount=0.3)
    scene.shapes[6] = scene.shapes[6].replace(material=mixed)
    scene.group("g", [scene.shapes[7]])
    new = dl.materials.diffuse(reflectance=0.1)
    assert replace_material(scene, white, new) == 6
    assert scene.shapes[2]["material"] is new
    assert scene.shapes[6]["material"]["first"] is new
    assert scene.groups["g"].shapes[0]["material"] is new
    assert scene.shapes[0]["material"].name == "green"


# --- widgets ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("doc", [d for d in schema() if d.kind in ("material", "light", "environment", "camera")])
def test_every_parameter_has_a_widget_within_its_range(doc: object) -> None:
    if any(p.required for p in doc.params.values()):  # type: ignore[attr-defined]
        pytest.skip("needs other nodes")
    node = dl.Node(doc.kind, doc.type)  # type: ignore[attr-defined]
    shown = [*controls(node), *controls(node, common=True)]
    editable = ("scalar", "integer", "color", "vector", "bool", "enum")
    assert {c.name for c in shown} == {p.name for p in node.doc.params.values() if p.kind in editable}
    for c in shown:
        param = node.doc.param(c.name)
        if c.widget == "slider":
            assert (c.low, c.high) == (param.min, param.max)
            assert c.step is not None
        value = changed(param, node[c.name], c.value)
        assert node[c.name] is None or value == node[c.name]  # what is only looked at does not change
        node.replace(**{c.name: value})


def test_colours_go_through_a_picker_and_back() -> None:
    for color in ((0.2, 0.45, 0.03), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)):
        assert np.allclose(from_picker(*to_picker(color, bright=False), bright=False), color, atol=0.004)
    assert np.allclose(from_picker(*to_picker((15, 3, 0.5), bright=True), bright=True), (15, 3, 0.5), atol=0.07)


# --- placing ----------------------------------------------------------------------------------------------------------
SHAPES = {
    "box": dl.shapes.box((0, 0, 0), (1, 2, 3), transform=dl.translate(4, 5, 6) @ dl.rotate("y", 30) @ dl.scale(2)),
    "mirrored": dl.shapes.box((0, 0, 0), (1, 2, 3), transform=dl.scale(-1, 2, 1)),
    "sheared": dl.shapes.box((0, 0, 0), (1, 2, 3), transform=dl.shear(xy=0.5)),
    "quad": dl.shapes.quad((343, 554, 332), (-130, 0, 0), (0, 0, -105)),
    "sphere": dl.shapes.sphere((1, 2, 3), 0.5),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_that_is_moved_is_where_it_was_put(name: str) -> None:
    scene, shape = dl.Scene(), SHAPES[name]
    now = pose_of(scene, shape)
    there = replace(now, position=tuple(np.add(now.position, (10, -2, 1))))
    put = moved(shape, now, there)
    assert np.allclose(pose_of(scene, put).position, there.position, rtol=1e-5)
    back = moved(put, there, now)
    assert np.allclose(pose_of(scene, back).position, now.position, rtol=1e-5)
    if name != "sphere":
        matrices = [(node["transform"] or dl.Transform()).matrix for node in (shape, back)]
        assert np.allclose(*matrices, atol=1e-4)


def test_turning_and_growing_is_about_the_middle() -> None:
    scene, shape = dl.Scene(), SHAPES["box"]
    now = pose_of(scene, shape)
    turned = moved(shape, now, now.turned((10.0, 80.0, -30.0)))
    assert np.allclose(pose_of(scene, turned).degrees, (10, 80, -30), atol=1e-4)
    grown = moved(shape, now, type(now)(now.position, now.rotation, (4.0, 4.0, 4.0)))
    assert np.allclose(pose_of(scene, grown).position, now.position)
    assert pose_of(scene, grown).scale == (4, 4, 4)
    low, high = (np.array(b) for b in pose_bounds(grown))
    was_low, was_high = (np.array(b) for b in pose_bounds(shape))
    assert np.allclose(high - low, 2 * (was_high - was_low), rtol=1e-5)


def pose_bounds(shape: dl.Node) -> tuple[np.ndarray, np.ndarray]:
    scene = dl.Scene()
    scene.add(shape)
    bounds = scene.bounds()
    assert bounds is not None
    return bounds


@pytest.mark.parametrize("words", [(), ("translate",), ("scale", "rotate", "translate"), ("shear",)])
def test_saved_transforms_read_well(words: tuple[str, ...], rng: np.random.Generator) -> None:
    made = {
        "translate": dl.translate(1, 2, 3), "rotate": dl.rotate((0.3, 0.5, -0.2), 77), "scale": dl.scale(1, 2, 3),
        "shear": dl.shear(xy=0.4),
    }  # fmt: skip
    transform = dl.Transform([word for name in words for word in made[name].words])
    again = words_of_matrix(transform.matrix)
    assert np.allclose(again.matrix, transform.matrix, atol=1e-5)
    assert [name for name, _ in again.words] == (["matrix"] if words == ("shear",) else list(words))


def test_half_turns_have_an_axis() -> None:
    for axis in ("x", "y", "z", (1, 1, 0)):
        turn = dl.rotate(axis, 180)
        assert np.allclose(words_of_matrix(turn.matrix).matrix, turn.matrix, atol=1e-5)


def test_what_cannot_be_moved_says_why() -> None:
    assert can_move(SHAPES["box"]) is None
    assert "animated" in (can_move(dl.shapes.sphere((0, 0, 0), 1, center1=(1, 0, 0))) or "")
    assert can_move(dl.shapes.spheres(np.zeros((1, 3)), np.ones(1)))


def test_the_sky_turns_by_one_word() -> None:
    sky = dl.rotate("x", 10)
    turned = with_rotation(with_rotation(sky, 30), 50)
    assert turned is not None
    assert len(turned.words) == 2
    assert rotation_of(turned) == 50
    assert with_rotation(turned, 0) == sky
    assert with_rotation(None, 0) is None
    assert rotation_of(None) == 0


# --- access -----------------------------------------------------------------------------------------------------------
TOKEN = "0123456789abcdefXYZ"


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "::1", "127.3.2.1"])
def test_this_machine_needs_no_token(host: str) -> None:
    access = Access.for_host(host)
    assert is_local(host)
    assert access.token is None
    assert access.check("/?a=b", ["localhost:8080"], []) == "/"
    assert access.check("/x.js", ["127.0.0.1:8080"], ["http://127.0.0.1:8080"]) == "/x.js"


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.7", "render-box", "localhost.example.org"])
def test_others_need_one(host: str) -> None:
    first, second = Access.for_host(host), Access.for_host(host)
    assert first.token
    assert len(first.token) >= 20
    assert first.token != second.token
    assert first.token in address(host, 80, first)


@pytest.mark.parametrize(
    "path", ["/", f"/{TOKEN[:-1]}/", f"/{TOKEN}x/", f"/x/{TOKEN}/", f"/?{TOKEN}", "", f"//{TOKEN}/", "/é/"]
)
def test_a_wrong_token_is_refused(path: str) -> None:
    found = Access(TOKEN).check(path, ["box:8080"], [])
    assert isinstance(found, Refusal)
    assert found.status == 403


def test_the_right_token_is_taken_off_the_path() -> None:
    access = Access(TOKEN)
    assert access.check(f"/{TOKEN}", ["box:8080"], ["http://box:8080"]) == "/"
    assert access.check(f"/{TOKEN}/a/b?c", ["box:8080"], []) == "/a/b"


@pytest.mark.parametrize(
    ("hosts", "origins"),
    [
        (["evil.example:8080"], []),  # a name of theirs that leads to 127.0.0.1
        (["localhost:8080"], ["http://evil.example"]),  # a page of theirs in the user's browser
        (["localhost:8080"], ["null"]),
        (["localhost:8080"], ["http://localhost:9999"]),
        ([], []),
        (["localhost:8080", "localhost:8080"], []),
        (["localhost:8080"], ["http://localhost:8080", "http://localhost:8080"]),
        (["[::1"], []),
    ],
)
def test_requests_from_elsewhere_are_refused(hosts: list[str], origins: list[str]) -> None:
    assert isinstance(Access().check("/", hosts, origins), Refusal)


@pytest.mark.parametrize("token", ["short", "a" * 15, "with/slash/in/it/12345", "ünïcödé-token-12345"])
def test_a_token_that_can_be_guessed_or_breaks_the_path_is_refused(token: str) -> None:
    with pytest.raises(InputError, match="token"):
        Access.for_host("0.0.0.0", token)
