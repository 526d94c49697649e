"""Write core/bsdf/openpbr/film_tables.h: the cosines at which facets below a thin film are seen, and its wavelengths.

Usage: python tools/openpbr_film_tables.py > core/bsdf/openpbr/film_tables.h, then clang-format -i on it. Takes a
minute.
"""

from __future__ import annotations

import numpy as np

from destello._core import testing
from microfacets import Floats, lattice, lines, toward
from openpbr_facets import LEAST_ROUGHNESS, MOST_STRETCH, Facets, alphas, anisotropic, isotropic, seen_cosine

STRATA, MEAN_STRATA = 8, 16  # of a direction's facets, and of all directions'
COSINES, ROUGHNESSES = 40, 32
STRETCHED, MEAN_STRETCHED = (12, 6, 5, 10), (5, 19)  # cosine, turn, stretch, roughness
FINE, COARSE, FEW = lattice(21), lattice(19), lattice(15)  # points of quadrature
WAVELENGTHS = 16


def edges(strata: int) -> Floats:
    """Return (strata + 1,) shares of facets below the strata's edges: few in the first and the last."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(strata + 1) / strata))


def stratified(cosines: Floats, weights: Floats, strata: int) -> Floats:
    """Return the mean cosine (strata,) in each."""
    order = np.argsort(cosines)
    c, w = cosines[order], np.maximum(weights[order], 1e-12)
    below = np.append(0, np.cumsum(w) / w.sum())
    sums = np.interp(edges(strata), below, np.append(0, np.cumsum(w * c) / w.sum()))
    return np.diff(sums) / np.diff(edges(strata))


def seen(facets: Facets) -> Floats:
    """Return (STRATA,) cosines of the facets that a direction sees, over about the mean one."""
    along = np.hypot(facets.ax * facets.out[0], facets.ay * facets.out[1]) / np.hypot(*facets.out[:2])
    return stratified(facets.cosine, facets.kept, STRATA) / float(seen_cosine(facets.out[2], along))


def places(n: int) -> Floats:
    """Return the directions' coordinates by `place`, closer where facets are seen from above."""
    return np.asarray(1 - np.linspace(1, 0, n) ** 2)


def seen_table() -> Floats:
    """Return (roughness, cosine, STRATA)."""
    cosines, roughnesses = places(COSINES), np.linspace(0, 1, ROUGHNESSES)
    return np.array([[seen(isotropic(c, r, FINE)) for c in cosines] for r in roughnesses])


def stretched_table() -> Floats:
    """Return (roughness, stretch, turn, cosine, STRATA)."""
    cosines, turns, stretches, roughnesses = places(STRETCHED[0]), *(np.linspace(0, 1, n) for n in STRETCHED[1:])

    def at(c: float, t: float, s: float, r: float) -> Floats:
        return seen(anisotropic(c, t, s * MOST_STRETCH, r, COARSE))

    return np.array([[[[at(c, t, s, r) for c in cosines] for t in turns] for s in stretches] for r in roughnesses])


def of_all(roughness: float, stretch: float, turns: int) -> Floats:
    """Return (MEAN_STRATA,) of cosine-distributed directions."""
    ax, ay = alphas(max(roughness, LEAST_ROUGHNESS), stretch)
    mu, cos_phi = np.sqrt((np.arange(100) + 0.5) / 100), np.cos((np.arange(turns) + 0.5) * np.pi / (2 * turns))
    parts = [Facets.seen(toward(z, c), ax, ay, FEW) for z in mu for c in cos_phi]
    cosines, kept = np.concatenate([f.cosine for f in parts]), np.concatenate([f.kept for f in parts])
    return stratified(cosines, kept, MEAN_STRATA)


def mean_table() -> Floats:
    """Return (roughness, MEAN_STRATA)."""
    return np.array([of_all(r, 0, 1) for r in np.linspace(0, 1, ROUGHNESSES)])


def mean_stretched_table() -> Floats:
    """Return (roughness, stretch, MEAN_STRATA)."""
    stretches, roughnesses = (np.linspace(0, 1, n) for n in MEAN_STRETCHED)
    return np.array([[of_all(r, s * MOST_STRETCH, 8) for s in stretches] for r in roughnesses])


# --- C++ -------------------------------------------------------------------------------------------------------------


def entries(name: str, doc: str, values: Floats) -> str:
    """Return a function that looks up strata (..., n) of cosines c, kept as c / (1 + c)."""
    n = values.shape[-1]
    rows = np.round(values / (1 + values) * 65535).astype(int).reshape(-1, n)
    body = lines([f"{{{{{', '.join(map(str, row))}}}}}," for row in rows])
    return (
        f"\n// {doc}\nDST_FN CosineEntry<{n}> {name}(int i) {{\n"
        f"  static constexpr CosineEntry<{n}> kTable[{len(rows)}] = {{\n{body}\n"
        "  };\n  return kTable[i];\n}"
    )


def numbers(name: str, doc: str, rows: Floats, kind: str) -> str:
    """Return a function that looks up numbers (n,), or triples of them (n, 3)."""
    words = [f"{row:.9g}f," if np.ndim(row) == 0 else f"{{{', '.join(f'{x:.7f}f' for x in row)}}}," for row in rows]
    triples = rows.ndim > 1
    found = "{kTable[i][0], kTable[i][1], kTable[i][2]}" if triples else "kTable[i]"
    return (
        f"\n// {doc}\nDST_FN {kind} {name}(int i) {{\n"
        f"  static constexpr float kTable[{len(rows)}]{'[3]' if triples else ''} = {{\n{lines(words)}\n"
        f"  }};\n  return {found};\n}}"
    )


def wavelengths() -> tuple[Floats, Floats]:
    """Return wavelengths in nm (n,) at which films are evaluated, and their RGB weights (n, 3), which sum to 1."""
    lo, hi = testing.WAVELENGTHS
    nm = lo + (hi - lo) * (np.arange(WAVELENGTHS) + 0.5) / WAVELENGTHS
    fine = lo + (hi - lo) * (np.arange(WAVELENGTHS * 100) + 0.5) / (WAVELENGTHS * 100)
    weight = np.asarray(testing.wavelength_weight(fine.astype(np.float32)), np.float64)
    weight = weight.reshape(WAVELENGTHS, 100, 3).mean(axis=1)
    return nm, weight / weight.sum(axis=0)


SIZES = {
    "kStrata": STRATA, "kMeanStrata": MEAN_STRATA, "kStrataCosines": COSINES, "kStrataRoughnesses": ROUGHNESSES,
    **dict(zip(("kStretchedStrataCosines", "kStrataTurns", "kStrataStretches", "kStretchedStrataRoughnesses"),
               STRETCHED, strict=True)),
    "kStretchedStrataMeanRoughnesses": MEAN_STRETCHED[1], "kFilmWavelengths": WAVELENGTHS,
}  # fmt: skip

HEAD = """\
// Written by tools/openpbr_film_tables.py; do not edit.
//
// The cosines at which GGX facets are seen that reflect light past the others, in strata from the lowest:
// the mean in each. What the axes are is in albedo.h.
#pragma once

#include "base/vec.h"

namespace destello::openpbr {

"""


def main() -> None:
    """Print the header."""
    nm, weight = wavelengths()
    print(HEAD, end="")
    print("\n".join(f"inline constexpr int {name} = {n};" for name, n in SIZES.items()))
    print("\n// Cosines c as 16-bit fractions, c / (1 + c).\ntemplate <int N>")
    print("struct alignas(16) CosineEntry {\n  uint16_t c[N];\n};")
    print(entries("strata_entry", "Isotropic facets, c over that of `seen_cosine`: place, roughness.", seen_table()))
    doc = "Anisotropic facets: place, turn, stretch, roughness."
    print(entries("stretched_strata_entry", doc, stretched_table()))
    print(entries("mean_strata_entry", "Of cosine-distributed directions: roughness.", mean_table()))
    doc = "Of anisotropic facets: stretch, roughness."
    print(entries("stretched_mean_strata_entry", doc, mean_stretched_table()))
    doc = "The share of facets that each of kMeanStrata strata has; one of kStrata has those of two."
    print(numbers("stratum_share", doc, np.diff(edges(MEAN_STRATA)), "float"))
    print(numbers("film_waves", "The inverse of the wavelength, 1/nm.", 1 / nm, "float"))
    print(numbers("film_weight", "The wavelength's share of each of red, green and blue.", weight, "Vec3"))
    print("\n}  // namespace destello::openpbr")


if __name__ == "__main__":
    main()
