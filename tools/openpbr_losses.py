"""Write core/bsdf/openpbr/loss_tables.h: what single scattering by GGX facets between dielectrics loses, and its means.

Usage: python tools/openpbr_losses.py > core/bsdf/openpbr/loss_tables.h, on all cores; a quarter of an hour of one.

As functions of the ratio of indices, on axes that follow where total reflection begins, losses are sums of few curves.
Tables have the curves, and their weights by direction and facets (core/bsdf/openpbr/losses.h has the axes, too).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from microfacets import Floats, evened, lattice, lines, toward
from openpbr_facets import LEAST_ROUGHNESS, Facets, seen_cosine, steady

SIZES, STRETCHED = (32, 24), (18, 12, 7, 12)  # place, roughness; place, turn, stretch, roughness
BELOW, ABOVE = 49, 33  # nodes of the curves of ratios below and above 1
BELOW_CURVES, ABOVE_CURVES = 16, 8
MEAN_STEPS, STRETCHED_MEAN_STEPS = 65, 33  # of the means: by the signed root of s = (eta - 1) / (eta + 1)
MEAN_ROUGHNESSES, STRETCHED_MEAN_ROUGHNESSES = 61, 45  # by the root of roughness
MEAN_STRETCHES = 2 * STRETCHED[2] - 1
LEAST_ASPECT = 0.02
FINE, COARSE = lattice(23), lattice(20)  # points of quadrature for isotropic and anisotropic facets


# --- axes ------------------------------------------------------------------------------------------------------------


def inverse(rising: Callable[[Floats], Floats], goal: Floats) -> Floats:
    """Return where in [0, 1] a rising function has these values, by bisection."""
    lo, hi = np.zeros_like(goal), np.ones_like(goal)
    for _ in range(50):
        x = (lo + hi) / 2
        low = rising(x) < goal
        lo, hi = np.where(low, x, lo), np.where(low, hi, x)
    return np.asarray((lo + hi) / 2)


def place(x: Floats, alpha: Floats) -> Floats:
    """Return the coordinate of a cosine x^2, in [0, 1]; alpha is that along the azimuth."""
    k = np.sqrt(alpha + 0.001)
    return np.asarray(0.3 * x * x + 0.7 * x * (1 + k) / (x + k))


def stretch(aspect: Floats) -> Floats:
    """Return the coordinate of the aspect, before its greatest value is divided out."""
    root = np.sqrt(aspect)
    return np.asarray((1 - root) / (1 + 0.15 * root))


MOST_STRETCH = float(stretch(np.float64(LEAST_ASPECT)))


def axes(stretched: Floats, roughness: Floats) -> tuple[Floats, Floats]:
    """Return alphas (ax, ay) whose mean square is roughness^4."""
    v = stretched * MOST_STRETCH
    aspect = np.minimum(((1 - v) / (1 + 0.15 * v)) ** 2, 1 - 1e-3)
    ax = roughness**2 * np.sqrt(2 / (1 + aspect**2))
    return ax, ax * aspect


def along(cos_phi: Floats, ax: Floats, ay: Floats) -> tuple[Floats, Floats]:
    """Return alpha along an azimuth, and its coordinate, in [0, 1] from ay to ax."""
    alpha = np.hypot(ax * cos_phi, ay * np.sqrt(1 - cos_phi**2))
    far = np.sqrt(np.clip((alpha - ay) / (ax - ay), 0, 1))
    return alpha, np.asarray(0.5 * (far + 1 - np.sqrt(1 - cos_phi**2)))


def edges(w: Floats, ax: Floats, ay: Floats) -> tuple[Floats, Floats]:
    """Return cosines to facets of a direction (3, ...): of many, and the greatest, where few see more."""

    def reach(k: float) -> Floats:
        x, y = ax * ax / (ax * ax + k), ay * ay / (ay * ay + k)
        return np.asarray(np.sqrt(np.minimum(w[2] ** 2 + x * w[0] ** 2 + y * w[1] ** 2, 1)))

    return reach(0.6), reach(0.02)


def below(u: Floats, many: Floats, most: Floats) -> Floats:
    """Return the ratio of indices below 1 at a coordinate: by the cosine at which total reflection begins."""
    critical = (
        many * np.minimum(2 * u, 1) + (most - many) * np.clip(4 * u - 2, 0, 1) + (1 - most) * np.maximum(4 * u - 3, 0)
    )
    return np.asarray(np.sqrt(1 - np.clip(critical, 1e-3, 1 - 1e-9) ** 2))


def below_place(eta: Floats, many: Floats, most: Floats) -> Floats:
    """Return the inverse of `below`."""
    c = np.sqrt(1 - np.minimum(eta, 1) ** 2)
    top = 0.5 + 0.25 * np.minimum((c - many) / np.maximum(most - many, 1e-9), 1)
    top += 0.25 * np.maximum(c - most, 0) / np.maximum(1 - most, 1e-9)
    return np.where(c < many, 0.5 * c / many, top)


def above_place(s: Floats, seen: Floats) -> Floats:
    """Return the coordinate of a ratio above 1: fine where s = (eta - 1) / (eta + 1) or 1 - s is the seen cosine."""
    near, far, k, m = np.sqrt(s), 1 - s, 0.7 * seen, 2 * seen
    return np.asarray(0.2 * s + 0.5 * near * (1 + k) / (near + k) + 0.3 * (1 - far * (1 + m) / (far + m)))


# --- losses ----------------------------------------------------------------------------------------------------------


def losses(w: Floats, ax: float, ay: float, square: tuple[Floats, Floats]) -> Floats:
    """Return those of one direction at the nodes of the curves (BELOW + ABOVE,)."""
    facets = Facets.seen(w, ax, ay, square)
    many, most = edges(w, np.float64(ax), np.float64(ay))
    alpha = np.hypot(ax * w[0], ay * w[1]) / np.hypot(w[0], w[1])
    seen = seen_cosine(w[2], alpha)
    s = np.clip(inverse(lambda s: above_place(s, seen), np.linspace(0, 1, ABOVE)), 1e-6, 0.9999)
    etas = np.concatenate([below(np.linspace(0, 1, BELOW), many, most), (1 + s) / (1 - s)])
    return np.array([facets.loss(eta) for eta in etas])


def direction(c: float, alpha: float, cos_phi: float) -> Floats:
    """Return the direction at that place."""
    x = max(float(inverse(lambda x: place(x, np.float64(alpha)), np.float64(c))), 0.01 * np.sqrt(alpha))
    return toward(min(x * x, 1 - 1e-12), cos_phi)


def isotropic(node: tuple[float, float]) -> Floats:
    """Return the losses at a node of the table."""
    alpha = max(node[1], LEAST_ROUGHNESS) ** 2
    return losses(direction(node[0], alpha, 1), alpha, alpha, FINE)


def anisotropic(node: tuple[float, float, float, float]) -> Floats:
    """Return the losses at a node of the table."""
    c, turn, stretched, roughness = node
    ax, ay = (float(a) for a in axes(np.float64(stretched), np.float64(max(roughness, 0.02))))
    cos_phi = float(inverse(lambda x: along(x, np.float64(ax), np.float64(ay))[1], np.float64(turn)))
    alpha = float(along(np.float64(cos_phi), np.float64(ax), np.float64(ay))[0])
    return losses(direction(c, alpha, cos_phi), ax, ay, COARSE)


def at_nodes(function: Callable[..., Floats], sizes: tuple[int, ...]) -> Floats:
    """Return a function's values (*sizes, BELOW + ABOVE) at the nodes of a table, from all cores."""
    with ProcessPoolExecutor() as pool:
        rows = list(pool.map(function, itertools.product(*(np.linspace(0, 1, n) for n in sizes)), chunksize=16))
    return np.array(rows).reshape(*sizes, -1)


@dataclass
class Sums:
    """Losses as sums of curves: weights (*sizes, BELOW_CURVES + ABOVE_CURVES) in [-1, 1], curves (nodes, number)."""

    weights: Floats
    below: Floats
    above: Floats

    @staticmethod
    def of(table: Floats) -> Sums:
        """Return the sums that are closest to losses (*sizes, BELOW + ABOVE)."""
        weights, curves = [], []
        for part, count in ((table[..., :BELOW], BELOW_CURVES), (table[..., BELOW:], ABOVE_CURVES)):
            rows = part.reshape(-1, part.shape[-1])
            curve = np.linalg.eigh(rows.T @ rows)[1][:, ::-1][:, :count]
            weight = part @ curve
            for axis in range(weight.ndim - 1):
                weight = evened(weight, axis)
            scale = np.abs(weight).reshape(-1, count).max(axis=0)
            weights.append(weight / scale)
            curves.append(curve * scale)
        return Sums(np.concatenate(weights, axis=-1), *curves)

    def at(self, places: tuple[Floats, ...]) -> Floats:
        """Return interpolated weights (N, curves) at N places."""
        sizes = self.weights.shape[:-1]
        flat = self.weights.reshape(-1, self.weights.shape[-1])
        t = [np.clip(p, 0, 1) * (n - 1) for p, n in zip(places, sizes, strict=True)]
        i = [np.minimum(x.astype(int), n - 2) for x, n in zip(t, sizes, strict=True)]
        out = np.zeros((len(places[0]), flat.shape[1]))
        for corner in itertools.product((0, 1), repeat=len(sizes)):
            weight = np.prod([(x - k) if e else 1 - (x - k) for e, x, k in zip(corner, t, i, strict=True)], axis=0)
            out += flat[np.ravel_multi_index([k + e for k, e in zip(i, corner, strict=True)], sizes)] * weight[:, None]
        return out


# --- means over directions, as the core looks the tables up -----------------------------------------------------------


def mean_losses(sums: Sums, at: Floats, w: Floats, facets: tuple[float, float], steps: int) -> Floats:
    """Return (steps,) of directions (3, N), cosine-distributed over x, the root of their cosines."""
    ax, ay = facets
    many, most = edges(w, np.float64(ax), np.float64(ay))
    x = np.sqrt(w[2])
    seen = seen_cosine(w[2], np.hypot(ax * w[0], ay * w[1]) / np.hypot(w[0], w[1]))
    t = np.linspace(-1, 1, steps)
    out = []
    for s in t * np.abs(t):
        if s < 0:
            curves, weights = sums.below, at[:, :BELOW_CURVES]
            u = below_place(np.full_like(x, (1 + s) / (1 - s)), many, most)
        else:
            curves, weights, u = sums.above, at[:, BELOW_CURVES:], above_place(np.full_like(x, s), seen)
        v = np.clip(u, 0, 1) * (len(curves) - 1)
        i = np.minimum(v.astype(int), len(curves) - 2)
        f = (v - i)[:, None]
        got = np.maximum(((curves[i] * (1 - f) + curves[i + 1] * f) * weights).sum(axis=1), 0)
        out.append(np.mean(got * 4 * x**3))
    return np.array(out)


def isotropic_means(sums: Sums) -> Floats:
    """Return (MEAN_ROUGHNESSES, MEAN_STEPS)."""
    x = (np.arange(2000) + 0.5) / 2000
    w = np.stack([np.sqrt(1 - x**4), x * 0, x * x])
    out = []
    for r in np.linspace(0, 1, MEAN_ROUGHNESSES) ** 2:
        at = sums.at((place(x, np.float64(r * r)), np.full_like(x, r)))
        out.append(mean_losses(sums, at, w, (r * r, r * r), MEAN_STEPS))
    return np.array(out)


def anisotropic_means(sums: Sums) -> Floats:
    """Return (STRETCHED_MEAN_ROUGHNESSES, MEAN_STRETCHES, STRETCHED_MEAN_STEPS)."""
    x, phi = (a.ravel() for a in np.meshgrid((np.arange(100) + 0.5) / 100, (np.arange(64) + 0.5) * np.pi / 128))
    sine = np.sqrt(1 - x**4)
    w = np.stack([sine * np.cos(phi), sine * np.sin(phi), x * x])
    out = []
    for r, s in itertools.product(
        np.linspace(0, 1, STRETCHED_MEAN_ROUGHNESSES) ** 2, np.linspace(0, 1, MEAN_STRETCHES)
    ):
        ax, ay = axes(np.float64(s), np.float64(max(r, 1e-3)))
        alpha, turn = along(np.cos(phi), ax, ay)
        at = sums.at((place(x, alpha), turn, np.full_like(x, s), np.full_like(x, r)))
        out.append(mean_losses(sums, at, w, (float(ax), float(ay)), STRETCHED_MEAN_STEPS))
    return np.array(out).reshape(STRETCHED_MEAN_ROUGHNESSES, MEAN_STRETCHES, -1)


# --- C++ -------------------------------------------------------------------------------------------------------------


def function(name: str, doc: str, kind: str, words: list[str]) -> str:
    """Return a function that looks a table up."""
    return (
        f"\n// {doc}\nDST_FN {kind} {name}(int i) {{\n"
        f"  static constexpr {kind} kTable[{len(words)}] = {{\n{lines(words)}\n  }};\n  return kTable[i];\n}}"
    )


def packed(name: str, doc: str, values: Floats) -> str:
    """Return a function that looks up numbers (..., 4 n) in [-1, 1], four to a word."""
    four = np.rint((values.reshape(-1, 4) + 1) / 2 * 65535).clip(0, 65535).astype(np.uint64)
    words = four @ np.array([1, 1 << 16, 1 << 32, 1 << 48], np.uint64)
    return function(name, doc, "uint64_t", [f"0x{w:016x}u," for w in words])


def curves(name: str, sums: Sums, most: float) -> str:
    """Return a function that looks the curves up."""
    parts = [
        part.reshape(len(part), -1, 4).transpose(1, 0, 2).ravel() / most for part in (sums.below, sums.above)
    ]  # by four: all nodes
    doc = "Curves over kMostCurve, by node first, then by four."
    return packed(name, doc, np.concatenate(parts))


HEAD = """\
// Written by tools/openpbr_losses.py; do not edit.
//
// What GGX facets between dielectrics lose (Smith, height-correlated, single scattering). What the axes are is in
// losses.h. Words are four fractions of 16 bits, from -1 to 1.
#pragma once

#include "base/vec.h"

namespace destello::openpbr {
"""


def main() -> None:
    """Print the header."""
    sums, stretched = Sums.of(at_nodes(isotropic, SIZES)), Sums.of(at_nodes(anisotropic, STRETCHED))
    most = float(np.ceil(max(np.abs(c).max() for s in (sums, stretched) for c in (s.below, s.above)) * 100) / 100)
    names = {
        "kLossPlaces": SIZES[0], "kLossRoughnesses": SIZES[1], "kStretchedLossPlaces": STRETCHED[0],
        "kLossTurns": STRETCHED[1], "kLossStretches": STRETCHED[2], "kStretchedLossRoughnesses": STRETCHED[3],
        "kBelow": BELOW, "kAbove": ABOVE, "kBelowWords": BELOW_CURVES // 4, "kAboveWords": ABOVE_CURVES // 4,
        "kLossMeanSteps": MEAN_STEPS, "kLossMeanRoughnesses": MEAN_ROUGHNESSES,
        "kStretchedLossMeanSteps": STRETCHED_MEAN_STEPS, "kLossMeanStretches": MEAN_STRETCHES,
        "kStretchedLossMeanRoughnesses": STRETCHED_MEAN_ROUGHNESSES,
    }  # fmt: skip
    print(HEAD)
    print("\n".join(f"inline constexpr int {name} = {n};" for name, n in names.items()))
    print(f"inline constexpr float kMostCurve = {most}f, kMostLossStretch = {MOST_STRETCH:.7f}f;")
    doc = "Weights of the curves: word, place, {}roughness."
    # innermost first: the tables run over roughness slowest
    print(packed("loss_word", doc.format(""), sums.weights.swapaxes(0, 1)))
    print(packed("stretched_loss_word", doc.format("turn, stretch, "), stretched.weights.transpose(3, 2, 1, 0, 4)))
    print(curves("loss_curve_word", sums, most))
    print(curves("stretched_loss_curve_word", stretched, most))
    doc = "Means over roughness^1.5, by the signed root of s first; then by the root of roughness."
    means = steady(isotropic_means(sums), np.linspace(0, 1, MEAN_ROUGHNESSES) ** 2)
    print(function("loss_mean_entry", doc, "uint16_t", [f"{round(v * 65535)}," for v in means.ravel()]))
    rows = anisotropic_means(stretched)
    means = steady(rows.reshape(-1, rows.shape[-1]), np.repeat(np.linspace(0, 1, len(rows)) ** 2, MEAN_STRETCHES))
    print(function("stretched_loss_mean_entry", doc, "uint16_t", [f"{round(v * 65535)}," for v in means.ravel()]))
    print("\n}  // namespace destello::openpbr")


if __name__ == "__main__":
    main()
