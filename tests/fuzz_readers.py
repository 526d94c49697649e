"""Feeds damaged scene files to the readers. Run it as a program, with a memory limit of its own:

    python tests/fuzz_readers.py FORMAT FIRST_SEED CASES [MEGABYTES]

It prints one line for each case in which anything but a `destello.Error` came out, and exits with 1 if there was one.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import destello
from destello.io import load
from scene_files import QUAD, QUAD_INDICES, QUAD_UV, Gltf, corner_image, encode_image, sphere

LONGEST = 20.0  # seconds a case may take, on a busy machine
STRANGE: list[Any] = [
    *(None, True, [], {}, "", "x", -1, 0, 1, 2, 3.5, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 10**30),
    *(
        1e300,
        -1e300,
        1e-300,
        [0],
        [[0]],
        [1e38] * 3,
        [0] * 16,
        {"index": 0},
        "data:;base64,AAAA",
        "../x",
        "VEC4",
        "MAT4",
    ),
]
BYTES = [
    b"\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"\xff\xff\xff\x7f",
    b"\0\0\0\x80",
    b"\x01\0\0\0",
    b"\xff",
    b"\0",
    b"\n",
    b" ",
]
WORDS = [b"nan", b"-1", b"99999999999", b"1e999", b"0", b"/", b"//", b"-", b"\\\n", b"#", b"f", b"v ", b"\xc3", b"list"]

Case = tuple[str, bytes, dict[str, bytes]]  # file name, content, files beside it


def rich_materials(g: Gltf, folder: Path) -> None:
    """Five materials, and two variants."""
    texture = g.texture(encode_image(corner_image(), ".png", folder), wrapS=33071, magFilter=9728)
    info = {
        "index": texture,
        "extensions": {"KHR_texture_transform": {"offset": [0.5, 0], "rotation": 1, "scale": [2, 2]}},
    }
    g.add(
        "materials",
        pbrMetallicRoughness={"baseColorTexture": info, "metallicRoughnessTexture": {"index": 0}},
        normalTexture={"index": 0, "scale": 0.5},
        emissiveFactor=[1, 1, 1],
        alphaMode="MASK",
        extensions={"KHR_materials_ior": {"ior": 1.4}, "KHR_materials_transmission": {"transmissionFactor": 0.5}},
    )
    g.add("materials", extensions={"KHR_materials_unlit": {}}, alphaMode="BLEND")
    layers = {
        "clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0}, "clearcoatRoughnessFactor": 0.5}
        | {"clearcoatNormalTexture": {"index": 0, "scale": 0.5}},
        "sheen": {"sheenColorFactor": [0.5, 0.2, 0], "sheenRoughnessTexture": {"index": 0}},
        "iridescence": {"iridescenceFactor": 1, "iridescenceThicknessTexture": info, "iridescenceIor": 1.4},
        "anisotropy": {"anisotropyStrength": 0.5, "anisotropyRotation": 1},
        "diffuse_transmission": {"diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorFactor": [1, 0, 0]},
        "volume": {"thicknessFactor": 1, "attenuationColor": [0.5, 0.1, 1], "attenuationDistance": 0.1},
        "volume_scatter": {"multiscatterColor": [0.5, 0.5, 0.5], "scatterAnisotropy": 0.5},
        "specular": {"specularFactor": 0.5, "specularColorFactor": [2, 1, 0]},
        "dispersion": {"dispersion": 0.1},
    }
    layered = {f"KHR_materials_{name}": values for name, values in layers.items()}
    g.add("materials", extensions=layered)
    g.add("materials", extensions={**layered, "KHR_materials_transmission": {"transmissionFactor": 1}})
    old = {"glossinessFactor": 0.5, "specularGlossinessTexture": info, "diffuseTexture": {"index": 0}}
    g.add("materials", extensions={"KHR_materials_pbrSpecularGlossiness": old})
    g.extend("KHR_materials_variants", variants=[{"name": "one"}, {"name": "two"}])


def rich_gltf(folder: Path) -> Gltf:
    """A file that uses all that the reader knows."""
    g = Gltf()
    positions, uv, indices = sphere(4, 6)
    for name in ("KHR_materials_ior", "KHR_texture_transform", "KHR_mesh_quantization"):
        g.extend(name, required=True)
    g.extend("KHR_lights_punctual", lights=[{"type": "spot", "intensity": 3, "spot": {"outerConeAngle": 0.5}}])
    rich_materials(g, folder)
    attributes = {"POSITION": g.accessor(positions), "NORMAL": g.accessor(positions), "TEXCOORD_0": g.accessor(uv)}
    variants = {"KHR_materials_variants": {"mappings": [{"material": 4, "variants": [1]}]}}
    triangles = g.accessor(indices.astype(np.uint16))
    ball = g.mesh(attributes, triangles, material=0, name="ball", extensions=variants)
    sparse = {
        "count": 1,
        "indices": {"bufferView": g.view(b"\2\0"), "componentType": 5123},
        "values": {"bufferView": g.view(np.float32((1, 2, 3)).tobytes())},
    }
    bent = g.add(
        "accessors", bufferView=g.view(QUAD.tobytes()), componentType=5126, count=4, type="VEC3", sparse=sparse
    )
    colors = g.accessor(np.full((4, 4), 200, np.uint8), normalized=True)
    strip = {"POSITION": bent, "TEXCOORD_0": g.accessor(QUAD_UV, stride=12), "COLOR_0": colors}
    strip |= {
        "JOINTS_0": g.accessor(np.zeros((4, 4), np.uint8)),
        "WEIGHTS_0": g.accessor(np.full((4, 4), 0.25, np.float32)),
    }
    targets = [{"POSITION": g.accessor(QUAD)}]
    quad = g.mesh(strip, g.accessor(QUAD_INDICES), material=1, mode=5, targets=targets)
    joint = g.node(translation=[0, 1, 0], name="joint")
    skin = g.add("skins", joints=[joint], inverseBindMatrices=g.accessor(np.eye(4, dtype=np.float32).reshape(1, 16)))
    g.node(mesh=quad, skin=skin, weights=[0.5])
    child = g.node(root=False, mesh=ball, rotation=[0, 0.6, 0, 0.8], scale=[1, 2, 1])
    g.node(children=[child], matrix=np.eye(4).reshape(-1).tolist())
    g.node(mesh=ball, translation=[3, 0, 0])
    for material in (2, 3):
        g.node(mesh=g.mesh(attributes, triangles, material=material))
    moves = g.accessor(np.eye(3, dtype=np.float32))
    g.node(mesh=ball, extensions={"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": moves}}})
    g.node(camera=g.add("cameras", type="perspective", perspective={"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1}))
    light = g.node(translation=[0, 3, 0], extensions={"KHR_lights_punctual": {"light": 0}})
    times = g.accessor(np.float32([0, 0.02, 0.5]))
    outputs = {"rotation": np.eye(4)[:3], "scale": np.eye(3) + 1, "translation": np.arange(27).reshape(9, 3)}
    kinds = ("LINEAR", "STEP", "CUBICSPLINE")
    samplers = [
        {"input": times, "output": g.accessor(values.astype(np.float32)), "interpolation": kind}
        for kind, values in zip(kinds, outputs.values(), strict=True)
    ]
    targets = [{"node": node, "path": path} for node, path in zip((child, child, light), outputs, strict=True)]
    channels = [{"sampler": i, "target": target} for i, target in enumerate(targets)]
    g.add("animations", channels=channels, samplers=samplers, name="all")
    return g


def gltf_case(rng: np.random.Generator, folder: Path) -> Case:
    g = rich_gltf(folder)
    if rng.random() < 0.6:
        for _ in range(min(rng.geometric(0.6), 4)):
            change_json(rng, g.json)
        return "scene.glb", g.glb_bytes(), {}
    if rng.random() < 0.3:
        path = g.gltf(folder)
        return "scene.gltf", damaged(rng, path.read_bytes()), {}
    if rng.random() < 0.3:
        return "scene.glb", damaged(rng, g.glb_bytes()), {}
    g.data[:] = damaged(rng, bytes(g.data)).ljust(len(g.data), b"\0")[: len(g.data)]
    return "scene.glb", g.glb_bytes(), {}


def change_json(rng: np.random.Generator, data: Any) -> None:
    """Replaces, removes or copies one value somewhere in a JSON document."""
    places: list[tuple[Any, Any]] = []
    pending = [data]
    while pending:
        node = pending.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node))
        places += [(node, key) for key in keys]
        pending += [node[key] for key in keys if isinstance(node[key], (dict, list))]
    node, key = places[rng.integers(len(places))]
    what = rng.random()
    if what < 0.1:
        del node[key]
    elif what < 0.3:
        other, place = places[rng.integers(len(places))]
        node[key] = json.loads(json.dumps(other[place] if not isinstance(other, list) or place < len(other) else 0))
    elif what < 0.5 and isinstance(node[key], (int, float)) and not isinstance(node[key], bool):
        node[key] = node[key] + int(rng.integers(-3, 4))
    else:
        node[key] = STRANGE[rng.integers(len(STRANGE))]


def damaged(rng: np.random.Generator, data: bytes, *, words: list[bytes] = BYTES) -> bytes:
    """A file with some bytes changed, taken out, doubled or cut off."""
    made = bytearray(data)
    for _ in range(min(rng.geometric(0.6), 6)):
        at = int(rng.integers(len(made) + 1))
        what = rng.random()
        if what < 0.25 and at < len(made):
            made[at] = rng.integers(256)
        elif what < 0.5 and at < len(made):
            made[at] = made[rng.integers(len(made))]
        elif what < 0.75:
            word = words[rng.integers(len(words))]
            made[at : at + len(word) * int(rng.integers(2))] = word
        elif what < 0.8:
            del made[at : at + int(rng.integers(1, 40))]
        elif what < 0.9:
            made[at:at] = made[at : at + int(rng.integers(1, 200))]
        else:
            del made[at:]
        if not made:
            return b""
    return bytes(made)


def obj_case(rng: np.random.Generator, folder: Path) -> Case:
    points, uv, indices = sphere(3, 5)
    lines = ["mtllib scene.mtl", "o ball", *(f"v {x:.4g} {y:.4g} {z:.4g}" for x, y, z in points)]
    lines += [f"vt {u:.4g} {v:.4g}" for u, v in uv] + ["vn 0 0 1", "vn 0 1 0", "usemtl one", "s 1"]
    for i, (a, b, c) in enumerate(indices.reshape(-1, 3) + 1):
        form = [f"{a} {b} {c} {a}", f"{a}/{a} {b}/{b} {c}/{c}", f"{a}//1 {b}//2 {c}//1", f"-{a} -{b} -{c}"][i % 4]
        lines += [f"f {form}", *(["usemtl two", "s off"] if i == 7 else [])]
    mtl = (
        b"newmtl one\nKd 0.5 0.6 0.7\nKs 0.2 0.2 0.2\nNs 50\nd 0.9\nmap_Kd -s 2 2 t.png\nnewmtl two\nillum 7\nNi 1.4\n"
    )
    if rng.random() < 0.3:
        layers = b"Pr 0.5\nPs 0.5\nPc 1\nPcr 0.1\naniso 0.3\n"
        blender = b"newmtl three\nKa 0.5 0.5 0.5\nillum 3\nmap_Bump -bm 2 t.png\n"
        mtl = b"# Blender 4.1 MTL File\n" + mtl + layers + blender
    data = "\n".join(lines).encode() + b"\n"
    files = {"scene.mtl": mtl, "t.png": encode_image(corner_image(), ".png", folder)}
    if rng.random() < 0.3:
        files["scene.mtl"] = damaged(rng, mtl, words=WORDS)
    else:
        data = damaged(rng, data, words=WORDS + BYTES)
    return "scene.obj", data, files


def stl_case(rng: np.random.Generator, folder: Path) -> Case:
    points, _, indices = sphere(3, 5)
    corners = points[indices].reshape(-1, 9)
    if rng.random() < 0.5:
        rows = np.zeros(len(corners), [("n", "<f4", 3), ("v", "<f4", 9), ("a", "<u2")])
        rows["v"] = corners
        return "scene.stl", damaged(rng, b"solid".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()), {}
    text = "solid x\n"
    for row in corners:
        vertices = "".join(f"vertex {x:.4g} {y:.4g} {z:.4g}\n" for x, y, z in row.reshape(3, 3))
        text += f"facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\n"
    return "scene.stl", damaged(rng, (text + "endsolid x\n").encode(), words=WORDS + BYTES), {}


def ply_case(rng: np.random.Generator, folder: Path) -> Case:
    import io

    import plyfile

    points, uv, indices = sphere(3, 5)
    vertex = np.zeros(
        len(points),
        [(n, "f4") for n in ("x", "y", "z", "nx", "ny", "nz", "s", "t")]
        + [("red", "u1"), ("green", "u1"), ("blue", "u1")],
    )
    for name, column in zip(vertex.dtype.names or (), [*points.T, *points.T, *uv.T], strict=False):
        vertex[name] = column
    triangles = indices.reshape(-1, 3).astype("i4")
    faces = np.empty(len(triangles), [("vertex_indices", "O")])
    mixed = rng.random() < 0.5
    faces["vertex_indices"] = [np.append(t, t[:1]) if mixed and i % 3 == 0 else t for i, t in enumerate(triangles)]
    options = [{"text": True}, {"byte_order": "<"}, {"byte_order": ">"}][rng.integers(3)]
    elements = [plyfile.PlyElement.describe(vertex, "vertex"), plyfile.PlyElement.describe(faces, "face")]
    stream = io.BytesIO()
    plyfile.PlyData(elements, **options).write(stream)
    data = stream.getvalue()
    head, mark, body = data.partition(b"end_header\n")
    if rng.random() < 0.7:
        return "scene.ply", head + mark + damaged(rng, body, words=WORDS + BYTES), {}
    return (
        "scene.ply",
        damaged(rng, head, words=[*WORDS, b"999999999", b"float", b"uint", b"element"]) + mark + body,
        {},
    )


CASES: dict[str, Callable[[np.random.Generator, Path], Case]] = {
    "gltf": gltf_case,
    "obj": obj_case,
    "stl": stl_case,
    "ply": ply_case,
}


def run(kind: str, seed: int, folder: Path) -> str:
    """What happened to one case: "" if all is well."""
    rng = np.random.default_rng((seed, len(kind)))
    name, data, files = CASES[kind](rng, folder)
    (folder / name).write_bytes(data)
    for beside, content in files.items():
        (folder / beside).write_bytes(content)
    start = time.process_time()
    try:
        scene = load(folder / name, variant="two" if kind == "gltf" and seed % 2 else None)
        scene.compile()
        if not scene.cameras:
            return "no camera"
    except destello.Error as error:
        text = str(error)
        if "\n" in text or len(text) > 2000 or (str(folder) not in text and "shapes[" not in text):
            return f"a bad message: {text[:300]!r}"
    except Exception:
        return traceback.format_exc()
    took = time.process_time() - start
    return f"took {took:.1f} s" if took > LONGEST else ""


def main() -> int:
    """Runs the cases that the command line asks for."""
    kind, first, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    megabytes = int(sys.argv[4]) if len(sys.argv) > 4 else 3000
    resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))
    warnings.simplefilter("error")
    failures = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            problem = run(kind, seed, Path(folder))
            if problem:
                failures += 1
                print(f"{kind} {seed}: {problem}")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
