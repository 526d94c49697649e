"""`Job`: one render, with everything that was asked for checked and everything else filled in from the scene."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from destello import device as devices
from destello.color import Display
from destello.compile import check_quality
from destello.device import Device
from destello.errors import InputError, SceneError, did_you_mean
from destello.film import Span
from destello.settings import FilmSettings, RenderSettings
from destello.texture_memory import read_size

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene

AOVS = ("albedo", "normal", "depth")
Crop = tuple[int, int, int, int]

#: Where a render without a number of samples stops at the latest: the film's sums are exact up to here.
MAX_OPEN_SPP = 1 << 20
MAX_SAMPLE = 2**31 - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What a caller asked for; None: as the scene says. The arguments of `destello.render`, which documents them."""

    spp: int | None = None
    size: tuple[int, int] | None = None
    device: str = "auto"
    camera: str | None = None
    seed: int | None = None
    max_depth: int | None = None
    max_volume_depth: int | None = None
    samples: Span | None = None
    crop: Crop | None = None
    filter: Node | None = None
    aov: tuple[str, ...] = ()
    denoise: bool = False
    target_error: float | None = None
    time: float | None = None
    threads: int = 0
    build: str = "balanced"
    texture_budget: str | int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A render: all values checked.

    Attributes:
        width, height: of the whole picture, in pixels.
        crop: (x0, y0, x1, y1), the pixels rendered: x0 <= x < x1, y0 <= y < y1.
        camera: its name in the scene.
        span: the sample indices to render.
        open_ended: the end of `span` is only a limit; time or error are to stop the render.
        settings: for the core.
        aovs: layers wanted in the image; `features`: whether the film has to hold them.
        threads: of the CPU; 0: one a core. build: quality of the trees. texture_budget: bytes, or None.
        time, target_error: when to stop early, or None.
        display: the scene's look.
        working_space: the RGB space of the film's sums.
    """

    width: int
    height: int
    crop: Crop
    camera: str
    span: Span
    open_ended: bool
    settings: dict[str, Any]
    aovs: tuple[str, ...]
    features: bool
    device: Device
    threads: int
    build: str
    texture_budget: int | None
    time: float | None
    target_error: float | None
    display: Display
    working_space: str

    @property
    def pixels(self) -> int:
        """How many pixels are rendered."""
        x0, y0, x1, y1 = self.crop
        return (x1 - x0) * (y1 - y0)

    @property
    def cropped(self) -> bool:
        """Whether only a part of the picture is rendered."""
        return self.crop != (0, 0, self.width, self.height)

    def identity(self, scene_hash: str, version: str) -> dict[str, Any]:
        """Everything a sample depends on but the kind of device: see `destello.film.Film`."""
        return {
            "version": version,
            "scene": scene_hash,
            "size": [self.width, self.height],
            "crop": list(self.crop) if self.cropped else None,
            "camera": self.camera,
            "aovs": self.features,
            "working_space": self.working_space,
            **self.settings,
        }


def plan(scene: Scene, request: Request) -> Job:
    """Checks a request against a scene. Raises InputError (SceneError, DeviceError, ImageTooLarge)."""
    width, height = _size(scene, request.size)
    settings = core_settings(scene, request)
    span, open_ended = _span(scene, request)
    aovs = _aovs(request.aov)
    features = bool(aovs) or request.denoise
    crop = _crop(request.crop, width, height)
    threads = _integer("threads", request.threads, 0, 4096)
    camera = _camera(scene, request.camera)
    time = _positive("time", request.time, "seconds, more than 0")
    target_error = _positive("target_error", request.target_error, "more than 0, such as 0.01 for one per cent")
    if request.denoise:
        from destello.denoise import check_available

        check_available()
    display = Display.of(scene.render, scene.source)
    device = devices.choose(request.device)
    devices.check_fits(width, height, aovs=features)
    return Job(
        width=width,
        height=height,
        crop=crop,
        camera=camera,
        span=span,
        open_ended=open_ended,
        settings=settings,
        aovs=aovs,
        features=features,
        device=device,
        threads=threads,
        build=check_quality(request.build),
        texture_budget=read_size(request.texture_budget),
        time=time,
        target_error=target_error,
        display=display,
        working_space=scene.render.working_space,
    )


def _size(scene: Scene, size: tuple[int, int] | None) -> tuple[int, int]:
    if size is None:
        return scene.film.width, scene.film.height
    width, height = _numbers("size", size, 2, "(width, height) in pixels")
    film = FilmSettings(width=width, height=height)
    return film.width, film.height


def core_settings(scene: Scene, request: Request) -> dict[str, Any]:
    """What the core's renderer is told besides camera and samples."""
    changes = {
        "seed": request.seed,
        "max_depth": request.max_depth,
        "max_volume_depth": request.max_volume_depth,
    }
    asked = RenderSettings(**{**scene.render.given, **{k: v for k, v in changes.items() if v is not None}})
    chosen = request.filter if request.filter is not None else scene.film.filter
    if chosen is None:
        from destello import filters

        chosen = filters.gaussian()
    elif getattr(chosen, "kind", None) != "filter":
        raise SceneError("not a filter", place="filter", value=chosen, expected="one of destello.filters")
    shutter = asked.shutter
    return {
        "seed": asked.seed,
        "max_depth": asked.max_depth,
        "max_volume_depth": asked.max_volume_depth,
        "rr_depth": asked.rr_depth,
        "light_sampling": asked.light_sampling,
        "clamp": asked.clamp,
        "time0": shutter[0],
        "time1": shutter[1],
        "filter": {"type": chosen.type, **{name: chosen[name] for name in chosen.doc.params}},
    }


def _span(scene: Scene, request: Request) -> tuple[Span, bool]:
    """The sample indices, and whether their end is only a limit."""
    if request.samples is not None:
        if request.spp is not None:
            raise InputError("spp and samples exclude each other", value=request.samples, expected="one of them")
        expected = "two sample indices A:B, 0 <= A < B"
        first, last = _numbers("samples", request.samples, 2, expected)
        if not 0 <= first < last <= MAX_SAMPLE:
            raise InputError("wrong range", place="samples", value=f"{first}:{last}", expected=expected)
        return (first, last), False
    if request.spp is None and (request.time is not None or request.target_error is not None):
        return (0, MAX_OPEN_SPP), True
    spp = scene.render.spp if request.spp is None else _integer("spp", request.spp, 1, MAX_SAMPLE)
    return (0, spp), False


def _aovs(names: Iterable[str]) -> tuple[str, ...]:
    if isinstance(names, str):
        names = (names,)
    chosen = tuple(dict.fromkeys(names))
    for name in chosen:
        if name not in AOVS:
            raise InputError("unknown layer", place="aov", value=name, expected=did_you_mean(name, AOVS))
    return chosen


def _crop(crop: Crop | None, width: int, height: int) -> Crop:
    if crop is None:
        return (0, 0, width, height)
    expected = f"x0 < x1 within 0 to {width} and y0 < y1 within 0 to {height}"
    x0, y0, x1, y1 = _numbers("crop", crop, 4, expected)
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise InputError("not within the picture", place="crop", value=f"{x0}:{x1},{y0}:{y1}", expected=expected)
    return (x0, y0, x1, y1)


def _camera(scene: Scene, name: str | None) -> str:
    if not scene.cameras:
        from destello.defaults import ensure_camera

        ensure_camera(scene)
    if name is None:
        return next(key for key, camera in scene.cameras.items() if camera is scene.camera)
    if name not in scene.cameras:
        raise SceneError("unknown camera", place="camera", value=name, expected=did_you_mean(name, scene.cameras))
    return name


def _numbers(place: str, values: Any, count: int, expected: str) -> tuple[int, ...]:
    try:
        numbers = tuple(values)
    except TypeError:
        numbers = ()
    if len(numbers) != count or not all(_whole(n) for n in numbers):
        raise InputError("wrong kind of value", place=place, value=values, expected=expected)
    return tuple(int(n) for n in numbers)


def _integer(place: str, value: Any, least: int, most: int) -> int:
    if not _whole(value) or not least <= int(value) <= most:
        raise InputError("out of range", place=place, value=value, expected=f"a whole number from {least} to {most}")
    return int(value)


def _whole(value: Any) -> bool:
    return hasattr(value, "__index__") and not isinstance(value, bool)


def _positive(place: str, value: Any, expected: str) -> float | None:
    if value is None:
        return None
    number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan
    if not 0 < number < math.inf:
        raise InputError("out of range", place=place, value=value, expected=expected)
    return number
