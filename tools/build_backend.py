"""PEP 517 build back end: scikit-build-core, plus NVIDIA's compiler from PyPI when the machine has none.

``pip install .`` on a machine without a CUDA toolkit still gets both backends: `nvcc`, the static run time and CCCL are
ordinary build requirements (about 100 MB to download, thrown away with pip's build environment). They are left out if

* CUDA is switched off: ``pip install . -C cmake.define.DST_CUDA=OFF``, or ``DESTELLO_CUDA=0`` in the environment;
* a compiler is there already: ``CUDACXX`` is set, or `nvcc` is on ``PATH`` or in the usual place.

CMake makes the same choice again from what is installed (see ``cmake/Cuda.cmake``).
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from scikit_build_core import build as _backend
from scikit_build_core.build import *  # noqa: F403  (every hook that is not overridden below)

# PTX from a newer nvcc does not load on the 580 driver series, so the minor version is pinned.
CUDA_REQUIREMENT = "cuda-toolkit[nvcc,cudart,cccl]==13.0.*"
USUAL_NVCC = Path("/usr/local/cuda/bin/nvcc")

ConfigSettings = dict[str, Any] | None


def _is_off(value: object) -> bool:
    return str(value).strip().upper() in {"0", "OFF", "FALSE", "NO", "N"}


def cuda_is_off(config_settings: ConfigSettings) -> bool:
    """Whether the user asked for a CPU-only build; a config setting is stronger than the environment."""
    settings = config_settings or {}
    for name in ("cmake.define.DST_CUDA", "skbuild.cmake.define.DST_CUDA"):
        if name in settings:
            return _is_off(settings[name])
    return _is_off(os.environ.get("DESTELLO_CUDA", "AUTO"))


def cuda_requirements(config_settings: ConfigSettings = None) -> list[str]:
    """The extra build requirements: NVIDIA's compiler, unless it is not wanted or already there."""
    if cuda_is_off(config_settings):
        return []
    if os.environ.get("CUDACXX") or shutil.which("nvcc") or USUAL_NVCC.is_file():
        return []
    return [CUDA_REQUIREMENT]


def get_requires_for_build_wheel(config_settings: ConfigSettings = None) -> list[str]:
    return [*_backend.get_requires_for_build_wheel(config_settings), *cuda_requirements(config_settings)]


def get_requires_for_build_editable(config_settings: ConfigSettings = None) -> list[str]:
    return [*_backend.get_requires_for_build_editable(config_settings), *cuda_requirements(config_settings)]
