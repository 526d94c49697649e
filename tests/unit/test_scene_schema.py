"""The schema: what it takes from the core, what it says; the JSON Schema refuses what loading refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import destello as dl
from destello import _core
from destello.json_schema import json_schema, main
from destello.python_types import INTERNAL
from destello.schema import ParamDoc, build, core_param, schema

VALIDATOR = jsonschema.Draft202012Validator(json_schema())


def test_every_core_type_and_parameter_is_there() -> None:
    raw = _core.schema()
    for kind in ("material", "texture", "light", "environment", "camera", "filter"):
        types = schema().kinds[kind]
        for entry in raw[f"{kind}s"]:
            if entry["type"] in INTERNAL:
                assert entry["type"] not in types
                continue
            wanted = {p["name"] for p in entry["params"]}
            if (kind, entry["type"]) != ("texture", "image"):  # the core's takes a number, Python's a file
                assert wanted <= set(types[entry["type"]].params)
    for param in raw["surface"]:
        assert all((param["name"] in doc.params) == (doc.type != "mix") for doc in schema().kinds["material"].values())


def test_numbers_are_the_shortest_that_mean_the_same() -> None:
    raw = {"name": "x", "doc": "", "unit": "m", "kind": "scalar", "texturable": False, "choices": []}
    param = core_param(
        {**raw, "default": 0.30000001192092896, "min": -0.9900000095367432, "max": 3.0000000054977558e38}
    )
    assert (param.default, param.min, param.max) == (0.3, -0.99, None)


@pytest.mark.parametrize(
    ("doc", "said"),
    [
        (ParamDoc("x", min=0, max=1), "a number from 0 to 1"),
        (ParamDoc("x", min=0, unit="m", texturable=True), "a number of at least 0 m, or a texture"),
        (ParamDoc("x", max=0.5), "a number of at most 0.5"),
        (ParamDoc("x", unit="deg"), "a number in deg"),
        (ParamDoc("x", kind="enum", choices=("a", "b")), "a or b"),
        (ParamDoc("x", kind="numbers", columns=(2,)), "2 numbers"),
        (ParamDoc("x", kind="array", columns=(3, 4)), "an array of shape (N, 3) or (N, 4), float32"),
        (ParamDoc("x", kind="array", columns=(0,)), "an array of shape (N,), float32"),
    ],
)
def test_what_is_accepted_in_words(doc: ParamDoc, said: str) -> None:
    assert doc.accepted == said


def test_a_new_core_type_needs_nothing_in_python() -> None:
    raw = _core.schema()
    params = [{**raw["surface"][0], "name": "glitter"}]
    raw["materials"].append({"type": "snow", "doc": "Snow.", "params": params})
    snow = build(raw).kinds["material"]["snow"]
    assert {"glitter", "emission"} <= set(snow.params)
    assert "glitter" not in snow.common
    assert "emission" in snow.common


def sphere(**params: Any) -> dict[str, Any]:
    return {"shapes": [{"type": "sphere", "center": [0, 0, 0], "radius": 1, **params}]}


ONE_KEY = {"times": [0], "values": [[0, 0, 1]]}
ONE_TURN = {"times": [0, 1], "values": [{"axis": "y", "angle": 90}, [0, 0, 0, 1]]}
DOCUMENTS: list[tuple[dict[str, Any], bool]] = [
    ({}, True),
    (sphere(), True),
    (sphere(name="ball", material="m") | {"materials": {"m": {"type": "diffuse"}}}, True),
    (sphere(material={"type": "diffuse", "reflectance": 0.5, "roughness": None}), True),
    (sphere(material={"type": "diffuse", "reflectance": {"type": "solid"}}), True),
    ({"film": {"width": 3, "filter": {"type": "box"}}, "camera": {"type": "perspective"}}, True),
    (
        {
            "shapes": [
                {"type": "box", "min": [0, 0, 0], "max": [1, 1, 1], "transform": [{"scale": 2}, {"shear": {"xy": 1}}]}
            ]
        },
        True,
    ),
    (sphere(radus=1), False),
    (sphere(radius="1"), False),
    (sphere(center=[0, 0]), False),
    (sphere(type="spere"), False),
    (sphere(material={"type": "diffuse", "reflectance": [1, 1, 2]}), False),
    (sphere(material={"type": "diffuse", "roughness": -1}), False),
    (sphere(material={"reflectance": 1}), False),
    (sphere(material={"type": "emissive", "two_sided": 1}), False),
    ({"shape": []}, False),
    ({"shapes": {}}, False),
    ({"film": {"width": 0}}, False),
    ({"film": {"width": 1.5}}, False),
    ({"render": {"light_sampling": "all"}}, False),
    ({"camera": {"type": "perspective", "vfov": {"type": "solid"}}}, False),
    ({"materials": {"a": "b"}}, False),
    ({"shapes": [{"type": "box", "min": [0, 0, 0], "max": [1, 1, 1], "transform": [{"scal": 2}]}]}, False),
    ({"shapes": [{"type": "box", "min": [0, 0, 0], "max": [1, 1, 1], "transform": {"rotate": {"axis": "x"}}}]}, False),
    ({"destello": 2}, False),
    (sphere(animation={"translate": {"times": [0, 1], "values": [[0, 0, 0], [1, 0, 0]]}}), True),
    (sphere(animation=[{"translate": {**ONE_KEY, "interpolation": "step"}}]), True),
    ({"render": {"fps": 25}, "camera": {"type": "panorama", "animation": {"rotate": ONE_TURN}}}, True),
    ({"lights": [{"type": "point", "animation": [{"scale": {"times": [0], "values": [2]}}, {"scale": 2}]}]}, True),
    ({"lights": [{"type": "point", "animation": {"rotate": {**ONE_KEY, "tims": [0]}}}]}, False),
    ({"lights": [{"type": "point", "animation": {"rotate": ONE_KEY}}]}, False),
    ({"lights": [{"type": "point", "animation": {"shear": ONE_KEY}}]}, False),
    (sphere(animation={"translate": {**ONE_KEY, "interpolation": "bezier"}}), False),
    (sphere(animation={"translate": {"times": [], "values": []}}), False),
    ({"render": {"fps": 0}}, False),
]


@pytest.mark.parametrize(("document", "good"), DOCUMENTS)
def test_schema_and_loading_agree(document: dict[str, Any], good: bool, tmp_path: Path) -> None:
    path = tmp_path / "s.json"
    path.write_text(json.dumps(document))
    try:
        dl.load(path)
        loads = True
    except dl.SceneError:
        loads = False
    assert (VALIDATOR.is_valid(document), loads) == (good, good)


def test_the_command(tmp_path: Path) -> None:
    path = tmp_path / "schema.json"
    done = subprocess.run(
        [sys.executable, "-m", "destello.schema", str(path)], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    assert json.loads(path.read_text(encoding="utf-8")) == json_schema()
    main(["--check", str(path)])
    path.write_text("{}")
    with pytest.raises(SystemExit, match="not up to date"):
        main(["--check", str(path)])
