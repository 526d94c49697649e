"""What a scene may hold: every kind, type and parameter, with units, ranges and defaults.

The compiled core declares its materials, textures, lights, cameras and filters; `python_types` adds what only Python
knows (meshes and other shapes, image files, transforms). Factories, validation, the scene format, its JSON Schema and
its documentation all read this one table. ``python -m destello.schema`` writes the published JSON Schema.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Literal

from destello.errors import SceneError, did_you_mean

# kind of node: (name of the list in _core.schema(), section of a scene file)
KINDS: Mapping[str, str] = MappingProxyType(
    {
        "material": "materials",
        "texture": "textures",
        "volume": "volumes",
        "shape": "shapes",
        "light": "lights",
        "environment": "environments",
        "camera": "cameras",
        "filter": "filters",
    }
)
NO_LIMIT = 3.0e38  # the core's word for "no limit" (core/base/param.h)
NORMALS = frozenset({"normal_map", "geometry_coat_normal"})
TANGENTS = frozenset({"tangent_map", "geometry_coat_tangent"})
_NUMBERS = {"eta", "k", "subsurface_radius_scale"}  # in the guise of colours
Role = Literal["color", "directions", "number"]
"""What a value is for; a texture in its place is read accordingly."""


@dataclass(frozen=True, slots=True)
class ParamDoc:
    """One parameter.

    Attributes:
        name, doc, unit: for people.
        kind: what values look like. From the core: scalar, color, vector, bool, enum. From Python: integer, numbers,
            text, path, array, texels, voxels, transform, animation, texture, image, material, volume, filter, group.
        texturable: a texture may stand in place of the value.
        default: value if not given; None: nothing.
        required: must be given.
        min, max: accepted range of every component, ends included; None: no limit.
        choices: names that an enum accepts, or a text; any text if empty.
        columns: for numbers, how many; for arrays, the accepted numbers of columns (0: one-dimensional); for voxels, of
            channels.
        dtype: for arrays, NumPy's name of the type kept.
    """

    name: str
    doc: str = ""
    kind: str = "scalar"
    unit: str = ""
    texturable: bool = False
    default: Any = None
    required: bool = False
    min: float | None = None
    max: float | None = None
    choices: tuple[str, ...] = ()
    columns: tuple[int, ...] = ()
    dtype: str = "float32"

    @property
    def accepted(self) -> str:
        """What is accepted, in words."""
        text = " ".join(part for part in (_form(self), self.range_text) if part)
        return f"{text}, or a texture" if self.texturable else text

    @property
    def range_text(self) -> str:
        """The accepted range with its unit, in words; empty if there is none."""
        unit = f" {self.unit}" if self.unit else ""
        if self.min is not None and self.max is not None:
            return f"from {_digits(self.min)} to {_digits(self.max)}{unit}"
        if self.min is not None:
            return f"of at least {_digits(self.min)}{unit}"
        if self.max is not None:
            return f"of at most {_digits(self.max)}{unit}"
        return f"in {self.unit}" if self.unit else ""


@dataclass(frozen=True, slots=True)
class TypeDoc:
    """One type of node: a material, a shape... `common` names the parameters that all types of the kind share."""

    kind: str
    type: str
    doc: str = ""
    params: Mapping[str, ParamDoc] = field(default_factory=dict)
    common: frozenset[str] = frozenset()

    def param(self, name: str) -> ParamDoc:
        """The parameter called `name`; SceneError with the nearest name if there is none."""
        try:
            return self.params[name]
        except KeyError:
            raise SceneError(
                f"{self.type} has no parameter {name!r}", place=None, expected=did_you_mean(name, self.params)
            ) from None


@dataclass(frozen=True, slots=True)
class Schema:
    """All types by kind and name."""

    kinds: Mapping[str, Mapping[str, TypeDoc]]

    def type(self, kind: str, name: object) -> TypeDoc:
        """The type called `name`; SceneError with the nearest name if there is none."""
        types = self.kinds[kind]
        if isinstance(name, str) and name in types:
            return types[name]
        raise SceneError(f"unknown {kind} type", value=name, expected=did_you_mean(name, types))

    def __iter__(self) -> Iterator[TypeDoc]:
        for types in self.kinds.values():
            yield from types.values()


@lru_cache(maxsize=1)
def schema() -> Schema:
    """The schema of this build: the core's declarations and Python's."""
    from destello import _core

    return build(_core.schema())


def build(raw: Mapping[str, Any]) -> Schema:
    """The schema from what `_core.schema()` returns."""
    from destello import python_types as own

    kinds: dict[str, dict[str, TypeDoc]] = {}
    for kind, section in KINDS.items():
        common = _common(kind, raw)
        extra = own.EXTRA.get(kind, {})
        types = {}
        for entry in raw.get(section, ()):
            name = str(entry["type"])
            if name in own.INTERNAL:
                continue
            params = [core_param(p) for p in entry["params"]]
            shared = () if name in own.BARE else common
            types[name] = _type(kind, name, str(entry["doc"]), [*extra.get(name, ()), *params], shared)
        for doc in own.TYPES:
            if doc.kind == kind and (doc.type not in types or doc.type in own.REPLACED):
                types[doc.type] = _type(kind, doc.type, doc.doc, list(doc.params.values()), common)
        kinds[kind] = types
    return Schema(MappingProxyType({kind: MappingProxyType(types) for kind, types in kinds.items()}))


def _common(kind: str, raw: Mapping[str, Any]) -> list[ParamDoc]:
    from destello import python_types as own

    core = [*raw.get("surface", ()), *raw.get("medium", ())] if kind == "material" else []
    return [*(core_param(p) for p in core), *own.COMMON.get(kind, ())]


def _type(kind: str, name: str, doc: str, params: Sequence[ParamDoc], common: Sequence[ParamDoc]) -> TypeDoc:
    table = {p.name: p for p in params}
    shared = [p for p in common if p.name not in table]
    table.update((p.name, p) for p in shared)
    return TypeDoc(kind, name, doc, MappingProxyType(table), frozenset(p.name for p in shared))


def core_param(raw: Mapping[str, Any]) -> ParamDoc:
    """A ParamDoc from the core's own description."""
    kind = str(raw["kind"])
    default = raw["default"]
    if kind in ("color", "vector"):
        default = tuple(_shortest(v) for v in default)
    elif kind == "scalar":
        default = _shortest(default)
    numeric = kind in ("scalar", "color", "vector")
    return ParamDoc(
        name=str(raw["name"]),
        doc=str(raw.get("doc", "")),
        kind=kind,
        unit=str(raw.get("unit", "")),
        texturable=bool(raw.get("texturable", False)),
        default=default,
        min=_limit(raw.get("min")) if numeric else None,
        max=_limit(raw.get("max")) if numeric else None,
        choices=tuple(str(c) for c in raw.get("choices", ())),
    )


def role_of(doc: ParamDoc) -> Role:
    """Whether the parameter is a colour to look at, or directions or numbers, be they in the guise of one."""
    if doc.name in NORMALS | TANGENTS:
        return "directions"
    return "color" if doc.kind == "color" and doc.unit != "1/m" and doc.name not in _NUMBERS else "number"


def is_color(doc: ParamDoc) -> bool:
    """Whether the parameter is a colour to look at."""
    return role_of(doc) == "color"


def required(doc: ParamDoc) -> ParamDoc:
    """The same parameter, without a default."""
    return replace(doc, default=None, required=True)


def _limit(value: Any) -> float | None:
    return None if value is None or abs(value) >= NO_LIMIT * 0.999 else _shortest(value)


def _shortest(value: Any) -> float:
    """A float32 as the shortest decimal number that rounds to it: 0.3, not 0.30000001192092896."""
    import numpy as np

    return float(str(np.float32(value)))


_FORMS = {
    "scalar": "a number",
    "integer": "a whole number",
    "color": "3 numbers (linear red, green, blue) or one (grey)",
    "vector": "3 numbers",
    "bool": "true or false",
    "text": "a text",
    "path": "the path of a file",
    "texels": "an array of shape (height, width, 1 to 4), uint8, uint16, float16 or float32",
    "transform": "a transform",
    "volume": "a volume",
    "animation": "transform words, some with keyframes",
    "texture": "a texture",
    "image": "an image texture",
    "material": "a material",
    "filter": "a filter",
    "group": "the name of a group",
}


def _form(doc: ParamDoc) -> str:
    if doc.kind == "color" and doc.unit.startswith("W/"):
        return "3 numbers (linear red, green, blue), one (grey), or {blackbody: kelvin}"
    if doc.choices:
        return " or ".join(doc.choices)
    if doc.kind == "numbers":
        return f"{doc.columns[0]} numbers"
    if doc.kind == "array":
        shapes = " or ".join("(N,)" if c == 0 else f"(N, {c})" for c in doc.columns)
        return f"an array of shape {shapes}, {doc.dtype}"
    if doc.kind == "voxels":
        channels = " or ".join(str(c) for c in doc.columns)
        return f"an array of shape (depth, height, width, {channels}), uint8, float16 or float32, at least 0"
    return _FORMS[doc.kind]


def _digits(number: float) -> str:
    return str(int(number)) if number == int(number) and abs(number) < 1e12 else f"{number:g}"


if __name__ == "__main__":
    from destello.json_schema import main

    main()
