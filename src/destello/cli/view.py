"""`destello view`."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from typing import Annotated

from typer import Option

from destello.cli import options as o

Host = Annotated[str, Option(metavar="NAME", help="Where to listen; others than this machine need the URL's token.")]
Port = Annotated[int | None, Option(metavar="N", help="Of the page; without it 8080, or the next that is free.")]
Token = Annotated[
    str | None,
    Option(metavar="TEXT", help="What the URL must contain; a random one with --host.", envvar="DESTELLO_TOKEN"),
]


def view(
    scene: o.SceneName,
    host: Host = "localhost",
    port: Port = None,
    token: Token = None,
    device: o.Device = "auto",
    threads: o.Threads = 0,
    allow_missing: o.AllowMissing = False,
    allow_external: o.AllowExternal = False,
) -> int:
    """Show a scene in the browser, and edit it there."""
    from destello import io
    from destello.viewer import check_available

    check_available()
    loaded = io.load(scene, allow_missing=allow_missing, allow_external=allow_external)
    for note in loaded.notes:
        print(f"note: {note}", file=sys.stderr)
    from destello.viewer.server import Viewer

    viewer = Viewer(loaded, host=host, port=port, device=device, token=token, threads=threads)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    print(f"device: {viewer.device.name} ({viewer.device.label}), because: {viewer.device.reason}", file=sys.stderr)
    print(viewer.url, flush=True)
    print("Ctrl-C ends it. From another machine: ssh -L and the same port.", file=sys.stderr)
    with contextlib.suppress(KeyboardInterrupt):
        viewer.wait()
    if not viewer.idle:  # the pass of a render cannot be broken off everywhere, and nobody wants what comes of it
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
    return 0
