"""Ratios of two runs, entry by entry, the worst first. Reads what the scripts here and `destello bench --json` write.

    python benches/compare.py before.json after.json --threshold 0.05
    python benches/compare.py peers.json                                   # destello against the others of one run

An entry is compared with the one of the same scene, size, samples, depth, detail, device and so on. A ratio above 1
means that the second run is better, whether more or less of that figure is good. Exit codes: 0; 1: with --threshold,
something fell by more than that; 2: a file cannot be read, or nothing matches.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Two entries are the same measurement if they agree in all of these.
IDENTITY = (
    "scene", "size", "spp", "max_depth", "detail", "device", "threads", "peer", "kind", "count", "method", "build",
    "surface", "target_relative_mse", "reference_spp",
)  # fmt: skip

# The figures that are compared: 1 where more is better, -1 where less is.
FIGURES = {
    "kernel_Msamples_s": 1,
    "kernel_Mrays_s": 1,
    "Msamples_s": 1,
    "Mrays_s": 1,
    "build_Mtris_s": 1,
    "seconds_to_error": -1,
    "spp_to_error": -1,
    "sah_cost": -1,
    "bvh_bytes_per_triangle": -1,
}
_OTHER_HITS, _OTHER_PICTURE = 0.01, 0.02  # from where it is said that peers did not do the same
_TOO_SMALL_TO_TIME = 1000  # triangles: below, a build's time says nothing

Entries = dict[tuple[str, ...], dict[str, Any]]


class Unreadable(Exception):
    """A file that holds no measurements."""


@dataclass(frozen=True)
class Ratio:
    """One figure of one measurement in both runs; `ratio` is above 1 where the second is better."""

    ratio: float
    figure: str
    name: str
    before: float
    after: float


def read(path: Path) -> Entries:
    """The measurements in a file of JSON lines, or of `destello bench`. Raises Unreadable."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise Unreadable(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    found = {}
    for entry in _parse(path, text):
        if "scene" in entry:
            found[tuple(json.dumps(entry.get(name)) for name in IDENTITY)] = entry
    if not found:
        raise Unreadable(f"{path}: no measurements in it (expected lines of JSON, or a file of destello bench --json)")
    return found


def _parse(path: Path, text: str) -> Iterator[dict[str, Any]]:
    try:
        whole = json.loads(text)
    except ValueError:
        yield from _parse_lines(path, text)
        return
    run = whole if isinstance(whole, dict) else {"results": whole}
    shared = {name: run[name] for name in ("device", "threads") if name in run}
    results = run.get("results", [run])
    for entry in results if isinstance(results, list) else []:
        if isinstance(entry, dict):
            yield {**shared, **entry}


def _parse_lines(path: Path, text: str) -> Iterator[dict[str, Any]]:
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            entry = json.loads(line)
        except ValueError as error:
            raise Unreadable(f"{path}:{number}: not JSON: {error}") from error
        if isinstance(entry, dict):
            yield entry


def compare(before: Entries, after: Entries) -> list[Ratio]:
    """Every figure that both runs have, the worst ratio first."""
    found = []
    for key in before.keys() & after.keys():
        a, b = before[key], after[key]
        for figure, sign in FIGURES.items():
            if figure == "build_Mtris_s" and a.get("triangles", 0) < _TOO_SMALL_TO_TIME:
                continue
            x, y = a.get(figure), b.get(figure)
            if isinstance(x, int | float) and isinstance(y, int | float) and x > 0 and y > 0:
                found.append(Ratio((y / x) ** sign, figure, label(a), x, y))
    return sorted(found, key=lambda r: (r.ratio, r.name, r.figure))


def label(entry: dict[str, Any]) -> str:
    """A measurement in a few words."""
    words = [str(entry["scene"])]
    if entry.get("size"):
        words.append("x".join(map(str, entry["size"])))
    if entry.get("spp"):
        words.append(f"{entry['spp']} spp")
    if entry.get("detail") not in (None, 1):
        words.append(f"detail {entry['detail']}")
    words += [str(entry[name]) for name in ("kind", "method", "peer", "device") if entry.get(name)]
    return ", ".join(words)


def peer_ratios(results: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Lines that set each peer of a run of `peers.py` against destello in the same run."""
    results = list(results)

    def measured(result: dict[str, Any]) -> tuple[Any, ...]:
        return tuple(json.dumps(result.get(name)) for name in ("scene", "detail", "size", "kind", "ray_threads"))

    own = {measured(r): r for r in results if r["peer"] in ("destello", "destello rays", "destello rays (1 thread)")}
    for r in results:
        figure = "Msamples_s" if "Msamples_s" in r else "Mrays_s"
        name = r["scene"] if r["detail"] == 1 else f"{r['scene']}:{r['detail']:g}"
        line = f"{name:<16}{r['kind']:<10}{r['peer']:<26}{r[figure]:>9.4g} {figure[:-2]}/s"
        mine = own.get(measured(r))
        if mine is not None and mine is not r:
            line += f"   destello: {mine[figure] / r[figure]:.2f} times that"
            line += "".join(_differences(mine, r))
        yield line


def _differences(mine: dict[str, Any], other: dict[str, Any]) -> Iterator[str]:
    """What else there is to say of two measurements: less noise a sample, or not the same picture or hits."""
    if mine.get("kernel_Msamples_s") and other.get("kernel_Msamples_s"):
        yield f", {mine['kernel_Msamples_s'] / other['kernel_Msamples_s']:.2f} without the copy to the host"
    if mine.get("relative_mse") and other.get("relative_mse"):
        noise = mine["relative_mse"] / other["relative_mse"]
        speed = mine["Msamples_s"] / other["Msamples_s"]
        yield f", {speed / noise:.2f} for the same noise"
    if abs(mine.get("hit", 0) - other.get("hit", 0)) > _OTHER_HITS:
        yield f", BUT {other['hit']:.1%} of the rays hit instead of {mine['hit']:.1%}"
    if "mean" in mine and "mean" in other:
        off = max(abs(a - b) / max(a, b, 1e-9) for a, b in zip(mine["mean"], other["mean"], strict=True))
        if off > _OTHER_PICTURE:
            yield f", BUT the picture's mean is {other['mean']} instead of {mine['mean']}"


def main() -> int:
    """Prints the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, metavar="A.json")
    parser.add_argument("after", type=Path, metavar="B.json", nargs="?", help="without it: peers within A.json")
    parser.add_argument("--threshold", type=float, metavar="T", help="fail if a ratio is below 1 - T; 0.05: by 5 %%")
    args = parser.parse_args()
    if args.threshold is not None and not 0 <= args.threshold < 1:
        parser.error(f"argument --threshold: {args.threshold} (expected 0 or more, below 1)")
    try:
        before = read(args.before)
        if args.after is None:
            return _print_peers(args.before, before)
        after = read(args.after)
    except Unreadable as error:
        print(f"compare.py: {error}", file=sys.stderr)
        return 2
    ratios = compare(before, after)
    for r in ratios:
        print(f"{r.ratio:7.3f}  {r.figure:<22} {r.before:>10.4g} -> {r.after:<10.4g} {r.name}")
    for name, mine, other in ((args.before, before, after), (args.after, after, before)):
        for key in mine.keys() - other.keys():
            print(f"only in {name}: {label(mine[key])}", file=sys.stderr)
    if not ratios:
        print("compare.py: the files have no measurement in common", file=sys.stderr)
        return 2
    limit = 0.0 if args.threshold is None else 1 - args.threshold
    fallen = [r for r in ratios if r.ratio < limit]
    if fallen:
        print(f"{len(fallen)} of {len(ratios)} figures fell by more than {args.threshold:.0%}", file=sys.stderr)
    return 1 if fallen else 0


def _print_peers(path: Path, run: Entries) -> int:
    results = [entry for entry in run.values() if "peer" in entry]
    if not results:
        raise Unreadable(f"{path}: no peers in it (expected a file of peers.py, or a second file to compare with)")
    for line in peer_ratios(results):
        print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
