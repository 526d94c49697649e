"""The JSON Schema of scene files, so that editors complete and check them.

``python -m destello.schema`` writes it to docs/destello.schema.json; ``--check`` says whether that file is up to date.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from destello.animation import INTERPOLATIONS, KEYED
from destello.python_types import BLACK_BODY, FILM, RENDER
from destello.schema import KINDS, ParamDoc, Schema, TypeDoc, is_color, schema

DIALECT = "https://json-schema.org/draft/2020-12/schema"
NUMBER = {"type": "number"}
_NAMED = {"material": "materials", "texture": "textures"}  # kinds whose nodes may stand for themselves by name


def json_schema(types: Schema | None = None) -> dict[str, Any]:
    """The JSON Schema of the native format, as plain data."""
    types = types or schema()
    definitions: dict[str, Any] = {"transform": _transform(), "animation": _animation()}
    definitions["blackbody"] = {"description": BLACK_BODY.doc, **_params(BLACK_BODY), "required": ["blackbody"]}
    for kind in KINDS:
        definitions[kind] = _kind(kind, types)
        for doc in types.kinds[kind].values():
            definitions.update((f"{kind}:{name}", _param(doc.params[name])) for name in sorted(doc.common))
        definitions.update((f"{kind}.{name}", _type(doc)) for name, doc in types.kinds[kind].items())
    return {
        "$schema": DIALECT,
        "title": "destello scene",
        "description": "A scene for the path tracer destello: YAML or JSON. Metres, seconds, degrees; linear Rec.709.",
        "type": "object",
        "properties": _sections(),
        "additionalProperties": False,
        "$defs": definitions,
    }


def _sections() -> dict[str, Any]:
    one_camera, cameras = (
        _ref("camera"),
        _map("camera", "Cameras by name; the one called default, or the first, is used."),
    )
    return {
        "destello": {"description": "Version of the format.", "const": 1},
        "name": {"description": "What the scene is called.", "type": ["string", "null"]},
        "camera": {**one_camera, "description": "The camera, if there is only one."},
        "cameras": cameras,
        "film": {"description": FILM.doc, **_params(FILM), "type": ["object", "null"]},
        "render": {"description": RENDER.doc, **_params(RENDER), "type": ["object", "null"]},
        "environment": {"anyOf": [_ref("environment"), {"type": "null"}]},
        "textures": _map("texture", "Textures by name: wherever a texture may stand, its name may.", inline=True),
        "materials": _map("material", "Materials by name: wherever a material may stand, its name may.", inline=True),
        "groups": {
            "description": "Shapes that instances place as one.",
            "type": ["object", "null"],
            "additionalProperties": {"anyOf": [_list("shape"), {"type": "null"}]},
        },
        "shapes": {"description": "What is seen.", "anyOf": [_list("shape"), {"type": "null"}]},
        "lights": {"description": "Lights that are no surfaces.", "anyOf": [_list("light"), {"type": "null"}]},
    }


def _ref(name: str) -> dict[str, Any]:
    return {"$ref": f"#/$defs/{name}"}


def _map(kind: str, doc: str, *, inline: bool = False) -> dict[str, Any]:
    """Nodes by name; `inline`: a name cannot stand for another."""
    inner = {"type": "object", **_ref(kind)} if inline else _ref(kind)
    return {"description": doc, "type": ["object", "null"], "additionalProperties": inner}


def _list(kind: str) -> dict[str, Any]:
    return {"type": "array", "items": _ref(kind)}


def _kind(kind: str, types: Schema) -> dict[str, Any]:
    """Any node of a kind: its type decides which parameters there are."""
    names = list(types.kinds[kind])
    node = {
        "type": "object",
        "required": ["type"],
        "properties": {"type": {"enum": names}},
        "allOf": [
            {"if": {"properties": {"type": {"const": name}}, "required": ["type"]}, "then": _ref(f"{kind}.{name}")}
            for name in names
        ],
    }
    if kind not in _NAMED:
        return node
    return {"anyOf": [{"type": "string", "description": f"The name of a {kind} in {_NAMED[kind]}."}, node]}


def _type(doc: TypeDoc) -> dict[str, Any]:
    params = _params(doc)
    params["properties"] = {"type": {"const": doc.type, "description": doc.doc}, **params["properties"]}
    params["properties"]["name"] = {"type": ["string", "null"], "description": "A label for people."}
    arrays = [p.name for p in doc.params.values() if p.kind in ("array", "texels", "voxels")]
    if arrays:
        text = f"A .npz file beside the scene that holds arrays: {', '.join(arrays)}."
        params["properties"]["data"] = {"type": ["string", "null"], "description": text}
    required = [p.name for p in doc.params.values() if p.required and p.name not in arrays]
    return {"description": doc.doc, **params, "required": ["type", *required]}


def _params(doc: TypeDoc) -> dict[str, Any]:
    properties = {
        name: _ref(f"{doc.kind}:{name}") if name in doc.common else _param(param) for name, param in doc.params.items()
    }
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _param(doc: ParamDoc) -> dict[str, Any]:
    options = _values(doc)
    if is_color(doc):
        options.append(_ref("blackbody"))
    if doc.texturable:
        options.append(_ref("texture"))
    if not doc.required:
        options.append({"type": "null"})
    made: dict[str, Any] = {"description": f"{doc.doc}. {doc.accepted[:1].upper()}{doc.accepted[1:]}."}
    made.update(options[0] if len(options) == 1 else {"anyOf": options})
    if doc.default is not None:
        made["default"] = list(doc.default) if isinstance(doc.default, tuple) else doc.default
    return made


def _values(doc: ParamDoc) -> list[dict[str, Any]]:
    """What a parameter accepts beside textures."""
    number: dict[str, Any] = dict(NUMBER)
    if doc.min is not None:
        number["minimum"] = doc.min
    if doc.max is not None:
        number["maximum"] = doc.max
    simple: dict[str, list[dict[str, Any]]] = {
        "scalar": [number],
        "integer": [{**number, "type": "integer"}],
        "color": [_tuple(number, 3), number],
        "vector": [_tuple(number, 3)],
        "numbers": [_tuple(number, doc.columns[0] if doc.columns else 0)],
        "bool": [{"type": "boolean"}],
        "enum": [{"enum": list(doc.choices)}],
        "text": [{"enum": list(doc.choices)} if doc.choices else {"type": "string"}],
        "path": [{"type": "string"}],
        "group": [{"type": "string"}],
        "transform": [_ref("transform")],
        "animation": [_ref("animation")],
        "image": [_ref("texture")],
    }
    if doc.kind in ("array", "texels", "voxels"):
        return [_array(doc)]
    return simple.get(doc.kind) or [_ref(doc.kind)]


def _tuple(item: dict[str, Any], count: int) -> dict[str, Any]:
    return {"type": "array", "items": item, "minItems": count, "maxItems": count}


def _array(doc: ParamDoc) -> dict[str, Any]:
    number = {"type": "integer", "minimum": 0} if doc.dtype == "uint32" else NUMBER
    if doc.kind in ("texels", "voxels") or doc.columns == (0,):
        return {"type": "array", "items": number}
    row = {"type": "array", "items": number, "minItems": min(doc.columns), "maxItems": max(doc.columns)}
    return {"type": "array", "items": row}


def _words() -> dict[str, dict[str, Any]]:
    """The words of a transform with what they take."""
    three = _tuple(NUMBER, 3)
    row = _tuple(NUMBER, 4)
    return {
        "translate": three,
        "rotate": _object({"axis": {"anyOf": [three, {"enum": ["x", "y", "z"]}]}, "angle": NUMBER}, ["axis", "angle"]),
        "scale": {"anyOf": [three, NUMBER]},
        "shear": _object(dict.fromkeys(("xy", "xz", "yx", "yz", "zx", "zy"), NUMBER), []),
        "look_at": _object({"origin": three, "target": three, "up": three}, ["origin", "target"]),
        "matrix": {"type": "array", "items": row, "minItems": 3, "maxItems": 4},
    }


def _word_list(words: dict[str, dict[str, Any]], text: str) -> dict[str, Any]:
    word = {
        "type": "object",
        "properties": words,
        "additionalProperties": False,
        "minProperties": 1,
        "maxProperties": 1,
    }
    return {"description": text, "anyOf": [{"type": "array", "items": word}, word]}


def _transform() -> dict[str, Any]:
    text = "Words applied first to last; angles in degrees, counter-clockwise seen from the tip of the axis."
    return _word_list(_words(), text)


def _animation() -> dict[str, Any]:
    """A transform in which some words have keyframes."""
    words = _words()
    for name in KEYED:
        value = words[name] if name != "rotate" else {"anyOf": [words[name], _tuple(NUMBER, 4)]}
        tangents = {"type": "array", "items": _tuple(NUMBER, 4) if name == "rotate" else words[name]}
        fields: dict[str, Any] = {
            "times": {"type": "array", "items": NUMBER, "minItems": 1, "description": "In seconds."},
            "values": {"type": "array", "items": value, "minItems": 1, "description": "One a time."},
            "interpolation": {"enum": list(INTERPOLATIONS), "default": "linear"},
            "in_tangents": {**tangents, "description": "For cubic: change a second into each keyframe."},
            "out_tangents": {**tangents, "description": "For cubic: change a second out of each keyframe."},
        }
        words[name] = {"anyOf": [words[name], _object(fields, ["times", "values"])]}
    text = "Transform words applied first to last; translate, rotate and scale may have keyframes."
    return _word_list(words, text)


def _object(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def text() -> str:
    """The published file's content."""
    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


def main(arguments: list[str] | None = None) -> None:
    """The command line of ``python -m destello.schema``."""
    parser = argparse.ArgumentParser(
        prog="python -m destello.schema", description="Writes the scene format's JSON Schema."
    )
    parser.add_argument("path", nargs="?", type=Path, default=Path("docs/destello.schema.json"))
    parser.add_argument("--check", action="store_true", help="write nothing; fail if the file is not up to date")
    options = parser.parse_args(arguments)
    wanted = text()
    if not options.check:
        options.path.write_text(wanted, encoding="utf-8")
    elif not options.path.exists() or options.path.read_text(encoding="utf-8") != wanted:
        sys.exit(f"{options.path} is not up to date: run python -m destello.schema")
