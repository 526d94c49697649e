"""Ratios of two runs, entry by entry, the worst first. Reads what the scripts here and `destello bench --json` write.

    python benches/compare.py before.json after.json --threshold 0.05

An entry is compared with the one of the same scene, size, samples, depth, detail, device and so on. A ratio above 1
means that the second run is better, whether more or less of that figure is good. Exit codes: 0; 1: with --threshold,
something fell by more than that; 2: a file cannot be read, or nothing matches.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Two entries are the same measurement if they agree in all of these.
IDENTITY = (
    "scene", "size", "spp", "max_depth", "detail", "device", "threads", "peer", "kind", "count", "method",
    "target_relative_mse", "reference_spp",
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


def main() -> int:
    """Prints the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, metavar="A.json")
    parser.add_argument("after", type=Path, metavar="B.json")
    parser.add_argument("--threshold", type=float, metavar="T", help="fail if a ratio is below 1 - T; 0.05: by 5 %%")
    args = parser.parse_args()
    if args.threshold is not None and not 0 <= args.threshold < 1:
        parser.error(f"argument --threshold: {args.threshold} (expected 0 or more, below 1)")
    try:
        before, after = read(args.before), read(args.after)
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


if __name__ == "__main__":
    sys.exit(main())
