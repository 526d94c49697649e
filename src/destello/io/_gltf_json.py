"""glTF's JSON, read without trust: every value is checked where it is used, and errors name its place.

pygltflib and trimesh take what they find (wrong types, indices out of range, views larger than their buffer), so
neither could say what is wrong with a file; the JSON is small, and NumPy reads the buffers.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from destello.errors import FormatError

ROUNDING = 1e-6  # what single precision may add to a number, or take from it, relative to its limit
_LARGEST = 3.4028234e38  # float32


class Item:
    """One JSON object, with the file it is from, its place in it (``meshes[2].primitives[0]``) and its own index."""

    __slots__ = ("data", "file", "index", "place")

    def __init__(self, data: dict[str, Any], file: Path, place: str = "", index: int = 0) -> None:
        self.data = data
        self.file = file
        self.place = place
        self.index = index

    def at(self, key: str) -> str:
        """The place of a member."""
        return f"{self.place}.{key}" if self.place else key

    def error(self, problem: str, key: str = "", *, value: object = None, expected: str | None = None) -> FormatError:
        """An error at this object, or at its member `key`."""
        place = (self.at(key) if key else self.place) or None
        return FormatError(problem, file=self.file, place=place, value=value, expected=expected)

    def _wrong(self, key: str, expected: str) -> NoReturn:
        if key not in self.data:
            raise self.error("missing", key, expected=expected)
        value = self.data[key]
        raise self.error("wrong value", key, value="null" if value is None else value, expected=expected)

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def integer(self, key: str, default: int | None = None, *, low: int = 0, high: int | None = None) -> int:
        """A whole number from `low` to `high`; without a `default` it must be there."""
        value = self.data.get(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or value < low or (high is not None and value > high):
            limit = f"from {low} to {high}" if high is not None else f"of at least {low}"
            self._wrong(key, f"a whole number {limit}")
        return value

    def number(
        self, key: str, default: float | None = None, *, low: float = -math.inf, high: float = math.inf
    ) -> float:
        """A finite number from `low` to `high`; without a `default` it must be there."""
        value: Any = self.data.get(key, default)
        held = _held(value, low, high)
        if held is None:
            self._wrong(key, f"a number{_limits(low, high)}")
        return held

    def numbers(
        self, key: str, count: int, default: Sequence[float] | None = None, *, low: float = -math.inf
    ) -> tuple[float, ...]:
        """`count` finite numbers of at least `low`; without a `default` they must be there."""
        value: Any = self.data.get(key, default)
        listed = isinstance(value, (list, tuple)) and len(value) == count
        held = [h for v in value if (h := _held(v, low, math.inf)) is not None] if listed else []
        if len(held) != count:
            self._wrong(key, f"{count} numbers{_limits(low, math.inf)}")
        return tuple(held)

    def shares(self, key: str, count: int) -> tuple[float, ...]:
        """`count` numbers of at least 0, by default 1: shares of light, many of which are 1 but for rounding."""
        values = self.numbers(key, count, (1.0,) * count, low=0)
        return tuple(1.0 if 1 < value <= 1 + ROUNDING else value for value in values)

    def text(self, key: str, default: str | None = None) -> str:
        """A text; without a `default` it must be there."""
        value = self.data.get(key, default)
        if not isinstance(value, str):
            self._wrong(key, "a text")
        return value

    def choice(self, key: str, choices: Sequence[str], default: str | None = None) -> str:
        """One of some texts."""
        value = self.text(key, default)
        if value not in choices:
            self._wrong(key, " or ".join(choices))
        return value

    def flag(self, key: str) -> bool:
        """True or false; false if it is not there."""
        value = self.data.get(key, False)
        if not isinstance(value, bool):
            self._wrong(key, "true or false")
        return value

    def item(self, key: str) -> Item | None:
        """A JSON object, or None if it is not there."""
        if key not in self.data:
            return None
        value = self.data[key]
        if not isinstance(value, dict):
            self._wrong(key, "a JSON object")
        return Item(value, self.file, self.at(key))

    def items(self, key: str) -> list[Item]:
        """A list of JSON objects; empty if it is not there."""
        value = self.data.get(key, [])
        if not isinstance(value, list):
            self._wrong(key, "a list of JSON objects")
        place = self.at(key)
        for i, element in enumerate(value):
            if not isinstance(element, dict):
                raise FormatError(
                    "wrong value", file=self.file, place=f"{place}[{i}]", value=element, expected="a JSON object"
                )
        return [Item(element, self.file, f"{place}[{i}]", i) for i, element in enumerate(value)]

    def integers(self, key: str, *, high: int) -> list[int]:
        """A list of whole numbers from 0 to `high`; empty if it is not there."""
        value = self.data.get(key, [])
        if not isinstance(value, list):
            self._wrong(key, "a list of whole numbers")
        for i, n in enumerate(value):
            if isinstance(n, bool) or not isinstance(n, int) or not 0 <= n <= high:
                raise FormatError(
                    "index out of range" if isinstance(n, int) else "wrong value",
                    file=self.file,
                    place=f"{self.at(key)}[{i}]",
                    value=n,
                    expected=f"a whole number from 0 to {high}" if high >= 0 else "none: there is nothing to refer to",
                )
        return value

    def texts(self, key: str) -> list[str]:
        """A list of texts; empty if it is not there."""
        value = self.data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            self._wrong(key, "a list of texts")
        return value

    def extension(self, name: str) -> Item | None:
        """The object's extension called `name`, or None."""
        extensions = self.item("extensions")
        return None if extensions is None else extensions.item(name)


class Document:
    """The root object and its tables (meshes, accessors...), as Items."""

    def __init__(self, root: Item) -> None:
        self.root = root
        self.file = root.file
        self._tables: dict[str, list[Item]] = {}

    def table(self, name: str) -> list[Item]:
        """All of ``root[name]``."""
        if name not in self._tables:
            self._tables[name] = self.root.items(name)
        return self._tables[name]

    def refer(self, item: Item, key: str, table: str, *, required: bool = False) -> Item | None:
        """What index ``item[key]`` of `table` refers to; None if there is no such member and it is not `required`."""
        if key not in item and not required:
            return None
        targets = self.table(table)
        index = item.integer(key)
        if index >= len(targets):
            raise item.error("index out of range", key, value=index, expected=_indices_of(table, len(targets)))
        return targets[index]

    def extension_table(self, extension: str, name: str) -> list[Item]:
        """A table that an extension keeps at the root."""
        holder = self.root.extension(extension)
        return [] if holder is None else holder.items(name)


def _indices_of(table: str, count: int) -> str:
    return f"0 to {count - 1}: there are {count} {table}" if count else f"none: there are no {table}"


def _held(value: Any, low: float, high: float) -> float | None:
    """A number from `low` to `high`, or None; one that rounding has put just outside is the limit."""
    if not _is_number(value):
        return None
    slack = [ROUNDING * abs(limit) if limit != 0 else ROUNDING for limit in (low, high)]
    near = (low == -math.inf or value >= low - slack[0]) and (high == math.inf or value <= high + slack[1])
    return min(max(float(value), low), high) if near else None


def _limits(low: float, high: float) -> str:
    limits = [f"at least {low:g}"] * (low > -math.inf) + [f"at most {high:g}"] * (high < math.inf)
    return f" of {' and '.join(limits)}" if limits else ""


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _LARGEST


def parse(text: bytes, file: Path, place: str = "") -> Item:
    """The root of a JSON text. FormatError names line and column of what is broken."""
    try:
        decoded = text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = text.count(b"\n", 0, error.start) + 1
        raise FormatError(
            "not UTF-8 text",
            file=file,
            line=line,
            place=place or None,
            value=text[error.start : error.end],
            expected="glTF 2.0 JSON",
        ) from None
    try:
        data = json.loads(decoded, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise FormatError(
            f"broken JSON at line {error.lineno}, column {error.colno}: {error.msg}",
            file=file,
            line=error.lineno,
            place=place or None,
            value=decoded[max(error.pos - 10, 0) : error.pos + 20] or None,
        ) from None
    except (ValueError, RecursionError) as error:  # a constant that is no JSON, an endless number, endless nesting
        what = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise FormatError(f"broken JSON: {what}", file=file, place=place or None) from None
    if not isinstance(data, dict):
        raise FormatError("not glTF: the JSON is no object", file=file, place=place or None, value=data)
    return Item(data, file)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON value")
