"""The native format: what is wrong is said with its file, line, place and value, all of it at once."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pytest

import destello as dl
from destello.errors import Error, InputError, MissingFileError, SceneError

HEAD = "destello: 1\nmaterials:\n  red:\n    type: diffuse\n    reflectance: [0.8, 0.1, 0.1]\n"
BOX = "shapes:\n- type: box\n  min: [0, 0, 0]\n  max: [1, 1, 1]\n"
BAD: list[tuple[str, int | None, str | None, str]] = [
    ("destello: 2", 1, "destello", "unknown version"),
    ("[1, 2]", None, None, "not a mapping"),
    ("just text", None, None, "not a mapping"),
    ("", None, None, "not a mapping"),
    ("shape: []", 1, "shape", "did you mean 'shapes'"),
    ("shapes: {}", 1, "shapes", "not a list"),
    ("shapes:\n- 3", 2, "shapes[0]", "not a shape"),
    ("shapes:\n- {radius: 1}", 2, "shapes[0]", "has no type"),
    ("shapes:\n- {type: spere}", 2, "shapes[0].type", "did you mean 'sphere'"),
    ("shapes:\n- {type: [1]}", 2, "shapes[0].type", "unknown shape type"),
    ("shapes:\n- {type: sphere, center: [0, 0, 0]}", 2, "shapes[0]", "radius is missing"),
    ("shapes:\n- type: sphere\n  center: [0, 0, 0]\n  radus: 1", 4, "shapes[0].radus", "did you mean 'radius'"),
    ("shapes:\n- type: sphere\n  center: [0, 0, .nan]\n  radius: 1", 3, "shapes[0].center", "not a finite number"),
    ("shapes:\n- type: sphere\n  center: [0, 0, 1e999]\n  radius: 1", 3, "shapes[0].center", "not a finite number"),
    ("shapes:\n- type: box\n  min: [0, 0, 0]\n  max: [1, 0, 1]", 4, "shapes[0].max", "the box is empty"),
    (BOX + "  material:\n    type: diffuse\n    reflectance: [1, 1, 2]",
     7, "shapes[0].material.reflectance", "out of range"),
    (BOX + "  transform:\n  - scale: 1\n  - scale: [1, 0, 1]",
     6, "shapes[0].transform", "determinant is 0"),
    (BOX + "  transform:\n  - scale: 1\n  - rotate: {axis: q, angle: 1}",
     7, "shapes[0].transform[1].rotate.axis", "unknown axis"),
    ("shapes:\n- type: mesh\n  positions: [[0, 0, 0], [1, 0]]\n  indices: [[0, 1, 2]]",
     3, "shapes[0].positions", "not an array"),
    ("shapes:\n- type: instance\n  group: gone", 3, "shapes[0].group", "unknown group"),
    (HEAD + "shapes:\n- {type: sphere, center: [0, 0, 0], radius: 1, material: rde}",
     7, "shapes[0].material", "did you mean 'red'"),
    (HEAD.replace("0.8", "8"), 5, "materials.red.reflectance", "out of range"),
    ("materials:\n  a: b", 2, "materials.a", "not a material"),
    ("materials:\n  a: {type: mix, first: a, second: a}", 2, "materials.a.first", "references without end"),
    ("materials:\n  a: {type: mix, first: b, second: b}\n  b: {type: mix, first: a, second: a}",
     3, "materials.b.first", "without end"),
    ("materials:\n  a: {type: diffuse, roughness: b}", 2, "materials.a.roughness", "no texture of this name"),
    ("materials:\n  a: {type: diffuse, roughness: b}", 2, "materials.a.roughness", "accepted: a number from 0 to 1"),
    ("materials:\n  a: {type: diffuse, Roughnes: 1}", 2, "materials.a.Roughnes", "did you mean 'roughness'"),
    ("textures:\n  t: {type: udim, first: 5}", 2, "textures.t.type", "unknown texture type"),
    ("camera: {type: perspective, vfov: {type: solid}}", 1, "camera.vfov", "no texture may stand here"),
    ("camera: {type: perspective}\ncameras: {}", 1, "camera", "camera and cameras"),
    ("cameras: [1]", 1, "cameras", "not a mapping"),
    ("film: {width: 0}", 1, "film.width", "out of range"),
    ("film: {filter: box}", 1, "film.filter", "not a filter"),
    ("film: {wide: 3}", 1, "film", "did you mean 'width'"),
    ("render:\n  spp: 0", 2, "render.spp", "out of range"),
    ("render:\n  shutter: [1, 0]", 2, "render.shutter", "closes before it opens"),
    ("name: [1]", 1, "name", "not a name"),
    ("environment: {type: constant, radiance: -1}", 1, "environment.radiance", "out of range"),
    ("groups:\n  g:\n  - {type: instance, group: g}", 3, "groups.g[0]", "cannot be in a group"),
    ("lights:\n- {type: point, name: 3}", 2, "lights[0]", "not a name"),
    ("lights:\n- {type: point, data: x.npz}", 2, "lights[0].data", "has no arrays"),
    ("shapes: [\n", None, None, "broken YAML"),
    ("a: 1\na: 2", 2, None, "twice"),
    ("a: !!python/object/apply:os.system ['ls']", 1, None, "YAML tag"),
    ("a: *b", 1, None, "alias"),
    ("? [1]\n: 2", 1, None, "key"),
    ("a: 1\n---\nb: 2", 2, None, "second document"),
]  # fmt: skip


@pytest.mark.parametrize(("source", "line", "place", "said"), BAD, ids=[b[0][:40] for b in BAD])
def test_errors_name_line_and_place(
    source: str, line: int | None, place: str | None, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(source)
    with pytest.raises(InputError) as caught:
        dl.load(path)
    error = caught.value
    assert said in str(error)
    assert error.file == str(path)
    if not isinstance(error, MissingFileError):
        assert error.place == place
        assert line is None or error.line == line
        assert str(error).startswith(f"{path}:" if error.line is None else f"{path}:{error.line}: ")
    assert "\n" not in str(error)
    assert error.exit_code == 2


def test_json_errors_have_lines_too(tmp_path: Path) -> None:
    path = tmp_path / "bad.json"
    for source, line, said in [
        ('{\n"shapes": [\n{"type": "sphere", "center": [0, 0, 0], "radius": NaN}]}', 3, "not a finite number"),
        ('{\n"shapes": [,', 2, "broken JSON"),
        ('{"name": "a", "name": "b"}', None, "twice"),
        ("", 1, "broken JSON"),
        ('{"render": {"seed": ' + "9" * 5000 + "}}", None, "digits"),
        ('{"name": "\\ud800"}', None, "not a name"),
    ]:
        path.write_text(source)
        with pytest.raises(Error) as caught:
            dl.load(path)
        assert said in str(caught.value)
        assert caught.value.line == line or line is None
        assert caught.value.file == str(path)


def test_all_problems_are_told_once(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(
        textwrap.dedent("""\
        materials:
          bad: {type: diffuse, roughness: 7}
          uses: {type: mix, first: bad, second: bad}
        shapes:
        - {type: sphere, center: [0, 0, 0], radius: 1, material: bad}
        - {type: sphere, center: [0, 0, 0], radius: 0, material: uses}
        - {type: sphere, center: [0, 0], radius: 0}
        render: {spp: 0}
        """)
    )
    with pytest.raises(SceneError) as caught:
        dl.load(path)
    told = sorted((p.line or 0, p.place or "") for p in caught.value.problems)
    assert told == [
        (2, "materials.bad.roughness"),
        (7, "shapes[2].center"),
        (8, "render.spp"),
    ]


def test_missing_files_are_told_together(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(
        "textures: {a: {type: image, path: a.png}, b: {type: image, path: b.png}}\n"
        "shapes: [{type: mesh_file, path: c.ply}, {type: mesh_file, path: c.ply}]\n"
    )
    with pytest.raises(MissingFileError) as caught:
        dl.load(path)
    assert caught.value.paths == ["a.png", "b.png", "c.ply"]
    assert caught.value.file == str(path)
    assert dl.load(path, allow_missing=True).allow_missing


def test_external_files(tmp_path: Path) -> None:
    path = tmp_path / "in" / "s.yaml"
    path.parent.mkdir()
    (tmp_path / "x.png").write_bytes(b"")
    for name in ("../x.png", str(tmp_path / "x.png")):
        path.write_text(f"textures:\n  a: {{type: image, path: {name}}}\n")
        with pytest.raises(InputError) as caught:
            dl.load(path)
        assert caught.value.place == "textures.a.path"
        assert caught.value.file == str(path)
        dl.load(path, allow_external=True)


@pytest.mark.parametrize(
    ("broken", "place", "said"),
    [
        ("shapes: [{type: mesh, data: a.npz, normls: 1}]", "shapes[0].normls", "did you mean 'normals'"),
        ("textures: {t: {type: imge, path: b.png}}", "textures.t.type", "did you mean 'image'"),
        ("materials: {n: {type: diffuse, reflectanc: {type: image, path: b.png}}}", "materials.n.reflectanc", "did"),
        ("shapes: [{type: mesh_file, path: c.ply, material: gone}]", "shapes[0].material", "no material of this name"),
        ("shapes: [{type: mesh_file, path: c.ply}, {type: instance, group: gone}]", "shapes[1].group", "unknown group"),
    ],
)  # fmt: skip
def test_missing_files_do_not_hide_what_else_is_wrong(broken: str, place: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(f"environment: {{type: image, image: {{type: image, path: x.png}}}}\n{broken}\n")
    with pytest.raises(SceneError) as caught:
        dl.load(path)
    assert [problem.place for problem in caught.value.problems] == [place]
    assert said in str(caught.value)


def test_missing_arrays_are_told_with_all_other_missing_files(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("shapes: [{type: mesh, data: a.npz}, {type: mesh_file, path: b.ply}]")
    with pytest.raises(MissingFileError) as caught:
        dl.load(path)
    assert sorted(caught.value.paths) == ["a.npz", "b.ply"]
    with pytest.raises(MissingFileError) as caught:
        dl.load(path, allow_missing=True)
    assert caught.value.paths == ["a.npz"]
