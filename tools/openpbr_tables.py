"""Write core/bsdf/openpbr/tables.h: albedos of OpenPBR's lobes, by quadrature.

Usage: python tools/openpbr_tables.py > core/bsdf/openpbr/tables.h, then clang-format -i on it. Takes two minutes.
"""

from __future__ import annotations

import numpy as np

from microfacets import Floats, lattice, lines
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
    step,
    two_cosines,
)

COSINES, ROUGHNESSES = 24, 24  # isotropic facets: by `place`, and by roughness
BELOW, ABOVE = 21, 13  # nodes of the ratio of indices below and above 1, by `step`; they share the one at 1
MEAN_RATIOS, MEAN_STEPS = 33, 33  # of the means: by s = (eta - 1) / (eta + 1), and by its signed root
# Anisotropic: by `place`, the root of how far alpha along the azimuth is from ay to ax, (ax - ay) / (ax + ay),
# roughness.
STRETCHED, STRETCHED_LOSS = (12, 6, 5, 10), (10, 8, 5, 8)
STRETCHED_BELOW, STRETCHED_ABOVE = 12, 9
STRETCHED_MEAN_RATIOS, STRETCHED_MEAN_STEPS = 17, 17
# Between two roughnesses of a table the mean of what is looked up bends: means have those between, too.
MEAN_ROUGHNESSES, STRETCHED_MEAN_ROUGHNESSES, LOSS_MEAN_ROUGHNESSES = (
    2 * n - 1 for n in (ROUGHNESSES, STRETCHED[3], STRETCHED_LOSS[3])
)
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
    return np.array(rows[::-1])


def stretched_table() -> Floats:
    """Return (roughness, stretch, turn, cosine, 4)."""
    cosines, turns, stretches, roughnesses = STRETCHED
    out = np.empty((roughnesses, stretches, turns, cosines, 4))
    known: dict[int, list[Floats]] = {}  # by stretch: the fits of the first turn
    beside: list[Floats] | None = None
    for i in range(roughnesses)[::-1]:
        for j, stretch in enumerate(grid(stretches) * MOST_STRETCH):
            beside = known.get(j, beside)
            for k, turn in enumerate(grid(turns)):
                row = [anisotropic(c, turn, stretch, grid(roughnesses)[i], COARSE) for c in grid(cosines)]
                out[i, j, k], beside = fitted(row, beside)
                if k == 0:
                    known[j] = beside
    return out


def loss_table() -> Floats:
    """Return (roughness, cosine, ratio)."""
    return np.array([[isotropic(c, r, FINE).losses(BELOW, ABOVE) for c in grid(COSINES)] for r in grid(ROUGHNESSES)])


def stretched_loss_table() -> Floats:
    """Return (roughness, stretch, turn, cosine, ratio)."""
    cosines, turns, stretches, roughnesses = (grid(n) for n in STRETCHED_LOSS)

    def at(c: float, t: float, s: float, r: float) -> Floats:
        return anisotropic(c, t, s * MOST_STRETCH, r, COARSE).losses(STRETCHED_BELOW, STRETCHED_ABOVE)

    return np.array([[[[at(c, t, s, r) for c in cosines] for t in turns] for s in stretches] for r in roughnesses])


# --- their means over directions, as the core looks the tables up -----------------------------------------------------


def between(values: Floats, at: Floats) -> Floats:
    """Interpolate (n, ...) linearly at places (N,) in [0, 1]: (N, ...)."""
    t = np.clip(at, 0, 1) * (len(values) - 1)
    i = np.minimum(t.astype(int), len(values) - 2)
    f = (t - i).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(values[i] * (1 - f) + values[i + 1] * f)


def step_place(s: Floats, seen: Floats, below: int, above: int) -> Floats:
    """Return where the table of losses, of below + above - 1 ratios, has a signed s: in [0, 1]."""
    u = step(np.abs(s), seen)
    return np.where(s < 0, (below - 1) * (1 - u), below - 1 + (above - 1) * u) / (below + above - 2)


def mean_reflected(facets: Floats, seen: Floats, weights: Floats, ratios: int) -> Floats:
    """Return (ratios,) of numbers (N, 4) of directions that weigh `weights` (N,)."""
    s = grid(ratios)[:-1]
    eta = ((1 + s) / (1 - s))[:, None]
    lost, low, high = facets[:, 0], *(np.minimum(facets[:, k] * seen, 1) for k in (1, 2))
    up = by_two(lost, low, high, facets[:, 3], np.maximum(eta, 1 + 1e-7)) @ weights
    return np.append(up, (1 - lost) @ weights)


def mean_loss(losses: Floats, seen: Floats, weights: Floats, counts: tuple[int, int, int]) -> Floats:
    """Return (steps,) of losses (N, ratios) of directions."""
    below, above, steps = counts
    t = np.linspace(-1, 1, steps)
    rows = np.arange(len(losses))
    out = []
    for s in t * np.abs(t):
        at = step_place(s, seen, below, above) * (losses.shape[1] - 1)
        i = np.minimum(at.astype(int), losses.shape[1] - 2)
        out.append((losses[rows, i] * (1 - at + i) + losses[rows, i + 1] * (at - i)) @ weights)
    return np.array(out)


def isotropic_means(facets: Floats, losses: Floats) -> tuple[Floats, Floats, Floats]:
    """Return means (roughness,) of what perfect facets lose, (roughness, MEAN_RATIOS), (roughness, MEAN_STEPS)."""
    x = (np.arange(2000) + 0.5) / 2000
    weights = 4 * x**3 / len(x)
    rows = []
    rs = grid(MEAN_ROUGHNESSES)
    for r, f, w in zip(rs, between(facets, rs), between(losses, rs), strict=True):
        c, seen = place(x, r), seen_cosine(x * x, r * r)
        at = between(f, c)
        rows.append(
            (
                at[:, 0] @ weights,
                mean_reflected(at, seen, weights, MEAN_RATIOS),
                mean_loss(between(w, c), seen, weights, (BELOW, ABOVE, MEAN_STEPS)),
            )
        )
    lost, reflected, loss = zip(*rows, strict=True)
    return np.array(lost), np.array(reflected), np.array(loss)


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


def stretched_means(facets: Floats, losses: Floats) -> tuple[Floats, Floats, Floats]:
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

    lost, up, loss = [], [], []
    for table, roughnesses in ((facets, STRETCHED_MEAN_ROUGHNESSES), (losses, LOSS_MEAN_ROUGHNESSES)):
        for r, rows in zip(grid(roughnesses), between(table, grid(roughnesses)), strict=True):
            for s, row in zip(grid(len(rows)) * MOST_STRETCH, rows, strict=True):
                c, turn, seen, weights = stretched_directions(s, r)
                at = rows_at(row, c, turn)
                if table is losses:
                    counts = STRETCHED_BELOW, STRETCHED_ABOVE, STRETCHED_MEAN_STEPS
                    loss.append(mean_loss(at, seen, weights, counts))
                else:
                    lost.append(at[:, 0] @ weights)
                    up.append(mean_reflected(at, seen, weights, STRETCHED_MEAN_RATIOS))
    return np.array(lost), np.array(up), np.array(loss)


def steady(means: Floats, roughnesses: Floats) -> Floats:
    """Return mean losses (N, ...) over what they go by, roughness^3.5: that can be interpolated down to none."""
    scaled = means / np.maximum(roughnesses, 1e-9).reshape(-1, *[1] * (means.ndim - 1)) ** 3.5
    none = roughnesses == 0
    scaled[none] = scaled[np.count_nonzero(none) : 2 * np.count_nonzero(none)]
    return scaled


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
        "kCosines": COSINES, "kRoughnesses": ROUGHNESSES, "kBelow": BELOW, "kAbove": ABOVE,
        "kMeanRatios": MEAN_RATIOS, "kMeanSteps": MEAN_STEPS,
        "kMeanRoughnesses": MEAN_ROUGHNESSES, "kStretchedMeanRoughnesses": STRETCHED_MEAN_ROUGHNESSES,
        "kLossMeanRoughnesses": LOSS_MEAN_ROUGHNESSES,
        **dict(zip(("kStretchedCosines", "kTurns", "kStretches", "kStretchedRoughnesses"), STRETCHED, strict=True)),
        **dict(zip(("kLossCosines", "kLossTurns", "kLossStretches", "kLossRoughnesses"), STRETCHED_LOSS, strict=True)),
        "kStretchedBelow": STRETCHED_BELOW, "kStretchedAbove": STRETCHED_ABOVE,
        "kStretchedMeanRatios": STRETCHED_MEAN_RATIOS, "kStretchedMeanSteps": STRETCHED_MEAN_STEPS,
        "kFuzzCosines": FUZZ_COSINES, "kFuzzRoughnesses": FUZZ_ROUGHNESSES,
    }  # fmt: skip
    return "\n".join(f"inline constexpr int {name} = {n};" for name, n in names.items())


HEAD = f"""\
// Written by tools/openpbr_tables.py; do not edit.
//
// GGX facets between dielectrics (Smith, height-correlated, single scattering). What the axes are is in albedo.h.
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
    facets, losses = facet_table(), loss_table()
    stretched, stretched_losses = stretched_table(), stretched_loss_table()
    means = isotropic_means(facets, losses), stretched_means(stretched, stretched_losses)
    mus = np.maximum(grid(FUZZ_COSINES) ** 2, 1e-4)
    rs = LEAST_FUZZ + (1 - LEAST_FUZZ) * grid(FUZZ_ROUGHNESSES) ** 2
    fuzz = np.array([[fuzz_albedo(mu, r) for mu in mus] for r in rs])
    print(HEAD, end="")
    print(facet_entries("facet_entry", "Isotropic facets: place, roughness.", facets))
    print(table("loss_entry", "What they lose between dielectrics: ratio of indices, place, roughness.", losses))
    print(facet_entries("stretched_entry", "Anisotropic facets: place, turn, stretch, roughness.", stretched))
    doc = "What they lose: ratio of indices, place, turn, stretch, roughness."
    print(table("stretched_loss_entry", doc, stretched_losses))
    rows = (
        grid(MEAN_ROUGHNESSES),
        np.repeat(grid(STRETCHED_MEAN_ROUGHNESSES), STRETCHED[2]),
        np.repeat(grid(LOSS_MEAN_ROUGHNESSES), STRETCHED_LOSS[2]),
    )
    for prefix, (lost, reflected, loss), r, r_loss in zip(
        ("", "stretched_"), means, rows[:2], (rows[0], rows[2]), strict=True
    ):
        doc = "Mean of what perfect facets lose, over roughness^3.5, a twelfth."
        print(table(f"{prefix}lost_mean_entry", doc, steady(lost, r) / 12))
        print(table(f"{prefix}reflected_mean_entry", "Mean of what dielectrics reflect, by s first.", reflected))
        doc = "Mean of what they lose, so scaled, by the signed root of s first."
        print(table(f"{prefix}loss_mean_entry", doc, steady(loss, r_loss) / 12))
    doc = "Half and 16 times what rough diffuse bases are to be held back by: by s first."
    print(table("coupling_entry", doc, 0.5 + 16 * coupling_table(facets)))
    doc = "A quarter of the albedo of the fuzz lobe, which may exceed 1 before it is normalised."
    print(table("fuzz_entry", doc, fuzz / 4))
    print("\n}  // namespace destello::openpbr")


if __name__ == "__main__":
    main()
