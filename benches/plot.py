"""Curves for the docs: rays a second, and build time, against the number of triangles. Needs matplotlib.

    python benches/rays.py  mesh1m:0.001 mesh1m:0.01 mesh1m:0.1 mesh1m terrain > rays.json
    python benches/build.py mesh1m:0.001 mesh1m:0.01 mesh1m:0.1 mesh1m terrain > build.json
    python benches/plot.py rays.json build.json -o docs/plots

Reads the lines of both scripts, from any number of files. For every device it draws rays-DEVICE.svg (a curve for each
kind of ray), and builds of all devices and qualities into build.svg.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from compare import Unreadable, read

KINDS = ("primary", "ao", "bounce", "shuffled", "random")
QUALITIES = ("fast", "balanced", "high")
_LINES = {"fast": ":", "balanced": "-", "high": "--"}
_INK = "#333333"

Curve = list[tuple[int, float]]


def curves(entries: Iterable[dict[str, Any]], figure: str, *names: str) -> dict[tuple[str, ...], Curve]:
    """(triangles, figure) by triangles, for each combination of the names' values; of one point the last counts."""
    found: dict[tuple[str, ...], dict[int, float]] = defaultdict(dict)
    for entry in entries:
        if entry.get("triangles") and entry.get(figure):
            found[tuple(str(entry.get(name)) for name in names)][entry["triangles"]] = entry[figure]
    return {key: sorted(points.items()) for key, points in found.items()}


def figure(title: str, unit: str) -> tuple[Any, Any]:
    """An empty picture with triangles along its width, both axes logarithmic."""
    from matplotlib import pyplot as plt

    plt.rcParams.update({"svg.hashsalt": "destello", "svg.fonttype": "none", "font.size": 10, "text.color": _INK})
    made, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
    axes.set(xscale="log", yscale="log", xlabel="triangles", ylabel=unit)
    axes.set_title(title, loc="left", fontsize=11)
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    return made, axes


def save(made: Any, path: Path) -> None:
    """Writes the picture, the same bytes for the same curves."""
    made.savefig(path, metadata={"Date": None})
    print(path)


def plot_rays(entries: list[dict[str, Any]], folder: Path) -> None:
    """A picture for each device."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    rays = [entry for entry in entries if entry.get("kind") in KINDS and "method" in entry]
    for device in sorted({entry["device"] for entry in rays}):
        mine = [entry for entry in rays if entry["device"] == device]
        made, axes = figure(f"Rays a second: {_about(mine[-1])}", "Mrays/s")
        found = curves(mine, "Mrays_s", "kind")
        for kind in KINDS:
            if (kind,) in found:
                axes.plot(*zip(*found[kind,], strict=True), marker="o", markersize=4, label=kind)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.legend(frameon=False)
        save(made, folder / f"rays-{_file_name(mine[-1])}.svg")


def plot_builds(entries: list[dict[str, Any]], folder: Path) -> None:
    """One picture of all devices."""
    builds = [entry for entry in entries if entry.get("kind") == "build" and entry.get("triangles")]
    if not builds:
        return
    made, axes = figure("Build time, from arrays to a finished scene", "seconds")
    found = curves(builds, "build_seconds", "device_name", "build")
    labels = {entry["device_name"]: _about(entry) for entry in builds}
    for number, device in enumerate(sorted(labels)):
        for quality in QUALITIES:
            if (device, quality) in found:
                style = {"color": f"C{number}", "linestyle": _LINES[quality], "marker": "o", "markersize": 4}
                points = zip(*found[device, quality], strict=True)
                axes.plot(*points, label=f"{labels[device]}, {quality}", **style)
    made.set_figheight(5.4)
    made.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    save(made, folder / "build.svg")


def _about(entry: dict[str, Any]) -> str:
    if entry["device_name"] != "cpu":
        return str(entry["device"])
    threads = entry.get("threads") or entry.get("cores")
    return f"{entry.get('cpu')}, {threads} thread{'s' if threads != 1 else ''}"


def _file_name(entry: dict[str, Any]) -> str:
    return str(entry["device_name"]).partition(":")[0]


def main() -> int:
    """Draws what the files hold; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.json")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/plots"), help="a folder (docs/plots)")
    args = parser.parse_args()
    try:
        import matplotlib as mpl
    except ImportError:
        print("plot.py: needs matplotlib: pip install matplotlib", file=sys.stderr)
        return 2
    mpl.use("svg")
    try:
        entries = [entry for path in args.files for entry in read(path).values()]
    except Unreadable as error:
        print(f"plot.py: {error}", file=sys.stderr)
        return 2
    args.output.mkdir(parents=True, exist_ok=True)
    plot_rays(entries, args.output)
    plot_builds(entries, args.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
