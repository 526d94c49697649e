"""Keyframes: transforms that change with time, as readable words.

An animation is a list of the words of `destello.transform`, applied first to last, after the object's own transform.
The words translate, rotate and scale may have keyframes in place of a value: ``{times, values, interpolation}``. Times
are seconds; before the first keyframe and after the last one, their values hold. Two keyframes at one time are a jump.

A rotation is {axis, angle} or a quaternion [x, y, z, w]. Between rotations about the same axis the angle moves, by any
number of turns; between others the shorter way on the sphere is taken (slerp). `cubic` is glTF's CUBICSPLINE: a Hermite
spline through the values with a tangent (change a second) into and out of each; its rotations are quaternions.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from destello.errors import SceneError, did_you_mean
from destello.transform import Rows, Transform, Word, check_value, check_word, numbers, plain, words_of

KEYED = ("translate", "rotate", "scale")
INTERPOLATIONS = ("linear", "step", "cubic")
_FIELDS = ("times", "values", "interpolation", "in_tangents", "out_tangents")
_SLACK = 1e-6  # relative: a step's time may be a float32 that is rounded up

Quaternion = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Keys:
    """The keyframes of one word.

    Attributes:
        word: `translate`, `rotate` or `scale`.
        times: in seconds, none less than the one before; at least one.
        values: what the word takes, one a time; rotations may be quaternions (x, y, z, w).
        interpolation: `linear`, `step` (a value holds until the next keyframe) or `cubic`.
        in_tangents, out_tangents: for `cubic`, change a second on the way into and out of each keyframe; else empty.

    Raises SceneError for anything else.
    """

    word: str
    times: tuple[float, ...]
    values: tuple[Any, ...]
    interpolation: str = "linear"
    in_tangents: tuple[Any, ...] = ()
    out_tangents: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        if self.interpolation not in INTERPOLATIONS:
            expected = did_you_mean(self.interpolation, INTERPOLATIONS)
            raise SceneError("unknown choice", place="interpolation", value=self.interpolation, expected=expected)
        times = tuple(_listed("times", self.times, lambda time: numbers((time,), 1)[0]))
        object.__setattr__(self, "times", times)
        if not times:
            raise SceneError("no keyframes", place="times", value=times, expected="at least one time in seconds")
        for i in range(1, len(times)):
            if times[i] < times[i - 1]:
                expected = f"at least {times[i - 1]:g}, the time before"
                raise SceneError("times run backwards", place=f"times[{i}]", value=times[i], expected=expected)
        check = self._check_value
        tangent = _quaternion if self.word == "rotate" else check
        self._set("values", check, len(times))
        cubic = self.interpolation == "cubic"
        for name in ("in_tangents", "out_tangents"):
            self._set(name, tangent, len(times) if cubic else 0)

    def _set(self, name: str, check: Callable[[Any], Any], count: int) -> None:
        checked = tuple(_listed(name, getattr(self, name), check))
        if len(checked) != count:
            expected = f"{count}, one a time" if count else "none: only cubic keyframes have tangents"
            raise SceneError("wrong number of values", place=name, value=len(checked), expected=expected)
        object.__setattr__(self, name, checked)

    def _check_value(self, value: Any) -> Any:
        if self.word == "rotate" and (self.interpolation == "cubic" or not isinstance(value, Mapping)):
            try:
                checked = _quaternion(value)
            except SceneError:
                cubic = "" if self.interpolation == "cubic" else "{axis, angle}, or "
                expected = f"{cubic}a quaternion [x, y, z, w]"
                raise SceneError("not a rotation", value=value, expected=expected) from None
            if not math.hypot(*checked) > 1e-12:
                raise SceneError("a rotation without direction", value=checked, expected="a unit quaternion")
            return checked
        return check_value(self.word, value)

    def at(self, time: float) -> Word:
        """The word at a time in seconds; a rotation between two axes is a matrix."""
        step = self.interpolation == "step"
        i = bisect_right(self.times, time + _SLACK * max(1.0, abs(time)) if step else time) - 1
        if step or i < 0 or i + 1 == len(self.times):
            value = self.values[max(i, 0)]
        elif self.interpolation == "cubic":
            value = self._spline(i, time)
        else:
            u = (time - self.times[i]) / (self.times[i + 1] - self.times[i])
            value = _between(self.word, self.values[i], self.values[i + 1], u)
        if self.word == "rotate" and not isinstance(value, Mapping):
            return "matrix", rotation_rows(value)
        return self.word, value

    def _spline(self, i: int, time: float) -> tuple[float, ...]:
        """The Hermite spline of glTF 2.0, appendix C.4."""
        span = self.times[i + 1] - self.times[i]
        u = (time - self.times[i]) / span
        u2, u3 = u * u, u * u * u
        weights = (2 * u3 - 3 * u2 + 1, span * (u3 - 2 * u2 + u), -2 * u3 + 3 * u2, span * (u3 - u2))
        points = (self.values[i], self.out_tangents[i], self.values[i + 1], self.in_tangents[i + 1])
        return tuple(
            sum(w * c for w, c in zip(weights, parts, strict=True))
            for parts in zip(*(_spread(point) for point in points), strict=True)
        )

    def to_plain(self) -> dict[str, Any]:
        """As scene files hold it."""
        values = {name: plain(getattr(self, name)) for name in _FIELDS}
        return {name: value for name, value in values.items() if value not in ([], "linear")}


class Animation:
    """A transform that changes with time: words, applied first to last, some with `Keys`. Immutable; compared by word.

    `a @ b` applies b first; either may be a Transform. See `keyframes`.
    """

    __slots__ = ("words",)

    words: tuple[Word, ...]

    def __init__(self, words: Iterable[Word]) -> None:
        """`words`: pairs (name, value or Keys), at least one with Keys. Raises SceneError."""
        checked = tuple(_check(name, value) for name, value in words)
        if not any(isinstance(value, Keys) for _, value in checked):
            expected = f"{', '.join(KEYED)} with {{times, values}}"
            raise SceneError("no keyframes", value=[name for name, _ in checked], expected=expected)
        object.__setattr__(self, "words", checked)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"animations do not change; make a new one instead of setting {name!r}")

    @property
    def keys(self) -> tuple[Keys, ...]:
        """Those of all words."""
        return tuple(value for _, value in self.words if isinstance(value, Keys))

    @property
    def seconds(self) -> float:
        """The time of the last keyframe."""
        return max(keys.times[-1] for keys in self.keys)

    def words_at(self, time: float, *, opened: float | None = None) -> tuple[Word, ...]:
        """Transform words at a time in seconds; what steps keeps the value that it has at the time `opened`."""
        held = time if opened is None else opened
        return tuple(
            value.at(held if value.interpolation == "step" else time) if isinstance(value, Keys) else (name, value)
            for name, value in self.words
        )

    def at(self, time: float) -> Transform:
        """The transform at a time in seconds. Raises `destello.transform.NotInvertible`, as for a scale of 0."""
        return Transform(self.words_at(time))

    def to_list(self) -> list[dict[str, Any]]:
        """The words as plain data: what scene files hold."""
        return [{name: value.to_plain() if isinstance(value, Keys) else plain(value)} for name, value in self.words]

    @staticmethod
    def of(value: Any) -> Animation:
        """An animation from an Animation, one word or a list of words."""
        if isinstance(value, Animation):
            return value
        if isinstance(value, Mapping):
            return Animation(words_of(value, None, _check))
        if isinstance(value, Sequence) and not isinstance(value, str) and all(isinstance(w, Mapping) for w in value):
            return Animation(word for i, w in enumerate(value) for word in words_of(w, i, _check))
        expected = f"a list of words, of which {', '.join(KEYED)} may have keyframes"
        raise SceneError("not an animation", value=value, expected=expected)

    def __matmul__(self, other: Animation | Transform) -> Animation:
        if not isinstance(other, (Animation, Transform)):
            return NotImplemented
        return Animation(other.words + self.words)

    def __rmatmul__(self, other: Transform) -> Animation:
        if not isinstance(other, Transform):
            return NotImplemented
        return Animation(self.words + other.words)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Animation) and self.words == other.words

    def __hash__(self) -> int:
        return hash(self.words)

    def __repr__(self) -> str:
        return f"Animation({list(self.words)!r})"

    def __reduce__(self) -> tuple[Callable[[Iterable[Word]], Animation], tuple[tuple[Word, ...]]]:
        return (Animation, (self.words,))


def keyframes(word: str, keys: Mapping[float, Any], interpolation: str = "linear") -> Animation:
    """An animation of one word: ``keyframes("translate", {0: (0, 0, 0), 2.5: (1, 0, 0)})``.

    Args:
        word: `translate`, `rotate` or `scale`.
        keys: the word's values by time in seconds; a rotation is ``{"axis": "y", "angle": 90}`` or a quaternion.
        interpolation: `linear` or `step`.

    Raises:
        SceneError: for anything else. `a @ b` applies b first.
    """
    times = sorted(keys)
    values = {"times": times, "values": [keys[time] for time in times], "interpolation": interpolation}
    return Animation.of({word: values})


def _check(name: str, value: Any) -> Word:
    """A word whose value may be keyframes."""
    if isinstance(value, Keys):
        if value.word != name:
            raise SceneError("keyframes of another word", place=name, value=value.word, expected=name)
        return name, value
    if not (isinstance(value, Mapping) and "times" in value):
        return check_word(name, value)
    if name not in KEYED:
        raise SceneError("cannot have keyframes", value=name, expected=", ".join(KEYED))
    try:
        for key in value:
            if key not in _FIELDS:
                raise SceneError("unknown name", value=key, expected=did_you_mean(key, _FIELDS))
        if "values" not in value:
            raise SceneError("values is missing", expected="times and values")
        return name, Keys(name, **{key: inner for key, inner in value.items() if inner is not None})
    except SceneError as error:
        raise error.within(name) from None


def _listed(name: str, values: Any, check: Callable[[Any], Any]) -> Iterator[Any]:
    if isinstance(values, (str, Mapping)) or not hasattr(values, "__len__"):
        raise SceneError("not a list", place=name, value=values, expected="a list, one a keyframe")
    for i, value in enumerate(values):
        try:
            yield check(value)
        except SceneError as error:
            raise error.within(f"{name}[{i}]") from None


# --- values between keyframes -----------------------------------------------------------------------------------------


def _between(word: str, a: Any, b: Any, u: float) -> Any:
    """The value a part `u`, 0 to 1, of the way from `a` to `b`."""
    if word != "rotate":
        return tuple(p * (1.0 - u) + q * u for p, q in zip(_spread(a), _spread(b), strict=True))
    if isinstance(a, Mapping) and isinstance(b, Mapping) and a["axis"] == b["axis"]:
        return {"axis": a["axis"], "angle": a["angle"] * (1.0 - u) + b["angle"] * u}
    return slerp(_as_quaternion(a), _as_quaternion(b), u)


def _spread(value: Any) -> tuple[float, ...]:
    """A number as three."""
    return value if isinstance(value, tuple) else (value,) * 3


def _quaternion(value: Any) -> Quaternion:
    return numbers(value, 4)


def _as_quaternion(value: Any) -> Quaternion:
    if not isinstance(value, Mapping):
        length = math.hypot(*value)
        return tuple(c / length for c in value)
    half = math.radians(value["angle"]) / 2
    length = math.hypot(*value["axis"])
    return (*(math.sin(half) * c / length for c in value["axis"]), math.cos(half))


def slerp(a: Quaternion, b: Quaternion, u: float) -> Quaternion:
    """Between unit quaternions (x, y, z, w) at constant speed, the shorter way (Shoemake 1985); `u` from 0 to 1."""
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    if cosine < 0:
        b, cosine = tuple(-c for c in b), -cosine
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-6:  # so near that the chord is the arc
        return tuple(p * (1.0 - u) + q * u for p, q in zip(a, b, strict=True))
    first, last = math.sin((1.0 - u) * angle), math.sin(u * angle)
    return tuple((first * p + last * q) / math.sin(angle) for p, q in zip(a, b, strict=True))


def rotation_rows(quaternion: Sequence[float]) -> Rows:
    """The upper three rows, (3, 4), of the rotation by a quaternion (x, y, z, w) of any length but 0."""
    length = math.hypot(*quaternion)
    if not length > 1e-12:
        raise SceneError("a rotation without direction", value=tuple(quaternion), expected="a unit quaternion")
    x, y, z, w = (float(c) / length for c in quaternion)
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 0.0),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 0.0),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), 0.0),
    )
