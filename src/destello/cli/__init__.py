"""The command line: `destello render`, `view`, `info`, `devices`, `scenes`, `convert`, `bench`.

Results go to standard output; progress, notes and errors to standard error. An error is one line; `DESTELLO_DEBUG=1`
shows where it came from. Exit codes: 0 done, 1 the render failed, 2 the input or the command line is wrong,
130 interrupted.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from destello import __version__
from destello.cli.bench import bench
from destello.cli.convert import convert
from destello.cli.look import devices, info, scenes
from destello.cli.render import render
from destello.cli.view import view
from destello.errors import Error

INTERRUPTED = 130


class OneLineErrors(TyperGroup):
    """The command group that turns whatever goes wrong into one line and an exit code."""

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,  # noqa: ARG002
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Runs a command and exits: `standalone_mode` is always on."""
        known = {"complete_var": complete_var, "windows_expand_args": windows_expand_args, **extra}
        sys.exit(self._run(args, prog_name or "destello", known))

    def _run(self, args: Sequence[str] | None, prog_name: str, extra: dict[str, Any]) -> int:
        try:
            code = super().main(args, prog_name, standalone_mode=False, **extra)
            sys.stdout.flush()
        except BrokenPipeError:
            # Whoever read our output has gone. Keep the interpreter from complaining when it closes standard output.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        except (Exception, KeyboardInterrupt) as error:
            return report(error)
        return code if isinstance(code, int) else 0


def report(error: BaseException) -> int:
    """Prints an error as one line, those found together as a line each; returns the exit code."""
    if os.environ.get("DESTELLO_DEBUG"):
        traceback.print_exception(error)
    text, code = describe(error)
    for line in error.lines() if isinstance(error, Error) else [text] if text else []:
        print(f"destello: {' '.join(line.split())}", file=sys.stderr)
    return code


def describe(error: BaseException) -> tuple[str, int]:
    """The message and the exit code of anything that ends a command."""
    if isinstance(error, Error):
        return str(error), error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return "interrupted", INTERRUPTED
    if hasattr(error, "format_message"):  # the command line itself is wrong, says typer
        message = error.format_message()  # empty where the help was shown instead
        return f"{message} (destello --help shows what there is)" if message else "", 2
    if type(error).__name__ == "Abort":
        return "aborted", 1
    if isinstance(error, OSError):
        return ": ".join(str(part) for part in (error.filename, error.strerror or error) if part), 1
    if isinstance(error, MemoryError):
        return f"out of memory {error}", 1
    hint = "DESTELLO_DEBUG=1 shows where"
    return f"this is a mistake in destello, please report it: {type(error).__name__}: {error} ({hint})", 1


app = typer.Typer(
    name="destello",
    cls=OneLineErrors,
    help="A physically based path tracer for NVIDIA GPUs and CPUs.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"destello {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """A physically based path tracer for NVIDIA GPUs and CPUs."""


for command in (render, view, info, devices, scenes, convert, bench):
    app.command()(command)


def main() -> None:
    """The `destello` command."""
    app()
