"""A scene's fingerprint: a hash of everything that the core is told about it, arrays and images included."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np


class HashingBuilder:
    """Stands before a `_core.SceneBuilder`, passes every call on and hashes it.

    Two scenes with the same fingerprint are the same to the core, whatever files they came from; a film can go on with
    either. How the trees are built is not in it: whatever its tree, a ray finds the nearest surface, so pictures differ
    at most where two surfaces lie at exactly the same distance, and there either is right.
    """

    def __init__(self, builder: Any) -> None:
        self._builder = builder
        self._hash = hashlib.blake2b(digest_size=16)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        method = getattr(self._builder, name)

        def call(*args: Any, **kwargs: Any) -> Any:
            self._add([name, args, kwargs])
            return method(*args, **kwargs)

        return call

    def build(self, **options: Any) -> Any:
        """`build` of the core; its options are not hashed."""
        return self._builder.build(**options)

    def fingerprint(self) -> str:
        """32 hexadecimal digits, of all calls so far."""
        return self._hash.hexdigest()

    def _add(self, value: Any) -> None:
        """Hashes a value with its type and length, so that no two differ only in how they are divided."""
        if isinstance(value, np.ndarray):
            self._word(f"array {value.dtype.str} {value.shape}")
            self._hash.update(np.ascontiguousarray(value).data if value.size else b"")
        elif isinstance(value, Mapping):
            self._word(f"map {len(value)}")
            for key in sorted(value, key=str):
                self._word(str(key))
                self._add(value[key])
        elif isinstance(value, (list, tuple)):
            self._word(f"list {len(value)}")
            for item in value:
                self._add(item)
        elif isinstance(value, (float, np.floating)):
            self._word("float")
            self._hash.update(struct.pack("<d", float(value)))
        elif value is None or isinstance(value, (bool, int, str, np.integer)):
            self._word(f"{type(value).__name__} {value}")
        else:
            raise TypeError(f"a {type(value).__name__} cannot be hashed")

    def _word(self, text: str) -> None:
        data = text.encode()
        self._hash.update(struct.pack("<I", len(data)))
        self._hash.update(data)
