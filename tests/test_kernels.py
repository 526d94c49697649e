"""The CPU kernels are compiled for any x86-64 processor, for AVX2 and for AVX-512: same results, kept apart."""

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


def kernel_objects(root: Path, isa: str) -> list[Path]:
    """One kernel of every optimised build there is: sanitized ones are not for use, and inline little."""
    found = root.glob(f"build/*/CMakeFiles/destello_kernel_{isa}.dir/core/backend/*.o")
    return sorted(p for p in found if not p.relative_to(root).parts[1].startswith("sanitize"))


def symbols(path: Path) -> list[tuple[str, str]]:
    """(letter, demangled name) of each symbol that the object defines."""
    out = subprocess.run(["nm", "-C", "--defined-only", path], capture_output=True, text=True, check=True).stdout
    return [match.groups() for match in re.finditer(r"^[0-9a-f]* ([A-Za-z]) (.*)$", out, re.MULTILINE)]


@pytest.mark.parametrize("isa", ["avx2", "avx512"])
def test_no_code_for_one_processor_can_stand_in_for_that_of_another(root, isa):
    """The linker keeps one copy of each inline function: what such a kernel offers must have names of its own."""
    objects = kernel_objects(root, isa)
    if not objects:
        pytest.skip("no build folder with this kernel in this checkout")
    if shutil.which("nm") is None:
        pytest.skip("there is no nm")
    for path in objects:
        defined = symbols(path)
        entry_points = {name for letter, name in defined if letter == "T" and "::" not in name}
        assert entry_points == {f"dst_render_tiles_{isa}", f"dst_trace_rays_{isa}"}
        strays = [name for letter, name in defined if letter in WEAK and f"destello_{isa}" not in name]
        assert strays == [], path
        outside = [name for letter, name in defined if letter == "T" and "::" in name and f"destello_{isa}" not in name]
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


def test_all_kernels_render_the_same_bits(tmp_path):
    isas = {"baseline": "baseline", "avx2": "AVX2", "avx512": "AVX-512"}
    best = _core.testing.cpu_isa()
    if best == "baseline":
        pytest.skip("this processor, or this build, has no AVX2")
    names = list(isas)[: list(isas.values()).index(best) + 1]
    images = {name: render_with(name, tmp_path / f"{name}.npz") for name in names}
    assert {name: str(image.pop("isa")) for name, image in images.items()} == {name: isas[name] for name in names}
    for name in names[1:]:
        assert images[name].keys() == images["baseline"].keys()
        for key, values in images[name].items():
            assert np.count_nonzero(values) > 0
            np.testing.assert_array_equal(images["baseline"][key], values, f"{name} {key}")
