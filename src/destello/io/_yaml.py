"""YAML and JSON texts to plain data and back, for texts that nobody vouches for.

Reading keeps to what both languages share and scene files need: mappings with text keys, lists, texts, numbers, true,
false and null. Numbers are read as in JSON and YAML 1.2 (so 1e-3 is a number, `on` is a text). There are no tags, so
nothing can be constructed; nesting and size are bounded; an alias gives the very same object again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from destello.errors import FormatError

DEEPEST = 64  # levels of lists and mappings within each other
MOST_VALUES = 5_000_000  # aliases count as what they stand for
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_INTEGER = re.compile(r"[-+]?[0-9]+")
_WORDS: Mapping[str, Any] = {
    "": None, "~": None, "null": None, "true": True, "false": False,
    ".inf": float("inf"), "+.inf": float("inf"), "-.inf": float("-inf"), ".nan": float("nan"),
}  # fmt: skip
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")


@dataclass
class _Open:
    """A list or mapping that is being read."""

    data: Any
    anchor: str | None
    place: str
    key: str | None = None
    size: int = 1


def parse_yaml(text: str) -> Any:
    """The document in a YAML text. Raises FormatError with the line."""
    return _Reader().read(text)


def parse_json(text: str) -> Any:
    """The document in a JSON text. Raises FormatError with the line."""
    try:
        data = json.loads(text, object_pairs_hook=_unique)
    except json.JSONDecodeError as error:
        raise FormatError(f"broken JSON: {error.msg}", line=error.lineno, expected="JSON") from error
    except RecursionError:
        raise FormatError("nested too deeply", expected=f"at most {DEEPEST} levels") from None
    except ValueError as error:  # a number of thousands of digits
        raise FormatError(f"broken JSON: {error}", expected="JSON") from error
    _check_depth(data)
    return data


def lines_of(text: str, places: Sequence[str]) -> dict[str, int]:
    """For each place that is there, the line (first: 1) of the innermost value that is or encloses it."""
    reader = _Reader(places)
    try:
        reader.read(text)
    except FormatError:
        return {}
    return {place: line for place, (_, line) in reader.best.items()}


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise FormatError("a key that is there twice", value=twice, expected="each key once")
    return data


def _check_depth(data: Any) -> None:
    level = [data]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in _inner(outer)]
        if not level:
            return
    raise FormatError("nested too deeply", expected=f"at most {DEEPEST} levels")


def _inner(data: Any) -> Iterator[Any]:
    if isinstance(data, dict):
        values: Any = data.values()
    elif isinstance(data, list):
        values = data
    else:
        return
    for value in values:
        if isinstance(value, (dict, list)):
            yield value


class _Reader:
    """Builds data from libyaml's events, without recursion."""

    def __init__(self, places: Sequence[str] = ()) -> None:
        """`places`: those whose lines are wanted, in `best`: for each, how much of it was found, and the line."""
        self._places = places
        self.best: dict[str, tuple[int, int]] = {}
        self._open: list[_Open] = []
        self._anchors: dict[str, tuple[Any, int]] = {}  # with the number of values
        self._root: Any = None
        self._documents = 0

    def read(self, text: str) -> Any:
        loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        try:
            for event in yaml.parse(text, Loader=loader):
                self._take(event)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line = None if mark is None else mark.line + 1
            if "nesting depth" in (error.problem or ""):  # newer libyaml looks itself, while reading ahead
                raise FormatError("nested too deeply", line=line, expected=f"at most {DEEPEST} levels") from None
            raise FormatError(f"broken YAML: {error.problem or error.context}", line=line, expected="YAML") from error
        except (yaml.YAMLError, UnicodeError) as error:
            raise FormatError(f"broken YAML: {str(error).splitlines()[0]}", expected="YAML") from error
        return self._root

    def _take(self, event: Any) -> None:
        line = event.start_mark.line + 1
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                raise FormatError("a second document", line=line, expected="one document a file")
        elif isinstance(event, yaml.ScalarEvent):
            self._scalar(event, line)
        elif isinstance(event, (yaml.MappingStartEvent, yaml.SequenceStartEvent)):
            self._start({} if isinstance(event, yaml.MappingStartEvent) else [], event, line)
        elif isinstance(event, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
            self._end(line)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchors:
                raise FormatError("an alias without anchor", line=line, value=event.anchor, expected="a known anchor")
            self._put(*self._anchors[event.anchor], line)

    def _start(self, data: Any, event: Any, line: int) -> None:
        _check_tag(event, line)
        place = self._put(data, 0, line)
        if len(self._open) >= DEEPEST:
            raise FormatError("nested too deeply", line=line, expected=f"at most {DEEPEST} levels")
        self._open.append(_Open(data, event.anchor, place))

    def _end(self, line: int) -> None:
        done = self._open.pop()
        if done.anchor is not None:
            self._anchors[done.anchor] = (done.data, done.size)
        self._charge(done.size, line)

    def _charge(self, size: int, line: int) -> None:
        """Counts values towards the list or mapping that they are in."""
        if self._open:
            self._open[-1].size += size
            if self._open[-1].size > MOST_VALUES:
                raise FormatError(
                    "too many values", line=line, expected=f"at most {MOST_VALUES}; large arrays in files"
                )

    def _scalar(self, event: Any, line: int) -> None:
        top = self._open[-1] if self._open else None
        if top is not None and isinstance(top.data, dict) and top.key is None:
            if event.value in top.data:
                raise FormatError("a key that is there twice", line=line, value=event.value, expected="each key once")
            top.key = event.value
            return
        _check_tag(event, line)
        value = _plain_value(event.value, line) if event.implicit[0] else event.value
        self._put(value, 1, line)
        if event.anchor is not None:
            self._anchors[event.anchor] = (value, 1)

    def _put(self, value: Any, size: int, line: int) -> str:
        """Puts a value, which counts as `size` values, where it belongs; returns its place."""
        self._charge(size, line)
        if not self._open:
            self._root = value
            return ""
        top = self._open[-1]
        if isinstance(top.data, list):
            top.data.append(value)
            return self._note(f"[{len(top.data) - 1}]", line)
        if top.key is None:
            raise FormatError("a key that is no text", line=line, expected="a text as key")
        top.data[top.key] = value
        key, top.key = top.key, None
        return self._note(f".{key}", line)

    def _note(self, step: str, line: int) -> str:
        """The place reached by `step`; remembers the line where that is the closest one to a wanted place yet."""
        if not self._places:
            return ""
        here = (self._open[-1].place + step).removeprefix(".")
        for place in self._places:
            inside = place.startswith(here) and place[len(here) : len(here) + 1] in ("", ".", "[")
            if inside and len(here) > self.best.get(place, (-1, 0))[0]:
                self.best[place] = (len(here), line)
        return here


def _check_tag(event: Any, line: int) -> None:
    if event.tag is not None and event.tag != "!":
        raise FormatError("a YAML tag", line=line, value=event.tag, expected="plain data without tags")


def _plain_value(text: str, line: int) -> Any:
    if text in _WORDS:
        return _WORDS[text]
    if not _NUMBER.fullmatch(text):
        return text
    if not _INTEGER.fullmatch(text):
        return float(text)
    try:
        return int(text)
    except ValueError:
        raise FormatError("a number of too many digits", line=line, expected="a number") from None


# --- writing ----------------------------------------------------------------------------------------------------------

WIDTH = 110  # columns within which lists and mappings stay on one line


def to_yaml(data: Any) -> str:
    """A YAML text of plain data; `parse_yaml` reads back the same."""
    return "\n".join(_block(data, 0) if _is_open(data) else [_flow(data)]) + "\n"


def to_json(data: Any) -> str:
    """A JSON text of plain data; `parse_json` reads back the same."""
    return _json(data, 0) + "\n"


def _block(data: Any, indent: int) -> Iterator[str]:
    """The lines of a list or mapping that is not empty."""
    pad = " " * indent
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _entry(f"{pad}{_text(key)}:", value, indent + 2)
        return
    for value in data:
        flat = _flow(value)
        if not _is_open(value) or len(flat) + indent + 2 <= WIDTH:
            yield f"{pad}- {flat}"
        elif _is_numbers(value):
            yield from _wrapped(f"{pad}- [", [_flow(v) for v in value], indent + 3)
        else:
            first, *others = _block(value, indent + 2)
            yield f"{pad}- {first.lstrip()}"
            yield from others


def _entry(head: str, value: Any, indent: int) -> Iterator[str]:
    flat = _flow(value)
    section = indent == 2 and _is_open(value) and not _is_leaf(value)
    if not section and (not _is_open(value) or len(head) + len(flat) + 1 <= WIDTH):
        yield f"{head} {flat}"
    elif _is_numbers(value):
        yield from _wrapped(f"{head} [", [_flow(v) for v in value], indent)
    else:
        yield head
        yield from _block(value, indent)


def _wrapped(head: str, parts: list[str], indent: int) -> Iterator[str]:
    """A list on as many lines as it takes."""
    line = head
    for i, part in enumerate(parts):
        piece = part + ("," if i + 1 < len(parts) else "]")
        if len(line) + len(piece) + 1 > WIDTH and i > 0:
            yield line.rstrip()
            line = " " * indent
        line += piece + " "
    yield line.rstrip()


def _is_open(value: Any) -> bool:
    return isinstance(value, (dict, list)) and bool(value)


def _is_numbers(value: Any) -> bool:
    """Whether it is a list of nothing but values, or of such lists."""
    return isinstance(value, list) and not any(isinstance(v, dict) or (_is_open(v) and not _is_flat(v)) for v in value)


def _is_flat(value: Any) -> bool:
    return isinstance(value, list) and not any(isinstance(v, (dict, list)) for v in value)


def _is_leaf(value: Any) -> bool:
    """Whether a section holds nothing but values, so that it may stay on one line."""
    inner = value.values() if isinstance(value, dict) else value
    return not any(isinstance(v, dict) for v in inner)


def _flow(data: Any) -> str:
    if isinstance(data, dict):
        return "{" + ", ".join(f"{_text(key)}: {_flow(value)}" for key, value in data.items()) + "}"
    if isinstance(data, list):
        return "[" + ", ".join(_flow(value) for value in data) + "]"
    return _text(data) if isinstance(data, str) else _scalar(data)


def _scalar(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)


def _text(text: str) -> str:
    """A text, quoted where it could be taken for something else."""
    if _PLAIN.fullmatch(text) and text not in _WORDS:
        return text
    return '"' + "".join(_escape(c) for c in text) + '"'


def _escape(c: str) -> str:
    if c in '"\\':
        return "\\" + c
    if c.isprintable() and ord(c) != 0xFEFF:
        return c
    code = ord(c)
    if code < 0x100:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _json(data: Any, indent: int) -> str:
    flat = json.dumps(data, ensure_ascii=False)
    if not _is_open(data) or len(flat) + indent <= WIDTH:
        return flat
    pad = " " * (indent + 2)
    if _is_numbers(data):
        return "\n".join(_wrapped("[", [json.dumps(v, ensure_ascii=False) for v in data], indent + 2))
    if isinstance(data, dict):
        lines = [f"{pad}{json.dumps(k, ensure_ascii=False)}: {_json(v, indent + 2)}" for k, v in data.items()]
        return "{\n" + ",\n".join(lines) + "\n" + " " * indent + "}"
    return "[\n" + ",\n".join(pad + _json(v, indent + 2) for v in data) + "\n" + " " * indent + "]"
