"""The built package: versions, metadata, the type stub, and that it loads on a machine without a GPU driver."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import destello
from destello import _core

ROOT = Path(__file__).resolve().parents[1]
MODULE = Path(_core.__file__)
SANITIZED = "DESTELLO_SANITIZE" in os.environ


def run_python(code: str, **environment: str) -> str:
    """Standard output of `code` in a fresh interpreter."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_versions_agree() -> None:
    assert destello.__version__ == _core.__version__ == importlib.metadata.version("destello")
    assert re.search(rf"^## \[{re.escape(destello.__version__)}\]", (ROOT / "CHANGELOG.md").read_text(), re.M)


def test_metadata() -> None:
    meta = importlib.metadata.metadata("destello")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert meta["Requires-Python"] == project["requires-python"]
    assert meta["License-Expression"] == "Apache-2.0"
    assert set(project["optional-dependencies"]) == set(meta.get_all("Provides-Extra"))
    scripts = importlib.metadata.distribution("destello").entry_points.select(group="console_scripts")
    assert {s.name: s.value for s in scripts} == project["scripts"]


def test_the_build_needs_nothing_at_run_time() -> None:
    """No toolkit, driver or C++ package is linked: what every Linux has, and nothing else."""
    if SANITIZED:
        pytest.skip("a sanitizer adds its own libraries")
    listing = subprocess.run(["ldd", str(MODULE)], capture_output=True, text=True, check=True).stdout
    needed = {line.split()[0].split("/")[-1] for line in listing.splitlines()}
    allowed = r"linux-vdso|ld-linux|lib(c|m|dl|rt|pthread|gcc_s|stdc\+\+)\.so"
    assert not [name for name in needed if not re.match(allowed, name)]


def test_only_the_entry_point_is_exported() -> None:
    if SANITIZED:
        pytest.skip("sanitizers export names of their own")
    listing = subprocess.run(
        ["nm", "-D", "--defined-only", str(MODULE)], capture_output=True, text=True, check=True
    ).stdout
    names = [line.split()[-1] for line in listing.splitlines() if line.split()[-2] not in "uVvWw"]
    assert names == ["PyInit__core"]


def test_import_without_a_driver() -> None:
    """With every GPU hidden the module loads, lists the CPU and says why there is no GPU."""
    assert run_python("import destello; print('loaded')", CUDA_VISIBLE_DEVICES="").strip() == "loaded"


def test_import_takes_no_optional_package() -> None:
    """A plain `import destello` is quick: file formats, the command line and extras load when they are used."""
    code = "import sys, destello; print(*[m for m in sys.argv[1:] if m in sys.modules])"
    heavy = ["trimesh", "pygltflib", "tinyobjloader", "plyfile", "typer", "pyoidn", "tinyvdb", "scipy", "pxr", "viser"]
    loaded = run_python(code.replace("sys.argv[1:]", repr(heavy)))
    assert not loaded.split()


@pytest.mark.skipif("DESTELLO_EXPECT_CUDA_BUILD" not in os.environ, reason="CPU-only builds are fine here")
def test_cuda_backend_was_built() -> None:
    assert _core.has_cuda


@pytest.mark.skipif(SANITIZED, reason="no stub is made with sanitizers")
@pytest.mark.skipif(importlib.util.find_spec("nanobind") is None, reason="nanobind is not installed")
def test_stub_is_in_sync(tmp_path: Path) -> None:
    stub = MODULE.parent / "_core.pyi"
    assert stub.is_file(), "the build made no stub"
    made = tmp_path / "_core.pyi"
    command = [sys.executable, "-m", "nanobind.stubgen", "-q", "-m", "_core", "-i", str(MODULE.parent), "-o", str(made)]
    command += ["-p", str(ROOT / "cmake" / "stub_patterns.txt")]
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    assert made.read_text() == stub.read_text()


def backend_module() -> object:
    spec = importlib.util.spec_from_file_location("build_backend", ROOT / "tools" / "build_backend.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.skipif(importlib.util.find_spec("scikit_build_core") is None, reason="scikit-build-core is not installed")
@pytest.mark.parametrize(
    ("settings", "environment", "wanted"),
    [
        ({}, {}, True),
        (None, {}, True),
        ({"cmake.define.DST_CUDA": "OFF"}, {}, False),
        ({"cmake.define.DST_CUDA": "ON"}, {"DESTELLO_CUDA": "0"}, True),
        ({}, {"DESTELLO_CUDA": "0"}, False),
        ({}, {"CUDACXX": "/somewhere/nvcc"}, False),
    ],
)
def test_nvcc_is_asked_for(
    settings: dict[str, str] | None, environment: dict[str, str], wanted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    backend = backend_module()
    for name in ("DESTELLO_CUDA", "CUDACXX"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(backend, "USUAL_NVCC", Path("/nonexistent/nvcc"))
    monkeypatch.setattr(backend.shutil, "which", lambda _: None)
    assert bool(backend.cuda_requirements(settings)) == wanted
