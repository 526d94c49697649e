"""What `destello bench` measures of a scene: build time, rates, and the seconds to a certain error.

The figure that counts is the last one: how long a render takes until its relative mean squared error against a
converged picture falls to a fixed value. Rates alone can be raised by doing the wrong thing quickly.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.color import luminance
from destello.device import Device, check_fits
from destello.errors import RenderError
from destello.job import Request, plan
from destello.memory import forget_peaks, peaks, per_triangle

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.compile import CompiledScene
    from destello.scene import Scene

    Pixels = NDArray[np.float32]

REFERENCE_SEED = 1_000_003
FIRST_SEED = 1
_DARK = 0.1  # as in `destello.film.relative_error`
_CALL_SECONDS = 1.0  # a call of the core is about that long at most, so that Ctrl-C is soon heard


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How a scene is measured.

    Attributes:
        device: where. threads: of the CPU; 0: one a core. build: quality of the trees.
        size: width and height of the picture in pixels; None: the scene's.
        spp: samples a pixel of each run that measures rates, 1 or more; `repeat`: how many such runs count, 1 or more.
        target: relative mean squared error to reach, above 0.
        seeds: how many renders measure the time to that error; 0: this part is left out.
        reference_spp: samples a pixel of the reference, some ten times as many as the error will need. A render that
            does not reach the error with half of them is given up.
    """

    device: Device
    threads: int = 0
    build: str = "balanced"
    size: tuple[int, int] | None = None
    spp: int = 16
    repeat: int = 5
    target: float = 0.01
    seeds: int = 5
    reference_spp: int = 2048


def relative_mse(picture: Pixels, reference: Pixels) -> float:
    """The relative mean squared error of linear RGB (H, W, 3) against a reference: 0 or more, 0.01 for 10 % noise.

    The mean over the pixels of ((Y - R) / max(R, M / 10))²: Y and R are luminances, M the reference's mean. It is the
    square of the relative standard error (`--target-error`), measured instead of estimated.
    """
    got, wanted = luminance(picture).astype(np.float64), luminance(reference).astype(np.float64)
    floor = _DARK * float(wanted.mean())
    if floor <= 0:
        return 0.0 if not got.any() else math.inf
    return float(np.mean(((got - wanted) / np.maximum(wanted, floor)) ** 2))


def measure(scene: Scene, effort: Effort, say: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Builds and renders a scene, and returns the figures as plain data; `say` is told what is going on.

    Times are in seconds; rates of rendering leave out the copy of the film to the host.

    Raises InputError for a size out of range, ImageTooLarge, RenderError.
    """
    forget_peaks()
    run = _Run(scene, effort)
    figures = run.build()
    say(f"built in {figures['build_seconds']:.3g} s; measuring rates with {effort.repeat} x {effort.spp} spp")
    figures |= run.rates()
    if effort.seeds:
        samples = effort.reference_spp
        seconds = samples * run.pixels / figures["kernel_Msamples_s"] / 1e6
        say(f"{figures['kernel_Msamples_s']:.3g} Msamples/s; reference of {samples} spp, about {seconds:.0f} s")
        figures |= run.seconds_to_error()
    return figures | peaks()


def rate_figures(
    samples: int, walls: Iterable[float], kernels: Iterable[float], rays: Iterable[float]
) -> dict[str, float]:
    """Medians over runs of `samples` samples each, and the rates that they make.

    Args:
        samples: of one run.
        walls: seconds of each run, with the copy of the film.
        kernels: the same without it.
        rays: of each run.
    """
    wall, kernel, traced = (statistics.median(values) for values in (walls, kernels, rays))
    return {
        "seconds": wall,
        "kernel_seconds": kernel,
        "Msamples_s": samples / wall / 1e6,
        "kernel_Msamples_s": samples / kernel / 1e6,
        "kernel_Mrays_s": traced / kernel / 1e6,
        "rays_per_sample": traced / samples,
    }


class _Run:
    """One scene on one device."""

    def __init__(self, scene: Scene, effort: Effort) -> None:
        self.scene, self.effort = scene, effort
        job = plan(scene, Request(size=effort.size, device=effort.device.name, threads=effort.threads))
        check_fits(job.width, job.height * 2, aovs=False)
        self.width, self.height, self.settings = job.width, job.height, job.settings
        self.pixels = job.width * job.height
        self.camera = job.camera
        self._paths: dict[str, int] = {}
        self._chunk = 1  # samples a pixel in one call of the core
        self._compiled: CompiledScene
        self._renderer: Any

    def build(self) -> dict[str, Any]:
        """Compiles the scene and takes it to the device."""
        from destello import _core

        began = time.perf_counter()
        effort = self.effort
        self._compiled = self.scene.compile(build=effort.build, device=effort.device.name, threads=effort.threads)
        compiled = time.perf_counter()
        try:
            self._renderer = _core.Renderer(self._compiled.core, self.effort.device.name, self.effort.threads)
        except (RuntimeError, MemoryError, ValueError) as error:
            raise RenderError(f"{self.effort.device.name} cannot start: {error}") from error
        stats = self._compiled.stats
        counts = {name: stats[name] for name in ("triangles", "spheres", "instances", "bvh_nodes", "sah_cost")}
        sizes = {name: stats[name] for name in ("geometry_bytes", "bvh_bytes")}
        return {
            "size": [self.width, self.height],
            "max_depth": self.settings["max_depth"],
            **counts,
            **sizes,
            "triangle_bytes": per_triangle(stats["triangles"], stats["geometry_bytes"], stats["bvh_bytes"]),
            "build": effort.build,
            "compile_seconds": compiled - began,
            "build_seconds": stats["build_seconds"],
            "build_Mtris_s": stats["triangles"] / max(stats["build_seconds"], 1e-9) / 1e6,
            "upload_seconds": time.perf_counter() - compiled,
        }

    def rates(self) -> dict[str, Any]:
        """Medians over `repeat` runs, after one to warm up."""
        spp, repeat = self.effort.spp, self.effort.repeat
        _, probe = self._render(0, 1, FIRST_SEED)
        self._chunk = max(1, int(_CALL_SECONDS / max(probe.seconds, 1e-9)))
        runs = []
        for i in range(repeat + 1):
            _, counted = self._render(0, spp, FIRST_SEED + i)
            runs.append(counted)
        runs = runs[1:]
        figures = rate_figures(
            self.pixels * spp, (r.wall for r in runs), (r.seconds for r in runs), (r.rays for r in runs)
        )
        self._chunk = max(1, int(_CALL_SECONDS * spp / max(figures["kernel_seconds"], 1e-9)))
        return {
            **self._paths,
            "spp": spp,
            "repeat": repeat,
            "first_seed": FIRST_SEED + 1,
            **figures,
        }

    def seconds_to_error(self) -> dict[str, Any]:
        """Median over the seeds of samples and seconds to the target, and all of them."""
        samples = self.effort.reference_spp
        film, _ = self._render(0, samples, REFERENCE_SEED)
        reference = film.mean()
        seeds = range(FIRST_SEED, FIRST_SEED + self.effort.seeds)
        found = [self._to_error(seed, reference, max(1, samples // 256), samples // 2) for seed in seeds]
        spp, seconds = ([pair[k] for pair in found if pair] for k in (0, 1))
        reached = 2 * len(seconds) > len(found)  # else there is no median
        missing = [math.inf] * (len(found) - len(seconds))
        return {
            "target_relative_mse": self.effort.target,
            "reference_spp": samples,
            "reference_seed": REFERENCE_SEED,
            "seeds": list(seeds),
            "spp_to_error": statistics.median(spp + missing) if reached else None,
            "seconds_to_error": statistics.median(seconds + missing) if reached else None,
            "seconds_to_error_all": [pair and pair[1] for pair in found],
        }

    def _to_error(self, seed: int, reference: Pixels, first: int, last: int) -> tuple[float, float] | None:
        """Samples a pixel and seconds until the target; None if it takes more than `last`.

        The error is looked at after `first`, 2 `first`, 4 `first`... samples; between two looks it falls as a power of
        the samples, before the first as 1 / samples.
        """
        target = self.effort.target
        film, before = None, None
        done, seconds = 0, 0.0
        count = first
        while done < last or film is None:
            part, counted = self._render(done, count, seed)
            if film is None:
                film = part
            else:
                film.add(part)
            took, seconds = seconds, seconds + counted.seconds
            error = relative_mse(film.mean(), reference)
            if error <= target:
                if before is None:
                    share = error / target
                    return count * share, seconds * share
                spp = done * (count / done) ** (math.log(before / target) / math.log(before / error))
                return spp, took + (seconds - took) * (spp - done) / (count - done)
            before, done, count = error, count, 2 * count
        return None

    def _render(self, first: int, last: int, seed: int) -> tuple[Any, _Counted]:
        """The samples first <= i < last in a film of their own."""
        from destello import _core

        film, total = None, _Counted()
        settings = {**self.settings, "seed": seed}
        camera = self._compiled.cameras[self.camera]
        for start, end in _spans(first, last, self._chunk):
            try:
                part = _core.Film(self.width, self.height)
                counts = self._renderer.render(part, camera, start, end, settings)
            except (RuntimeError, ValueError, MemoryError) as error:
                raise RenderError(f"rendering failed: {error}") from error
            total.wall += counts["seconds"]
            total.seconds += counts["device_seconds"] or counts["seconds"]
            total.rays += counts["rays"]
            self._paths = {name: counts[name] for name in ("paths", "path_bytes", "path_device_bytes")}
            if film is None:
                film = part
            else:
                film.add(part)
        return film, total


@dataclass
class _Counted:
    """What rendering took: seconds with and without the film's copy, rays."""

    wall: float = 0.0
    seconds: float = 0.0
    rays: int = 0


def _spans(first: int, last: int, step: int) -> Iterator[tuple[int, int]]:
    for start in range(first, last, step):
        yield start, min(start + step, last)
