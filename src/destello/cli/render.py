"""`destello render`."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from destello.cli import options as o
from destello.cli.grading import Look
from destello.device import warm_up
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
    frames: o.Frames = None,
    camera: o.Camera = None,
    resume: o.Resume = False,
    device: o.Device = "auto",
    threads: o.Threads = 0,
    build: o.Build = "balanced",
    texture_budget: o.TextureBudget = None,
    seed: o.Seed = None,
    max_depth: o.MaxDepth = None,
    max_volume_depth: o.MaxVolumeDepth = None,
    filter: o.Filter = None,  # noqa: A002
    denoise: o.Denoise = False,
    working_space: o.WorkingSpace = None,
    exposure: o.Exposure = None,
    white_balance: o.WhiteBalance = None,
    tone: o.Tone = None,
    curve: o.Curve = None,
    ocio_config: o.OcioConfig = None,
    ocio_display: o.OcioDisplay = None,
    ocio_view: o.OcioView = None,
    file_format: o.FileFormat = None,
    bits: o.Bits = None,
    quality: o.Quality = 95,
    p3: o.P3 = False,
    aov: o.Aov = None,
    preview: o.Preview = None,
    json_: o.Json = False,
    json_file: o.JsonFile = None,
    quiet: o.Quiet = False,
    variant: o.Variant = None,
    allow_missing: o.AllowMissing = False,
    allow_external: o.AllowExternal = False,
) -> int:
    """Render a scene to a picture."""
    warm_up(device)
    arguments = {
        "spp": spp, "target_error": target_error, "time": o.read_time(time), "samples": o.read_samples(samples),
        "size": o.read_size(size), "crop": o.read_crop(crop), "camera": camera, "device": device, "threads": threads,
        "build": build, "texture_budget": texture_budget, "seed": seed, "max_depth": max_depth,
        "max_volume_depth": max_volume_depth,
        "filter": o.read_filter(filter), "denoise": denoise,
        "working_space": working_space, "aov": _layers(aov), "allow_missing": allow_missing,
        "allow_external": allow_external,
    }  # fmt: skip
    look = Look(exposure, white_balance, tone, curve, ocio_config, ocio_display, ocio_view).values()
    numbers = o.read_frames(frames)
    written = _Written(look, output or _default_name(scene, numbers), file_format, bits, quality, p3)
    job = _Command(scene, arguments, written, preview, numbers, resume, json_, json_file, quiet, variant)
    job.check()
    with _terminate_like_interrupt():
        return job.run()


def _layers(aov: list[str] | None) -> tuple[str, ...]:
    return tuple(name for text in aov or () for name in text.split(",") if name)


def _default_name(scene: str, frames: range | None) -> str:
    stem = Path(scene).stem if Path(scene).suffix else Path(scene).name
    return f"{stem}.png" if frames is None else f"{stem}_####.png"


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
class _Written:
    """The output as the command line describes it."""

    look: dict[str, Any]  # options of `Display.changed`; what is not in it is the scene's
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
            asked=bool(self.look),
        )

    def display(self, scene: Scene | None) -> Any:
        from destello.color import Display

        return (Display() if scene is None else Display.of(scene.render, scene.source)).changed(**self.look)


@dataclass
class _Command:
    """One call of `destello render`."""

    scene: str
    arguments: dict[str, Any]
    written: _Written
    preview: str | None
    frames: range | None
    resume: bool
    json: bool
    json_file: str | None
    quiet: bool
    variant: str | None

    def check(self) -> None:
        """Everything that can be known to be wrong before the scene is read. Raises InputError or OutputError."""
        from destello.image_file import Target, check_writable

        first = None if self.frames is None else self.frames[0]
        self._check_names()
        target = self._output(first).target()
        target.check_writable()
        if self.written.stdout and self.json:
            raise InputError("the picture and --json both go to standard output", expected="--json-file FILE")
        if self.resume and self._film(target) is None:
            problem = "--resume keeps a film beside the output, and there can be none here"
            raise InputError(problem, value=self.written.name, expected="-o FILE")
        if self.arguments["aov"] and target.format.name != "openexr":
            raise InputError(f"--aov needs layers, which {target.format.name} has not", expected="-o FILE.exr")
        if self.preview is not None:
            Target.of(o.numbered(self.preview, first), display=self.written.display(None)).check_writable()
        if self.json_file is not None:
            check_writable(self.json_file)

    def _check_names(self) -> None:
        """Several frames cannot have one name."""
        if self.frames is None or len(self.frames) == 1:
            return
        if self.written.stdout:
            raise InputError("several frames cannot go to standard output", place="-o", expected="-o out_####.png")
        if "#" not in Path(self.written.name).name:
            problem, expected = "the frames need a number in their names", "a run of #, such as out_####.png"
            raise InputError(problem, place="-o", value=self.written.name, expected=expected)

    def _output(self, frame: int | None) -> _Written:
        return replace(self.written, name=o.numbered(self.written.name, frame))

    def run(self) -> int:
        """Renders and writes; returns the exit code."""
        from destello import io

        flags = {name: self.arguments[name] for name in ("allow_missing", "allow_external")}
        scene = io.load(self.scene, variant=self.variant, **flags)
        figures: list[dict[str, Any]] = []
        try:
            code = self._render_frames(scene, figures) if self.frames else self._render(scene, figures)
        except BaseException:  # what is finished is reported, whatever stops the rest
            if figures:
                self._report(figures)
            raise
        if figures or self.frames:
            self._report(figures)
        return code

    def say(self, line: str) -> None:
        """Tells people something, on standard error."""
        if not self.quiet:
            print(line, file=sys.stderr, flush=True)

    def _render_frames(self, scene: Scene, figures: list[dict[str, Any]]) -> int:
        """All frames, one after the other; with --resume, those that are not there yet."""
        from destello.progress import each_frame, showing

        assert self.frames is not None
        if not scene.frames and len(self.frames) > 1:
            self.say("note: nothing in the scene is animated: the frames are all the same")
        said: set[str] = set()

        def once(line: str) -> None:
            if line not in said:
                said.add(line)
                self.say(line)

        missing = [frame for frame in self.frames if not self._finished(frame)] if self.resume else self.frames
        with showing(False if self.quiet else "auto") as shown:
            for frame, progress in each_frame(shown, missing):
                code = self._render(scene.at_frame(frame), figures, frame, progress=progress, messages=once)
                if code != 0:
                    return code
        return 0

    def _finished(self, frame: int) -> bool:
        """Whether --resume has nothing to do for a frame: its picture is there, and no film to go on from."""
        target = self._output(frame).target()
        film = self._film(target)
        if target.path is None or not target.path.exists() or film is None or film.exists():
            return False
        self.say(f"{target.path}: already there")
        return True

    def _render(self, scene: Scene, figures: list[dict[str, Any]], frame: int | None = None, **told: Any) -> int:
        """One picture; appends its figures. `told`: progress and messages, if others than usual."""
        from importlib import import_module

        from destello.image_file import Target

        module = import_module("destello.render")
        written = self._output(frame)
        target = written.target(scene)
        film = self._film(target)
        preview = self.preview and Target.of(o.numbered(self.preview, frame), display=written.display(scene))
        told = {"progress": "auto", "messages": self.say, **told, **({"progress": False} if self.quiet else {})}
        files = {"preview": preview, "resume": film if self.resume else None, "rescue": film}
        try:
            image, code = module.render(scene, **self.arguments, **told, **files), 0
        except module.RenderInterrupted as error:
            image, code = error.image, INTERRUPTED
        if image is None:
            self.say("interrupted before the first sample of every pixel: nothing was written")
            return INTERRUPTED
        done_with = film if frame is not None and code == 0 and self.resume else None  # a finished frame needs none
        if frame is not None:
            image.metadata["frame"] = frame
        if done_with is not None:
            image.metadata["film"] = None
        self._write(image, target)
        if done_with is not None:
            done_with.unlink(missing_ok=True)
        figures.append({"output": written.name, **image.metadata})
        for line in (*([] if frame is not None else [_memory(figures[-1])]), *_closing(figures[-1])):
            self.say(line)
        if code == INTERRUPTED:
            kept = image.metadata["film"]
            self.say("interrupted" + (f"; --resume goes on from {kept}" if kept else ""))
        return code

    @staticmethod
    def _film(target: Target) -> Path | None:
        """The film's file; None where the output is a stream or a device."""
        path = target.path
        return None if path is None or (path.exists() and not path.is_file()) else o.film_path(path)

    @staticmethod
    def _write(image: Image, target: Target) -> None:
        if target.path is None:
            target.write_stream(sys.stdout.buffer, image.array, image.metadata, image.aovs)
            sys.stdout.buffer.flush()
        else:
            image.write(target)

    def _report(self, figures: list[dict[str, Any]]) -> None:
        """The figures for programs: with --frames a list, else one object."""
        text = json.dumps(figures if self.frames else figures[0], indent=2)
        if self.json:
            print(text)
        if self.json_file is not None:
            from destello.image_file import replacing

            with replacing(Path(self.json_file)) as aside:
                aside.write_text(text + "\n", encoding="utf-8")


def _memory(figures: dict[str, Any]) -> str:
    """What the scene and the render took."""
    from destello.memory import words

    scene = words(figures["geometry_bytes"] + figures["bvh_bytes"])
    each = figures["triangle_bytes"]
    parts = [f"geometry and trees {scene}" + (f" ({sum(each.values()):.0f} bytes a triangle)" if each else "")]
    if figures["texture_bytes"]:
        parts.append(f"textures {words(figures['texture_bytes'])}")
    if figures["peak_device_bytes"]:
        parts.append(f"at most {words(figures['peak_device_bytes'])} on the device")
    if figures["peak_host_bytes"]:
        parts.append(f"at most {words(figures['peak_host_bytes'])} of main memory")
    return "memory: " + ", ".join(parts)


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
