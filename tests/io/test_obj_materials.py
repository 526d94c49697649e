"""MTL: what programs mean by their own files."""

from __future__ import annotations

import codecs
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from destello.errors import FormatError
from destello.formats import LoadOptions
from destello.io import obj
from destello.nodes import Node
from scene_files import corner_image, encode_image

BLENDER = "# Blender 4.1.1 MTL File: 'x.blend'\n# www.blender.org\n"


def blender_material(folder: Path, lines: str, *, header: str = BLENDER) -> Node:
    (folder / "scene.mtl").write_text(f"{header}\nnewmtl m\n{lines}")
    (folder / "scene.obj").write_text("mtllib scene.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n")
    (shape,) = obj.load(folder / "scene.obj", LoadOptions(complete=False)).shapes
    material = shape["material"]
    assert isinstance(material, Node)
    return material


def notes(folder: Path) -> list[str]:
    return obj.load(folder / "scene.obj", LoadOptions(complete=False)).notes


@pytest.mark.parametrize(
    ("line", "said", "param", "value"),
    [
        ("Kd 2 0.5 -1", "Kd 2 0.5 -1 counts as 1 0.5 0 (accepted: 0 to 1)", "reflectance", (1, 0.5, 0)),
        ("Kd 1 1 1\nPr 5", "Pr 5 counts as 1 (accepted: 0 to 1)", "roughness", 1),
        ("Pm -0.5", "Pm -0.5 counts as 0 (accepted: 0 to 1)", "metallic", 0),
        ("Pc 3", "Pc 3 counts as 1 (accepted: 0 to 1)", "coat_weight", 1),
        ("Ke -1 2 3", "Ke -1 2 3 counts as 0 2 3 (accepted: at least 0)", "emission", (0, 2, 3)),
        ("Tr 1.5", "Tr 1.5 counts as 1 (accepted: 0 to 1)", "opacity", 0),
        ("d -halo 2", "d 2 counts as 1 (accepted: 0 to 1)", "opacity", 1),
        ("illum 7\nTf 3 1 1", "Tf 3 1 1 counts as 1 1 1 (accepted: 0 to 1)", "tint", (1, 1, 1)),
        ("illum 7\nNi 0", "Ni 0 counts as 1.5 (accepted: above 0)", "ior", 1.5),
        ("illum 3\nKd 0 0 0\nKs 2 1 1", "Ks 2 1 1 counts as 1 1 1 (accepted: 0 to 1)", "reflectance", (1, 1, 1)),
        ("Ks 1 1 1\nillum 99", "illum 99 counts as 2 (accepted: 0 to 10)", "specular_color", (2, 2, 2)),
        ("illum 6.5", "illum 6.5 counts as 2 (accepted: 0 to 10)", "roughness", 0),
        ("Ks 1 1 1\nNs -3", "Ns -3 counts as 0 (accepted: at least 0)", "roughness", 1),
    ],
)
def test_values_out_of_range_are_told(line: str, said: str, param: str, value: Any, tmp_path: Path) -> None:
    node = blender_material(tmp_path, line, header="# by hand")
    assert node[param] == value
    assert notes(tmp_path) == [f"scene.mtl:{3 + line.count(chr(10))}: newmtl m: {said}"]


def test_values_out_of_range_are_told_once_a_keyword(tmp_path: Path) -> None:
    blender_material(tmp_path, "Kd 2 2 2\nPr 5\nnewmtl n\nKd 3 0 0\nnewmtl o\nKd 0 0 7\nPr 0.5", header="# by hand")
    assert notes(tmp_path) == [
        "scene.mtl:3: newmtl m: Kd 2 2 2 counts as 1 1 1 (accepted: 0 to 1); 2 more",
        "scene.mtl:4: newmtl m: Pr 5 counts as 1 (accepted: 0 to 1)",
    ]


@pytest.mark.parametrize(("exponent", "roughness"), [(250, 0.5), (1000, 0), (0, 1), (640, 0.2)])
def test_blender_roughness(exponent: float, roughness: float, tmp_path: Path) -> None:
    node = blender_material(tmp_path, f"Ns {exponent}\nKd 0.8 0.1 0.2\nKs 0.5 0.5 0.5\nNi 1.45\nd 1\nillum 2\n")
    assert (node.type, node["specular_color"]) == ("metallic_roughness", (1, 1, 1))
    assert node["roughness"] == pytest.approx(roughness)


def test_blender_images_of_roughness_metal_and_specular(tmp_path: Path) -> None:
    """Its exporter writes them so without the PBR extension, and its importer reads them back as they are."""
    for name, grey in (("ns", 64), ("refl", 255), ("ks", 128)):
        (tmp_path / f"{name}.png").write_bytes(encode_image(np.full((2, 2, 1), grey, np.uint8), ".png", tmp_path))
    images = "map_Ns ns.png\nmap_refl -type sphere refl.png\nmap_Ks ks.png\n"
    lines = f"Ka 1 1 1\nKd 0.8 0.1 0.2\nillum 3\n{images}"
    node = blender_material(tmp_path, lines)
    assert node.type == "metallic_roughness"
    wanted = {"roughness": ("ns.png", 1), "metallic": ("refl.png", 1), "specular_color": ("ks.png", 2)}
    for name, (file, scale) in wanted.items():
        assert Path(node[name]["texture"]["path"]).name == file
        assert np.all(np.asarray(node[name]["scale"]) == scale)
        assert node[name]["texture"]["color_space"] == "linear"
    node = blender_material(tmp_path, "Ka 1 1 1\nKd 0.8 0.1 0.2\nKs 0.25 0.25 0.25\nillum 2\nmap_Ns ns.png\n")
    assert (node["metallic"], node["specular_color"]) == (0, (0.5, 0.5, 0.5))
    node = blender_material(tmp_path, "Ka 1 1 1\nKd 0.8 0.1 0.2\nillum 2\nmap_Ks ks.png\n")
    assert (node["metallic"], node["roughness"]) == (0, 0.5)
    node = blender_material(tmp_path, lines, header="# by hand")
    assert "roughness" not in node.params or not isinstance(node["roughness"], Node)
    assert "map_ns" in " ".join(notes(tmp_path))


def test_blender_pbr_extension(tmp_path: Path) -> None:
    """As Blender 5.0 writes coats (four times the weight), transmission (Tf) and specular levels (Ks)."""
    common = "Kd 0.64 0.81 1\nKs 0.5 0.5 0.5\nNi 1.33\nd 1\nillum 2\nPr 0.25\nPm 0\nPs 0\nPcr 0.1\naniso 0\nanisor 0\n"
    coated = blender_material(tmp_path, common + "Pc 2\n")
    assert (coated["coat_weight"], coated["coat_roughness"], coated["transmission_weight"]) == (0.5, 0.1, 0)
    blender_material(tmp_path, common + "Pc 4\n")
    assert notes(tmp_path) == []
    glass = blender_material(tmp_path, common + "Pc 0\nTf 0.5 0.5 0.5\n")
    assert (glass.type, glass["transmission_weight"], glass["specular_ior"]) == ("openpbr", 0.5, 1.33)
    assert (glass["specular_roughness"], glass["coat_weight"]) == (0.25, 0)
    assert glass["transmission_color"] == pytest.approx((0.8, 0.9, 1))  # at each of two boundaries
    dull = blender_material(tmp_path, common.replace("Ks 0.5 0.5 0.5", "Ks 0 0 0") + "Pc 0\n")
    assert (dull.type, dull["specular_color"]) == ("metallic_roughness", (0, 0, 0))
    assert blender_material(tmp_path, common + "Pc 1\n", header="# by hand")["coat_weight"] == 1


def test_blender_metal_and_see_through(tmp_path: Path) -> None:
    node = blender_material(tmp_path, "Ns 250\nKa 0.75 0.75 0.75\nKd 0.8 0.7 0.2\nKs 0.5 0.5 0.5\nillum 3\n")
    assert (node["metallic"], node["roughness"], node["base_color"]) == (0.75, 0.5, (0.8, 0.7, 0.2))
    node = blender_material(tmp_path, "Ns 250\nKa 1 1 1\nKd 0.8 0.7 0.2\nKs 0.5 0.5 0.5\nd 0.25\nillum 9\n")
    assert (node.type, node["opacity"]) == ("metallic_roughness", 0.25)
    node = blender_material(tmp_path, "Ka 1 1 1\nKd 0.8 0.7 0.2\nd 0.25\nillum 6\n")
    assert (node["metallic"], node["opacity"]) == (1, 0.25)


def test_blender_bump_is_a_normal_map_and_others_are_not(tmp_path: Path) -> None:
    (tmp_path / "n.png").write_bytes(encode_image(corner_image(), ".png", tmp_path))
    lines = "Ns 250\nKd 0.8 0.7 0.2\nillum 2\nmap_Bump -bm 0.5 n.png\n"
    node = blender_material(tmp_path, lines)
    assert (node["normal_map"]["path"], node["normal_map"]["color_space"], node["normal_scale"]) == (
        "n.png",
        "linear",
        0.5,
    )
    assert blender_material(tmp_path, lines, header="# Maya").params.get("normal_map") is None
    assert notes(tmp_path) == [left_out(6)]


def left_out(line: int) -> str:
    why = "the bump map is left out: heights, of which MTL has no unit (accepted: a normal map)"
    return f"scene.mtl:{line}: newmtl m: {why}"


@pytest.mark.parametrize("keyword", ["bump", "map_Bump"])
@pytest.mark.parametrize(("kind", "found"), [(np.uint8, True), (np.uint16, True), ("grey", False), ("heights", False)])
def test_bump_maps_of_normals_are_normal_maps(keyword: str, kind: Any, found: bool, tmp_path: Path) -> None:
    """Whoever wrote the file; heights are told from them by their texels."""
    slopes = np.random.default_rng(5).normal(0, 0.4, (600, 300, 2))
    normals = np.concatenate([slopes, np.ones((600, 300, 1))], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    if isinstance(kind, str):  # of a grey whose vector has length 1, too
        level = 0.789 if kind == "grey" else np.random.default_rng(6).random((600, 300, 1))
        normals = np.broadcast_to(2 * np.asarray(level) - 1, (600, 300, 3))
        kind = np.uint8
    texels = np.round((normals + 1) / 2 * np.iinfo(kind).max).astype(kind)
    (tmp_path / "n.png").write_bytes(encode_image(texels, ".png", tmp_path))
    lines = f"Kd 1 1 1\n{keyword} -bm 0.5 n.png\n"
    by_blender = blender_material(tmp_path, lines).params.get("normal_map")
    assert (by_blender is not None) == found  # old versions wrote heights
    node = blender_material(tmp_path, lines, header="# by hand")
    normal = node.params.get("normal_map")
    assert (normal is not None) == found
    assert notes(tmp_path) == ([] if found else [left_out(4)])
    if normal is not None:
        assert (normal["path"], normal["color_space"], node["normal_scale"]) == ("n.png", "linear", 0.5)


def test_blender_bump_without_a_file_is_missing(tmp_path: Path) -> None:
    assert blender_material(tmp_path, "Kd 1 1 1\nmap_Bump none.png\n")["normal_map"]["path"] == "none.png"


def test_bump_maps_that_cannot_be_read_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "broken.png").write_bytes(b"no image")
    for name in ("none.png", "broken.png", "../../etc/passwd"):
        assert blender_material(tmp_path, f"Kd 1 1 1\nbump {name}\n", header="# x").params.get("normal_map") is None
        assert notes(tmp_path) == [left_out(4)]
    lines = "Kd 1 1 1\nnorm n.png\nbump m.png\nnewmtl b\nbump c.png\nnewmtl c\nbump c.png\n"
    assert blender_material(tmp_path, lines, header="# x")["normal_map"]["path"] == "n.png"
    assert notes(tmp_path) == [left_out(7).replace("newmtl m", "newmtl b") + "; 1 more"]


def test_glass_of_other_programs_stays_glass(tmp_path: Path) -> None:
    assert blender_material(tmp_path, "Ni 1.4\nd 0.5\nillum 9\n", header="# by hand").type == "dielectric"


# --- the PBR extension ------------------------------------------------------------------------------------------------


def test_pbr_extension_without_layers(tmp_path: Path) -> None:
    """What Blender writes for a plain material."""
    lines = "Kd 0.8 0.7 0.2\nPr 0.4\nPm 1\nPs 0\nPc 0\nPcr 0.03\naniso 0\nanisor 0\n"
    node = blender_material(tmp_path, lines)
    assert (node.type, node["metallic"], node["roughness"]) == ("metallic_roughness", 1, 0.4)


def test_pbr_extension_with_layers(tmp_path: Path) -> None:
    node = blender_material(tmp_path, "Kd 0.8 0.7 0.2\nPr 0.4\nPm 0.5\nPs 0.25\nPc 3\nPcr 0.1\n")
    assert (node.type, node["base_color"], node["base_metalness"]) == ("openpbr", (0.8, 0.7, 0.2), 0.5)
    assert (node["specular_roughness"], node["fuzz_weight"]) == (0.4, 0.25)
    assert (node["coat_weight"], node["coat_roughness"]) == (0.75, 0.1)
    assert (node["coat_ior"], node["coat_darkening"]) == (1.5, 0)


@pytest.mark.parametrize("aniso", [0.3, 1.0])
def test_anisotropy_has_disneys_widths(aniso: float, tmp_path: Path) -> None:
    node = blender_material(tmp_path, f"Kd 1 1 1\nPr 0.4\nPm 1\naniso {aniso}\n")
    aspect = math.sqrt(1 - 0.9 * aniso)
    ratio = 1 - node["specular_roughness_anisotropy"]
    along = node["specular_roughness"] ** 2 * math.sqrt(2 / (1 + ratio**2))
    assert along == pytest.approx(0.4**2 / aspect)
    assert along * ratio == pytest.approx(0.4**2 * aspect)


def test_anisotropy_turns(tmp_path: Path) -> None:
    for turns, degrees in ((0, 0), (0.25, 90), (1.5, 180)):
        node = blender_material(tmp_path, f"Kd 1 1 1\nPr 0.4\nPm 1\naniso 0.5\nanisor {turns}\n")
        assert node["tangent_rotation"] == degrees


def test_maps_of_the_pbr_extension(tmp_path: Path) -> None:
    (tmp_path / "c.png").write_bytes(encode_image(corner_image(), ".png", tmp_path))
    node = blender_material(tmp_path, "Kd 1 1 1\nPr 0.4\nmap_Pc c.png\nPs 0.5\nmap_Ps -imfchan g c.png\n")
    assert (node["coat_weight"]["texture"]["path"], node["coat_weight"]["channel"]) == ("c.png", "mean")
    assert (node["fuzz_weight"]["channel"], node["fuzz_weight"]["scale"]) == ("g", (0.5, 0.5, 0.5))


def test_opaque_materials_of_maya_are_seen(tmp_path: Path) -> None:
    lines = "illum 4\nKd 0.5 0.4 0.3\nKa 0 0 0\nTf 1.00 1.00 1.00\nNi 1.00\n"
    node = blender_material(tmp_path, lines, header="")
    assert (node.type, node["reflectance"]) == ("diffuse", (0.5, 0.4, 0.3))
    assert blender_material(tmp_path, lines + "Tf 0.9 1 1\n", header="").type == "dielectric"
    assert blender_material(tmp_path, lines + "Ni 1.3\n", header="").type == "dielectric"


@pytest.mark.parametrize(
    ("lines", "opacity", "told"),
    [
        ("d 1\nTr 1", 1, True),  # as old exporters mean it
        ("Tr 0.3\nd 0.3", 0.3, True),
        ("d 0.3\nTr 0.7", 0.3, False),
        ("Tr 0.25", 0.75, False),
    ],
)
def test_d_counts_beside_tr(lines: str, opacity: float, told: bool, tmp_path: Path) -> None:
    assert blender_material(tmp_path, lines, header="")["opacity"] == opacity
    assert ["d counts" in note for note in notes(tmp_path)] == [True] * told


def test_byte_order_marks_quotes_and_comments(tmp_path: Path) -> None:
    encode = codecs.BOM_UTF8.decode()
    node = blender_material(tmp_path, 'Kd 1 0 0 # red\nmap_Ke -s 2 2 1 "a b.png"\n', header=f"{encode}newmtl n")
    assert node["reflectance"] == (1, 0, 0)
    assert node["emission"]["path"] == "a b.png"
    text = (tmp_path / "scene.obj").read_text().replace("scene.mtl", '"scene.mtl"')
    (tmp_path / "scene.obj").write_text(encode + text)
    (shape,) = obj.load(tmp_path / "scene.obj", LoadOptions(complete=False)).shapes
    assert shape["material"] == node


def test_an_option_without_numbers_names_the_word(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"scene.mtl:3: -s: wrong values: 'x' \(accepted: 1 or 2 or 3 finite"):
        blender_material(tmp_path, "map_Kd -s x y a.png", header="#")
