"""Damaged files: only `destello.Error` may come out, in bounded time and memory (see tests/fuzz_readers.py)."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest

import fuzz_readers


@pytest.mark.fuzz
@pytest.mark.parametrize("kind", fuzz_readers.CASES)
def test_damaged_files(kind: str) -> None:
    program = Path(fuzz_readers.__file__)
    done = subprocess.run(
        [sys.executable, str(program), kind, "0", "400"], capture_output=True, text=True, check=False, timeout=280
    )
    assert done.returncode == 0, f"{done.returncode}: {done.stdout[-3000:]}{done.stderr[-3000:]}"


@pytest.mark.fuzz
@pytest.mark.parametrize("kind", fuzz_readers.CASES)
def test_some_damaged_files_are_still_read(kind: str, tmp_path: Path) -> None:
    """Else the fuzzing would end at the front door."""
    import numpy as np

    from destello.errors import Error
    from destello.io import load

    read = 0
    for seed in range(60):
        name, data, files = fuzz_readers.CASES[kind](np.random.default_rng((seed, len(kind))), tmp_path)
        for beside, content in {name: data, **files}.items():
            (tmp_path / beside).write_bytes(content)
        with contextlib.suppress(Error):
            read += bool(load(tmp_path / name).shapes)
    assert 5 < read < 55
