"""MTL files, the materials of OBJ: parsed. `_obj_materials` makes destello's of them.

Bump maps are kept as `maps["bump"]`, for `_obj_bump` to tell what they are.
"""

from __future__ import annotations

import codecs
import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from destello.errors import FormatError
from destello.io._text import numbered_lines, printable, unquoted

_COLORS = ("ka", "kd", "ks", "ke", "tf")
_NUMBERS = ("ns", "ni", "d", "tr", "pr", "pm", "ps", "pc", "pcr", "aniso", "anisor", "illum")
_MAPS = ("map_kd", "map_ke", "map_d", "map_pr", "map_pm", "map_ps", "map_pc", "map_pcr", "map_aniso", "norm")
BLENDER_MAPS = ("map_ns", "map_refl", "map_ks")
BLENDER_COAT = 4.0  # its Pc of a whole coat
_BUMPS = ("bump", "map_bump")
_UNSEEN = ("map_ka", "sharpness")  # ambient light and the like: nothing that a path tracer misses
_OPTIONS = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2, "-bm": 1, "-boost": 1, "-texres": 1}  # numbers at most
_WORDS = ("-clamp", "-blendu", "-blendv", "-imfchan", "-type", "-cc")
_ACCEPTED = {  # least and most
    **dict.fromkeys(("kd", "ks", "tf", "d", "tr", "pr", "pm", "ps", "pc", "pcr", "aniso"), (0.0, 1.0)),
    **dict.fromkeys(("ke", "ns"), (0.0, math.inf)),
}
_ILLUMS, DEFAULT_ILLUM, DEFAULT_INDEX = range(11), 2.0, 1.5


@dataclass
class Map:
    """A texture map: its file (relative to the scene) and its options."""

    path: str
    line: int
    numbers: dict[str, list[float]] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)


@dataclass
class Material:
    """One newmtl block, keywords in lower case. `opacity`: d, or 1 - Tr; `blender`: that program wrote it."""

    name: str
    line: int
    colors: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    maps: dict[str, Map] = field(default_factory=dict)
    opacity: float = 1.0
    blender: bool = False


def parse(data: bytes, file: Path, folder: str) -> tuple[list[Material], Counter[str], list[str]]:
    """The materials of an MTL file, how often statements were not understood, what else to say. Raises FormatError.

    `folder`: the file's directory relative to the scene's, "" if it is the same; map paths are prefixed with it.
    """
    parser = _Parser(file, folder)
    for number, line in numbered_lines(data.removeprefix(codecs.BOM_UTF8)):
        words = printable(line).split()
        if words[:2] == ["#", "Blender"] and not parser.materials:
            parser.blender = True
        if words and not words[0].startswith("#"):
            parser.statement(words[0].lower(), words[1:], printable(line), number)
    return parser.materials, parser.ignored, parser.notes()


class _Parser:
    def __init__(self, file: Path, folder: str) -> None:
        self.file = file
        self.folder = folder
        self.blender = False
        self.materials: list[Material] = []
        self.ignored: Counter[str] = Counter()
        self._said: dict[str, str] = {}  # by keyword: what was the matter with it first
        self._times: Counter[str] = Counter()

    def notes(self) -> list[str]:
        """What was not taken as it stands, once for each keyword."""
        more = {keyword: count - 1 for keyword, count in self._times.items()}
        return [text + (f"; {more[keyword]} more" if more[keyword] else "") for keyword, text in self._said.items()]

    def _say(self, keyword: str, line: int, text: str) -> None:
        name = self.materials[-1].name
        self._said.setdefault(keyword, f"{self.file.name}:{line}: newmtl {name}: {text}")
        self._times[keyword] += 1

    def _accepted(self, keyword: str, values: list[float], line: int) -> list[float]:
        """The values in their range."""
        if keyword == "illum":
            made, known = [v if v in _ILLUMS else DEFAULT_ILLUM for v in values], f"0 to {_ILLUMS[-1]}"
        elif keyword == "ni":
            made, known = [v if v > 0 else DEFAULT_INDEX for v in values], "above 0"
        else:
            low, high = _ACCEPTED.get(keyword, (-math.inf, math.inf))
            if self.blender and keyword == "pc":
                high = BLENDER_COAT
            made = [min(max(v, low), high) for v in values]
            known = f"{low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
        if made != values:
            was, counts = (" ".join(f"{v:g}" for v in numbers) for numbers in (values, made))
            self._say(keyword, line, f"{_spelled(keyword)} {was} counts as {counts} (accepted: {known})")
        return made

    def statement(self, keyword: str, words: list[str], line: str, number: int) -> None:
        """Takes in one line."""
        if keyword == "newmtl":
            name = line.partition(line.split()[0])[2].strip()
            self.materials.append(Material(name, number, blender=self.blender))
            return
        if not self.materials:
            raise FormatError(f"{keyword} before the first newmtl", file=self.file, line=number, expected="newmtl")
        material = self.materials[-1]
        if keyword in _COLORS and words[:1] not in (["spectral"], ["xyz"]):
            red, *others = self._accepted(keyword, self._numbers(keyword, words, number, (1, 3)), number)
            material.colors[keyword] = (red, others[0], others[1]) if others else (red, red, red)
        elif keyword in _NUMBERS:
            values = self._numbers(keyword, words[1:] if words[:1] == ["-halo"] else words, number, (1,))
            (value,) = self._accepted(keyword, values, number)
            material.numbers[keyword] = value
            if keyword in ("d", "tr"):
                self._opacity(material, number)
        elif keyword in _MAPS or (self.blender and keyword in BLENDER_MAPS):
            material.maps[keyword] = self._map(words, line, number)
        elif keyword in _BUMPS:
            material.maps["bump"] = self._map(words, line, number)
        elif keyword not in _UNSEEN:
            self.ignored[keyword[:20]] += 1

    def _opacity(self, material: Material, line: int) -> None:
        """MTL has d; Tr is 1 - d to most programs that add it, but d again to some, so d decides."""
        d, tr = (material.numbers.get(key) for key in ("d", "tr"))
        if d is None:
            material.opacity = 1.0 - (tr or 0.0)
            return
        material.opacity = d
        if tr is not None and abs(1.0 - tr - d) > 0.01:
            self._say("d beside tr", line, f"d {d:g} and Tr {tr:g} differ: d counts (accepted: Tr = 1 - d)")

    def _numbers(self, keyword: str, words: list[str], line: int, counts: tuple[int, ...]) -> list[float]:
        try:
            before = next((at for at, word in enumerate(words) if word.startswith("#")), len(words))
            values = [float(word) for word in words[:before]][: max(counts)]
            if len(values) not in counts or not all(abs(v) < 1e30 for v in values):
                raise ValueError
        except ValueError:
            wanted = " or ".join(map(str, counts))
            raise FormatError(
                f"{keyword}: wrong values",
                file=self.file,
                line=line,
                value=" ".join(words),
                expected=f"{wanted} finite numbers",
            ) from None
        return values

    def _map(self, words: list[str], line: str, number: int) -> Map:
        found = Map("", number)
        at = 0
        while at < len(words) - 1 and words[at].lower() in (*_OPTIONS, *_WORDS):
            option = words[at].lower()
            at += 1
            if option in _WORDS:
                found.words[option] = words[at].lower()
                at += 1
                continue
            values: list[str] = []
            while at < len(words) - 1 and len(values) < _OPTIONS[option] and _is_number(words[at]):
                values.append(words[at])
                at += 1
            found.numbers[option] = self._numbers(option, values or words[at : at + 1], number, (1, 2, 3))
        name = line.split(maxsplit=at + 1)[at + 1].strip() if at < len(words) else ""
        if not name or "\0" in name:
            raise FormatError("a map without a file", file=self.file, line=number, value=line, expected="a path")
        name = unquoted(name).replace("\\", "/")
        found.path = f"{self.folder}/{name}" if self.folder and not name.startswith("/") else name
        return found


def _spelled(keyword: str) -> str:
    """As MTL writes it."""
    return keyword if keyword in ("d", "illum", "aniso") else keyword.capitalize()


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
