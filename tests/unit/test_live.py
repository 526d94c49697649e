"""Scenes that are edited while they render: pictures as if compiled anew, and no more work than an edit needs."""

from __future__ import annotations

import numpy as np
import pytest

import destello as dl
from destello import live as live_module
from destello import scenes
from destello.color import CURVES, TONES, Display
from destello.errors import InputError, SceneError
from destello.live import NOTHING, Edit, LiveScene
from live_scenes import SIZE, picture, random_edit, studio
from stats import z_threshold

NODE, LEAF, INSTANCE, MATERIAL, SLOT, OBJECT = 80, 48, 164, 36, 16, 32  # bytes


def assert_as_compiled_anew(live: LiveScene, device: str, what: object) -> None:
    fresh = LiveScene(live.scene, device)
    assert np.array_equal(picture(live), picture(fresh)), what
    assert np.array_equal(live.ids(SIZE), fresh.ids(SIZE)), what
    flags = ("interiors", "lights", "clear_shadows", "simple")
    assert {name: live.stats()[name] for name in flags} == {name: fresh.stats()[name] for name in flags}, what


# --- the same pictures ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("sequence", range(4))
def test_random_edits_end_where_compiling_anew_does(device: str, rng: np.random.Generator, sequence: int) -> None:
    live, done = LiveScene(studio(), device), []
    for step in range(24):
        kind, edit = random_edit(live, rng)
        done.append(kind)
        assert edit.recompiled == "", done
        if step % 4 == 3:
            assert_as_compiled_anew(live, device, (sequence, done))


def test_undo_gives_the_first_picture_again(device: str, rng: np.random.Generator) -> None:
    first = studio()
    live = LiveScene(first, device)
    before = picture(live)
    for _ in range(8):
        random_edit(live, rng)
    assert not np.array_equal(picture(live), before)
    live.update(first)
    assert np.array_equal(picture(live), before)


@pytest.mark.parametrize("name", ["book1", "cornell", "cornell-smoke", "book3"])
def test_as_an_ordinary_render(device: str, name: str) -> None:
    """Instances round differently, so the last bits differ; the samples are the same ones."""
    scene = scenes.build(name)
    scene.render.max_depth = 8
    size, spp = (64, 40), 16
    image = dl.render(scene, spp=spp, size=size, device=device, progress=False)
    a, b = image.array, picture(LiveScene(scene, device), spp, size)
    assert image.film is not None
    deviation = np.sqrt(np.maximum(2 * image.film.core.variance(), 1e-8))
    difference = np.abs(a - b) @ np.array([0.2126, 0.7152, 0.0722])
    assert np.median(difference / deviation) < 0.1
    assert (difference / deviation).max() < z_threshold(difference.size)


def test_a_worn_tree_is_built_anew(device: str, rng: np.random.Generator) -> None:
    scene = studio()
    group = scene.groups["pair"]
    for x in range(60):
        scene.add(dl.shapes.instance(group, transform=dl.translate(0.5 * x - 15, 0, -4), name=f"i{x}"))
    live = LiveScene(scene, device)
    edits = []
    for x in range(60):  # far away from where they were, one after another
        place = dl.translate(*rng.uniform([-5, 0, -9], [5, 5, 1]))
        edits.append(live.set_transform(f"i{x}", place))
    assert 0 < sum(edit.rebuilt for edit in edits) < 30
    assert all((edit.rebuilt == 1) == (edit.refitted == 0) for edit in edits)
    assert_as_compiled_anew(live, device, "worn")


def test_motion_blur_and_frames(device: str) -> None:
    scene = studio()
    keys = {"translate": {"times": [0, 1], "values": [[0, 0, 0], [2, 1, 0]]}}
    box = next(i for i, s in enumerate(scene.shapes) if s.name == "box")
    scene.shapes[box] = scene.shapes[box].replace(animation=keys)
    live = LiveScene(scene, device)
    edit = live.set_frame(12)
    assert not edit.recompiled
    assert edit.refitted
    assert np.array_equal(picture(live), picture(LiveScene(scene, device, frame=12)))
    live.set_transform("ball", dl.translate(0, 2, 0), dl.translate(1, 2, 0))
    assert np.array_equal(picture(live), picture(LiveScene(live.scene, device, frame=12)))


# --- no more work than needed -----------------------------------------------------------------------------------------
def test_moving_a_mesh_touches_the_top_level_only(device: str) -> None:
    live = LiveScene(studio(), device)
    stats = live.stats()
    edit = live.set_transform("mesh", dl.translate(0.5, 0.3, 2))
    top = edit.refitted
    assert (edit.recompiled, edit.rebuilt) == ("", 0)
    assert 1 <= top <= 4
    assert stats["nodes"] > top + 2
    # the instance, the tree over instances and its root's copy; the extent is the floor's, so lights stay
    assert edit.light_tables == 0
    assert edit.bytes == INSTANCE + LEAF + (top + 1) * NODE
    assert live.stats() == stats


def test_constants_of_a_material_are_a_few_bytes(device: str) -> None:
    live = LiveScene(studio(), device)
    stats = live.stats()
    edit = live.set_material("glass", {"ior": 1.7})
    assert edit == Edit(edit.version, bytes=edit.bytes)
    assert edit.bytes < 512
    for i in range(50):  # slots and numbers are used again
        live.set_material("mesh", {"reflectance": (0.01 * i, 0.5, 0.5)})
    assert {name: live.stats()[name] for name in ("nodes", "instances")} == {
        name: stats[name] for name in ("nodes", "instances")
    }
    assert live.stats()["materials"] <= stats["materials"] + 2
    assert live.stats()["slots"] <= stats["slots"] + 32


def test_lights_are_weighed_anew_where_they_change(device: str) -> None:
    live = LiveScene(studio(), device)
    assert live.set_light("point", {"intensity": (1, 2, 3)}).light_tables == 1
    assert live.set_transform("bulb", dl.translate(2, 2, 0) @ dl.scale(0.2)).light_tables == 1
    assert live.set_environment({"transform": dl.rotate("y", 30)}).light_tables == 1
    assert live.set_material("ball", {"emission": (1, 1, 1)}).light_tables == 1
    assert live.set_material("ball", {"reflectance": (0.1, 0.1, 0.1)}).light_tables == 1  # it shines
    assert live.set_material("box", {"reflectance": (0.1, 0.1, 0.1)}).light_tables == 0
    assert live.set_camera("default", {"vfov": 30}).bytes == 0
    lights = live.stats()["lights"]
    changed = live.scene.copy()
    changed.lights = []
    assert not live.update(changed).recompiled
    assert live.stats()["lights"] == lights - 2


def test_rotating_an_environment_sends_no_texels(device: str) -> None:
    live = LiveScene(studio(), device)
    assert live.set_environment({"transform": dl.rotate("y", 30)}).bytes < 1024
    assert live.set_environment(dl.environments.image(np.ones((16, 32, 3), np.float32))).bytes > 16 * 32 * 12
    assert_as_compiled_anew(live, device, "environment")


def test_what_is_compiled_anew_says_why(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    live = LiveScene(studio(), device)
    more = live.scene.copy()
    more.add(dl.shapes.sphere(center=(0, 3, 0), radius=0.2))
    assert live.update(more).recompiled == "shapes were added or removed"
    other = live.scene.copy()
    other.shapes[3] = other.shapes[3].replace(max=(0.5, 2, 0.5))
    assert live.update(other).recompiled == "shapes[3] has another geometry"
    single = live.scene.copy()
    pair = single.groups["pair"]
    shapes = (pair.shapes[0].replace(material=dl.materials.diffuse()), *pair.shapes[1:])
    single.groups["pair"] = type(pair)("pair", shapes)
    assert "others in its group" in live.update(single).recompiled
    monkeypatch.setattr(live_module, "WASTE", 1000)
    image = dl.textures.image(np.full((16, 16, 3), 0.5, np.float32))
    assert "given up" in live.set_material("ball", {"reflectance": image}).recompiled
    assert_as_compiled_anew(live, device, "compiled anew")


def test_what_is_gone_slows_nothing_down(device: str) -> None:
    scene = scenes.build("cornell")
    live = LiveScene(scene, device)
    assert live.stats()["simple"] == 1
    for material in (dl.materials.interface(medium_density=1), dl.materials.diffuse(opacity=0.5)):
        live.set_material("tall box", material)
        assert live.stats()["simple"] == 0
        live.update(scene)
        assert live.stats()["simple"] == 1
        assert live.stats()["interiors"] == 0


def test_insides_that_are_gone_leave_no_gap(device: str) -> None:
    scene = studio()
    fog = dl.materials.interface(medium_density=2, medium_albedo=(0.9, 0.3, 0.1))
    scene.shapes[1] = scene.shapes[1].replace(material=dl.materials.dielectric(ior=1.3))
    scene.shapes[3] = scene.shapes[3].replace(material=fog)
    live = LiveScene(scene, device)
    assert live.stats()["interiors"] == 3
    live.set_material("ball", dl.materials.diffuse())
    live.set_material("glass", {"ior": 2.0})  # comes to lie where the fog's was
    assert live.stats()["interiors"] == 2
    assert_as_compiled_anew(live, device, "interiors")


def test_textured_insides_change_in_place(device: str) -> None:
    """Their colour's slot moves with the material's."""
    live = LiveScene(studio(), device)
    picture = dl.textures.image(np.random.default_rng(2).random((8, 8, 3), np.float32))
    skin = dl.materials.openpbr(subsurface_weight=1, subsurface_radius=0.2, subsurface_color=picture)
    for words in ({}, {"subsurface_radius": 0.1}, {"subsurface_color": (0.2, 0.9, 0.4)}, {"subsurface_color": picture}):
        assert not live.set_material("ball", skin.replace(**words)).recompiled
        live.set_material("mesh", {"reflectance": (0.1, 0.5, 0.5)})
        assert_as_compiled_anew(live, device, str(words))


def test_a_new_texture_goes_in_place(device: str) -> None:
    live = LiveScene(studio(), device)
    image = dl.textures.image(np.random.default_rng(1).random((8, 8, 3), np.float32))
    edit = live.set_material("ball", {"reflectance": image})
    assert not edit.recompiled
    assert edit.bytes >= 8 * 8 * 3 * 4
    assert_as_compiled_anew(live, device, "texture")


def test_a_refused_edit_leaves_everything(device: str) -> None:
    live = LiveScene(studio(), device)
    before, version = picture(live), live.version
    with pytest.raises(SceneError):
        live.set_material("ball", {"reflectance": (2, 0, 0)})
    with pytest.raises(InputError, match="stretched"):
        live.set_transform("ball", dl.scale(1, 2, 1))
    assert live.version == version
    broken = live.scene.copy()
    broken.lights[1] = dl.lights.directional(direction=(0, 0, 0))
    broken.shapes[1] = broken.shapes[1].replace(center=(0, 5, 0))
    with pytest.raises(SceneError):  # the core refuses it, when a part of the edit is done
        live.update(broken)
    assert np.array_equal(picture(live), before)


# --- looking ----------------------------------------------------------------------------------------------------------
def test_ids_and_picks_agree_and_name_the_shape(device: str, rng: np.random.Generator) -> None:
    live = LiveScene(studio(), device)
    ids = live.ids(SIZE)
    assert ids.dtype == np.uint32
    assert ids.shape == SIZE[::-1]
    assert {"floor", "ball", "glass", "box", "mesh", "two"} <= {
        live.shown.shapes[i].name for i in np.unique(ids) if i != NOTHING
    }
    origin = np.array(live.camera()["origin"])
    for x, y in rng.integers([0, 0], SIZE, (40, 2)):
        found = live.pick(x + 0.5, y + 0.5, SIZE)
        assert (NOTHING if found is None else found.index) == ids[y, x]
        if found is not None:
            assert found.node is live.shown.shapes[found.index]
            to = np.array(found.point) - origin
            assert np.linalg.norm(to) == pytest.approx(found.distance, rel=1e-4)
            assert np.dot(to, found.normal) < 0
            assert np.linalg.norm(found.normal) == pytest.approx(1, abs=1e-5)


def test_a_picked_sphere_is_where_geometry_says(device: str) -> None:
    live = LiveScene(studio(), device)
    size = (101, 101)
    camera = dl.cameras.perspective(origin=(-2, 1.01, 7), target=(-2, 1.01, 0), vfov=20)
    found = live.pick(50.5, 50.5, size, camera)
    assert found is not None
    assert found.node.name == "ball"
    assert found.point == pytest.approx((-2, 1.01, 1), abs=1e-4)
    assert found.normal == pytest.approx((0, 0, 1), abs=1e-3)
    assert found.distance == pytest.approx(6, abs=1e-4)
    assert live.ids(size, camera)[50, 50] == found.index
    up = dl.cameras.perspective(origin=(0, 20, 0), target=(0, 30, 0), up=(0, 0, 1))
    assert live.pick(50, 50, size, up) is None


@pytest.mark.parametrize("tone", TONES)
@pytest.mark.parametrize("curve", CURVES)
def test_pictures_are_those_of_the_display(device: str, tone: str, curve: str) -> None:
    live = LiveScene(studio(), device)
    film = live.film(*SIZE)
    live.render(film, 2)
    for exposure in (-3.0, 0.0, 4.0):
        display = Display(exposure, tone, curve)
        wanted = display.quantise(film.mean()).astype(int)
        difference = np.abs(film.picture(display).astype(int) - wanted)
        assert difference.max() <= 1
        assert np.mean(difference > 0) < 0.01
        assert wanted.max() > wanted.min()


def test_films_go_on_and_start_anew(device: str) -> None:
    live = LiveScene(studio(), device)
    whole, parts = live.film(*SIZE), live.film(*SIZE, guides=True)
    live.render(whole, 6)
    for samples in (1, 2, 3):
        live.render(parts, samples)
    assert np.array_equal(whole.mean(), parts.mean())
    assert parts.samples == 6
    near = live.camera().replace(vfov=20)
    live.render(parts, 2, camera=near, guides=True)
    assert (parts.samples, parts.guide_samples) == (2, 2)
    live.render(parts, 2, camera=near)
    assert (parts.samples, parts.guide_samples) == (4, 2)
    live.set_material("ball", {"reflectance": (0, 0, 0)})
    live.render(parts, 1, camera=near)
    assert parts.samples == 1
    parts.restart()
    live.render(parts, 3, camera=near)
    assert parts.samples == 3
    with pytest.raises(InputError, match="no guides"):
        whole.albedo()


def test_guides_are_the_features_of_a_render(device: str) -> None:
    scene = studio()
    live = LiveScene(scene, device)
    film = live.film(*SIZE, guides=True)
    live.render(film, 4, guides=True)
    image = dl.render(scene, spp=4, size=SIZE, device=device, aov=("albedo", "normal"), progress=False)
    for name, own in (("albedo", film.albedo()), ("normal", film.normal())):
        assert np.mean(np.abs(own - image.aovs[name]) < 1e-4) > 0.98


def test_volumes_in_groups_are_compiled_anew(device: str) -> None:
    """They stand where the instance was: the picture after an edit is that of the edited scene."""
    ones = np.ones((2, 2, 2), np.float32)
    scene = dl.Scene("clouds")
    cloud = dl.volumes.box(dl.volumes.grid(density=ones), medium_density=3, name="cloud")
    group = scene.group("sky", [cloud, dl.shapes.sphere((0.5, 2, 0.5), 0.4)])
    scene.add(dl.shapes.instance(group, name="here"), dl.shapes.sphere((-1, 0, 0), 0.5, name="ball"))
    scene.camera = dl.cameras.perspective(origin=(0, 1, 6), target=(0, 1, 0))
    live = LiveScene(scene, device)
    assert not live.set_transform("ball", dl.translate(0, 1, 0)).recompiled
    assert "a volume follows" in live.set_transform("here", dl.translate(1, 0, 0)).recompiled
    ids = live.ids(SIZE)
    assert {int(n) for n in np.unique(ids)} == {0, 1, NOTHING}
    row, column = np.argwhere(ids == 0)[-1]  # the cloud's lower edge
    picked = live.pick(column + 0.5, row + 0.5, SIZE)
    assert picked is not None
    assert (picked.node.name, picked.point[1] < 1) == ("here", True)
    thicker = live.scene.copy()
    sky = thicker.groups["sky"]
    inside = cloud["material"].replace(medium_density=5.0)
    thicker.groups["sky"] = type(sky)("sky", (cloud.replace(material=inside), *sky.shapes[1:]))
    assert "has a volume" in live.update(thicker).recompiled
    fresh = LiveScene(live.scene, device)
    assert np.array_equal(picture(live), picture(fresh))


def test_volumes_follow_their_shapes(device: str) -> None:
    """What is moved, or gets another medium where it stands, is compiled anew; the rest still edits in place."""
    ones = np.ones((2, 2, 2), np.float32)
    scene = dl.Scene("clouds")
    cloud = dl.volumes.box(dl.volumes.grid(density=ones), medium_density=3, name="cloud")
    scene.add(cloud, dl.shapes.sphere((-1, 0, 0), 0.5, name="ball"))
    scene.camera = dl.cameras.perspective(origin=(0, 1, 6), target=(0, 1, 0))
    live = LiveScene(scene, device)
    thicker = cloud["material"].replace(medium_density=5.0)
    assert not live.set_material("cloud", thicker).recompiled  # it has no transform yet
    assert "a volume follows shapes[0]" in live.set_transform("cloud", dl.translate(1, 0.5, 0)).recompiled
    assert not live.set_transform("ball", dl.translate(0, 1, 0)).recompiled
    assert np.array_equal(picture(live), picture(LiveScene(live.scene, device)))
    assert "a volume stands where" in live.set_material("cloud", cloud["material"]).recompiled
    assert np.array_equal(picture(live), picture(LiveScene(live.scene, device)))
