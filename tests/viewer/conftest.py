"""A viewer to talk to, for the tests of this folder; they are skipped where viser is missing."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("viser", reason="the extra destello[viewer] is not installed")

import destello as dl
from destello.viewer.server import Viewer


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    """The Cornell box on the CPU, at a port of its own."""
    with dl.view(dl.scenes.build("cornell"), port=0, device="cpu") as shown:
        yield shown
