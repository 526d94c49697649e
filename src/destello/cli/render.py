"""`destello render`."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from destello.cli import options as o
from destello.errors import InputError

if TYPE_CHECKING:
    from destello.image import Image
    from destello.image_file import Target
    from destello.scene import Scene

INTERRUPTED = 130


def render(
    scene: o.SceneName,
    output: o.Output = None,
    spp: o.Spp = None,
    target_error: o.TargetError = None,
    time: o.Time = None,
    samples: o.Samples = None,
    size: o.Size = None,
    crop: o.Crop = None,
    camera: o.Camera = None,
    resume: o.Resume = False,
    device: o.Device = "auto",
    threads: o.Threads = 0,
    seed: o.Seed = None,
    max_depth: o.MaxDepth = None,
    filter: o.Filter = None,  # noqa: A002
    denoise: o.Denoise = False,
    exposure: o.Exposure = None,
    tone: o.Tone = None,
    curve: o.Curve = None,
    file_format: o.FileFormat = None,
    bits: o.Bits = None,
    quality: o.Quality = 95,
    p3: o.P3 = False,
    aov: o.Aov = None,
    preview: o.Preview = None,
    json_: o.Json = False,
    json_file: o.JsonFile = None,
    quiet: o.Quiet = False,
    allow_missing: o.AllowMissing = False,
    allow_external: o.AllowExternal = False,
) -> int:
    """Render a scene to a picture."""
    arguments = {
        "spp": spp, "target_error": target_error, "time": o.read_time(time), "samples": o.read_samples(samples),
        "size": o.read_size(size), "crop": o.read_crop(crop), "camera": camera, "device": device, "threads": threads,
        "seed": seed, "max_depth": max_depth, "filter": o.read_filter(filter), "denoise": denoise,
        "aov": _layers(aov), "allow_missing": allow_missing, "allow_external": allow_external,
    }  # fmt: skip
    look = _Look(exposure, tone, curve)
    written = _Written(look, output or _default_name(scene), file_format, bits, quality, p3)
    job = _Command(scene, arguments, written, preview, resume, json_, json_file, quiet)
    job.check()
    with _terminate_like_interrupt():
        return job.run()


def _layers(aov: list[str] | None) -> tuple[str, ...]:
    return tuple(name for text in aov or () for name in text.split(",") if name)


def _default_name(scene: str) -> str:
    return f"{Path(scene).stem if Path(scene).suffix else Path(scene).name}.png"


@contextlib.contextmanager
def _terminate_like_interrupt() -> Iterator[None]:
    """SIGTERM, as batch systems send it, keeps the work so far like Ctrl-C."""
    try:
        before = signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    except ValueError:  # not the main thread: no signals arrive here
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@dataclass
class _Look:
    """The look asked for on the command line; None: the scene's."""

    exposure: float | None
    tone: str | None
    curve: str | None

    @property
    def asked(self) -> bool:
        return (self.exposure, self.tone, self.curve) != (None, None, None)


@dataclass
class _Written:
    """The output as the command line describes it."""

    look: _Look
    name: str
    file_format: str | None
    bits: int | None
    quality: int
    plain: bool

    @property
    def stdout(self) -> bool:
        return self.name == "-"

    def target(self, scene: Scene | None = None) -> Target:
        """The checked output; with the scene, its look where the command line asks for none."""
        from destello.image_file import Target

        return Target.of(
            None if self.stdout else self.name,
            file_format=self.file_format or ("ppm" if self.stdout else None),
            bits=self.bits,
            quality=self.quality,
            plain=self.plain,
            display=self.display(scene),
            asked=self.look.asked,
        )

    def display(self, scene: Scene | None) -> Any:
        from destello.color import Display

        own = Display()
        if scene is not None:
            own = Display(scene.render.exposure, scene.render.tone, scene.render.curve)
        return own.changed(self.look.exposure, self.look.tone, self.look.curve)


@dataclass
class _Command:
    """One call of `destello render`."""

    scene: str
    arguments: dict[str, Any]
    written: _Written
    preview: str | None
    resume: bool
    json: bool
    json_file: str | None
    quiet: bool

    def check(self) -> None:
        """Everything that can be known to be wrong before the scene is read. Raises InputError or OutputError."""
        from destello.image_file import Target, check_writable

        target = self.written.target()
        target.check_writable()
        if self.written.stdout and self.json:
            raise InputError("the picture and --json both go to standard output", expected="--json-file FILE")
        if self.resume and self._film(target) is None:
            problem = "--resume keeps a film beside the output, and there can be none here"
            raise InputError(problem, value=self.written.name, expected="-o FILE")
        if self.arguments["aov"] and target.format.name != "openexr":
            raise InputError(f"--aov needs layers, which {target.format.name} has not", expected="-o FILE.exr")
        if self.preview is not None:
            Target.of(self.preview, display=self.written.display(None)).check_writable()
        if self.json_file is not None:
            check_writable(self.json_file)

    def run(self) -> int:
        """Renders and writes; returns the exit code."""
        from importlib import import_module

        from destello import io
        from destello.image_file import Target

        module = import_module("destello.render")
        flags = {name: self.arguments[name] for name in ("allow_missing", "allow_external")}
        scene = io.load(self.scene, **flags)
        target = self.written.target(scene)
        film = self._film(target)
        preview = self.preview and Target.of(self.preview, display=self.written.display(scene))
        say: Callable[[str], None] = (lambda _: None) if self.quiet else _say
        try:
            image = module.render(
                scene,
                **self.arguments,
                progress=False if self.quiet else "auto",
                preview=preview,
                resume=film if self.resume else None,
                rescue=film,
                messages=say,
            )
        except module.RenderInterrupted as error:
            if error.image is None:
                say("interrupted before the first sample of every pixel: nothing was written")
                return INTERRUPTED
            self._write(error.image, target, say)
            kept = error.image.metadata["film"]
            say("interrupted" + (f"; --resume goes on from {kept}" if kept else ""))
            return INTERRUPTED
        self._write(image, target, say)
        return 0

    @staticmethod
    def _film(target: Target) -> Path | None:
        """The film's file; None where the output is a stream or a device."""
        path = target.path
        return None if path is None or (path.exists() and not path.is_file()) else o.film_path(path)

    def _write(self, image: Image, target: Target, say: Callable[[str], None]) -> None:
        if target.path is None:
            target.write_stream(sys.stdout.buffer, image.array, image.metadata, image.aovs)
            sys.stdout.buffer.flush()
        else:
            image.write(target)
        figures = {"output": str(self.written.name), **image.metadata}
        if self.json:
            print(json.dumps(figures, indent=2))
        if self.json_file is not None:
            from destello.image_file import replacing

            with replacing(Path(self.json_file)) as aside:
                aside.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
        for line in _closing(figures):
            say(line)


def _closing(figures: dict[str, Any]) -> Iterator[str]:
    """The last words: what was written, how long it took, how fast."""
    from destello.progress import duration

    if figures["nonfinite_samples"]:
        yield f"warning: {figures['nonfinite_samples']} samples were not finite and were left out"
    if figures["nonfinite_pixels"]:
        yield f"warning: {figures['nonfinite_pixels']} pixels are not finite; they show as black or white"
    seconds = figures["seconds"]
    name = "standard output" if figures["output"] == "-" else figures["output"]
    took = f"{seconds:.2f} s" if seconds < 60 else duration(seconds)
    error = "" if figures["relative_error"] is None else f", error {figures['relative_error']:.2%}"
    rates = f"{figures['samples_per_second'] / 1e6:.3g} Msamples/s, {figures['rays_per_second'] / 1e6:.3g} Mrays/s"
    picture = f"{figures['width']}x{figures['height']}, {figures['spp']} spp{error}"
    yield f"{name}: {picture} in {took} on {figures['device']}, {rates}"


def _say(message: str) -> None:
    print(message, file=sys.stderr, flush=True)
