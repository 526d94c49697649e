"""Grids of NanoVDB: the voxels of a tree of nodes, gathered with NumPy.

A root of tiles leads to upper nodes (32^3 children, 4096 voxels wide), these to lower ones (16^3, 128), these to leaves
of 8^3 voxels; where a child would be constant there is a tile (Museth 2021, "NanoVDB: A GPU-Friendly and Portable VDB
Data Structure For Real-Time Rendering And Simulation"). Offsets of the fields are those of PNanoVDB.h, version 32.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.errors import FormatError
from destello.nanovdb_file import GRID_HEADER

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[Any]

_TREE = 64
_LEAF_HEADER = 96  # of quantised leaves: their values follow
_BATCH = 1 << 25  # bytes of nodes that are copied at a time
_FOG = (0, 2)  # classes that are read: unknown, fog volume


@dataclass(frozen=True)
class _Layout:
    """How nodes of one type of value are laid out, in bytes."""

    name: str
    value: str  # of tiles, and of voxels where `bits` is 0
    channels: int = 1
    bits: int = 0  # a voxel's, if voxels are quantised; -1: each leaf says it
    root: int = 64
    root_tile_value: int = 20
    root_tile: int = 32
    tile: int = 8
    upper: int = 270400
    lower: int = 33856
    leaf_values: int = 96
    leaf: int = 2144


_LAYOUTS = {
    1: _Layout("float", "<f4"),
    2: _Layout("double", "<f8", root=96, root_tile_value=24, leaf_values=128, leaf=4224),
    6: _Layout("vec3f", "<f4", 3, root=96, tile=16, upper=532544, lower=66624, leaf_values=128, leaf=6272),
    9: _Layout("half", "<f2", leaf=1120),
    13: _Layout("fp4", "<f4", bits=4, leaf=352),
    14: _Layout("fp8", "<f4", bits=8, leaf=608),
    15: _Layout("fp16", "<f4", bits=16, leaf=1120),
    16: _Layout("fpn", "<f4", bits=-1, leaf=_LEAF_HEADER + 64),
}


@dataclass(frozen=True)
class _Level:
    """A level of nodes with children: where its parts are, log2 of its children along an axis, their size in voxels."""

    name: str
    size: int
    child_mask: int
    table: int
    log_children: int
    child: int


class NanoGrid:
    """A grid's voxels that are not in its background.

    Attributes: `matrix` (4, 4), from indices to the world; `low`, `high` (3,), the voxels' least and greatest indices;
    `channels`, 1 or 3.
    """

    def __init__(self, data: bytes | memoryview, name: str) -> None:
        """Finds all nodes. Raises FormatError if the grid is damaged, empty, or of another kind."""
        self._bytes = np.frombuffer(data, np.uint8)
        self._name = name
        group, kind = (int(value) for value in self._field(632, "<u4", 2))
        layout = _LAYOUTS.get(kind)
        if layout is None or group not in _FOG:
            found = f"type {kind}, class {group}"
            accepted = ", ".join(f"{known.name} ({key})" for key, known in _LAYOUTS.items())
            raise self._wrong("not a fog volume of numbers", found, f"class 0 or 2; types {accepted}")
        self._layout = layout
        self.channels = layout.channels
        self.matrix = np.eye(4)
        self.matrix[:3, :3] = self._field(296 + 88, "<f8", 9).reshape(3, 3)
        self.matrix[:3, 3] = self._field(296 + 232, "<f8", 3)
        self._tiles: list[tuple[Array, Array, int]] = []  # corners, values, width in voxels
        self._leaves, self._corners = self._walk()
        self.low, self.high = self._bounds()

    def fill(self, target: Array, low: Array) -> None:
        """Writes the values into zeros (z, y, x, channels), whose first voxel has the indices `low`."""
        for corners, values, width in self._tiles:
            for corner, value in zip(corners - low, values, strict=True):
                x, y, z = (slice(int(c), int(c) + width) for c in corner)
                target[z, y, x] = value
        local = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), 1)
        for part in self._batches(len(self._leaves), self._layout.leaf):
            active, values = self._leaf_values(self._leaves[part])
            x, y, z = (self._corners[part, None] - low + local)[active].T
            target[z, y, x] = values[active]

    # --- the file's fields --------------------------------------------------------------------------------------------

    def _wrong(self, problem: str, value: object, expected: str) -> FormatError:
        return FormatError(problem, place=f"grid {self._name}", value=value, expected=expected)

    def _field(self, at: int, kind: str, count: int) -> Array:
        size = np.dtype(kind).itemsize * count
        if not 0 <= at <= len(self._bytes) - size:
            raise self._wrong("data outside of the grid", f"byte {at}", f"0 to {len(self._bytes) - size}")
        return self._bytes[at : at + size].view(kind)

    def _rows(self, addresses: Array, size: int, what: str) -> Array:
        """The `size` bytes from each address on: (N, size)."""
        last = len(self._bytes) - size
        outside = addresses[(addresses < 0) | (addresses > last)]
        if len(outside):
            raise self._wrong(f"{what} outside of the grid", f"byte {outside[0]}", f"0 to {last}")
        return np.lib.stride_tricks.sliding_window_view(self._bytes, size)[addresses]

    @staticmethod
    def _batches(count: int, size: int) -> Iterator[slice]:
        step = max(_BATCH // size, 1)
        return (slice(first, first + step) for first in range(0, count, step))

    # --- the tree -----------------------------------------------------------------------------------------------------

    def _walk(self) -> tuple[Array, Array]:
        """Addresses (N,) and corners (N, 3) of all leaves; tiles are kept on the way."""
        layout = self._layout
        root = GRID_HEADER + int(self._field(GRID_HEADER + 24, "<u8", 1)[0])
        count = int(self._field(root + 24, "<u4", 1)[0])
        if count > len(self._bytes) // layout.root_tile:
            raise self._wrong(
                "more tiles at the root than fit", count, f"at most {len(self._bytes) // layout.root_tile}"
            )
        first = root + layout.root
        tiles = self._field(first, "<u1", count * layout.root_tile).reshape(count, layout.root_tile)
        keys = np.ascontiguousarray(tiles[:, :8]).view("<u8")[:, 0]
        child = np.ascontiguousarray(tiles[:, 8:16]).view("<i8")[:, 0]
        state = np.ascontiguousarray(tiles[:, 16:20]).view("<u4")[:, 0]
        parts = np.stack([keys >> 42, keys >> 21, keys], 1) & np.uint64((1 << 21) - 1)
        corners = (parts << np.uint64(12)).astype(np.uint32).view(np.int32).astype(np.int64)
        here = child != 0
        most = len(self._bytes) // layout.upper
        if here.sum() > most:
            raise self._wrong("more upper nodes than fit", int(here.sum()), f"at most {most}")
        self._keep_tiles(corners, self._values(tiles, layout.root_tile_value), ~here & (state != 0), 4096)
        nodes, corners = child[here] + root, corners[here]
        # Both tables begin at a multiple of 32 after the masks and four statistics; doubles and vectors fit as well.
        for level in (
            _Level("an upper node", layout.upper, 4128, 8256, 5, 128),
            _Level("a lower node", layout.lower, 544, 1088, 4, 8),
        ):
            below = layout.leaf if level.child == 8 else layout.lower
            nodes, corners = self._children(nodes, corners, level, len(self._bytes) // below)
        return nodes, corners

    def _children(self, nodes: Array, corners: Array, level: _Level, most: int) -> tuple[Array, Array]:
        """Children of all `nodes`: no more than `most`, as many as fit into the file."""
        n = 1 << 3 * level.log_children
        found: list[tuple[Array, Array]] = [(np.zeros(0, np.int64), np.zeros((0, 3), np.int64))]
        total = 0
        for part in self._batches(len(nodes), level.size):
            rows = self._rows(nodes[part], level.size, level.name)
            masks = (rows[:, at : at + n // 8] for at in (level.child_mask, 32))
            child, active = (np.unpackbits(mask, axis=1, bitorder="little").view(bool) for mask in masks)
            table = rows[:, level.table : level.table + n * self._layout.tile].reshape(len(rows), n, -1)
            i, j = np.nonzero(child)
            total += len(i)
            if total > most:
                raise self._wrong(f"more children of {level.name} than fit", total, f"at most {most}")
            places = np.stack(np.unravel_index(np.arange(n), (1 << level.log_children,) * 3), 1) * level.child
            offsets = np.ascontiguousarray(table[i, j, :8]).view("<i8")[:, 0]
            found.append((nodes[part][i] + offsets, corners[part][i] + places[j]))
            i, j = np.nonzero(active & ~child)
            values = self._values(table[i, j], 0)
            self._keep_tiles(corners[part][i] + places[j], values, np.ones(len(i), bool), level.child)
        return np.concatenate([a for a, _ in found]), np.concatenate([c for _, c in found])

    def _values(self, rows: Array, at: int) -> Array:
        """Tiles' values (N, channels)."""
        size = np.dtype(self._layout.value).itemsize * self.channels
        return np.ascontiguousarray(rows[:, at : at + size]).view(self._layout.value)

    def _keep_tiles(self, corners: Array, values: Array, active: Array, width: int) -> None:
        active = active & (values != 0).any(1)
        if active.any():
            self._tiles.append((corners[active], self._checked(values[active]), width))

    # --- voxels -------------------------------------------------------------------------------------------------------

    def _bounds(self) -> tuple[Array, Array]:
        lows = [corners.min(0) for corners, _, _ in self._tiles]
        highs = [corners.max(0) + width - 1 for corners, _, width in self._tiles]
        for part in self._batches(len(self._leaves), 512):
            active: Array = self._masks(self._rows(self._leaves[part], self._layout.leaf, "a leaf")).reshape(
                -1, 8, 8, 8
            )
            some: Array = np.asarray(active.any((1, 2, 3)))
            if not some.any():
                continue
            for axis, others in enumerate(((2, 3), (1, 3), (1, 2))):
                held: Array = np.asarray(active[some].any(others))
                at = self._corners[part][some]
                low, high = at.copy(), at.copy()
                low[:, axis] += held.argmax(1)
                high[:, axis] += 7 - held[:, ::-1].argmax(1)
                lows.append(np.where(np.arange(3) == axis, low.min(0), np.iinfo(np.int64).max))
                highs.append(np.where(np.arange(3) == axis, high.max(0), np.iinfo(np.int64).min))
        if not lows:
            raise self._wrong("no active voxels", 0, "a fog volume")
        return np.min(lows, 0), np.max(highs, 0)

    @staticmethod
    def _masks(rows: Array) -> Array:
        return np.unpackbits(rows[:, 16:80], axis=1, bitorder="little").view(bool)

    def _leaf_values(self, leaves: Array) -> tuple[Array, Array]:
        """Which voxels are active (N, 512), and all values (N, 512, channels)."""
        layout = self._layout
        rows = self._rows(leaves, layout.leaf, "a leaf")
        active = self._masks(rows)
        if layout.bits == 0:
            size = np.dtype(layout.value).itemsize * layout.channels * 512
            raw = np.ascontiguousarray(rows[:, layout.leaf_values : layout.leaf_values + size])
            values = raw.view(layout.value).reshape(-1, 512, layout.channels)
        else:
            values = np.empty((len(rows), 512, 1), np.float32)
            logs = rows[:, 15] >> 5 if layout.bits < 0 else np.full(len(rows), layout.bits.bit_length() - 1)
            for log in np.unique(logs):
                if log > 4:
                    raise self._wrong("a leaf's number of bits", 1 << int(log), "1, 2, 4, 8 or 16")
                values[logs == log, :, 0] = self._quantised(leaves[logs == log], 1 << int(log))
        return active, self._checked(values, active)

    def _quantised(self, leaves: Array, bits: int) -> Array:
        """Values of leaves that hold a minimum, a step, and `bits` a voxel, the first voxel in the lowest bits."""
        rows = self._rows(leaves, _LEAF_HEADER + 64 * bits, "a leaf")
        low, step = (np.ascontiguousarray(rows[:, at : at + 4]).view("<f4") for at in (80, 84))
        raw = np.ascontiguousarray(rows[:, _LEAF_HEADER:])
        if bits < 8:
            digits = np.unpackbits(raw, axis=1, bitorder="little").reshape(len(rows), 512, bits)
            codes = digits @ (1 << np.arange(bits))
        else:
            codes = raw.view(f"<u{bits // 8}")
        with np.errstate(all="ignore"):  # what is not finite is looked for later
            return np.asarray(codes.astype(np.float32) * step + low)

    def _checked(self, values: Array, active: Array | None = None) -> Array:
        """Values as floats, none below 0; those that are not active may be anything."""
        with np.errstate(over="ignore"):
            made = values.astype(np.float32)
        if not np.isfinite(made if active is None else made[active]).all():
            raise self._wrong("values that are not finite", "inf or nan", "finite numbers")
        return np.maximum(made, np.float32(0))
