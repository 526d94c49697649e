"""The native format: what is written reads back exactly."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import destello as dl
from destello.errors import FormatError, InputError, OutputError, SceneError
from destello.io import _yaml
from destello.json_schema import json_schema, text
from destello.nodes import Node
from destello.python_types import FILM, RENDER
from destello.schema import ParamDoc, TypeDoc, schema

# --- any scene --------------------------------------------------------------------------------------------------------
LETTERS = "aZ0 _-.:#'\"\\{[,&*!|>%@`~/?\n\t\x7f\x85\u00e9\u2028\ufeff\u4e2d\U0001f600"
WORDS = ["null", "true", "on", "1e3", ".nan", "-", "default", "red", "there.png", "no", "0x1", "~"]
STEPS = [
    dl.translate(1e-3, 2.5, -0.0),
    dl.rotate((1, 2, 3), 33.3),
    dl.scale(1 / 3),
    dl.scale(1, -2, 0.1),
    dl.shear(xy=0.1),
    dl.look_at((0, 0, 1), (1, 2, 3)),
    dl.matrix([[1, 0.1, 0, 5], [0, 1, 0, 6], [0, 0, 1, 1e-8]]),
]


VALIDATOR = jsonschema.Draft202012Validator(json_schema())


class AnyScene:
    """Makes scenes of every type and parameter there is, with values from the whole of their ranges."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.numbers = np.random.default_rng(seed)

    def name(self) -> str:
        if self.rng.random() < 0.5:
            return self.rng.choice(WORDS)
        return "".join(self.rng.choices(LETTERS, k=self.rng.randint(1, 6)))

    def number(self, doc: ParamDoc) -> float:
        low = -3.4e38 if doc.min is None else doc.min
        high = 3.4e38 if doc.max is None else doc.max
        wide = self.rng.choice([1, -1]) * 10 ** self.rng.uniform(-45, 38)
        tried = [low, high, 0.0, -0.0, 1.0, 1 / 3, 5e-324, wide, self.rng.uniform(0, 1), self.rng.uniform(-100, 100)]
        return self.rng.choice([v for v in tried if low <= v <= high])

    def array(self, doc: ParamDoc) -> Any:
        rows, columns = self.rng.choice([0, 1, 3, 40]), self.rng.choice(doc.columns)
        shape = (rows, columns) if columns else (rows,)
        if doc.dtype == "uint32":
            return self.numbers.integers(0, 2**32 - 1, shape, dtype=np.uint32, endpoint=True)
        return (self.numbers.standard_normal(shape) * 10.0 ** self.numbers.uniform(-44, 37, shape)).astype(np.float32)

    def texels(self) -> Any:
        shape = (self.rng.randint(1, 3), self.rng.randint(1, 3), self.rng.randint(1, 4))
        kind = self.rng.choice(["uint8", "uint16", "float32"])
        return (self.numbers.random(shape) * 200).astype(kind)

    def voxels(self, doc: ParamDoc) -> Any:
        values = self.numbers.random((3, 1, 2, self.rng.choice(doc.columns))) * 200
        return values.astype(self.rng.choice(["uint8", "float16", "float32"]))

    def transform(self) -> dl.Transform:
        made = dl.Transform()
        for _ in range(self.rng.randint(0, 3)):
            made = made @ self.rng.choice(STEPS)
        return made

    def keys(self, word: str) -> dict[str, Any]:
        """Keyframes of any interpolation."""
        count = self.rng.randint(1, 4)
        times = sorted(self.rng.choice([0.0, -1e-9, 1 / 3, 5e-324, self.rng.uniform(-9, 99)]) for _ in range(count))
        kind = self.rng.choice(["linear", "step", "cubic"])
        triple = [[self.rng.gauss(0, 1) for _ in range(4 if word == "rotate" else 3)] for _ in range(3 * count)]
        values: list[Any] = triple[:count]
        if word != "translate" and kind != "cubic" and self.rng.random() < 0.5:
            values = [0.0 if word == "scale" else {"axis": v[:3], "angle": 100 * v[0]} for v in values]
        made = {"times": times, "values": values, "interpolation": kind}
        cubic = {"in_tangents": triple[count : 2 * count], "out_tangents": triple[2 * count :]}
        return {**made, **(cubic if kind == "cubic" else {})}

    def animation(self, *words: str) -> Any:
        made = dl.Animation.of({words[0]: self.keys(words[0])})
        for word in self.rng.choices(words, k=self.rng.randint(0, 2)):
            made = (made if word == "translate" else self.transform() @ made) @ dl.Animation.of({word: self.keys(word)})
        return made

    def value(self, doc: ParamDoc, depth: int) -> Any:
        if doc.texturable and depth > 0 and self.rng.random() < 0.3:
            return self.node("texture", depth - 1)
        if doc.kind in ("scalar", "integer"):
            return self.number(doc) if doc.kind == "scalar" else self.rng.randint(int(doc.min or 0), int(doc.max or 9))
        if doc.kind in ("color", "vector", "numbers"):
            return [self.number(doc) for _ in range(doc.columns[0] if doc.columns else 3)]
        simple: dict[str, Any] = {
            "bool": lambda: self.rng.random() < 0.5,
            "enum": lambda: self.rng.choice(doc.choices),
            "path": lambda: "there.png",
            "array": lambda: self.array(doc),
            "texels": self.texels,
            "voxels": lambda: self.voxels(doc),
            "text": lambda: self.rng.choice(doc.choices or ["density", "größe 1", "- x: y"]),
            "volume": lambda: self.node("volume", 0),
            "transform": self.transform,
            "animation": lambda: self.animation("translate", "rotate", "scale"),
            "group": lambda: "group",
            "filter": lambda: self.node("filter", 0),
            "material": lambda: self.node("material", depth - 1),
            "texture": lambda: self.node("texture", 0),
            "image": lambda: dl.textures.image("there.png"),
        }
        return simple[doc.kind]()

    def node(self, kind: str, depth: int) -> Node:
        nested = ("mix", "scaled", "vertex_color") if depth <= 0 else ()
        doc = self.rng.choice([doc for doc in schema().kinds[kind].values() if doc.type not in nested])
        params: dict[str, Any] = {}
        for param in doc.params.values():
            if param.required or self.rng.random() < 0.25:
                params[param.name] = self.value(param, depth)
        if kind == "volume":
            params.pop(self.rng.choice(["emission", "temperature"]), None)
        if (kind, doc.type) == ("volume", "grid"):
            params.update(min=(-1, 0, 1 / 3), max=(2, 1e-3, 0.5))
        self.repair(doc, params)
        return Node(kind, doc.type, params, name=self.name() if self.rng.random() < 0.3 else None)

    def repair(self, doc: TypeDoc, params: dict[str, Any]) -> None:
        """What no single parameter can see to."""
        if doc.kind == "texture" and doc.type == "image" and ("path" in params) == ("pixels" in params):
            params.pop("path", None)
            params["pixels"] = self.texels()
        if doc.kind == "shape" and doc.type == "box":
            params["min"] = [v / 4 for v in params["min"]]
            params["max"] = [v + max(1.0, abs(v)) for v in params["min"]]
        if "metal" in params:
            params.update(fresnel=None, eta=None, k=None)
        if doc.type == "sphere":
            params["radius"] = params["radius"] or -2.5
        if "animation" in params:
            params.pop("transform1", None)
            params.pop("center1", None)
            if doc.type == "sphere":
                params["animation"] = self.animation("translate")
        if "transform1" in params:
            params["transform"] = params["transform1"]

    def scene(self) -> dl.Scene:
        scene = dl.Scene("" if self.rng.random() < 0.3 else self.name())
        scene.cameras = {self.name(): self.node("camera", 0) for _ in range(self.rng.randint(0, 2))}
        for section, doc in ((scene.film, FILM), (scene.render, RENDER)):
            for param in doc.params.values():
                if self.rng.random() < 0.5 and param.name != "shutter":
                    setattr(section, param.name, self.value(param, 0))
        scene.render.shutter = (0.25, 0.75)
        shapes = [self.node("shape", 2) for _ in range(self.rng.randint(0, 5))]
        scene.group("group", [shape for shape in shapes if shape.type != "instance"][:1])
        shared = [self.node("material", 2) for _ in range(self.rng.randint(0, 2))]
        scene.add(*shapes, *(dl.shapes.sphere((i, 0, 0), 1, material=m) for i in range(3) for m in shared))
        scene.add(*(self.node("light", 0) for _ in range(self.rng.randint(0, 2))))
        scene.environment = self.rng.choice([None, self.node("environment", 0)])
        return scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("native")
    (path / "there.png").write_bytes(b"")
    return path


def names(scene: dl.Scene) -> list[str | None]:
    return [n.name for n in (*scene.cameras.values(), *(s for _, s in scene.all_shapes()), *scene.lights)]


@settings(max_examples=100, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32), suffix=st.sampled_from([".yaml", ".json"]))
def test_any_scene_reads_back_exactly(seed: int, suffix: str, folder: Path) -> None:
    scene = AnyScene(seed).scene()
    scene.base_dir = folder
    path = folder / f"scene{suffix}"
    scene.save(path)
    loaded = dl.load(path)
    assert loaded == scene
    assert names(loaded) == names(scene)
    assert len(loaded.materials()) <= len(scene.materials())
    if suffix == ".json":
        VALIDATOR.validate(json.loads(path.read_text(encoding="utf-8")))


def test_the_random_scenes_hold_every_type() -> None:
    made = {(n.kind, n.type) for seed in range(150) for n in AnyScene(seed).scene().nodes()}
    assert made == {(doc.kind, doc.type) for doc in schema()}


@pytest.mark.parametrize("name", dl.scenes.names())
@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_built_in_scenes_read_back_exactly(name: str, suffix: str, tmp_path: Path) -> None:
    scene = dl.scenes.build(name)
    path = tmp_path / f"s{suffix}"
    scene.save(path)
    assert dl.load(path) == scene
    VALIDATOR.validate(_yaml.parse_yaml(path.read_text(encoding="utf-8")))


# --- texts ------------------------------------------------------------------------------------------------------------
NAMES = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=8)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | NAMES | st.just(""),
    lambda inner: st.lists(inner, max_size=40) | st.dictionaries(NAMES | st.just(""), inner, max_size=5),
    max_leaves=60,
)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(PLAIN)
def test_texts_read_back_exactly(data: Any) -> None:
    for again in (_yaml.parse_yaml(_yaml.to_yaml(data)), _yaml.parse_json(_yaml.to_json(data))):
        assert again == data
        assert repr(again) == repr(data)  # tells 1 from 1.0 and True, 0.0 from -0.0


@pytest.mark.parametrize(
    ("source", "wanted"),
    [
        ("1e-3", 1e-3), ("1.5E+3", 1500.0), ("-.5", -0.5), ("5.", 5.0), ("+7", 7), ("010", 10), (".inf", math.inf),
        ("on", "on"), ("1:30", "1:30"), ("0x10", "0x10"), ("1_000", "1_000"), ("2001-01-01", "2001-01-01"),
        ("null", None), ("~", None), ("# nothing", None), ("true", True), ("'true'", "true"), ('"1"', "1"), ("=", "="),
    ],
)  # fmt: skip
def test_yaml_scalars(source: str, wanted: Any) -> None:
    read = _yaml.parse_yaml(source)
    assert read == wanted
    assert type(read) is type(wanted)


def test_aliases_keep_identity(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("shapes:\n- {type: sphere, center: [0, 0, 0], radius: 1, material: &m {type: diffuse}}\n"
                    "- {type: sphere, center: [1, 0, 0], radius: 1, material: *m}\n")  # fmt: skip
    scene = dl.load(path)
    assert scene.shapes[0]["material"] is scene.shapes[1]["material"]


# --- what is written --------------------------------------------------------------------------------------------------
def test_shared_nodes_get_names(tmp_path: Path) -> None:
    scene = dl.Scene()
    scene.base_dir = tmp_path
    image = dl.textures.image("there.png")
    red, grey = dl.materials.diffuse(image, name="red"), dl.materials.diffuse(image, name="red", roughness=1)
    unnamed = dl.materials.diffuse(0.25)
    for i, material in enumerate([red, red, grey, unnamed, unnamed, dl.materials.diffuse(0.75)]):
        scene.add(dl.shapes.sphere((i, 0, 0), 1, material=material))
    (tmp_path / "there.png").write_bytes(b"")
    scene.save(tmp_path / "s.yaml")
    document = _yaml.parse_yaml((tmp_path / "s.yaml").read_text())
    assert list(document["materials"]) == ["red", "red-2", "diffuse-1"]
    assert document["textures"] == {"image-1": {"type": "image", "path": "there.png"}}
    assert [shape["material"] for shape in document["shapes"]] == [
        "red", "red", "red-2", "diffuse-1", "diffuse-1", {"type": "diffuse", "reflectance": [0.75, 0.75, 0.75]},
    ]  # fmt: skip
    shapes = dl.load(tmp_path / "s.yaml").shapes
    assert shapes[0]["material"] is shapes[1]["material"]
    assert shapes[0]["material"]["reflectance"] is shapes[2]["material"]["reflectance"]
    assert shapes[0]["material"].name == "red"


def test_large_arrays_go_beside_the_scene(tmp_path: Path) -> None:
    scene = dl.Scene()
    points = np.random.default_rng(1).random((40, 3))
    scene.add(
        dl.shapes.mesh(points, [[0, 1, 2]]),
        dl.shapes.mesh(points * 2, [[0, 1, 2]]),
        dl.shapes.mesh(points, [[0, 1, 2]]),
    )
    scene.save(tmp_path / "s.yaml")
    assert len(list((tmp_path / "s.data").iterdir())) == 2  # equal ones once
    assert (tmp_path / "s.yaml").stat().st_size < 400
    assert dl.load(tmp_path / "s.yaml") == scene
    small = dl.Scene()
    small.add(dl.shapes.mesh(np.eye(3) / 3, [[0, 1, 2]]))
    small.save(tmp_path / "small.yaml")
    assert not (tmp_path / "small.data").exists()
    assert "0.33333334" in (tmp_path / "small.yaml").read_text()


def test_saving_elsewhere_keeps_paths_meaning_the_same(tmp_path: Path) -> None:
    (tmp_path / "a" / "maps").mkdir(parents=True)
    (tmp_path / "b").mkdir()
    (tmp_path / "a" / "maps" / "x.ply").write_bytes(b"")
    scene = dl.Scene()
    scene.base_dir = tmp_path / "a"
    scene.add(dl.shapes.mesh_file("maps/x.ply"))
    scene.save(tmp_path / "b" / "s.yaml")
    with pytest.raises(InputError, match="--allow-external"):
        dl.load(tmp_path / "b" / "s.yaml")
    loaded = dl.load(tmp_path / "b" / "s.yaml", allow_external=True)
    assert loaded.shapes[0]["path"] == "../a/maps/x.ply"
    assert loaded.allow_external


def test_a_failed_save_leaves_nothing(tmp_path: Path) -> None:
    scene = dl.Scene()
    scene.add(dl.shapes.mesh(np.zeros((99, 3)), [[0, 1, 2]]))
    with pytest.raises(OutputError):
        scene.save(tmp_path / "none" / "s.yaml")
    with pytest.raises(FormatError, match=r"\.json, \.yaml, \.yml"):
        scene.save(tmp_path / "s.obj")
    (tmp_path / "s.yaml").write_text("old")
    scene.groups["x"] = 3  # type: ignore[assignment]
    with pytest.raises(SceneError):
        scene.save(tmp_path / "s.yaml")
    assert (tmp_path / "s.yaml").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["s.yaml"]


def test_the_schema_is_published(root: Path) -> None:
    assert (root / "docs" / "destello.schema.json").read_text(encoding="utf-8") == text(), (
        "run python -m destello.schema"
    )
    jsonschema.Draft202012Validator.check_schema(json_schema())


def test_loaded_scenes_know_where_they_are(tmp_path: Path) -> None:
    dl.Scene("x").save(tmp_path / "s.yaml")
    scene = dl.load(tmp_path / "s.yaml")
    assert (scene.base_dir, scene.source, scene.allow_external) == (tmp_path, tmp_path / "s.yaml", False)
    assert scene.notes == []
