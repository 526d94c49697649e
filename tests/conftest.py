"""What every test shares: the device fixture, seeded random numbers, and paths.

`device` runs a test once on the CPU and once on CUDA; the second is skipped, with the reason, where there is no GPU.
Set ``DESTELLO_REQUIRE_CUDA=1`` on a machine that should have one: what would be skipped then fails instead.
"""

from __future__ import annotations

import os
import signal
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(__file__).resolve().parent / "data"

# The same examples in every run, and no verdict on a machine that is busy with something else.
settings.register_profile("destello", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("destello")

# A shell lets a job that it starts in the background ignore Ctrl-C, and what that starts in turn: nothing to test then.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@cache
def why_no_cuda() -> str | None:
    """Why nothing can run on CUDA here, or None if it can."""
    from destello import _core

    if not _core.has_cuda:
        return "this build has no CUDA backend"
    return str(_core.cuda_status()) or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    marked = [item for item in items if item.get_closest_marker("cuda")]
    if not marked or os.environ.get("DESTELLO_REQUIRE_CUDA"):
        return
    reason = why_no_cuda()
    if reason:
        for item in marked:
            item.add_marker(pytest.mark.skip(reason=f"no CUDA: {reason}"))


@pytest.fixture(scope="session")
def needs_mitsuba() -> None:
    """Skips the test where Mitsuba 3 is missing or does not load."""
    from mitsuba_scenes import mitsuba

    try:
        mitsuba()
    except ImportError as error:
        pytest.skip(f"no Mitsuba: {error}")


def pytest_report_header() -> list[str]:
    import destello

    reason = why_no_cuda()
    return [f"destello: {destello.__version__}, CUDA: {'skipped, ' + reason if reason else 'yes'}"]


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.cuda)])
def device(request: pytest.FixtureRequest) -> str:
    """The name of the device to run on, as the public functions take it."""
    return str(request.param)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Random numbers that depend on nothing but the test's own name."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))


@pytest.fixture(scope="session")
def root() -> Path:
    """The top of the source tree."""
    return ROOT


@pytest.fixture(scope="session")
def data() -> Path:
    """The tests' own files."""
    return DATA


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder beside the checkout with the project's shared material; tests that need it are skipped without it."""
    path = ROOT.parent / "shared"
    if not path.is_dir():
        pytest.skip("there is no ../shared beside this checkout")
    return path
