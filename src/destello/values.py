"""Checks a parameter's value against its declaration and puts it into the one form in which nodes keep it.

Numbers become floats, colours and vectors tuples of three floats, arrays read-only NumPy arrays of the declared type.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

from destello.animation import Animation
from destello.errors import SceneError, did_you_mean
from destello.schema import ParamDoc, is_color
from destello.transform import Transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_VOXELS = 65536  # along an axis
LARGEST = 3.4028234e38  # float32, which the core computes in


def check(doc: ParamDoc, value: Any) -> Any:
    """`value` in its kept form. Raises SceneError whose place is the parameter's name."""
    from destello.nodes import Node

    try:
        if isinstance(value, Node):
            return _node(doc, value)
        return _CHECKS[doc.kind](doc, value)
    except SceneError as error:
        raise error.within(doc.name) from None


def wrong(doc: ParamDoc, value: Any, problem: str = "wrong kind of value") -> SceneError:
    """The error for a value that `doc` does not accept."""
    return SceneError(problem, value=value, expected=doc.accepted)


def _node(doc: ParamDoc, value: Any) -> Any:
    if value.kind == doc.kind:
        return value
    if value.kind == "texture":
        if doc.kind == "image" and value.type == "image":
            return value
        if doc.texturable:
            return value
        if doc.kind in ("scalar", "color", "vector", "bool", "enum"):
            raise wrong(doc, value, "no texture may stand here")
    raise wrong(doc, value, f"a {value.kind} where {doc.kind} is wanted")


def _number(doc: ParamDoc, value: Any) -> float:
    kind = getattr(getattr(value, "dtype", None), "kind", "f")
    if isinstance(value, (bool, str)) or not hasattr(value, "__float__") or kind not in "iuf" or _rank(value) != 0:
        raise wrong(doc, value)
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong(doc, value, "not a finite number") from None
    if not abs(number) <= LARGEST:
        raise wrong(doc, value, "not a finite number")
    low = doc.min is not None and number < doc.min
    high = doc.max is not None and number > doc.max
    if low or high:
        raise wrong(doc, value, "out of range")
    return number


def _rank(value: Any) -> int:
    return int(getattr(value, "ndim", 0))


def _scalar(doc: ParamDoc, value: Any) -> float:
    return _number(doc, value)


def _integer(doc: ParamDoc, value: Any) -> int:
    number = _number(doc, value)
    if number != math.floor(number):
        raise wrong(doc, value, "not a whole number")
    return int(value)


def _tuple(doc: ParamDoc, value: Any, count: int) -> tuple[float, ...]:
    if isinstance(value, (str, bytes, Mapping)) or not (hasattr(value, "__len__") and hasattr(value, "__getitem__")):
        raise wrong(doc, value)
    if len(value) != count:
        raise wrong(doc, value, f"{len(value)} values where {count} are wanted")
    return tuple(_number(doc, component) for component in value)


def _color(doc: ParamDoc, value: Any) -> tuple[float, ...]:
    if is_color(doc) and means_black_body(value):
        value = _black_body(value)
    if hasattr(value, "__float__") and not hasattr(value, "__len__"):
        return (_number(doc, value),) * 3
    return _tuple(doc, value, 3)


def means_black_body(value: Any) -> bool:
    """Whether a value in place of a colour is a black body's mapping, or one with a slip in it."""
    words = ("blackbody", "luminance", "temperature", "kelvin")
    return (
        isinstance(value, Mapping)
        and "type" not in value
        and any(get_close_matches(str(key).lower(), words, n=1, cutoff=0.7) for key in value)
    )


def _black_body(value: Mapping[str, Any]) -> tuple[float, ...]:
    """The colour that `destello.blackbody` gives for a mapping of its arguments."""
    from destello.nodes import check_params
    from destello.python_types import BLACK_BODY
    from destello.spectrum import blackbody

    given = check_params(BLACK_BODY, value)
    return blackbody(given["blackbody"], given.get("luminance", 1.0))


def _vector(doc: ParamDoc, value: Any) -> tuple[float, ...]:
    return _tuple(doc, value, 3)


def _fixed_numbers(doc: ParamDoc, value: Any) -> tuple[float, ...]:
    return _tuple(doc, value, doc.columns[0])


def _bool(doc: ParamDoc, value: Any) -> bool:
    if isinstance(value, bool) or type(value).__name__ in ("bool", "bool_"):
        return bool(value)
    raise wrong(doc, value)


def _enum(doc: ParamDoc, value: Any) -> str:
    if isinstance(value, str) and value in doc.choices:
        return value
    raise SceneError("unknown choice", value=value, expected=did_you_mean(value, doc.choices))


def _text(doc: ParamDoc, value: Any) -> str:
    if not isinstance(value, str) or not value or "\0" in value:
        raise wrong(doc, value)
    return _enum(doc, value) if doc.choices else value


def _path(doc: ParamDoc, value: Any) -> str:
    if isinstance(value, PathLike):
        value = fspath(value)
    return _text(doc, value)


def _transform(_: ParamDoc, value: Any) -> Transform:
    return Transform.of(value)


def _animation(_: ParamDoc, value: Any) -> Animation:
    return Animation.of(value)


def _group(doc: ParamDoc, value: Any) -> str:
    return _text(doc, getattr(value, "name", value))


def _array(doc: ParamDoc, value: Any) -> NDArray[Any]:
    import numpy as np

    array = _to_array(doc, value)
    if array.size == 0 and array.ndim <= 2:
        array = array.reshape((0,) if doc.columns == (0,) else (0, doc.columns[0]))
    fits = array.ndim == 1 if doc.columns == (0,) else array.ndim == 2 and array.shape[1] in doc.columns
    if not fits:
        raise wrong(doc, value, f"wrong shape {tuple(array.shape)}")
    integers = array.dtype.kind in "iu"
    if doc.dtype == "uint32":
        if array.size and (not integers or array.min() < 0 or array.max() > 2**32 - 1):
            raise wrong(doc, value, "values that are not whole numbers from 0 to 4294967295")
    elif array.dtype.kind not in "iuf":
        raise wrong(doc, value, f"wrong kind of values ({array.dtype})")
    with np.errstate(over="ignore"):
        return _keep(np.ascontiguousarray(array, dtype=doc.dtype))


def _texels(doc: ParamDoc, value: Any) -> NDArray[Any]:
    import numpy as np

    array = _to_array(doc, value)
    if array.ndim == 2:
        array = array[:, :, np.newaxis]
    if array.ndim != 3 or not 1 <= array.shape[2] <= 4 or array.shape[0] < 1 or array.shape[1] < 1:
        raise wrong(doc, value, f"wrong shape {tuple(array.shape)}")
    if array.dtype.kind == "f":
        if array.dtype != np.dtype(np.float16):
            with np.errstate(over="ignore"):
                array = array.astype(np.float32, copy=False)
    elif array.dtype not in (np.dtype(np.uint8), np.dtype(np.uint16)):
        raise wrong(doc, value, f"wrong kind of texels ({array.dtype})")
    return _keep(np.ascontiguousarray(array))


def _voxels(doc: ParamDoc, value: Any) -> NDArray[Any]:
    import numpy as np

    array = _to_array(doc, value)
    if array.ndim == 3:
        array = array[..., np.newaxis]
    if array.ndim != 4 or array.shape[3] not in doc.columns or not all(1 <= n <= MOST_VOXELS for n in array.shape[:3]):
        raise wrong(doc, value, f"wrong shape {tuple(array.shape)}")
    if array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            array = array.astype(np.float16 if array.dtype == np.float16 else np.float32, copy=False)
        if not (np.isfinite(array).all() and array.min() >= 0):
            raise wrong(doc, value, "voxels that are negative or not finite")
    elif array.dtype != np.uint8:
        raise wrong(doc, value, f"wrong kind of voxels ({array.dtype})")
    return _keep(np.ascontiguousarray(array))


def _to_array(doc: ParamDoc, value: Any) -> NDArray[Any]:
    import numpy as np

    if isinstance(value, (str, bytes, Mapping, set)) or not (hasattr(value, "__len__") or hasattr(value, "__array__")):
        raise wrong(doc, value)
    try:
        return np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong(doc, value, "not an array of numbers") from None


def _keep(array: NDArray[Any]) -> NDArray[Any]:
    if not array.flags.writeable:
        return array  # another node's: what is shared stays shared
    kept = array.view()
    kept.flags.writeable = False
    return kept


def _only_nodes(doc: ParamDoc, value: Any) -> Any:
    raise wrong(doc, value)


def _image(doc: ParamDoc, value: Any) -> Any:
    from destello.nodes import Node

    if isinstance(value, (str, PathLike)):
        return Node("texture", "image", {"path": value})
    if hasattr(value, "shape"):
        return Node("texture", "image", {"pixels": value})
    raise wrong(doc, value)


_CHECKS: dict[str, Callable[[ParamDoc, Any], Any]] = {
    "scalar": _scalar,
    "integer": _integer,
    "color": _color,
    "vector": _vector,
    "numbers": _fixed_numbers,
    "bool": _bool,
    "enum": _enum,
    "text": _text,
    "path": _path,
    "array": _array,
    "texels": _texels,
    "voxels": _voxels,
    "transform": _transform,
    "animation": _animation,
    "group": _group,
    "texture": _only_nodes,
    "image": _image,
    "material": _only_nodes,
    "volume": _only_nodes,
    "filter": _only_nodes,
}
