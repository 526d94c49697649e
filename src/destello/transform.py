"""Affine transforms as readable words, applied first to last.

``translate(0, 1, 0) @ rotate("y", 30)`` rotates first, as in mathematics; its words are
``[{rotate: {axis: [0, 1, 0], angle: 30}}, {translate: [0, 1, 0]}]``, which is also how scene files have it. Words are
kept as written, so that a scene reads back exactly. The matrix acts on column vectors: metres in, metres out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union

from destello.errors import SceneError, did_you_mean

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Matrix = NDArray[np.float64]

Triple = tuple[float, float, float]
Word = tuple[str, Any]
TransformLike = Union["Transform", Sequence[Mapping[str, Any]], Mapping[str, Any], "NDArray[Any]"]

_AXES: dict[str, Triple] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_SHEARS = ("xy", "xz", "yx", "yz", "zx", "zy")
_LARGEST = 3.4028234e38  # float32, which the core computes in
_LEAST_DETERMINANT = 1e-36
_LEAST_RATIO = 1e-7  # determinant over the product of the columns' lengths: how far from flat


class NotInvertible(SceneError):
    """A transform that makes things flat or shrinks them to nothing."""


class Transform:
    """An invertible affine transform: a sequence of words, applied first to last. Immutable; compared word by word.

    `a @ b` applies b first. See `translate`, `rotate`, `scale`, `shear`, `look_at` and `matrix` in this module.
    """

    __slots__ = ("_matrix", "words")
    __array_ufunc__ = None  # an array times a transform is a mistake

    words: tuple[Word, ...]

    def __init__(self, words: Iterable[Word] = ()) -> None:
        """`words`: pairs (name, value); an empty sequence is the identity. Raises SceneError if not invertible."""
        checked = tuple(check_word(name, value) for name, value in words)
        object.__setattr__(self, "words", checked)
        object.__setattr__(self, "_matrix", _product(checked))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"transforms do not change; make a new one instead of setting {name!r}")

    def __delattr__(self, name: str) -> None:
        raise AttributeError("transforms do not change")

    @property
    def matrix(self) -> Matrix:
        """(4, 4) float64, row-major, for column vectors. A copy."""
        import numpy as np

        return np.array(self._matrix, dtype=np.float64)

    def __matmul__(self, other: Transform) -> Transform:
        if not isinstance(other, Transform):
            return NotImplemented
        return Transform(other.words + self.words)

    def collapse(self, end: Transform) -> float | None:
        """The time in [0, 1] at which the matrix, on its linear way from here to `end`, has no inverse; else None."""
        import numpy as np

        first, change = self.matrix[:3, :3], end.matrix[:3, :3] - self.matrix[:3, :3]
        scale = max(float(np.abs(first).max()), float(np.abs(first + change).max()))
        times = np.linspace(0.0, 1.0, 4)  # four values tell a cubic
        determinants = [float(np.linalg.det((first + t * change) / scale)) for t in times]
        cubic = np.linalg.solve(np.vander(times), np.array(determinants))
        largest = float(np.abs(determinants).max())
        for root in np.roots(cubic[int(np.argmax(np.abs(cubic) > 1e-12 * largest)) :]):
            time = float(np.clip(root.real, 0.0, 1.0))
            if abs(np.polyval(cubic, time)) <= _LEAST_RATIO * largest:
                return time
        return None

    def inverse(self) -> Transform:
        """The inverse, as a matrix word."""
        import numpy as np

        return matrix(np.linalg.inv(self.matrix))

    def to_list(self) -> list[dict[str, Any]]:
        """The words as plain data: what scene files hold."""
        return [{name: plain(value)} for name, value in self.words]

    @staticmethod
    def of(value: Any) -> Transform:
        """A transform from a Transform, one word, a list of words, or a (4, 4) or (3, 4) matrix."""
        if isinstance(value, Transform):
            return value
        if isinstance(value, Mapping):
            return Transform(words_of(value, None))
        if isinstance(value, Sequence) and not isinstance(value, str) and all(isinstance(w, Mapping) for w in value):
            return Transform(word for i, w in enumerate(value) for word in words_of(w, i))
        if hasattr(value, "shape") or (isinstance(value, Sequence) and not isinstance(value, str)):
            return matrix(value)
        raise SceneError("not a transform", value=value, expected=f"a list of words: {', '.join(_WORDS)}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transform) and self.words == other.words

    def __hash__(self) -> int:
        return hash(self.words)

    def __repr__(self) -> str:
        inside = " @ ".join(_CALLS[name](value) for name, value in reversed(self.words))
        return inside or "Transform()"

    def __reduce__(self) -> tuple[Callable[[Iterable[Word]], Transform], tuple[tuple[Word, ...]]]:
        return (Transform, (self.words,))

    if TYPE_CHECKING:
        _matrix: tuple[tuple[float, ...], ...]


def translate(x: float, y: float, z: float) -> Transform:
    """A shift by (x, y, z) metres."""
    return Transform([("translate", (x, y, z))])


def rotate(axis: str | Sequence[float], angle: float) -> Transform:
    """A turn by `angle` degrees about `axis` ("x", "y", "z" or a vector), counter-clockwise seen from its tip."""
    return Transform([("rotate", {"axis": axis, "angle": angle})])


def scale(x: float, y: float | None = None, z: float | None = None) -> Transform:
    """A scaling by one factor, or by one factor for each axis; none may be 0, negative ones mirror."""
    if y is None and z is None:
        return Transform([("scale", x)])
    return Transform([("scale", (x, 1.0 if y is None else y, 1.0 if z is None else z))])


def shear(**factors: float) -> Transform:
    """``shear(xy=0.5)`` adds half of y to x; likewise xz, yx, yz, zx, zy."""
    return Transform([("shear", factors)])


def look_at(origin: Sequence[float], target: Sequence[float], up: Sequence[float] = (0.0, 1.0, 0.0)) -> Transform:
    """Moves the local origin to `origin` and turns the local z axis towards `target`, y as near to `up` as it goes."""
    return Transform([("look_at", {"origin": origin, "target": target, "up": up})])


def matrix(rows: Any) -> Transform:
    """A transform by its (4, 4) or (3, 4) matrix, row by row, for column vectors."""
    return Transform([("matrix", rows)])


# --- words: checks ----------------------------------------------------------------------------------------------------


def check_word(name: str, value: Any) -> Word:
    """The word with its value in the kept form: numbers as floats, triples as tuples. Raises SceneError."""
    try:
        return name, check_value(name, value)
    except SceneError as error:
        raise error.within(name if name in _WORDS else None) from None


def check_value(name: str, value: Any) -> Any:
    """The value of the word `name` in the kept form. Raises SceneError."""
    if name not in _WORDS:
        raise SceneError("unknown transform word", value=name, expected=did_you_mean(name, _WORDS))
    return _WORDS[name](value)


def words_of(
    word: Mapping[str, Any], index: int | None, check: Callable[[str, Any], Word] = check_word
) -> Iterator[Word]:
    """The word in a mapping of one name, checked; `index`: of it in its list. Raises SceneError."""
    place = None if index is None else f"[{index}]"
    if len(word) != 1:
        known = ", ".join(_WORDS)
        raise SceneError("a transform word is one name with its value", place=place, value=dict(word), expected=known)
    for name, value in word.items():
        try:
            yield check(name, value)
        except SceneError as error:
            raise error.within(place) from None


def _number(value: Any, place: str | None = None) -> float:
    if isinstance(value, (bool, str)) or not hasattr(value, "__float__"):
        raise SceneError("not a number", place=place, value=value, expected="a number")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not abs(number) <= _LARGEST:
        raise SceneError("not a finite number", place=place, value=value, expected="a finite number")
    return number


def numbers(value: Any, count: int, place: str | None = None) -> tuple[float, ...]:
    """`count` finite numbers as floats. Raises SceneError."""
    if isinstance(value, (str, Mapping)) or not hasattr(value, "__len__") or len(value) != count:
        raise SceneError(f"not {count} numbers", place=place, value=value, expected=f"{count} numbers")
    return tuple(_number(component, place) for component in value)


def _direction(value: Any, place: str) -> tuple[float, ...]:
    vector = numbers(value, 3, place)
    if not any(vector):
        raise SceneError("a direction of no length", place=place, value=vector, expected="a vector other than 0")
    return vector


def _fields(value: Any, needed: Sequence[str], optional: Sequence[str] = ()) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise SceneError("not a mapping", value=value, expected=", ".join([*needed, *optional]))
    for key in value:
        if key not in needed and key not in optional:
            raise SceneError("unknown name", value=key, expected=did_you_mean(key, [*needed, *optional]))
    for key in needed:
        if key not in value:
            raise SceneError(f"{key} is missing", expected=", ".join(needed))
    return value


def _check_translate(value: Any) -> Any:
    return numbers(value, 3)


def _check_rotate(value: Any) -> Any:
    fields = _fields(value, ("axis", "angle"))
    axis = fields["axis"]
    if isinstance(axis, str):
        if axis not in _AXES:
            raise SceneError("unknown axis", place="axis", value=axis, expected="x, y, z or 3 numbers")
        axis = _AXES[axis]
    return _Fields(axis=_direction(axis, "axis"), angle=_number(fields["angle"], "angle"))


def _check_scale(value: Any) -> Any:
    return numbers(value, 3) if hasattr(value, "__len__") and not isinstance(value, str) else _number(value)


def _check_shear(value: Any) -> Any:
    fields = _fields(value, (), _SHEARS)
    return _Fields(**{key: _number(number, key) for key, number in fields.items()})


def _check_look_at(value: Any) -> Any:
    fields = _fields(value, ("origin", "target"), ("up",))
    up = _direction(fields.get("up", (0.0, 1.0, 0.0)), "up")
    origin, target = numbers(fields["origin"], 3, "origin"), numbers(fields["target"], 3, "target")
    forward = _direction(tuple(t - o for t, o in zip(target, origin, strict=True)), "target")
    side = _cross(_unit(up), _unit(forward))
    if math.hypot(*side) < 1e-6:
        raise SceneError("up is parallel to the direction of view", place="up", value=up, expected="another direction")
    return _Fields(origin=origin, target=target, up=up)


def _check_matrix(value: Any) -> Any:
    if isinstance(value, str) or not hasattr(value, "__len__") or len(value) not in (3, 4):
        raise SceneError("not a matrix", value=value, expected="4 rows of 4 numbers, or the first 3 of them")
    rows = tuple(numbers(row, 4, f"[{i}]") for i, row in enumerate(value))
    if len(rows) == 4 and rows[3] != (0.0, 0.0, 0.0, 1.0):
        raise SceneError("not an affine matrix", place="[3]", value=rows[3], expected="last row 0, 0, 0, 1")
    return rows[:3]


_WORDS: dict[str, Callable[[Any], Any]] = {
    "translate": _check_translate,
    "rotate": _check_rotate,
    "scale": _check_scale,
    "shear": _check_shear,
    "look_at": _check_look_at,
    "matrix": _check_matrix,
}
_CALLS: dict[str, Callable[[Any], str]] = {
    "translate": lambda v: "translate({!r}, {!r}, {!r})".format(*v),
    "rotate": lambda v: f"rotate({v['axis']!r}, {v['angle']!r})",
    "scale": lambda v: "scale({!r}, {!r}, {!r})".format(*v) if isinstance(v, tuple) else f"scale({v!r})",
    "shear": lambda v: "shear({})".format(", ".join(f"{key}={factor!r}" for key, factor in v.items())),
    "look_at": lambda v: f"look_at({v['origin']!r}, {v['target']!r}, {v['up']!r})",
    "matrix": lambda v: f"matrix({v!r})",
}


class _Fields(dict[str, Any]):
    """A word's named values; hashable, since words never change."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(tuple(sorted(self.items())))


def plain(value: Any) -> Any:
    """A word's value as scene files hold it: tuples as lists."""
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    return [plain(inner) for inner in value] if isinstance(value, tuple) else value


# --- words: matrices --------------------------------------------------------------------------------------------------

Rows = tuple[tuple[float, ...], ...]
_IDENTITY: Rows = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _product(words: Sequence[Word]) -> Rows:
    rows = _IDENTITY
    for name, value in words:
        rows = _multiply(_word_matrix(name, value), rows)
    _check_invertible(rows, words)
    return rows


def _check_invertible(rows: Rows, words: Sequence[Word]) -> None:
    linear = [row[:3] for row in rows[:3]]
    columns = [math.hypot(*column) for column in zip(*linear, strict=True)]
    determinant = sum(a * b for a, b in zip(linear[0], _cross(linear[1], linear[2]), strict=True))
    size = math.prod(columns)
    if not all(abs(number) <= _LARGEST for row in rows for number in row) or not math.isfinite(size):
        raise SceneError("the transform leaves the range of numbers", value=words[-1][0], expected="smaller factors")
    if not (abs(determinant) >= _LEAST_DETERMINANT and abs(determinant) >= _LEAST_RATIO * size):
        raise NotInvertible(
            f"the transform cannot be inverted: its determinant is {determinant:g}",
            value=[name for name, _ in words],
            expected=f"a determinant of at least {max(_LEAST_DETERMINANT, _LEAST_RATIO * size):g} in size",
        )


def _word_matrix(name: str, value: Any) -> Rows:
    if name == "translate":
        return (*((*row[:3], shift) for row, shift in zip(_IDENTITY, value, strict=False)), _IDENTITY[3])
    if name == "scale":
        factors = value if isinstance(value, tuple) else (value,) * 3
        return (*(tuple(f * c for c in row) for f, row in zip(factors, _IDENTITY[:3], strict=True)), _IDENTITY[3])
    if name == "rotate":
        return _rotation(_unit(value["axis"]), value["angle"])
    if name == "shear":
        rows = [list(row) for row in _IDENTITY]
        for key, factor in value.items():
            rows["xyz".index(key[0])]["xyz".index(key[1])] += factor
        return tuple(tuple(row) for row in rows)
    if name == "look_at":
        z = _unit(tuple(t - o for t, o in zip(value["target"], value["origin"], strict=True)))
        x = _unit(_cross(_unit(value["up"]), z))
        y = _cross(z, x)
        return (*((x[i], y[i], z[i], value["origin"][i]) for i in range(3)), _IDENTITY[3])
    return (*value, _IDENTITY[3])


def _rotation(axis: Sequence[float], degrees: float) -> Rows:
    turn = degrees % 360.0
    exact = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    c, s = exact.get(turn) or (math.cos(math.radians(turn)), math.sin(math.radians(turn)))
    x, y, z = axis
    k = 1.0 - c
    return (
        (c + x * x * k, x * y * k - z * s, x * z * k + y * s, 0.0),
        (y * x * k + z * s, c + y * y * k, y * z * k - x * s, 0.0),
        (z * x * k - y * s, z * y * k + x * s, c + z * z * k, 0.0),
        _IDENTITY[3],
    )


def _multiply(a: Rows, b: Rows) -> Rows:
    columns = tuple(zip(*b, strict=True))
    return tuple(tuple(sum(p * q for p, q in zip(row, column, strict=True)) for column in columns) for row in a)


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, ...]:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _unit(v: Sequence[float]) -> tuple[float, ...]:
    largest = max(abs(component) for component in v)
    scaled = [component / largest for component in v]
    length = math.hypot(*scaled)
    return tuple(component / length for component in scaled)
