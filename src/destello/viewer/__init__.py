"""The viewer: a page in the browser in which a scene is seen, moved and edited, path traced all the time.

    scene, history ── Document ──┐
                                 ├── App (one render thread) ── Session for each page ── viser ── browser
    LiveScene ────── Engine ─────┘

Needs the extra `destello[viewer]`; docs/viewer.md is for users.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

from destello.errors import InputError
from destello.scene import Scene

if TYPE_CHECKING:
    from destello.viewer.server import Viewer


def check_available() -> None:
    """Raises InputError, naming the command that installs it, where viser is not installed."""
    if importlib.util.find_spec("viser") is None:
        raise InputError("the viewer is not installed", expected="pip install 'destello[viewer]'")


def view(
    scene: Scene | str | Path,
    *,
    host: str = "localhost",
    port: int | None = None,
    device: str = "auto",
    token: str | None = None,
) -> Viewer:
    """Shows a scene in the browser, path traced as it is edited, and returns at once.

    The page is where the result's `url` says; in a notebook the result shows itself. The scene can be edited from
    Python while it is shown (`scene.shapes[0] = ...`), and pages edit the same scene. `stop` ends it; so does the end
    of the program.

    Args:
        scene: a Scene, a file's path or a built-in scene's name.
        host: the name or address to listen at. Anything but this machine's own needs a token in the URL.
        port: of the page; None: 8080, or the next one that is free; 0: any.
        device: `auto`, `cpu`, `cuda`, `cuda:1`...
        token: what the URL must contain; None: a random one, if others can reach the host.

    Raises:
        InputError: wrong values, a port that is taken, no viser. SceneError, MissingFileError: the scene cannot be
        shown. DeviceError: the device cannot be used.
    """
    check_available()
    from destello.viewer.server import Viewer

    if not isinstance(scene, Scene):
        from destello.io import load

        scene = load(scene)
    return Viewer(scene, host=host, port=port, device=device, token=token)
