"""Write core/bsdf/openpbr/tables.h: albedos of OpenPBR's lobes, by quadrature.

Usage: python tools/openpbr_tables.py > core/bsdf/openpbr/tables.h, on all cores; a quarter of an hour of one.
"""

from __future__ import annotations

import itertools
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from microfacets import Floats, evened, lattice, lines
from openpbr_facets import (
    MOST_RATIO,
    MOST_STRETCH,
    Facets,
    alphas,
    anisotropic,
    by_two,
    isotropic,
    place,
    seen_cosine,
    steady,
    two_cosines,
)

COSINES, ROUGHNESSES = 32, 32  # isotropic facets: by `place`, and by roughness
MEAN_RATIOS = 65  # of the means: by s = (eta - 1) / (eta + 1)
# Anisotropic: by `place`, the root of how far alpha along the azimuth is from ay to ax, (ax - ay) / (ax + ay),
# roughness.
STRETCHED = (18, 9, 8, 13)
STRETCHED_MEAN_RATIOS = 33
# Between two nodes of a table the mean of what is looked up bends: means have more nodes, by the root of roughness.
MEAN_ROUGHNESSES, MEAN_STRETCHES, STRETCHED_MEAN_ROUGHNESSES = 61, 2 * STRETCHED[2] - 1, 45
FUZZ_COSINES, FUZZ_ROUGHNESSES, LEAST_FUZZ = 48, 24, 0.1
FINE, COARSE = lattice(23), lattice(21)  # points of quadrature for isotropic and anisotropic facets


def grid(n: int) -> Floats:
    """Return n nodes over [0, 1]."""
    return np.linspace(0, 1, n)


# --- facets ----------------------------------------------------------------------------------------------------------


def fitted(facets: list[Facets], known: list[Floats] | None) -> tuple[list[Floats], list[Floats]]:
    """Return (4,) for each of a row of facets: lost, two cosines over the seen one, weight; and the fits themselves.

    `known`: the fits of the row beside.
    """
    numbers: list[Floats] = []
    fits: list[Floats] = []
    for i, f in enumerate(facets):
        starts = [*([fits[-1]] if fits else []), *([known[i]] if known else [])]
        lost, v = two_cosines(f, starts)
        fits.append(v)
        numbers.append(np.array([lost, *np.exp(v[:2]), 1 / (1 + np.exp(-v[2]))]))
    return numbers, fits


def facet_table() -> Floats:
    """Return (roughness, cosine, 4)."""
    rows, known = [], None
    for r in grid(ROUGHNESSES)[::-1]:
        row, known = fitted([isotropic(c, r, FINE) for c in grid(COSINES)], known)
        rows.append(row)
    return evenly_lost(np.array(rows[::-1]))


def stretched_column(stretch_and_turn: tuple[float, float]) -> Floats:
    """Return (roughness, cosine, 4)."""
    rows, known = [], None
    for r in grid(STRETCHED[3])[::-1]:
        row, known = fitted([anisotropic(c, *stretch_and_turn[::-1], r, COARSE) for c in grid(STRETCHED[0])], known)
        rows.append(row)
    return np.array(rows[::-1])


def stretched_table() -> Floats:
    """Return (roughness, stretch, turn, cosine, 4)."""
    cosines, turns, stretches, roughnesses = STRETCHED
    with ProcessPoolExecutor() as pool:
        columns = list(pool.map(stretched_column, itertools.product(grid(stretches) * MOST_STRETCH, grid(turns))))
    rows = np.array(columns).reshape(stretches, turns, roughnesses, cosines, 4)
    return evenly_lost(rows.transpose(2, 0, 1, 3, 4))


def evenly_lost(facets: Floats) -> Floats:
    """Return the table (..., 4) with what is lost evened between nodes."""
    lost = facets[..., 0]
    for axis in range(lost.ndim):
        lost = evened(lost, axis)
    return np.concatenate([np.clip(lost, 0, 1)[..., None], facets[..., 1:]], axis=-1)


# --- their means over directions, as the core looks the tables up -----------------------------------------------------


def between(values: Floats, at: Floats) -> Floats:
    """Interpolate (n, ...) linearly at places (N,) in [0, 1]: (N, ...)."""
    t = np.clip(at, 0, 1) * (len(values) - 1)
    i = np.minimum(t.astype(int), len(values) - 2)
    f = (t - i).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(values[i] * (1 - f) + values[i + 1] * f)


def mean_reflected(facets: Floats, seen: Floats, weights: Floats, ratios: int) -> Floats:
    """Return (ratios,) of numbers (N, 4) of directions that weigh `weights` (N,)."""
    s = grid(ratios)[:-1]
    eta = ((1 + s) / (1 - s))[:, None]
    lost, low, high = facets[:, 0], *(np.minimum(facets[:, k] * seen, 1) for k in (1, 2))
    up = by_two(lost, low, high, facets[:, 3], np.maximum(eta, 1 + 1e-7)) @ weights
    return np.append(up, (1 - lost) @ weights)


def isotropic_means(facets: Floats) -> tuple[Floats, Floats]:
    """Return means (roughness,) of what perfect facets lose, and (roughness, MEAN_RATIOS) of what is reflected."""
    x = (np.arange(2000) + 0.5) / 2000
    weights = 4 * x**3 / len(x)
    lost, up = [], []
    rs = grid(MEAN_ROUGHNESSES) ** 2
    for r, f in zip(rs, between(facets, rs), strict=True):
        at = between(f, place(x, r))
        lost.append(at[:, 0] @ weights)
        up.append(mean_reflected(at, seen_cosine(x * x, r * r), weights, MEAN_RATIOS))
    return np.array(lost), np.array(up)


def rough_diffuse(cosine: Floats, incident: Floats) -> Floats:
    """Return pi times the roughest white EON (core/bsdf/diffuse.h), its mean over azimuths: (N, M)."""
    o, i, phi = cosine[:, None, None], incident[None, :, None], (np.arange(64) + 0.5) * np.pi / 64
    a, of_mean = 1 / (1.5 - 2 / (3 * np.pi)), 2 / 3 - 28 / (15 * np.pi)

    def lost(z: Floats) -> Floats:
        s = np.sqrt(1 - z * z)
        g = s * (np.arccos(z) - s * z) + 2 / 3 * (s * z * (1 + s + s * s) / (1 + s) - s)
        return np.asarray(1 - a * (1 + g / np.pi))

    s = np.sqrt((1 - o * o) * (1 - i * i)) * np.cos(phi)
    single = a * (1 + np.where(s > 0, s / np.maximum(o, i), s))
    return np.asarray(single.mean(axis=-1) + lost(cosine)[:, None] * lost(incident) / (1 - a * (1 + of_mean)))


def coupling_table(facets: Floats) -> Floats:
    """Return (roughness, MEAN_RATIOS): see `rough_coupling` in albedo.h.

    What white EON of roughness 1 gives of the light that gloss leaves, beyond Lambert's, is this times that function
    of the cosine: fitted where gloss leaves most.
    """
    z, w = np.polynomial.legendre.leggauss(64)
    mu, w = (z + 1) / 2, w * (z + 1) / 2
    shape = 1 - 8 * (1 - mu) ** 2.5
    kernel = rough_diffuse(mu, mu) * w
    s = np.minimum(grid(MEAN_RATIOS), 0.999)
    out = []
    for r, f in zip(grid(ROUGHNESSES), facets, strict=True):
        at, seen = between(f, place(np.sqrt(mu), r)), seen_cosine(mu, r * r)
        low, high = (np.minimum(at[:, k] * seen, 1) for k in (1, 2))
        eta = np.maximum((1 + s) / (1 - s), 1 + 1e-7)[:, None]
        left = 1 - by_two(at[:, 0], low, high, at[:, 3], eta)
        beyond = left @ kernel.T / (left @ w)[:, None] - 1
        out.append((beyond * left**2 * w) @ shape / ((shape * left) ** 2 @ w))
    return np.clip(out, -0.03, 0.03)  # far beyond kMostIor it would be more


def stretched_directions(stretch: float, roughness: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return place, turn, seen cosine and weight of directions evenly over a quarter."""
    x, phi = (a.ravel() for a in np.meshgrid((np.arange(100) + 0.5) / 100, (np.arange(64) + 0.5) * np.pi / 128))
    ax, ay = alphas(roughness, max(stretch, 1e-3))
    along = np.hypot(ax * np.cos(phi), ay * np.sin(phi))
    turn = np.sqrt((along - ay) / (ax - ay)) if ax > ay else phi * 0
    return place(x, np.sqrt(along)), turn, seen_cosine(x * x, along), 4 * x**3 / len(x)


def stretched_means(facets: Floats) -> tuple[Floats, Floats]:
    """Return the same with stretch after roughness."""

    def rows_at(table: Floats, c: Floats, turn: Floats) -> Floats:
        t = np.clip(turn, 0, 1) * (len(table) - 1)
        i = np.minimum(t.astype(int), len(table) - 2)
        out = np.empty((len(c), table.shape[-1]))
        for k in range(len(table) - 1):
            m = i == k
            f = (t[m] - k)[:, None]
            out[m] = between(table[k], c[m]) * (1 - f) + between(table[k + 1], c[m]) * f
        return out

    lost, up = [], []
    rs, stretches = grid(STRETCHED_MEAN_ROUGHNESSES) ** 2, grid(MEAN_STRETCHES)
    for r, rows in zip(rs, between(facets, rs), strict=True):
        for s, row in zip(stretches * MOST_STRETCH, between(rows, stretches), strict=True):
            c, turn, seen, weights = stretched_directions(s, r)
            at = rows_at(row, c, turn)
            lost.append(at[:, 0] @ weights)
            up.append(mean_reflected(at, seen, weights, STRETCHED_MEAN_RATIOS))
    return np.array(lost), np.array(up)


def fuzz_albedo(mu: float, roughness: float) -> float:
    """Return the albedo of the fuzz lobe (core/bsdf/openpbr/fuzz.h) of unit colour before normalisation."""
    alpha = max(roughness, LEAST_FUZZ) ** 2
    x, w = np.polynomial.legendre.leggauss(200)
    z, wz = (x + 1) / 2, w / 2
    phi = (np.arange(256) + 0.5) * np.pi / 256
    zz, pp = np.meshgrid(z, phi, indexing="ij")
    wi = np.stack([np.sqrt(1 - zz**2) * np.cos(pp), np.sqrt(1 - zz**2) * np.sin(pp), zz], -1)
    h = wi + np.array([np.sqrt(1 - mu * mu), 0, mu])
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    sine = np.sqrt(np.clip(1 - h[..., 2] ** 2, 0, 1))
    d = (2 + 1 / alpha) * sine ** (1 / alpha) / (2 * np.pi)
    f = d / (4 * (mu + zz - mu * zz)) * zz
    return float(np.sum(f.mean(axis=1) * wz) * 2 * np.pi)


# --- C++ -------------------------------------------------------------------------------------------------------------


def table(name: str, doc: str, values: Floats) -> str:
    """Return a function that looks up 16-bit fractions."""
    body = lines([f"{round(v * 65535)}," for v in values.ravel()])
    return (
        f"\n// {doc}\nDST_FN uint16_t {name}(int i) {{\n"
        f"  static constexpr uint16_t kTable[{values.size}] = {{\n{body}\n"
        "  };\n  return kTable[i];\n}"
    )


def facet_entries(name: str, doc: str, values: Floats) -> str:
    """Return a function that looks up the four numbers of facets (..., 4)."""
    flat = (values / [1, MOST_RATIO, MOST_RATIO, 1]).reshape(-1, 4)
    body = lines([f"{{{', '.join(str(round(v * 65535)) for v in row)}}}," for row in flat])
    return (
        f"\n// {doc}\nDST_FN FacetEntry {name}(int i) {{\n"
        f"  static constexpr FacetEntry kTable[{len(flat)}] = {{\n{body}\n"
        "  };\n  return kTable[i];\n}"
    )


def sizes() -> str:
    """Return the tables' sizes as constants."""
    names = {
        "kCosines": COSINES, "kRoughnesses": ROUGHNESSES, "kMeanRatios": MEAN_RATIOS,
        "kMeanRoughnesses": MEAN_ROUGHNESSES, "kMeanStretches": MEAN_STRETCHES,
        "kStretchedMeanRoughnesses": STRETCHED_MEAN_ROUGHNESSES, "kStretchedMeanRatios": STRETCHED_MEAN_RATIOS,
        **dict(zip(("kStretchedCosines", "kTurns", "kStretches", "kStretchedRoughnesses"), STRETCHED, strict=True)),
        "kFuzzCosines": FUZZ_COSINES, "kFuzzRoughnesses": FUZZ_ROUGHNESSES,
    }  # fmt: skip
    return "\n".join(f"inline constexpr int {name} = {n};" for name, n in names.items())


HEAD = f"""\
// Written by tools/openpbr_tables.py; do not edit.
//
// GGX facets (Smith, height-correlated, single scattering). What the axes are is in albedo.h.
// 16-bit fractions of 1; cosines are over that of `seen_cosine`, a fraction of kMostRatio.
#pragma once

#include "base/vec.h"

namespace destello::openpbr {{

{sizes()}
inline constexpr float kMostStretch = {MOST_STRETCH}f, kMostRatio = {MOST_RATIO}, kLeastFuzz = {LEAST_FUZZ}f;

struct alignas(8) FacetEntry {{
  uint16_t lost, low, high, weight;
}};
"""


def main() -> None:
    """Print the header."""
    facets, stretched = facet_table(), stretched_table()
    means = isotropic_means(facets), stretched_means(stretched)
    mus = np.maximum(grid(FUZZ_COSINES) ** 2, 1e-4)
    rs = LEAST_FUZZ + (1 - LEAST_FUZZ) * grid(FUZZ_ROUGHNESSES) ** 2
    fuzz = np.array([[fuzz_albedo(mu, r) for mu in mus] for r in rs])
    print(HEAD, end="")
    print(facet_entries("facet_entry", "Isotropic facets: place, roughness.", facets))
    print(facet_entries("stretched_entry", "Anisotropic facets: place, turn, stretch, roughness.", stretched))
    rows = grid(MEAN_ROUGHNESSES) ** 2, np.repeat(grid(STRETCHED_MEAN_ROUGHNESSES) ** 2, MEAN_STRETCHES)
    for prefix, (lost, reflected), r in zip(("", "stretched_"), means, rows, strict=True):
        doc = "Mean of what perfect facets lose, over roughness^1.5."
        print(table(f"{prefix}lost_mean_entry", doc, steady(lost, r)))
        print(table(f"{prefix}reflected_mean_entry", "Mean of what dielectrics reflect, by s first.", reflected))
    doc = "Half and 16 times what rough diffuse bases are to be held back by: by s first."
    print(table("coupling_entry", doc, 0.5 + 16 * coupling_table(facets)))
    doc = "A quarter of the albedo of the fuzz lobe, which may exceed 1 before it is normalised."
    print(table("fuzz_entry", doc, fuzz / 4))
    print("\n}  // namespace destello::openpbr")


if __name__ == "__main__":
    main()
