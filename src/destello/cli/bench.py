"""`destello bench`: how fast this machine renders."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from destello.cli import options as o
from destello.errors import InputError, did_you_mean

if TYPE_CHECKING:
    from destello.bench import Effort
    from destello.device import Device

Names = Annotated[list[str] | None, Argument(metavar="[SCENE]...", help="Built-in scenes; without: six of them.")]
Quick = Annotated[bool, Option("--quick", help="Small scenes and pictures: less than half a minute on two cores.")]
Spp = Annotated[int | None, Option(metavar="N", help="Samples a pixel of the runs that measure rates.")]
Seeds = Annotated[int | None, Option(metavar="N", help="Renders that measure the time to an error; 0: none.")]
JsonFile = Annotated[str | None, Option("--json", metavar="FILE", help="All figures as JSON; - is standard output.")]
Quiet = Annotated[bool, Option("--quiet", "-q", help="No progress.")]

SCENES = ("book1", "cornell", "mesh1m", "instances", "terrain", "interior")

# The relative mean squared error that the clock stops at, chosen so that it takes some tens or hundreds of samples; and
# the samples a pixel of the reference, over ten times as many.
TARGETS = {
    "book1": (0.01, 512),
    "cornell": (0.01, 2048),
    "mesh1m": (0.001, 512),
    "instances": (0.01, 1024),
    "terrain": (0.001, 1024),
    "interior": (0.1, 4096),
}
OTHER_TARGET = (0.01, 2048)

CPU_SCALE = 8  # pictures are that much narrower and lower than on a GPU
QUICK_SCALE = 20
QUICK_DETAIL = 0.05
QUICK_ERROR = 4  # times the error, with an eighth of the reference's samples

_COLUMNS = f"{'triangles':>10} {'build Mtris/s':>14} {'bytes/tri':>10} {'Msamples/s':>11} {'Mrays/s':>9} {'peak':>10}"
_HEAD = f"{'scene':<16}{'size':>10} {_COLUMNS}  seconds to error"


def bench(
    scene: Names = None,
    quick: Quick = False,
    device: o.Device = "auto",
    threads: o.Threads = 0,
    build: o.Build = "balanced",
    size: o.Size = None,
    spp: Spp = None,
    seeds: Seeds = None,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Measure how fast this machine builds and renders built-in scenes."""
    from destello import device as devices
    from destello.compile import check_quality

    names = tuple(dict.fromkeys(scene or SCENES))
    check_quality(build)
    _check(names, threads, spp, seeds)
    wanted = o.read_size(size)
    chosen = devices.choose(device)
    if json_file not in (None, "-"):
        from destello.image_file import check_writable

        check_writable(str(json_file))
    run = _Bench(names, quick, chosen, threads, build, wanted, spp, seeds, json_file, quiet)
    try:
        run.all()
    except KeyboardInterrupt:
        print("interrupted: finished scenes are kept", file=sys.stderr)
        raise


def _check(names: tuple[str, ...], threads: int, spp: int | None, seeds: int | None) -> None:
    from destello import scenes

    known = [*scenes.names(), *scenes.describe_benchmarks()]
    for name in names:
        if name not in known:
            expected = did_you_mean(name, known)
            raise InputError("no built-in scene of this name", place="SCENE", value=name, expected=expected)
    limits = (("--threads", threads, 0, 4096), ("--spp", spp, 1, 1 << 20), ("--seeds", seeds, 0, 1000))
    for option, value, least, most in limits:
        if value is not None and not least <= value <= most:
            expected = f"a whole number from {least} to {most}"
            raise InputError("out of range", place=option, value=value, expected=expected)


@dataclass
class _Bench:
    """One call of `destello bench`."""

    names: tuple[str, ...]
    quick: bool
    device: Device
    threads: int
    build: str
    size: tuple[int, int] | None
    spp: int | None
    seeds: int | None
    json_file: str | None
    quiet: bool

    def all(self) -> None:
        """Measures scene after scene; prints the table, and keeps the file of figures up to date."""
        from destello.machine import about

        machine = about(self.device, self.threads)
        figures: dict[str, Any] = {"program": "destello bench", **machine, "quick": self.quick, "results": []}
        self._say(f"device: {self.device.name} ({self.device.label}), because: {self.device.reason}")
        table = self.json_file != "-"
        if table:
            print(_HEAD, flush=True)
        try:
            for i, name in enumerate(self.names):
                result = self._measure(name, f"[{i + 1}/{len(self.names)}] {name}: ")
                figures["results"].append(result)
                if table:
                    print(_row(result), flush=True)
                    self._keep(figures)
            if table:
                print(_paths(figures["results"][-1]))
        finally:
            if not table:
                print(json.dumps(figures, indent=2))

    def _keep(self, figures: dict[str, Any]) -> None:
        """Writes the file of figures, if there is to be one."""
        if self.json_file is not None:
            from destello.image_file import replacing

            with replacing(Path(self.json_file)) as aside:
                aside.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")

    def _say(self, line: str) -> None:
        if not self.quiet:
            print(line, file=sys.stderr, flush=True)

    def _measure(self, name: str, prefix: str) -> dict[str, Any]:
        from destello import bench as measuring
        from destello import scenes

        detail = QUICK_DETAIL if self.quick and name in scenes.describe_benchmarks() else 1.0
        self._say(f"{prefix}making the scene")
        scene = scenes.build(name, detail)
        effort = self._effort(name, scene.film.width, scene.film.height)
        result = measuring.measure(scene, effort, lambda line: self._say(prefix + line))
        return {"scene": name, "detail": detail, **result}

    def _effort(self, name: str, width: int, height: int) -> Effort:
        from destello.bench import Effort

        cpu = self.device.kind == "cpu"
        scale = QUICK_SCALE if self.quick else CPU_SCALE if cpu else 1
        target, reference = TARGETS.get(name, OTHER_TARGET)
        if self.quick:
            target, reference = target * QUICK_ERROR, reference // 8
        return Effort(
            device=self.device,
            threads=self.threads,
            build=self.build,
            size=self.size or (max(1, round(width / scale)), max(1, round(height / scale))),
            spp=self.spp or (32 if self.quick else 16 if cpu else 64),
            repeat=3 if self.quick else 5,
            target=target,
            seeds=self.seeds if self.seeds is not None else 3 if self.quick else 5,
            reference_spp=reference,
        )


def _row(result: dict[str, Any]) -> str:
    """A line of the table. The peak is the device's, on the CPU the process's."""
    from destello.memory import words

    triangles = result["triangles"]
    build = f"{result['build_Mtris_s']:.3g}" if triangles >= 1000 else "-"
    size = "x".join(map(str, result["size"]))
    each = f"{sum(result['triangle_bytes'].values()):.1f}" if triangles >= 1000 else "-"
    peak = words(result["peak_device_bytes"] or result["peak_host_bytes"] or 0)
    rates = f"{result['kernel_Msamples_s']:>11.4g} {result['kernel_Mrays_s']:>9.4g} {peak:>10}"
    return f"{result['scene']:<16}{size:>10} {triangles:>10} {build:>14} {each:>10} {rates}  {_error_words(result)}"


def _paths(result: dict[str, Any]) -> str:
    """What the paths under way take."""
    from destello.memory import words

    if not result["path_bytes"]:
        return "paths: in registers and on the stack"
    whole = words(result["paths"] * result["path_bytes"])
    where = words(result["path_device_bytes"])
    return f"paths: {result['path_bytes']} bytes each, {result['paths']} at once: {whole}, {where} in device memory"


def _error_words(result: dict[str, Any]) -> str:
    if "seconds_to_error" not in result:
        return "not measured"
    target = f"MSE {result['target_relative_mse']:g}"
    if result["seconds_to_error"] is None:
        return f"{target} not reached with {result['reference_spp'] // 2} spp"
    return f"{result['seconds_to_error']:.3g} ({result['spp_to_error']:.3g} spp to {target})"
