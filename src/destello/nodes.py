"""Nodes: the plain data a scene is made of, checked when they are made.

A node is a kind ("material", "shape"...), a type of that kind ("diffuse", "sphere"...) and the parameters given. What
exists is in `destello.schema`; the functions of `destello.materials`, `destello.shapes` and so on make nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

from destello.errors import SceneError, did_you_mean, gather
from destello.schema import ParamDoc, TypeDoc, schema
from destello.transform import Transform
from destello.values import check

DEEPEST = 64  # levels of nodes within nodes


class Node:
    """One material, texture, shape, light, environment, camera or filter. Immutable; `replace` makes a changed one.

    Attributes:
        kind, type: what it is.
        params: the parameters given, checked and in canonical form (see `destello.values`). ``node["radius"]`` also
            knows the defaults of those that were not given.
        name: a label for people and scene files; plays no part in comparisons.

    Two nodes are equal if their kinds, types and given parameters are equal by value, arrays exactly.
    """

    __slots__ = ("_depth", "_hash", "kind", "name", "params", "type")

    kind: str
    type: str
    params: Mapping[str, Any]
    name: str | None
    _depth: int
    _hash: int

    def __init__(
        self,
        kind: str,
        type: str,  # noqa: A002
        params: Mapping[str, Any] | None = None,
        *,
        name: str | None = None,
        place: str | None = None,
    ) -> None:
        """Checks names, kinds and ranges; parameters that are None count as not given.

        `place` names the node in errors; without it, its name or type does. Raises SceneError, all problems in one.
        """
        where = place if place is not None else str(name or type)
        try:
            check_name(name)
            doc = schema().type(kind, type)
            checked = _resolved(doc, check_params(doc, params or {}))
            _check_together(kind, type, checked)
        except SceneError as error:
            raise error.within(where) from None
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "type", type)
        object.__setattr__(self, "params", MappingProxyType(checked))
        object.__setattr__(self, "name", name or None)
        object.__setattr__(self, "_depth", 1 + max((child._depth for child in self.children()), default=0))
        object.__setattr__(self, "_hash", _hash(self))
        if self._depth > DEEPEST:
            raise SceneError("nodes nested too deeply", place=where, value=self._depth, expected=f"at most {DEEPEST}")

    @property
    def doc(self) -> TypeDoc:
        """The declaration of this type."""
        return schema().type(self.kind, self.type)

    def __getitem__(self, key: str) -> Any:
        """The parameter's value, its default if not given, or None if it has none; SceneError if unknown."""
        doc = self.doc.param(key)
        return self.params.get(key, doc.default)

    def replace(self, **changes: Any) -> Node:
        """A copy with other parameters; None takes one away. ``name=`` renames."""
        name = changes.pop("name", self.name)
        return Node(self.kind, self.type, {**self.params, **changes}, name=name)

    def children(self) -> Iterator[Node]:
        """The nodes among the parameters."""
        return (value for value in self.params.values() if isinstance(value, Node))

    def walk(self) -> Iterator[Node]:
        """The node itself and all below it, each object once."""
        seen: set[int] = set()
        pending = [self]
        while pending:
            node = pending.pop()
            if id(node) not in seen:
                seen.add(id(node))
                yield node
                pending.extend(node.children())

    def __setattr__(self, key: str, value: object) -> None:
        raise AttributeError(f"nodes do not change; use replace({key}=...)")

    def __delattr__(self, key: str) -> None:
        raise AttributeError("nodes do not change")

    def __eq__(self, other: object) -> bool:
        return _equal_nodes(self, other, set()) if isinstance(other, Node) else NotImplemented

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        inside = ", ".join(f"{key}={_short(value)}" for key, value in self.params.items())
        return f"{self.doc_module}.{self.type}({inside})"

    @property
    def doc_module(self) -> str:
        """The module whose function makes such nodes: "materials"."""
        from destello.schema import KINDS

        return KINDS[self.kind]

    def __reduce__(self) -> tuple[Callable[..., Node], tuple[Any, ...]]:
        return (_restore, (self.kind, self.type, dict(self.params), self.name))


def check_name(name: object) -> None:
    """Raises SceneError unless `name` is None or a text that a file can hold."""
    if name is None or (
        isinstance(name, str) and "\0" not in name and not any(0xD800 <= ord(c) < 0xE000 for c in name)
    ):
        return
    raise SceneError("not a name", value=name, expected="a text")


def _restore(kind: str, type: str, params: dict[str, Any], name: str | None) -> Node:  # noqa: A002
    return Node(kind, type, params, name=name)


def check_params(doc: TypeDoc, params: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters given, in canonical form and in the declaration's order. Raises SceneError with all problems."""
    checked = {}
    problems: list[SceneError] = []
    for key, value in params.items():
        try:
            if key not in doc.params:
                known = did_you_mean(key, doc.params)
                raise SceneError(f"{doc.type} has no parameter of this name", place=str(key), expected=known)
            if value is not None:
                checked[key] = check(doc.params[key], value)
        except SceneError as error:
            problems.append(error)
    problems.extend(_missing(p) for p in doc.params.values() if p.required and params.get(p.name) is None)
    if problems:
        raise gather(problems) or problems[0]
    return {name: checked[name] for name in doc.params if name in checked}


def _resolved(doc: TypeDoc, params: dict[str, Any]) -> dict[str, Any]:
    """The parameters with a metal's name replaced by what it stands for."""
    if doc.type != "conductor" or "metal" not in params:
        return params
    from destello.metals import eta_k

    both = [name for name in ("fresnel", "eta", "k") if name in params]
    if both:
        raise SceneError(f"metal and {both[0]}", place="metal", value=params["metal"], expected="one of them")
    eta, k = eta_k(params["metal"])
    made = {**params, "fresnel": "eta_k", "eta": eta, "k": k}
    return {name: made[name] for name in doc.params if name in made and name != "metal"}


def _missing(doc: ParamDoc) -> SceneError:
    return SceneError(f"{doc.name} is missing", expected=doc.accepted)


def _check_together(kind: str, type_name: str, params: Mapping[str, Any]) -> None:
    """What no single parameter can tell."""
    if kind == "texture" and type_name == "image" and ("path" in params) == ("pixels" in params):
        raise SceneError("an image needs either a path or pixels", value=sorted(params), expected="one of them")
    if kind == "texture" and type_name == "scaled" and params["texture"].type in ("scaled", "vertex_color"):
        raise SceneError(
            "cannot be scaled again", place="texture", value=params["texture"].type, expected="its own texture"
        )
    if kind == "volume" and {"emission", "temperature"} <= params.keys():
        names = [params["temperature"], params["emission"]] if type_name == "volume_file" else None
        which = f" in {params['path']}" if names else ""
        raise SceneError(f"emission and temperature{which}", place="temperature", value=names, expected="one of them")
    if kind == "volume" and type_name == "grid":
        _check_grid(params)
    if (kind, type_name) in (("shape", "box"), ("volume", "grid")):
        low, high = params.get("min", (0.0, 0.0, 0.0)), params.get("max", (1.0, 1.0, 1.0))
        if not all(a < b for a, b in zip(low, high, strict=True)):
            raise SceneError(
                "the box is empty", place="max", value=high, expected=f"more than min {low} along every axis"
            )
    if kind == "shape" and type_name == "sphere" and params["radius"] == 0:
        raise SceneError("the sphere has no size", place="radius", value=0.0, expected="a number other than 0")
    if "animation" in params:
        _check_animation(type_name, params)
    if "transform1" in params:
        _check_motion(params.get("transform"), params["transform1"])


def _check_grid(params: Mapping[str, Any]) -> None:
    size = params["density"].shape[:3]
    for name in ("albedo", "emission", "temperature"):
        if name in params and params[name].shape[:3] != size:
            raise SceneError("arrays of different sizes", place=name, value=params[name].shape[:3], expected=f"{size}")


def _check_animation(type_name: str, params: Mapping[str, Any]) -> None:
    for end in ("transform1", "center1"):
        if end in params:
            expected = f"one of them: an animation says itself where {type_name} is when the shutter closes"
            raise SceneError(f"animation and {end}", place="animation", expected=expected)
    words = [name for name, _ in params["animation"].words]
    if type_name == "sphere" and set(words) != {"translate"}:
        expected = "translate: what turns or grows is an animated instance of a group"
        raise SceneError("a sphere can only be shifted", place="animation", value=words, expected=expected)


def _check_motion(first: Transform | None, last: Transform) -> None:
    if first is None:
        raise SceneError("transform1 without transform", place="transform", expected="the transform at time 0")
    time = first.collapse(last)
    if time is not None:
        raise SceneError(
            f"on the way from transform the matrix has no inverse at time {time:g}",
            place="transform1",
            value=last,
            expected="less than half a turn, and no mirroring",
        )


_HASHED = 1024  # elements of an array: enough to tell pictures apart, without reading the whole of each


def _hash(node: Node) -> int:
    simple = (_some_of(value) if hasattr(value, "shape") else value for value in node.params.values())
    return hash((node.kind, node.type, frozenset(zip(node.params, simple, strict=True))))


def _some_of(array: Any) -> tuple[Any, ...]:
    """The same of equal arrays, and hardly ever of others: shape, type and elements from all over it."""
    import numpy as np

    some = array.flat[:: max(1, array.size // _HASHED) | 1]
    if array.dtype.kind == "f":
        some = np.nan_to_num(some) + 0.0  # -0.0 equals 0.0, and one NaN another
    return array.shape, array.dtype.str, some.tobytes()


def _equal_nodes(a: Node, b: Node, known: set[tuple[int, int]]) -> bool:
    """`known`: pairs already found equal; without it, shared children would be compared exponentially often."""
    if a is b or (id(a), id(b)) in known:
        return True
    if a._hash != b._hash or (a.kind, a.type) != (b.kind, b.type) or a.params.keys() != b.params.keys():
        return False
    for key, value in a.params.items():
        other = b.params[key]
        if isinstance(value, Node) and isinstance(other, Node):
            if not _equal_nodes(value, other, known):
                return False
        elif not equal_values(value, other):
            return False
    known.add((id(a), id(b)))
    return True


def equal_values(a: Any, b: Any) -> bool:
    """Whether two parameters are equal: nodes and plain values by value, arrays exactly."""
    if hasattr(a, "shape") or hasattr(b, "shape"):
        import numpy as np

        if not (hasattr(a, "shape") and hasattr(b, "shape")) or (a.dtype, a.shape) != (b.dtype, b.shape):
            return False
        same = a.__array_interface__["data"] == b.__array_interface__["data"] and a.strides == b.strides
        return same or np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(type(a) is type(b) and a == b)


def _short(value: Any) -> str:
    return f"<array {value.shape}>" if hasattr(value, "shape") else repr(value)


def all_nodes(roots: Iterable[Node]) -> Iterator[Node]:
    """Every node reachable from `roots`, each object once, in a fixed order."""
    seen: set[int] = set()
    for root in roots:
        for node in root.walk():
            if id(node) not in seen:
                seen.add(id(node))
                yield node
