"""`render`: from a scene to an `Image`."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import device as devices
from destello._version import __version__
from destello.color_spaces import converted
from destello.errors import InputError, OutputError, RenderError
from destello.film import Film, show_spans, subtract_spans
from destello.image import Image
from destello.image_file import Target, check_writable
from destello.job import Crop, Job, Request, plan
from destello.memory import peaks, per_triangle, words
from destello.passes import Loop
from destello.progress import Progress, interactive, showing

if TYPE_CHECKING:
    from destello.compile import CompiledScene
    from destello.nodes import Node
    from destello.scene import Scene

PREVIEW_SECONDS = 1.5
CHECKPOINT_SECONDS = 30.0


class RenderInterrupted(KeyboardInterrupt):
    """Ctrl-C during a render: `image` is the picture so far, or None if no sample was whole yet."""

    def __init__(self, image: Image | None) -> None:
        super().__init__("the render was interrupted")
        self.image = image


def render(
    scene: Scene | str | Path,
    *,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    device: str = "auto",
    camera: str | None = None,
    seed: int | None = None,
    max_depth: int | None = None,
    max_volume_depth: int | None = None,
    samples: tuple[int, int] | None = None,
    crop: Crop | None = None,
    filter: Node | None = None,  # noqa: A002
    aov: tuple[str, ...] | list[str] | str = (),
    denoise: bool = False,
    target_error: float | None = None,
    time: float | None = None,
    threads: int = 0,
    build: str = "balanced",
    texture_budget: str | int | None = None,
    working_space: str | None = None,
    progress: Progress | bool | str | None = "auto",
    preview: str | Path | Target | None = None,
    resume: str | Path | None = None,
    rescue: str | Path | None = None,
    messages: Callable[[str], None] | None = None,
    allow_missing: bool = False,
    allow_external: bool = False,
) -> Image:
    """Renders a scene.

    The same scene, seed and kind of device give the same pixels to the bit, for any number of threads, and whether the
    samples were rendered at once, in parts that were added, or after interruptions.

    Args:
        scene: a Scene, a scene file's path, or a built-in scene's name. If it is animated, frame 0 is rendered;
            `Scene.at_frame` makes a scene of any other.
        spp: samples a pixel; None: as many as the scene says, or, with `time` or `target_error`, no limit.
        size: (width, height) in pixels; None: the scene's.
        device: `auto` (CUDA where there is one, else the CPU), `cpu`, `cuda`, `cuda:1`...
        camera: name of one of the scene's cameras; None: its default.
        seed: chooses the random numbers, 0 to 2^32 - 1; None: the scene's.
        max_depth: segments of a path at most, not counting what media add: 1 shows what shines, 2 adds direct light;
            None: the scene's.
        max_volume_depth: how many times a path may scatter in media; None: the scene's.
        samples: (A, B): renders the sample indices A <= i < B only, for example as one of several shards.
        crop: (x0, y0, x1, y1): renders the pixels x0 <= x < x1, y0 <= y < y1 only, with row 0 at the top.
        filter: reconstruction filter, one of `destello.filters`; None: the scene's.
        aov: other layers for `Image.aovs`: some of `albedo`, `normal`, `depth`.
        denoise: removes the remaining noise with Open Image Denoise (needs the extra `destello[denoise]`).
        target_error: stops when the relative standard error (`destello.film.relative_error`) is that small: 0.01 is
            1 %. It is looked at after fixed numbers of samples, so where it stops is reproducible, too.
        time: stops after this many seconds of rendering.
        threads: of the CPU; 0: one for every core.
        build: quality of the trees: `fast` (built soonest: for previews and geometry that changes all the time),
            `balanced` or `high` (rays are fastest: for long renders). It does not change what rays hit. Where a CUDA
            device renders, it also builds the trees of large scenes.
        texture_budget: bytes, or a text such as `512M`: images are made smaller, the largest first, until all of them
            need no more; what was done is among the messages. None: they stay as they are.
        working_space: the RGB space in which light is computed, `rec709` or `acescg`; None: the scene's. The picture
            is Rec.709 in any case; the film's sums are not.
        progress: `auto`, True, False, or a function that is called with a `destello.progress.Status`.
        preview: an image file that is rewritten while the picture refines.
        resume: a film file (`.film`): if there is one, the render goes on from it, and it is kept up to date.
        rescue: a film file that is written, if there is none yet, only when the render is interrupted or fails.
        messages: called with lines about the device and the scene; None: they go to standard error, or nowhere if
            `progress` is False.
        allow_missing: a visible stand-in replaces missing image files; otherwise they are an error.
        allow_external: the scene file may name files outside its own directory tree.

    Returns:
        The picture. Its `metadata` says how it was made: `spp`, `samples`, `seconds`, `rays`, `samples_per_second`,
        `rays_per_second`, `device`, `device_reason`, `stopped_by` (`samples`, `time`, `error`, `interrupt`), and more.

    Raises:
        InputError: a wrong value (also SceneError, DeviceError, MissingFileError, FormatError, ImageTooLarge).
        OutputError: the preview or film cannot be written. RenderError: the render failed.
        RenderInterrupted: Ctrl-C; a KeyboardInterrupt that has the picture so far as `image`. Where Python is used
            interactively, that picture is returned instead.
    """
    preview_target = preview if isinstance(preview, Target) or preview is None else Target.of(preview)
    outputs = _Outputs(preview_target, _film_path(resume), _film_path(rescue))
    outputs.check()
    devices.warm_up(device)
    scene = _open(scene, allow_missing=allow_missing, allow_external=allow_external)
    if working_space is not None:
        scene = scene.copy()
        scene.render.working_space = working_space
    request = Request(
        spp=spp, size=size, device=device, camera=camera, seed=seed, max_depth=max_depth,
        max_volume_depth=max_volume_depth, samples=samples, crop=crop,
        filter=filter, aov=(aov,) if isinstance(aov, str) else tuple(aov), denoise=denoise, target_error=target_error,
        time=time, threads=threads, build=build, texture_budget=texture_budget,
    )  # fmt: skip
    job = plan(scene, request)
    if preview_target is not None:
        preview_target.check_size(job.width, job.height)
    say = messages or (_to_stderr if progress else _to_nobody)
    return _Session(scene, job, outputs, denoise, say).run(progress, allow_missing)


def _open(scene: Scene | str | Path, *, allow_missing: bool, allow_external: bool) -> Scene:
    if isinstance(scene, (str, Path)):
        load = import_module("destello.io").load
        loaded: Scene = load(scene, allow_missing=allow_missing, allow_external=allow_external)
        return loaded
    if not hasattr(scene, "compile"):
        raise InputError("not a scene", value=scene, expected="a Scene, a path or the name of a built-in scene")
    return scene


def _film_path(path: str | Path | None) -> Path | None:
    return None if path is None else Path(path)


def _to_stderr(message: str) -> None:
    print(message, file=sys.stderr)


def _to_nobody(message: str) -> None:
    """Says nothing; notes are still in the image's metadata."""


@dataclass
class _Outputs:
    """The files that a render writes while it goes on."""

    preview: Target | None
    resume: Path | None
    rescue: Path | None
    _preview_due: float = field(default_factory=lambda: PREVIEW_SECONDS)
    _film_due: float = field(default_factory=lambda: CHECKPOINT_SECONDS)

    def check(self) -> None:
        """Raises OutputError now for what could not be written later."""
        if self.preview is not None:
            self.preview.check_writable()
        for path in (self.resume, self.rescue):
            if path is not None:
                check_writable(path)

    def after_pass(self, film: Film, seconds: float, image: Callable[[], Image]) -> None:
        """Writes what is due. Writing takes at most a tenth of the time."""
        if self.preview is not None and seconds >= self._preview_due:
            began = clock.monotonic()
            self.preview.write(image().array)
            self._preview_due = seconds + max(PREVIEW_SECONDS, 10 * (clock.monotonic() - began))
        if self.resume is not None and seconds >= self._film_due:
            began = clock.monotonic()
            film.save(self.resume)
            self._film_due = seconds + max(CHECKPOINT_SECONDS, 10 * (clock.monotonic() - began))

    def keep(self, film: Film, *, failed: bool) -> Path | None:
        """Writes the film at the end, where there is a file for it; returns which."""
        path = self.resume
        if path is None and failed and self.rescue is not None and not self.rescue.exists():
            path = self.rescue
        if path is None or not film.spans:
            return None
        film.save(path)
        return path


@dataclass
class _Session:
    """One call of `render` after its arguments are checked."""

    scene: Scene
    job: Job
    outputs: _Outputs
    denoise: bool
    messages: Callable[[str], None]
    notes: list[str] = field(default_factory=list)
    build_seconds: float = 0.0
    fingerprint: str = ""
    stats: dict[str, Any] = field(default_factory=dict)

    def run(self, progress: Progress | bool | str | None, allow_missing: bool) -> Image:
        """Builds, renders, makes the image."""
        from destello import _core

        began = clock.monotonic()
        device = self.job.device
        self.messages(f"device: {device.name} ({device.label}), because: {device.reason}")
        job = self.job
        compiled = self.scene.compile(
            allow_missing=allow_missing or None,
            build=job.build,
            device=job.device.name,
            threads=job.threads,
            texture_budget=job.texture_budget,
        )
        self.stats = compiled.stats
        self.fingerprint = compiled.fingerprint
        for note in compiled.notes:
            self._note(note)
        film = self._start_film()
        renderer = self._renderer(_core, compiled)
        self.build_seconds = clock.monotonic() - began
        with showing(progress) as shown:
            loop = Loop(self.job, _core, renderer, compiled.cameras[self.job.camera], film, shown, self._after_pass)
            try:
                loop.run()
            except (RenderError, OutputError) as error:
                raise self._rescue(film, loop, error) from error.__cause__
        film.seconds += loop.seconds
        return self._finish(film, loop)

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)
            self.messages(f"note: {note}")

    def _start_film(self) -> Film:
        """An empty film, or the one to go on with."""
        job = self.job
        identity = job.identity(self.fingerprint, __version__)
        path = self.outputs.resume
        if path is None or not path.exists():
            return Film(None, identity)
        film = Film.load(path, identity)
        extra = [span for done in film.spans for span in subtract_spans(done, [job.span])]
        if extra:
            raise InputError(
                "the film holds samples that were not asked for",
                file=path,
                value=show_spans(film.spans),
                expected=f"samples within {show_spans([job.span])}; ask for more, or use another output name",
            )
        if film.spans:
            self.messages(f"going on from {path}: {film.spp} spp done")
            if film.devices != [job.device.kind]:
                self._note(
                    f"the film was begun on {', '.join(film.devices)}: the last bits are not those of one device"
                )
        return film

    def _renderer(self, core: Any, compiled: CompiledScene) -> Any:
        try:
            return core.Renderer(compiled.core, device=self.job.device.name, threads=self.job.threads)
        except (RuntimeError, MemoryError, ValueError) as error:
            problem = f"{self.job.device.name} cannot start: {error}"
            if "memory" in str(error) and compiled.largest_textures:
                problem += f"; textures need {words(self.stats['texture_bytes'])}: {compiled.largest_textures}"
                raise RenderError(problem, expected="--texture-budget SIZE, which makes images smaller") from error
            raise RenderError(problem) from error

    def _after_pass(self, film: Film, seconds: float) -> None:
        self.outputs.after_pass(film, seconds, lambda: self._picture(film))

    def _picture(self, film: Film) -> Image:
        """The pixels so far, cropped."""
        x0, y0, x1, y1 = self.job.crop
        pixels = self._in_rec709(film.core.mean()[y0:y1, x0:x1])
        return Image(np.ascontiguousarray(pixels), film=film, display=self.job.display)

    def _in_rec709(self, colors: Any) -> Any:
        return converted(colors, self.job.working_space, "rec709")

    def _finish(self, film: Film, loop: Loop) -> Image:
        interrupted = loop.stopped_by == "interrupt"
        if not film.spans:
            raise RenderInterrupted(None)
        path = self.outputs.keep(film, failed=interrupted)
        image = self._picture(film)
        image.metadata = self._metadata(film, loop, path, image.nonfinite_pixels)
        x0, y0, x1, y1 = self.job.crop
        layers = {name: film.core.aov(name)[y0:y1, x0:x1] for name in self._layers()}
        if "albedo" in layers:
            layers["albedo"] = self._in_rec709(layers["albedo"])
        if self.denoise and not interrupted:
            image.aovs = layers
            began = clock.monotonic()
            image = image.denoised()
            image.metadata["denoise_seconds"] = clock.monotonic() - began
        image.aovs = {name: np.ascontiguousarray(layers[name], dtype=np.float32) for name in self.job.aovs}
        if self.outputs.preview is not None:
            self.outputs.preview.write(image.array, image.metadata)
        if interrupted and not interactive():
            raise RenderInterrupted(image)
        return image

    def _layers(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.job.aovs, *(("albedo", "normal") if self.denoise else ()))))

    def _rescue(self, film: Film, loop: Loop, error: Exception) -> Exception:
        """Keeps the work of the passes that were whole; the error, saying where it is."""
        film.seconds += loop.seconds
        path = self.outputs.keep(film, failed=True)
        if path is not None and isinstance(error, RenderError):
            error.problem += f"; the {film.spp} spp so far are in {path}"
        return error

    def _metadata(self, film: Film, loop: Loop, path: Path | None, nonfinite_pixels: int) -> dict[str, Any]:
        job = self.job
        seconds = max(loop.seconds, 1e-9)
        x0, y0, x1, y1 = job.crop
        return {
            "scene": self.scene.name or "scene",
            "scene_fingerprint": self.fingerprint,
            "spp": film.spp,
            "samples": show_spans(film.spans),
            "width": x1 - x0,
            "height": y1 - y0,
            "crop": f"{x0}:{x1},{y0}:{y1}" if job.cropped else None,
            "full_size": f"{job.width}x{job.height}" if job.cropped else None,
            "camera": job.camera,
            "working_space": job.working_space,
            "seed": job.settings["seed"],
            "max_depth": job.settings["max_depth"],
            "max_volume_depth": job.settings["max_volume_depth"],
            "light_sampling": job.settings["light_sampling"],
            "filter": job.settings["filter"]["type"],
            "device": job.device.name,
            "device_label": job.device.label,
            "device_reason": job.device.reason,
            "version": __version__,
            "time": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "build": job.build,
            "build_seconds": self.build_seconds,
            "geometry_bytes": self.stats["geometry_bytes"],
            "texture_bytes": self.stats["texture_bytes"],
            "bvh_bytes": self.stats["bvh_bytes"],
            "triangle_bytes": per_triangle(
                self.stats["triangles"], self.stats["geometry_bytes"], self.stats["bvh_bytes"]
            ),
            **peaks(),
            "seconds": loop.seconds,
            "total_seconds": film.seconds,
            "rays": film.rays,
            "samples_per_second": loop.new_samples * job.pixels / seconds,
            "rays_per_second": loop.new_rays / seconds,
            "relative_error": loop.error,
            "stopped_by": loop.stopped_by,
            "film": None if path is None else str(path),
            "nonfinite_samples": film.nonfinite,
            "nonfinite_pixels": nonfinite_pixels,
            "notes": list(self.notes),
        }
