"""Write core/bsdf/openpbr/tables.h: albedos of OpenPBR's lobes, by quadrature, and the thin film's wavelengths.

Usage: python tools/openpbr_tables.py > core/bsdf/openpbr/tables.h, then clang-format -i on it
"""

from __future__ import annotations

import numpy as np

from destello._core import testing
from microfacets import Floats, cosine_mean, lines, masked, toward, visible_normals

Facets = tuple[Floats, Floats, Floats, Floats, float, float]
"""Direction of view, normals it sees, their cosines to it, what masking leaves of reflection; alpha along x and y."""

COSINES, ROUGHNESSES = 32, 16  # grid in the square root of the cosine, and in roughness
FINE_ROUGHNESSES = 31  # for what is reflected: all of the above and those between
REFLECTING, PASSING = 10, 21  # grid in s = (eta - 1) / (eta + 1): by the square root, over [0, 1/2] and [-1/2, 1/2]
NODES = 160  # quadrature nodes along each of the two dimensions of a microfacet sample
WAVELENGTHS = 16

# Anisotropic: by (ax - ay) / (ax + ay) from 0 (left out) to MOST_STRETCH, and the azimuth's cosine to the x axis.
STRETCHES, AZIMUTHS, MOST_STRETCH = 4, 6, 0.96
STRETCHED_COSINES, STRETCHED_ROUGHNESSES, STRETCHED_RATIOS = 12, 11, 9
STRETCHED_NODES = 64


def fresnel(cosine: Floats, eta: float) -> tuple[Floats, Floats]:
    """Return the reflectance between dielectrics and the cosine of the refracted direction."""
    cos2 = 1 - (1 - cosine**2) / eta**2
    t = np.sqrt(np.maximum(cos2, 0))
    s, p = (cosine - eta * t) / (cosine + eta * t), (eta * cosine - t) / (eta * cosine + t)
    return np.where(cos2 > 0, (s * s + p * p) / 2, 1), t


def etas(nodes: int) -> Floats:
    """Return the ratios of indices of the grid of that many nodes over [1/3, 3]."""
    t = np.linspace(-1, 1, nodes)
    s = 0.5 * t * np.abs(t)
    return np.asarray((1 + s) / (1 - s))


def loss(facets: Facets, eta: float) -> float:
    """Return what reflection and refraction lose."""
    out, h, cosine, reflected, ax, ay = facets
    f, t = fresnel(cosine, eta)
    below = h * (cosine / eta - t)[:, None] - out / eta
    return float(max(1 - np.mean(f * reflected + (1 - f) * masked(out, below * [1, 1, -1], ax, ay)), 0))


def seen(out: Floats, ax: float, ay: float, nodes: int) -> Facets:
    """Return the facets that a direction meets."""
    h, cosine = visible_normals(out, ax, ay, nodes)
    return out, h, cosine, masked(out, 2 * cosine[:, None] * h - out, ax, ay), ax, ay


def albedos(mu: float, alpha: float) -> tuple[Floats, Floats]:
    """Return the reflected share for each s of REFLECTING, and what reflection and refraction lose, of PASSING."""
    facets = seen(toward(mu), alpha, alpha, NODES)
    s = 0.5 * np.linspace(0, 1, REFLECTING) ** 2
    up = [np.mean(fresnel(facets[2], eta)[0] * facets[3]) for eta in (1 + s) / (1 - s)]
    return np.array(up), np.array([loss(facets, eta) for eta in etas(PASSING)])


def stretched_losses(row: int) -> Floats:
    """Return (stretch, cosine, azimuth, STRETCHED_RATIOS + 1): what stretched facets lose beyond isotropic ones.

    `row` counts roughnesses. The last column is for facets that reflect all.
    """
    alpha = (row / (STRETCHED_ROUGHNESSES - 1)) ** 2
    mus = np.maximum(np.linspace(0, 1, STRETCHED_COSINES) ** 2, 1e-4)

    def losses(mu: float, cos_phi: float, stretch: float) -> Floats:
        # ax : ay = 1 + stretch : 1 - stretch, with the mean square alpha^2
        unit = alpha / np.sqrt(1 + stretch * stretch)
        facets = seen(toward(mu, cos_phi), unit * (1 + stretch), unit * (1 - stretch), STRETCHED_NODES)
        return np.array([*(loss(facets, eta) for eta in etas(STRETCHED_RATIOS)), 1 - np.mean(facets[3])])

    stretches = np.linspace(0, MOST_STRETCH, STRETCHES + 1)[1:]
    isotropic = [losses(mu, 1, 0) for mu in mus]
    return np.array(
        [
            [[losses(mu, c, s) - isotropic[i] for c in np.linspace(0, 1, AZIMUTHS)] for i, mu in enumerate(mus)]
            for s in stretches
        ]
    )


def azimuth_mean(values: Floats) -> Floats:
    """Return the mean over azimuths, exactly for values (..., AZIMUTHS) linear in its cosine between nodes."""
    phi = (np.arange(100_000) + 0.5) * np.pi / 200_000
    at = np.cos(phi) * (AZIMUTHS - 1)
    low = np.minimum(at.astype(int), AZIMUTHS - 2)
    weights = np.bincount(low, 1 - (at - low), AZIMUTHS) + np.bincount(low + 1, at - low, AZIMUTHS)
    return np.asarray(values @ (weights / len(phi)))


def fuzz_albedo(mu: float, roughness: float) -> float:
    """Return the albedo of the fuzz lobe (core/bsdf/openpbr/fuzz.h) of unit colour before normalisation."""
    alpha = max(roughness, 0.1) ** 2
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


def table(name: str, doc: str, values: Floats, unit: int = 65535) -> str:
    """Return a function that looks up 16-bit fractions, signed ones for a unit of 32767."""
    kind = "uint16_t" if unit == 65535 else "int16_t"
    body = lines([f"{round(v * unit)}," for v in values.ravel()])
    return (
        f"\n// {doc}\nDST_FN {kind} {name}(int i) {{\n"
        f"  static constexpr {kind} kTable[{values.size}] = {{\n{body}\n"
        "  };\n  return kTable[i];\n}"
    )


HEAD = f"""\
// Written by tools/openpbr_tables.py; do not edit.
//
// Albedos of isotropic GGX between dielectrics (Smith, height-correlated, single scattering). The fastest index is the
// square root of the cosine from 0 to 1, then roughness (alpha is its square), 0 to 1, then (eta - 1) / (eta + 1):
// by its square root, 0 to 1/2 for what is reflected, -1/2 to 1/2 for what is lost. 16-bit fractions of 1.
#pragma once

#include "base/vec.h"

namespace destello::openpbr {{

inline constexpr int kCosines = {COSINES}, kRoughnesses = {ROUGHNESSES}, kFineRoughnesses = {FINE_ROUGHNESSES};
inline constexpr int kReflecting = {REFLECTING}, kPassing = {PASSING};
inline constexpr int kStretches = {STRETCHES}, kAzimuths = {AZIMUTHS}, kStretchedCosines = {STRETCHED_COSINES};
inline constexpr int kStretchedRoughnesses = {STRETCHED_ROUGHNESSES}, kStretchedRatios = {STRETCHED_RATIOS};
inline constexpr float kMostStretch = {MOST_STRETCH}f;
inline constexpr int kFilmWavelengths = {WAVELENGTHS};
"""


def film_wavelengths() -> str:
    """Return the wavelengths at which thin films are evaluated, and their RGB weights, which sum to 1."""
    lo, hi = testing.WAVELENGTHS
    nm = lo + (hi - lo) * (np.arange(WAVELENGTHS) + 0.5) / WAVELENGTHS
    fine = lo + (hi - lo) * (np.arange(WAVELENGTHS * 100) + 0.5) / (WAVELENGTHS * 100)
    weight = np.asarray(testing.wavelength_weight(fine.astype(np.float32)), np.float64)
    weight = weight.reshape(WAVELENGTHS, 100, 3).mean(axis=1)
    weight /= weight.sum(axis=0)
    body = lines([f"{{{w[0]:.7f}f, {w[1]:.7f}f, {w[2]:.7f}f}}," for w in weight])
    return (
        "\n// The wavelength in nm, and its share of each of red, green and blue.\n"
        "DST_FN float film_wavelength(int i) { "
        f"return {nm[0]:.4f}f + {nm[1] - nm[0]:.4f}f * static_cast<float>(i); }}\n"
        f"DST_FN Vec3 film_weight(int i) {{\n  static constexpr float kTable[{WAVELENGTHS}][3] = {{\n{body}\n  }};\n"
        "  return {kTable[i][0], kTable[i][1], kTable[i][2]};\n}"
    )


def print_stretched() -> None:
    """Print the tables of anisotropic facets."""
    # (ratio, roughness, stretch, cosine, azimuth); the last ratio is perfect reflection's
    beyond = np.moveaxis(np.array([stretched_losses(row) for row in range(STRETCHED_ROUGHNESSES)]), -1, 0)
    means = cosine_mean(azimuth_mean(beyond))
    order = "azimuth's cosine, root of the cosine, stretch, roughness, ratio of indices and last perfect reflection"
    print(table("stretched_entry", f"What anisotropic facets lose beyond isotropic ones: {order}.", beyond, 32767))
    print(table("stretched_mean_entry", "The same, its cosine-weighted mean over directions.", means, 32767))


def main() -> None:
    """Print the header."""
    mus = np.maximum(np.linspace(0, 1, COSINES) ** 2, 1e-4)
    up = np.empty((REFLECTING, FINE_ROUGHNESSES, COSINES))
    lost = np.empty((PASSING, FINE_ROUGHNESSES, COSINES))
    for j, r in enumerate(np.linspace(0, 1, FINE_ROUGHNESSES)):
        for i, mu in enumerate(mus):
            up[:, j, i], lost[:, j, i] = albedos(mu, r * r)
    lost = lost[:, ::2]
    fuzz = np.array([[fuzz_albedo(mu, r) for mu in mus] for r in np.linspace(0, 1, ROUGHNESSES)])
    print(HEAD, end="")
    print(table("reflected_entry", "Reflected.", up))
    print(table("reflected_mean_entry", "The same, its cosine-weighted mean over directions.", cosine_mean(up)))
    print(table("lost_entry", "Lost: neither reflected nor refracted.", lost))
    print(table("lost_mean_entry", "The same, its cosine-weighted mean over directions.", cosine_mean(lost)))
    print(
        table(
            "fuzz_entry",
            "A quarter of the albedo of the fuzz lobe, which may exceed 1 before it is normalised.",
            fuzz / 4,
        )
    )
    print_stretched()
    print(film_wavelengths())
    print("\n}  // namespace destello::openpbr")


if __name__ == "__main__":
    main()
