"""Whole renders with destello, Mitsuba 3 and Cycles, for `peers.py`: the same scene, camera, depth and samples.

All of them: 8 segments, no Russian roulette, a box filter, nothing clamped. `fuzzy_metal` (the books' metal) has no
equal elsewhere, so GGX takes its place on every side. Each function returns the figures of one renderer.
"""

from __future__ import annotations

import importlib
import json
import resource
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import Image, _core, filters, materials
from destello.bench import relative_mse

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene

NO_ROULETTE = 65535


@dataclass(frozen=True)
class Work:
    """What is rendered: size in pixels, samples a pixel, segments of a path; `repeat` runs count, after one to warm up.

    `device` is destello's name of it; `pictures` the folder for PNG files, or None.
    """

    size: tuple[int, int]
    spp: int
    depth: int
    repeat: int
    device: str
    pictures: Path | None = None

    @property
    def samples(self) -> int:
        """Of one run."""
        return self.size[0] * self.size[1] * self.spp


@dataclass
class Runs:
    """Seconds and processor seconds of some renders, and their pictures."""

    walls: list[float] = field(default_factory=list)
    cores: list[float] = field(default_factory=list)
    pictures: list[Any] = field(default_factory=list)

    def time(self, call: Callable[[], Any]) -> None:
        """One more run; `call` returns the picture (H, W, 3)."""
        wall, core = time.perf_counter(), time.process_time()
        self.pictures.append(np.asarray(call()))
        self.walls.append(time.perf_counter() - wall)
        self.cores.append(time.process_time() - core)

    def figures(self, work: Work) -> dict[str, Any]:
        """Medians of all runs but the first, which is `first_seconds`."""
        mean = np.mean(self.pictures, axis=0)
        seconds, cores = statistics.median(self.walls[1:]), statistics.median(self.cores[1:])
        return {
            "kind": "render",
            "spp": work.spp,
            "max_depth": work.depth,
            "repeat": work.repeat,
            "first_seconds": self.walls[0],
            "seconds": seconds,
            "Msamples_s": work.samples / seconds / 1e6,
            "Msamples_core_s": work.samples / cores / 1e6,
            "mean": [round(float(x), 4) for x in mean.mean((0, 1))],
            "relative_mse": noise(self.pictures),
            "peak_host_bytes": peak_host(),
        }


def peak_host() -> int:
    """The largest main memory of this process so far, in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def noise(pictures: list[Any]) -> float | None:
    """Relative mean squared error of one run, from the differences of each run to the mean of all; None for one run."""
    count = len(pictures)
    if count < 2:
        return None
    mean = np.mean(pictures, axis=0)
    return statistics.mean(relative_mse(p, mean) for p in pictures) * count / (count - 1)


def prepared(scene: Scene) -> Scene:
    """The scene as all render it: a box filter, GGX in the place of the books' metal."""
    scene.film.filter = filters.box()
    scene.shapes[:] = [_with_ggx(shape) for shape in scene.shapes]
    return scene


def _with_ggx(shape: Node) -> Node:
    material = shape.params.get("material")
    if material is None or material.type != "fuzzy_metal":
        return shape
    ggx = materials.conductor(reflectance=material["albedo"], roughness=material["fuzz"] ** 0.5, fresnel="none")
    return shape.replace(material=ggx)


def keep(picture: Any, work: Work, name: str) -> None:
    """Writes the picture, if wanted."""
    if work.pictures is not None:
        work.pictures.mkdir(parents=True, exist_ok=True)
        Image(np.ascontiguousarray(picture, np.float32)).save(work.pictures / f"{name}.png")


def destello(scene: Scene, work: Work, light_sampling: str) -> dict[str, Any]:
    """Wall time of `Renderer.render`, the copy of the film and its mean included."""
    began = time.perf_counter()
    compiled = scene.compile(device=work.device)
    renderer = _core.Renderer(compiled.core, work.device, 0)
    load = time.perf_counter() - began
    shared = {"max_depth": work.depth, "rr_depth": NO_ROULETTE, "filter": {"type": "box"}}
    runs, kernels, rays = Runs(), [], 0

    def once() -> Any:
        film = _core.Film(*work.size)
        settings = {**shared, "seed": len(runs.walls), "light_sampling": light_sampling}
        counts = renderer.render(film, 0, 0, work.spp, settings)
        kernels.append(counts["device_seconds"] or counts["seconds"])
        nonlocal rays
        rays = counts["rays"]
        return film.mean()

    for _ in range(work.repeat + 1):
        runs.time(once)
    keep(np.mean(runs.pictures, axis=0), work, f"{scene.name}-destello")
    kernel = statistics.median(kernels[1:])
    return runs.figures(work) | {
        "load_seconds": load,
        "kernel_Msamples_s": work.samples / kernel / 1e6,
        "kernel_Mrays_s": rays / kernel / 1e6,
        "light_sampling": light_sampling,
    }


def mitsuba(scene: Scene, work: Work, variant: str) -> dict[str, Any]:
    """Wall time of `mi.render`, with the copy of its picture and without; `load_seconds` is that of `mi.load_dict`."""
    mi = importlib.import_module("mitsuba")
    mi.set_variant(variant)
    translate = importlib.import_module("mitsuba_scene").translate
    with tempfile.TemporaryDirectory(prefix="destello-peers-") as folder:
        made = translate(mi, scene, Path(folder), work.size, work.spp, work.depth)
        began = time.perf_counter()
        loaded = mi.load_dict(made)
        load = time.perf_counter() - began
    runs, kernels = Runs(), []

    def once() -> Any:
        began = time.perf_counter()
        picture = mi.render(loaded, spp=work.spp, seed=len(runs.walls))
        if not variant.startswith("scalar"):
            drjit = importlib.import_module("drjit")
            drjit.eval(picture)
            drjit.sync_thread()
        kernels.append(time.perf_counter() - began)
        return np.array(picture)

    for _ in range(work.repeat + 1):
        runs.time(once)
    kernel = statistics.median(kernels[1:])
    keep(np.mean(runs.pictures, axis=0), work, f"{scene.name}-mitsuba-{variant}")
    figures = {"load_seconds": load, "kernel_Msamples_s": work.samples / kernel / 1e6, "peer_version": mi.__version__}
    return runs.figures(work) | figures


def cycles(scene: Scene, work: Work, python: str) -> dict[str, Any]:
    """Cycles in the Python that has bpy; see `cycles_render.py`."""
    export = importlib.import_module("cycles_scene").export
    with tempfile.TemporaryDirectory(prefix="destello-peers-") as folder:
        export(scene, Path(folder), work.size, work.depth)
        script = Path(__file__).resolve().parent / "cycles_render.py"
        command = [python, str(script), folder, str(work.spp), str(work.repeat)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit((done.stderr.strip().splitlines() or ["no message"])[-1])
        found = json.loads(done.stdout.splitlines()[-1])
        pictures = list(np.load(Path(folder) / "pictures.npy"))
    runs = Runs([found["first_seconds"], *found["walls"]], [0.0, *found["cores"]], pictures)
    keep(np.mean(pictures, axis=0), work, f"{scene.name}-cycles")
    names = ("load_seconds", "peer_version", "peak_host_bytes")
    return runs.figures(work) | {name: found[name] for name in names}
