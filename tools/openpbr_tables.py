"""Write core/bsdf/openpbr/tables.h: albedos of OpenPBR's lobes, by quadrature, and the thin film's wavelengths.

Usage: python tools/openpbr_tables.py > core/bsdf/openpbr/tables.h, then clang-format -i on it
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from destello._core import testing

Floats = NDArray[np.float64]

COSINES, ROUGHNESSES = 32, 16  # grid in the square root of the cosine, and in roughness
FINE_ROUGHNESSES = 31  # for what is reflected: all of the above and those between
REFLECTING, PASSING = 10, 21  # grid in s = (eta - 1) / (eta + 1): by the square root, over [0, 1/2] and [-1/2, 1/2]
NODES = 160  # quadrature nodes along each of the two dimensions of a microfacet sample
WAVELENGTHS = 16


def visible_normals(mu: float, alpha: float) -> tuple[Floats, Floats, Floats]:
    """Return the direction of view and equally likely normals with their cosines to it (Dupuy and Benyoub 2023)."""
    u = (np.arange(NODES) + 0.5) / NODES
    u1, u2 = (x.ravel() for x in np.meshgrid(u, u))
    out = np.array([np.sqrt(1 - mu * mu), 0, mu])
    if alpha == 0:
        return out, np.array([[0.0, 0.0, 1.0]]), np.array([mu])
    stretched = out * [alpha, alpha, 1]
    stretched /= np.linalg.norm(stretched)
    z = (1 - u2) * (1 + stretched[2]) - stretched[2]
    radius = np.sqrt(np.clip(1 - z * z, 0, 1))
    h = np.stack([radius * np.cos(2 * np.pi * u1), radius * np.sin(2 * np.pi * u1), z], -1) + stretched
    h *= [alpha, alpha, 1]
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    return out, h, h @ out


def masked(mu: float, mu_in: Floats, alpha: float) -> Floats:
    """Return G2 / G1 of Smith's height-correlated masking and shadowing, 0 where mu_in <= 0."""
    seen = mu_in > 0
    c = np.where(seen, mu_in, 1)
    root_out = np.sqrt(mu * mu + alpha * alpha * (1 - mu * mu)) / mu
    root_in = np.sqrt(c * c + alpha * alpha * (1 - c * c)) / c
    return np.where(seen, (1 + root_out) / (root_out + root_in), 0)


def fresnel(cosine: Floats, eta: float) -> tuple[Floats, Floats]:
    """Return the reflectance between dielectrics and the cosine of the refracted direction."""
    cos2 = 1 - (1 - cosine**2) / eta**2
    t = np.sqrt(np.maximum(cos2, 0))
    s, p = (cosine - eta * t) / (cosine + eta * t), (eta * cosine - t) / (eta * cosine + t)
    return np.where(cos2 > 0, (s * s + p * p) / 2, 1), t


def albedos(mu: float, alpha: float) -> tuple[Floats, Floats]:
    """Return the reflected share for each s of REFLECTING, and what reflection and refraction lose, of PASSING."""
    out, h, cosine = visible_normals(mu, alpha)
    reflected = masked(mu, 2 * cosine * h[:, 2] - mu, alpha)
    up, lost = np.empty(REFLECTING), np.empty(PASSING)
    for k, s in enumerate(0.5 * np.linspace(0, 1, REFLECTING) ** 2):
        up[k] = np.mean(fresnel(cosine, (1 + s) / (1 - s))[0] * reflected)
    t = np.linspace(-1, 1, PASSING)
    for k, s in enumerate(0.5 * t * np.abs(t)):
        eta = (1 + s) / (1 - s)
        f, t = fresnel(cosine, eta)
        below = -(h[:, 2] * (cosine / eta - t) - out[2] / eta)
        lost[k] = 1 - np.mean(f * reflected + (1 - f) * masked(mu, below, alpha))
    return up, np.maximum(lost, 0)


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


def cosine_mean(rows: Floats) -> Floats:
    """Return 2 * integral of mu * row(mu) d mu over the last axis, exactly for rows linear in sqrt(mu)."""
    x = np.linspace(0, 1, rows.shape[-1])
    lo, hi = x[:-1], x[1:]
    slope = np.diff(rows) / (hi - lo)
    base = rows[..., :-1] - slope * lo
    return np.sum(base * (hi**4 - lo**4) + 0.8 * slope * (hi**5 - lo**5), axis=-1)


def lines(words: list[str]) -> str:
    """Return words as C++ initialiser lines."""
    out, line = [], "     "
    for word in words:
        if len(line) + 1 + len(word) > 120:
            out.append(line)
            line = "     "
        line += " " + word
    return "\n".join([*out, line])


def table(name: str, doc: str, values: Floats) -> str:
    """Return a function that looks up 16-bit fractions."""
    body = lines([f"{round(v * 65535)}," for v in values.ravel()])
    return (
        f"\n// {doc}\nDST_FN uint16_t {name}(int i) {{\n"
        f"  static constexpr uint16_t kTable[{values.size}] = {{\n{body}\n"
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
    print(film_wavelengths())
    print("\n}  // namespace destello::openpbr")


if __name__ == "__main__":
    main()
