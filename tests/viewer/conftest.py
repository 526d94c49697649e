"""A viewer to talk to, and a browser, for the tests of this folder; they are skipped where viser is missing.

The browser is Debian's package `chromium` (apt-get install chromium), not one that Playwright downloads; without it,
or without Playwright, what needs it is skipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("viser", reason="the extra destello[viewer] is not installed")

import destello as dl
from destello.viewer.server import Viewer
from viewer_browser import ARGUMENTS, CHROMIUM


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    """The Cornell box on the CPU, at a port of its own."""
    with dl.view(dl.scenes.build("cornell"), port=0, device="cpu") as shown:
        yield shown


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A headless Chromium, driven by Playwright."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("there is no Chromium: apt-get install chromium")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield chromium
        chromium.close()
