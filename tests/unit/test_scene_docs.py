"""The page on the scene format tells the truth."""

from __future__ import annotations

import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import destello as dl
from destello.animation import _FIELDS, INTERPOLATIONS
from destello.io import _yaml
from destello.io._native_read import SECTIONS
from destello.json_schema import json_schema
from destello.transform import _WORDS

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "scene-format.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("source", EXAMPLES)
def test_examples_load(source: str, tmp_path: Path) -> None:
    (tmp_path / "wood.png").write_bytes(b"")
    for name in re.findall(r"demo\.data/(\w+\.npz)", source):
        (tmp_path / "demo.data").mkdir()
        mesh = {"positions": np.eye(3, dtype=np.float32), "indices": np.uint32([[0, 1, 2]])}
        volume = {"density": np.ones((2, 2, 2), np.float32)}
        np.savez(tmp_path / "demo.data" / name, **(volume if name == "smoke.npz" else mesh))
    path = tmp_path / "demo.yaml"
    path.write_text(source, encoding="utf-8")
    assert dl.load(path).shapes
    jsonschema.Draft202012Validator(json_schema()).validate(_yaml.parse_yaml(source))


def test_the_whole_scene_compiles(tmp_path: Path) -> None:
    (tmp_path / "demo.yaml").write_text(EXAMPLES[0], encoding="utf-8")
    compiled = dl.load(tmp_path / "demo.yaml").compile()
    assert compiled.notes == []
    assert compiled.stats["instances"] >= 2


def test_all_sections_and_words_are_there() -> None:
    for name in (*SECTIONS, *_WORDS, *dir(dl.shapes)):
        assert f"`{name}`" in PAGE


def test_the_error_shown_is_the_one_given(tmp_path: Path) -> None:
    shown = re.findall(r"```\n(scene\.yaml:12: .*)\n```", PAGE)[0]
    lines = ["shapes:", *["- {type: sphere, center: [0, 0, 0], radius: 1}"] * 3]
    lines += [
        "- type: sphere",
        "  center: [0, 0, 0]",
        "  radius: 1",
        "  material:",
        "    type: diffuse",
        "",
        "    # bright",
    ]
    path = tmp_path / "scene.yaml"
    path.write_text("\n".join([*lines, "    reflectance: [1, 1, 2]"]))
    with pytest.raises(dl.SceneError) as caught:
        dl.load(path)
    assert str(caught.value).replace(f"{tmp_path}/", "") == shown


def test_all_names_of_keyframes_are_there() -> None:
    for name in (*_FIELDS, *INTERPOLATIONS, "fps", "animation"):
        assert f"`{name}`" in PAGE
