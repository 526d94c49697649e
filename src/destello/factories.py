"""Makes the functions of `destello.materials`, `destello.shapes`... from the schema, one for each type."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeAlias

from destello.errors import SceneError
from destello.nodes import Node
from destello.schema import ParamDoc, TypeDoc, schema

Factory: TypeAlias = Callable[..., Node]


class Factories:
    """The factory functions of one kind: attribute lookup for its module (PEP 562)."""

    def __init__(self, kind: str, module: str) -> None:
        """`kind`: of the nodes made; `module`: whose functions they are."""
        self.kind = kind
        self.module = module
        self._made: dict[str, Factory] = {}

    def get(self, name: str) -> Factory:
        """The function called `name`. Raises AttributeError, as a module would."""
        if name in self._made:
            return self._made[name]
        if name.startswith("__"):
            raise AttributeError(f"module {self.module!r} has no attribute {name!r}")
        try:
            doc = schema().type(self.kind, name)
        except SceneError as error:
            raise AttributeError(f"module {self.module!r} has no attribute {name!r} ({error.expected})") from None
        return self._made.setdefault(name, make_factory(doc, self.module))

    def names(self) -> list[str]:
        """All types of the kind."""
        return sorted(schema().kinds[self.kind])


def make_factory(doc: TypeDoc, module: str) -> Factory:
    """A function that makes nodes of one type; its signature and docstring come from the declaration."""
    own = sorted((p for p in doc.params.values() if p.name not in doc.common), key=lambda p: not p.required)
    positional = [p.name for p in own]

    def factory(*args: Any, name: str | None = None, **params: Any) -> Node:
        if len(args) > len(positional):
            raise SceneError(
                "too many positional arguments",
                place=doc.type,
                value=len(args),
                expected=", ".join(positional) or "none",
            )
        for key, value in zip(positional, args, strict=False):
            if params.get(key) is not None:
                raise SceneError("given twice", place=doc.type, value=key)
            params[key] = value
        return Node(doc.kind, doc.type, params, name=name)

    shared = [p for p in doc.params.values() if p.name in doc.common]
    parameters = [_parameter(p, inspect.Parameter.POSITIONAL_OR_KEYWORD) for p in own]
    parameters += [_parameter(p, inspect.Parameter.KEYWORD_ONLY) for p in shared]
    parameters.append(inspect.Parameter("name", inspect.Parameter.KEYWORD_ONLY, default=None, annotation="str | None"))
    factory.__name__ = doc.type
    factory.__qualname__ = doc.type
    factory.__module__ = module
    factory.__doc__ = _docstring(doc, [*own, *shared])
    factory.__signature__ = inspect.Signature(parameters, return_annotation="Node")  # type: ignore[attr-defined]
    return factory


def _parameter(doc: ParamDoc, kind: Any) -> inspect.Parameter:
    default = inspect.Parameter.empty if doc.required else doc.default
    return inspect.Parameter(doc.name, kind, default=default)


def _docstring(doc: TypeDoc, params: list[ParamDoc]) -> str:
    lines = [doc.doc.strip() or doc.type, "", "Args:"]
    for p in params:
        text = f"    {p.name}: {p.doc.rstrip('.')}. {p.accepted[:1].upper()}{p.accepted[1:]}."
        if p.default is not None and not p.required:
            text += f" Default: {p.default}."
        lines.append(text)
    lines += [
        "    name: label for people and scene files.",
        "",
        "Raises:",
        "    SceneError: if a value is not accepted.",
    ]
    return "\n".join(lines)
