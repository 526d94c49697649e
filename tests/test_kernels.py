"""The CPU kernels are compiled twice, for any x86-64 processor and for those with AVX2: same results, kept apart."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from destello import _core

WEAK = ("W", "V", "u", "w", "v")  # nm's letters for weak and unique symbols


def kernel_objects(root: Path) -> list[Path]:
    """The AVX2 kernel of every optimised build there is: sanitized ones are not for use, and inline little."""
    found = root.glob("build/*/CMakeFiles/destello_kernel_avx2.dir/core/backend/*.o")
    return sorted(p for p in found if not p.relative_to(root).parts[1].startswith("sanitize"))


def symbols(path: Path) -> list[tuple[str, str]]:
    """(letter, demangled name) of each symbol that the object defines."""
    out = subprocess.run(["nm", "-C", "--defined-only", path], capture_output=True, text=True, check=True).stdout
    return [match.groups() for match in re.finditer(r"^[0-9a-f]* ([A-Za-z]) (.*)$", out, re.MULTILINE)]


def test_no_code_for_avx2_can_stand_in_for_the_baseline(root):
    """The linker keeps one copy of each inline function: what the AVX2 kernel offers must have names of its own."""
    objects = kernel_objects(root)
    if not objects:
        pytest.skip("no build folder with the AVX2 kernel in this checkout")
    if shutil.which("nm") is None:
        pytest.skip("there is no nm")
    for path in objects:
        defined = symbols(path)
        entry_points = {name for letter, name in defined if letter == "T" and "::" not in name}
        assert entry_points == {"dst_render_tile_avx2", "dst_trace_rays_avx2"}
        strays = [name for letter, name in defined if letter in WEAK and "destello_avx2" not in name]
        assert strays == [], path
        outside = [name for letter, name in defined if letter == "T" and "::" in name and "destello_avx2" not in name]
        assert outside == [], path


SCRIPT = """
import sys
import numpy as np
import destello as dl
from destello import _core

images = {"isa": np.array(_core.testing.cpu_isa())}
for name in ("book1", "book2", "cornell", "cornell-smoke", "book3"):
    image = dl.render(name, size=(32, 24), spp=4, device="cpu", aov=("albedo", "normal", "depth"), progress=False)
    images.update({f"{name} {k}": v for k, v in image.film.core.state().items()})
np.savez(sys.argv[1], **images)
"""


def render_with(kernel: str, path: Path) -> dict[str, np.ndarray]:
    environment = {**os.environ, "DESTELLO_CPU": kernel}
    subprocess.run([sys.executable, "-c", SCRIPT, path], env=environment, check=True, timeout=300)
    with np.load(path) as file:
        return dict(file)


def test_both_kernels_render_the_same_bits(tmp_path):
    if _core.testing.cpu_isa() != "AVX2":
        pytest.skip("this processor, or this build, has no AVX2")
    best, plain = (render_with(kernel, tmp_path / f"{kernel}.npz") for kernel in ("best", "baseline"))
    assert (best.pop("isa"), plain.pop("isa")) == ("AVX2", "baseline")
    assert best.keys() == plain.keys()
    for name, values in best.items():
        assert np.count_nonzero(values) > 0
        np.testing.assert_array_equal(plain[name], values, name)
