"""Nodes and their factories: what is accepted, what is refused and how it is said."""

from __future__ import annotations

import inspect
import math
import pickle
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello import nodes
from destello.errors import Error, SceneError, gather
from destello.nodes import DEEPEST, Node
from destello.schema import KINDS, TypeDoc, schema

ALL_TYPES = list(schema())
CAN_BE_EMPTY = [doc for doc in ALL_TYPES if not any(p.required for p in doc.params.values()) and doc.type != "image"]


def ids(doc: TypeDoc) -> str:
    return f"{doc.kind}.{doc.type}"


def problem(function: Any, *args: Any, **params: Any) -> SceneError:
    with pytest.raises(SceneError) as caught:
        function(*args, **params)
    assert "\n" not in str(caught.value)
    return caught.value


# --- factories --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("doc", ALL_TYPES, ids=ids)
def test_every_type_has_a_factory_with_help(doc: TypeDoc) -> None:
    module = getattr(dl, KINDS[doc.kind])
    factory = getattr(module, doc.type)
    assert doc.type in dir(module)
    assert factory.__name__ == doc.type
    signature = inspect.signature(factory)
    if doc.type != "image" or doc.kind != "texture":
        for param in doc.params.values():
            assert signature.parameters[param.name].default == (
                inspect.Parameter.empty if param.required else param.default
            )
            assert param.doc.split(".")[0] in factory.__doc__
            assert not param.unit or param.unit in factory.__doc__
    assert "name" in signature.parameters


@pytest.mark.parametrize("doc", CAN_BE_EMPTY, ids=ids)
def test_defaults_are_accepted_when_given(doc: TypeDoc) -> None:
    module = getattr(dl, KINDS[doc.kind])
    empty = getattr(module, doc.type)()
    full = empty.replace(**{name: param.default for name, param in doc.params.items()})
    for name in doc.params:
        assert empty[name] == full[name]


def test_lists_cover_the_issue() -> None:
    assert {"diffuse", "fuzzy_metal", "conductor", "dielectric", "emissive", "mix"} <= set(dir(dl.materials))
    assert {"solid", "image", "checker", "noise", "turbulence", "marble", "planet", "scaled"} <= set(dir(dl.textures))
    assert {"sphere", "spheres", "mesh", "mesh_file", "quad", "box", "instance"} == set(dir(dl.shapes))
    assert {"point", "spot", "directional"} <= set(dir(dl.lights))
    assert {"constant", "gradient", "image"} <= set(dir(dl.environments))
    assert {"perspective", "orthographic", "panorama"} <= set(dir(dl.cameras))
    assert {"gaussian", "box", "tent", "mitchell", "blackman_harris"} <= set(dir(dl.filters))


@pytest.mark.parametrize("name", ["opacity", "emission", "normal_map", "bump", "medium_density", "priority"])
def test_a_mix_has_nothing_but_its_two_materials(name: str) -> None:
    """Paths see one of the two: what would be the mix's own did nothing."""
    two = {"first": dl.materials.diffuse(), "second": dl.materials.conductor()}
    with pytest.raises(SceneError, match=f"{name}: mix has no parameter of this name") as found:
        dl.materials.mix(**two, **{name: 0.5})
    assert "amount, first, second" in str(found.value)


def test_unknown_factory_names_the_nearest() -> None:
    with pytest.raises(AttributeError, match="did you mean 'diffuse'"):
        _ = dl.materials.difuse
    assert not hasattr(dl.materials, "__wrapped__")


def test_positional_arguments() -> None:
    assert dl.shapes.sphere((0, 1, 2), 3) == dl.shapes.sphere(center=(0, 1, 2), radius=3)
    assert dl.shapes.mesh_file("a.ply") == dl.shapes.mesh_file(path="a.ply")
    error = problem(dl.materials.diffuse, (1, 1, 1), reflectance=(0, 0, 0))
    assert error.place == "diffuse"
    assert "given twice" in str(error)
    assert "too many" in str(problem(dl.filters.box, *range(20)))


# --- values -----------------------------------------------------------------------------------------------------------
def test_values_have_one_form() -> None:
    material = dl.materials.diffuse(reflectance=np.float32([0.5, 0.25, 0]), roughness=np.float64(1))
    assert material.params["reflectance"] == (0.5, 0.25, 0.0)
    assert type(material.params["reflectance"][0]) is float
    assert type(material.params["roughness"]) is float
    assert dl.materials.diffuse(reflectance=1).params["reflectance"] == (1.0, 1.0, 1.0)
    assert dl.materials.emissive(two_sided=np.True_).params["two_sided"] is True
    assert dl.materials.diffuse(reflectance=None).params == {}


BAD_VALUES = [
    ("roughness", 1.5, "out of range", "from 0 to 1"),
    ("roughness", -0.1, "out of range", "from 0 to 1"),
    ("roughness", math.nan, "not a finite number", "from 0 to 1"),
    ("roughness", math.inf, "not a finite number", "from 0 to 1"),
    ("roughness", 10**400, "not a finite number", "from 0 to 1"),
    ("roughness", 1e39, "not a finite number", "from 0 to 1"),
    ("roughness", "0.5", "wrong kind of value", "a number"),
    ("roughness", True, "wrong kind of value", "a number"),
    ("roughness", np.True_, "wrong kind of value", "a number"),
    ("roughness", np.complex128(1j), "wrong kind of value", "a number"),
    ("roughness", [0.5], "wrong kind of value", "a number"),
    ("roughness", np.array([0.5]), "wrong kind of value", "a number"),
    ("reflectance", (0.5, 0.5), "2 values where 3 are wanted", "3 numbers"),
    ("reflectance", "red", "wrong kind of value", "3 numbers"),
    ("reflectance", {"r": 1}, "wrong kind of value", "3 numbers"),
    ("reflectance", (0.5, 0.5, "x"), "wrong kind of value", "3 numbers"),
    ("reflectance", (0.5, 0.5, 2), "out of range", "from 0 to 1"),
    ("emission_two_sided", 1, "wrong kind of value", "true or false"),
    ("reflectance", dl.materials.diffuse(), "a material where color is wanted", "texture"),
]


@pytest.mark.parametrize(
    ("name", "value", "said", "accepted"), BAD_VALUES, ids=[f"{n}-{v!r}"[:40] for n, v, *_ in BAD_VALUES]
)
def test_bad_values(name: str, value: Any, said: str, accepted: str) -> None:
    error = problem(dl.materials.diffuse, **{name: value})
    assert error.problem == said
    assert error.place == f"diffuse.{name}"
    assert accepted in (error.expected or "")
    assert error.exit_code == 2


def test_choices() -> None:
    error = problem(dl.textures.image, "a.png", wrap_u="repaet")
    assert error.place == "image.wrap_u"
    assert error.value == "repaet"
    assert "did you mean 'repeat'" in (error.expected or "")


def test_unknown_parameter_names_the_nearest() -> None:
    error = problem(dl.materials.diffuse, reflectanc=1)
    assert error.place == "diffuse.reflectanc"
    assert "did you mean 'reflectance'" in str(error)


def test_unknown_type() -> None:
    error = problem(Node, "material", "difuse")
    assert error.value == "difuse"
    assert "did you mean 'diffuse'" in str(error)


def test_all_problems_of_a_node_are_told() -> None:
    error = problem(dl.materials.diffuse, roughness=7, reflectance=-1, wrong=3)
    assert sorted(p.place or "" for p in error.problems) == [
        "diffuse.reflectance",
        "diffuse.roughness",
        "diffuse.wrong",
    ]
    assert str(error).endswith("[and 2 more problems]")
    assert [line.split(": ")[0] for line in error.lines()] == [p.place for p in error.problems]
    many = gather(Error(f"{i}") for i in range(30))
    assert many is not None
    assert many.lines()[-2:] == ["19", "and 10 more problems"]


def test_missing_parameters() -> None:
    error = problem(dl.shapes.sphere)
    assert [p.problem for p in error.problems] == ["center is missing", "radius is missing"]


def test_textures_only_where_they_may_stand() -> None:
    texture = dl.textures.solid()
    assert dl.materials.diffuse(reflectance=texture)["reflectance"] is texture
    for module, name, params in [
        ("cameras", "perspective", {"vfov": texture}),
        ("shapes", "sphere", {"center": texture}),
    ]:
        error = problem(getattr(getattr(dl, module), name), **params)
        assert "no texture may stand here" in [p.problem for p in error.problems]


def test_shapes_that_make_no_sense() -> None:
    assert problem(dl.shapes.box, (0, 0, 0), (1, 1, 0)).place == "box.max"
    assert problem(dl.shapes.sphere, (0, 0, 0), 0).place == "sphere.radius"
    assert dl.shapes.sphere((0, 0, 0), -1)["radius"] == -1
    assert problem(dl.shapes.box, (0, 0, 0), (1, 1, 1), transform1=dl.translate(1, 0, 0)).place == "box.transform"


def test_motion_through_a_flat_matrix() -> None:
    half_turn = dl.rotate("z", 180)
    error = problem(dl.shapes.instance, "g", dl.Transform(), half_turn)
    assert error.place == "instance.transform1"
    assert "time 0.5" in error.problem
    assert "time 0.25" in problem(dl.shapes.instance, "g", dl.scale(1), dl.scale(-3, 1, 1)).problem
    dl.shapes.instance("g", dl.Transform(), dl.rotate("z", 170))
    dl.shapes.instance("g", dl.scale(1e-3), dl.translate(5, 0, 0) @ dl.scale(1e-2))


# --- arrays -----------------------------------------------------------------------------------------------------------
def test_mesh_arrays_are_checked_and_kept() -> None:
    positions = np.eye(3, dtype=np.float32)
    mesh = dl.shapes.mesh(positions, [[0, 1, 2]])
    assert np.shares_memory(mesh["positions"], positions)
    assert mesh["indices"].dtype == np.uint32
    with pytest.raises(ValueError, match="read-only"):
        mesh["positions"][0, 0] = 1
    assert positions.flags.writeable
    assert dl.shapes.mesh(np.eye(3), np.zeros((0, 3), int))["indices"].shape == (0, 3)


BAD_ARRAYS: list[tuple[dict[str, Any], str]] = [
    ({"positions": np.zeros((3, 2))}, "positions"),
    ({"positions": np.zeros(9)}, "positions"),
    ({"positions": [[1, 2, 3], [1, 2]]}, "positions"),
    ({"positions": [["a", "b", "c"]]}, "positions"),
    ({"positions": "abc"}, "positions"),
    ({"positions": 3}, "positions"),
    ({"positions": [[1j, 0, 0]]}, "positions"),
    ({"indices": [[0.5, 1, 2]]}, "indices"),
    ({"indices": [[-1, 1, 2]]}, "indices"),
    ({"indices": [[0, 1, 2**32]]}, "indices"),
    ({"indices": [[0, 1, 2**70]]}, "indices"),
    ({"indices": [0, 1, 2]}, "indices"),
    ({"colors": np.zeros((3, 2))}, "colors"),
    ({"uvs": np.zeros((3, 3))}, "uvs"),
]


@pytest.mark.parametrize(("changes", "name"), BAD_ARRAYS)
def test_bad_arrays(changes: dict[str, Any], name: str) -> None:
    error = problem(dl.shapes.mesh, **({"positions": np.eye(3), "indices": [[0, 1, 2]]} | changes))
    assert error.place == f"mesh.{name}"
    assert "array of shape" in (error.expected or "")


def test_texels() -> None:
    assert dl.textures.image(np.zeros((2, 3), np.uint8))["pixels"].shape == (2, 3, 1)
    assert dl.textures.image(np.zeros((2, 3, 4), np.float64))["pixels"].dtype == np.float32
    for bad in [
        np.zeros((2, 3, 5), np.uint8),
        np.zeros((0, 3, 3), np.uint8),
        np.zeros((2, 2, 3), np.int32),
    ]:
        assert problem(dl.textures.image, bad).place == "image.pixels"
    assert "either" in str(problem(dl.textures.image))


# --- nodes as values --------------------------------------------------------------------------------------------------
def test_equality_is_by_value() -> None:
    a = dl.shapes.mesh(np.eye(3), [[0, 1, 2]], material=dl.materials.diffuse(0.5), name="a")
    b = dl.shapes.mesh(np.eye(3), [[0, 1, 2]], material=dl.materials.diffuse(0.5))
    assert a == b
    assert hash(a) == hash(b)
    assert a != b.replace(positions=np.eye(3) * 2)
    assert a != b.replace(uvs=np.zeros((3, 2)))
    assert a != dl.materials.diffuse(0.5)
    assert a != 3
    assert dl.materials.diffuse() != dl.materials.diffuse(0.5)  # given or not: a later default may differ


def test_equal_arrays_hash_equally_and_others_hardly_ever() -> None:
    pixels = np.zeros((40, 50, 3), np.float32)
    other = pixels.copy()
    other[3, 4] = np.nan
    pixels[3, 4] = -np.float32(np.nan)
    other[::2] = -other[::2]  # -0.0
    a, b = dl.textures.image(pixels), dl.textures.image(np.asfortranarray(other))
    assert a == b
    assert hash(a) == hash(b)
    rng = np.random.default_rng(1)
    noise = [dl.textures.image(rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)) for _ in range(300)]
    assert len({hash(node) for node in noise}) == 300


def test_compiling_many_pictures_compares_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Materials are looked up by hash: without the texels in it, a thousand of them took half a minute."""
    compared = []
    whole = nodes.equal_values
    monkeypatch.setattr(nodes, "equal_values", lambda a, b: compared.append(1) or whole(a, b))
    rng, count = np.random.default_rng(2), 200
    scene = dl.Scene()
    for i in range(count):
        picture = dl.textures.image(rng.integers(0, 256, (8, 8, 3), dtype=np.uint8))
        scene.add(dl.shapes.quad((i, 0, 0), (1, 0, 0), (0, 1, 0), material=dl.materials.diffuse(reflectance=picture)))
    scene.compile()
    assert len(compared) < 20 * count


def test_nodes_do_not_change() -> None:
    node = dl.materials.diffuse(0.5, name="grey")
    with pytest.raises(AttributeError, match="replace"):
        node.name = "x"
    with pytest.raises(AttributeError):
        del node.name
    with pytest.raises(TypeError):
        node.params["reflectance"] = 1  # type: ignore[index]
    assert node.replace(roughness=1).params == {"reflectance": (0.5, 0.5, 0.5), "roughness": 1.0}
    assert node.replace(reflectance=None, name="other").params == {}
    assert node.replace(name="other").name == "other"
    assert node.name == "grey"


def test_unknown_item() -> None:
    assert dl.materials.diffuse()["roughness"] == 0
    assert "did you mean" in str(problem(dl.materials.diffuse().__getitem__, "roughnes"))


def test_pickle_and_repr() -> None:
    node = dl.shapes.mesh(
        np.eye(3), [[0, 1, 2]], material=dl.materials.diffuse(0.5), transform=dl.rotate("x", 3), name="m"
    )
    again = pickle.loads(pickle.dumps(node))
    assert again == node
    assert again.name == "m"
    assert repr(dl.materials.diffuse(0.5)) == "materials.diffuse(reflectance=(0.5, 0.5, 0.5))"
    assert "<array (3, 3)>" in repr(node)


def test_shared_children_cost_no_exponential_time() -> None:
    def tower(levels: int) -> Node:
        node = dl.materials.diffuse(0.5)
        for _ in range(levels):
            node = dl.materials.mix(node, node)
        return node

    a, b = tower(DEEPEST - 1), tower(DEEPEST - 1)
    assert a == b
    assert len(list(a.walk())) == DEEPEST
    assert "nested too deeply" in str(problem(dl.materials.mix, a, a))


def test_bad_names() -> None:
    for bad in ["\0", "\ud800", 3]:
        assert problem(dl.materials.diffuse, name=bad).problem == "not a name"
    assert dl.materials.diffuse(name="").name is None


def test_scaled_textures() -> None:
    image = dl.textures.image("a.png")
    scaled = dl.textures.scaled(image, 2, channel="g", vertex_color=True)
    assert scaled["scale"] == (2.0, 2.0, 2.0)
    assert problem(dl.textures.scaled, scaled).place == "scaled.texture"
    assert problem(dl.textures.scaled, dl.materials.diffuse()).place == "scaled.texture"


def test_environment_images() -> None:
    by_path, by_node = dl.environments.image("a.hdr"), dl.environments.image(dl.textures.image("a.hdr"))
    assert by_path == by_node
    assert dl.environments.image(np.zeros((2, 4, 3)))["image"]["pixels"].shape == (2, 4, 3)
    assert problem(dl.environments.image, 3).place == "image.image"
    assert problem(dl.environments.image, dl.textures.solid()).place == "image.image"


# --- errors -----------------------------------------------------------------------------------------------------------
def test_error_message_parts() -> None:
    error = Error("bad", file="a.yaml", line=3, place="x.y", value=[1], expected="good")
    assert str(error) == "a.yaml:3: x.y: bad: [1] (accepted: good)"
    assert str(Error("two\nlines", value="a\nb")) == r"two lines: 'a\nb'"
    assert len(str(Error("long", value="x" * 1000))) < 120
    assert str(error.within("shapes[0]")) == "a.yaml:3: shapes[0].x.y: bad: [1] (accepted: good)"


def test_error_classes() -> None:
    for kind in (dl.InputError, dl.SceneError, dl.FormatError, dl.DeviceError, dl.OutputError, dl.ImageTooLarge):
        assert issubclass(kind, Error)
        assert kind("x").exit_code == 2
    assert dl.RenderError("x").exit_code == 1
    assert issubclass(dl.ImageTooLarge, MemoryError)
    missing = dl.MissingFileError(["a", "b"], file="s.yaml")
    assert missing.paths == ["a", "b"]
    assert str(missing).startswith("s.yaml: 2 missing files: a, b")
