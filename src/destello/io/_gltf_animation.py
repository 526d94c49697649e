"""glTF's animations: the first one's channels as keyframes of the nodes they move."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from destello.animation import Keys, rotation_rows
from destello.errors import SceneError
from destello.io._arrays import check_finite
from destello.io._gltf_accessors import Buffers
from destello.io._gltf_json import Document, Item
from destello.transform import Word

_INTERPOLATIONS = {"LINEAR": "linear", "STEP": "step", "CUBICSPLINE": "cubic"}
_STILL = {"scale": (1.0, 1.0, 1.0), "rotation": (0.0, 0.0, 0.0, 1.0), "translation": (0.0, 0.0, 0.0)}
_WORDS = {"translation": ("translate", "VEC3"), "rotation": ("rotate", "VEC4"), "scale": ("scale", "VEC3")}


class Motions:
    """What the first animation does to nodes.

    Attributes:
        note: which animation was read and how many there are, and what of it cannot be played; empty without any.
    """

    def __init__(self, document: Document, buffers: Buffers) -> None:
        self.note = ""
        self._document = document
        self._buffers = buffers
        self._channels: dict[int, dict[str, Keys]] = {}  # by node, then by path
        self._made: dict[tuple[int, str], Keys] = {}
        animations = document.table("animations")
        if animations:
            self._read(animations[0], len(animations))

    def __contains__(self, node: Item) -> bool:
        return node.index in self._channels

    def __bool__(self) -> bool:
        return bool(self._channels)

    def words(self, node: Item) -> list[Word]:
        """An animated node's own transform: scale, then rotation, then translation, those that move with keyframes."""
        if "matrix" in node:
            expected = "translation, rotation and scale in an animated node"
            raise node.error("a matrix cannot be animated", "matrix", expected=expected)
        words: list[Word] = []
        for path, still in _STILL.items():
            keys = self._channels[node.index].get(path)
            value = node.numbers(path, len(still), still)
            if keys is not None:
                words.append((keys.word, keys))
            elif value != still:
                turns = path == "rotation"
                words.append(("matrix", quaternion_rows(node, value)) if turns else (_WORDS[path][0], value))
        return words

    # --- reading ------------------------------------------------------------------------------------------------------

    def _read(self, animation: Item, count: int) -> None:
        samplers = animation.items("samplers")
        left_out: set[str] = set()
        for channel in animation.items("channels"):
            target = channel.item("target")
            if target is None:
                raise channel.error("missing", "target", expected="a JSON object")
            path = target.text("path")
            node = self._document.refer(target, "node", "nodes")
            if path not in _WORDS:
                left_out.add("morph weights" if path == "weights" else path)
            elif node is not None:
                self._add(channel, samplers, node, path)
        name = animation.text("name", "")
        which = f"animation 1 of {count}" + (f" ({name})" if name else "")
        ends = [keys.times[-1] for channels in self._channels.values() for keys in channels.values()]
        self.note = f"{which}: " + (f"{max(ends):.4g} s long" if ends else "nothing in it can be played")
        if left_out:
            self.note += f"; not animated: {', '.join(sorted(left_out))}"

    def _add(self, channel: Item, samplers: list[Item], node: Item, path: str) -> None:
        index = channel.integer("sampler")
        if index >= len(samplers):
            expected = f"0 to {len(samplers) - 1}" if samplers else "none: the animation has no samplers"
            raise channel.error("index out of range", "sampler", value=index, expected=expected)
        channels = self._channels.setdefault(node.index, {})
        if path in channels:
            raise channel.error(f"the {path} of node {node.index} is animated twice", expected="one channel for it")
        if (index, path) not in self._made:
            self._made[index, path] = self._keys(samplers[index], path)
        channels[path] = self._made[index, path]

    def _keys(self, sampler: Item, path: str) -> Keys:
        """A sampler's keyframes for a path. Float32 values become the shortest numbers that mean the same."""
        word, kind = _WORDS[path]
        interpolation = _INTERPOLATIONS[sampler.choice("interpolation", tuple(_INTERPOLATIONS), "LINEAR")]
        times = self._numbers(sampler, "input", "SCALAR")[:, 0]
        values = self._numbers(sampler, "output", kind)
        per_time = 3 if interpolation == "cubic" else 1
        if len(values) != per_time * len(times):
            expected = f"{per_time * len(times)}: {per_time} for each of {len(times)} times"
            raise sampler.error("wrong number of values", "output", value=len(values), expected=expected)
        parts = [[tuple(row) for row in values[i::per_time].tolist()] for i in range(per_time)]
        tangents = {"in_tangents": parts[0], "out_tangents": parts[2]} if per_time == 3 else {}
        made: dict[str, Any] = {"values": parts[per_time // 2], **tangents}
        try:
            return Keys(word, tuple(times.tolist()), interpolation=interpolation, **made)
        except SceneError as error:
            raise error.within(sampler.place, file=sampler.file) from None

    def _numbers(self, sampler: Item, key: str, kind: str) -> NDArray[np.float64]:
        accessor = self._document.refer(sampler, key, "accessors", required=True)
        assert accessor is not None
        values = self._buffers.floats(accessor, (kind,))
        check_finite(values, "keyframe", file=sampler.file, place=sampler.at(key))
        return values.astype(str).astype(np.float64)


def quaternion_rows(node: Item, turn: Any) -> tuple[tuple[float, ...], ...]:
    """The upper three rows, (3, 4), of a node's rotation by a quaternion (x, y, z, w)."""
    try:
        return rotation_rows(turn)
    except SceneError as error:
        raise node.error(error.problem, "rotation", value=list(turn), expected=error.expected) from None
