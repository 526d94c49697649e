"""Which widget edits which parameter: from the declared parameters of a node, with their ranges.

Numbers with two bounds that lie near each other get a slider, others a field; colours from 0 to 1 a picker, colours
without an upper bound (radiance, intensity) a picker and a strength. What a widget cannot show (textures, nodes) says
what it is. Pure data: `widgets.py` draws it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from destello.color_spaces import srgb_decode, srgb_encode
from destello.nodes import Node
from destello.schema import ParamDoc

Widget: TypeAlias = Literal["slider", "number", "checkbox", "choice", "color", "bright color", "vector", "text"]

_WIDEST_SLIDER = 200.0  # a slider over more than this cannot be set exactly


@dataclass(frozen=True, slots=True)
class Control:
    """One widget.

    Attributes:
        name: the parameter's. label: what stands beside it. hint: its sentence, unit and range.
        widget: its kind. value: what it shows, as the widget has it. choices: of a choice.
        low, high, step: bounds of a number, None: none; step of a slider.
    """

    name: str
    label: str
    hint: str
    widget: Widget
    value: Any
    low: float | None = None
    high: float | None = None
    step: float | None = None
    choices: tuple[str, ...] = ()


def controls(node: Node, *, common: bool = False, skip: tuple[str, ...] = ()) -> list[Control]:
    """The widgets of a node's own parameters; with `common`, of those that all nodes of its kind share."""
    doc = node.doc
    chosen = [p for p in doc.params.values() if (p.name in doc.common) == common and p.name not in skip]
    return [found for p in chosen if (found := control(p, node[p.name])) is not None]


def control(doc: ParamDoc, value: Any) -> Control | None:
    """The widget of one parameter; None: it cannot be edited here (a transform, a mesh's array, a whole material)."""
    label = doc.name.replace("_", " ")
    hint = f"{doc.doc}; {doc.range_text}" if doc.range_text else doc.doc
    if isinstance(value, Node):
        return Control(doc.name, label, hint, "text", _words(value))
    if doc.kind in ("scalar", "integer"):
        return _number(doc, label, hint, value)
    if doc.kind == "color":
        picked = (255, 255, 255) if value is None else to_picker(value, bright=doc.max is None)[0]
        if doc.max is not None:
            return Control(doc.name, label, hint, "color", picked)
        strength = 0.0 if value is None else max(value)
        return Control(doc.name, label, hint, "bright color", (picked, strength), low=0.0)
    if doc.kind == "vector":
        return Control(doc.name, label, hint, "vector", value or (0.0, 0.0, 0.0), step=0.01)
    if doc.kind == "bool":
        return Control(doc.name, label, hint, "checkbox", bool(value))
    if doc.kind == "enum":
        return Control(doc.name, label, hint, "choice", value, choices=doc.choices)
    return None


def _number(doc: ParamDoc, label: str, hint: str, value: Any) -> Control:
    whole = doc.kind == "integer"
    shown = (doc.min or 0) if value is None else value
    shown = int(shown) if whole else float(shown)  # the widget keeps the kind of number that it begins with
    bounded = doc.min is not None and doc.max is not None and doc.max - doc.min <= _WIDEST_SLIDER
    if not bounded:
        return Control(doc.name, label, hint, "number", shown, doc.min, doc.max, 1 if whole else None)
    step = 1 if whole else (doc.max - doc.min) / 200  # type: ignore[operator]
    return Control(doc.name, label, hint, "slider", shown, doc.min, doc.max, step)


def changed(doc: ParamDoc, now: Any, shown: Any) -> Any:
    """The parameter's value that a widget's value means; `now`: the value it had.

    A picker has 256 steps a channel, coarser than a colour: the value it had stays where the picker stands for it.
    """
    if doc.kind != "color" or isinstance(now, Node):
        return shown
    bright = doc.max is None
    picked, strength = shown if bright else (shown, 1.0)
    if now is not None and to_picker(now, bright=bright) == (tuple(picked), strength):
        return now
    return from_picker(picked, strength, bright=bright)


def to_picker(color: tuple[float, ...], *, bright: bool) -> tuple[tuple[int, int, int], float]:
    """A linear colour as the picker's sRGB bytes and a strength: the largest channel, or 1 if not `bright`."""
    strength = max(color) if bright else 1.0
    shown = np.array(color) / strength if strength > 0 else np.ones(3)
    r, g, b = (int(byte) for byte in np.rint(srgb_encode(np.clip(shown, 0, 1)) * 255))
    return (r, g, b), float(strength)


def from_picker(picked: tuple[int, int, int], strength: float, *, bright: bool) -> tuple[float, float, float]:
    """The linear colour: the inverse of `to_picker`. A `bright` colour's largest channel is the strength."""
    linear = srgb_decode(np.array(picked) / 255).astype(float)
    if bright:
        linear = linear / linear.max() if linear.max() > 0 else np.ones(3)
        linear = linear * strength
    r, g, b = (float(f"{channel:.6g}") for channel in linear)
    return r, g, b


def _words(node: Node) -> str:
    return f"{node.kind}: {node.name or node.params.get('path') or node.type}"
