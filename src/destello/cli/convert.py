"""`destello convert`."""

from __future__ import annotations

import sys
from typing import Annotated

from typer import Option

from destello.cli import options as o

Written = Annotated[str, Option("-o", "--output", metavar="FILE", help="A .yaml or .json file.")]


def convert(
    scene: o.SceneName, output: Written, variant: o.Variant = None, allow_external: o.AllowExternal = False
) -> None:
    """Write a scene in destello's own format, which is made to be read and edited."""
    from destello import io
    from destello.image_file import check_writable

    check_writable(output)
    loaded = io.load(scene, allow_external=allow_external, variant=variant)
    for note in loaded.notes:
        print(f"note: {note}", file=sys.stderr)
    loaded.save(output)
    print(f"{output}: {loaded.name or 'scene'} written", file=sys.stderr)
