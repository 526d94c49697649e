"""Write core/bsdf/ggx_albedo_table.h: the directional albedo of GGX reflection, by quadrature.

Usage: python tools/ggx_albedo_table.py > core/bsdf/ggx_albedo_table.h
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SIZE = 32  # entries along each axis
NODES = 256  # quadrature nodes along each of the two dimensions of a microfacet sample


def split_albedo(mu: float, alpha: float) -> tuple[float, float]:
    """Return (a, b): the albedo of isotropic GGX under Schlick's Fresnel term is f0 * a + f90 * b.

    `mu` is the cosine of the outgoing direction, in (0, 1]; `alpha` in [0, 1]. Integrates G2/G1 over the visible
    normals (spherical caps, Dupuy and Benyoub 2023) with Smith's height-correlated G2 by the midpoint rule.
    """
    if alpha == 0:
        weight = (1 - mu) ** 5
        return 1 - weight, weight
    u = (np.arange(NODES) + 0.5) / NODES
    u1, u2 = (x.ravel() for x in np.meshgrid(u, u))
    out = np.array([np.sqrt(1 - mu * mu), 0, mu])
    stretched = out * [alpha, alpha, 1]
    stretched /= np.linalg.norm(stretched)
    z = (1 - u2) * (1 + stretched[2]) - stretched[2]
    radius = np.sqrt(np.clip(1 - z * z, 0, 1))
    h = np.stack([radius * np.cos(2 * np.pi * u1), radius * np.sin(2 * np.pi * u1), z], -1) + stretched
    h *= [alpha, alpha, 1]
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    cosine = h @ out
    mu_in = 2 * cosine * h[:, 2] - mu
    seen = mu_in > 0
    mu_in = np.where(seen, mu_in, 1)
    root_out = np.sqrt(mu * mu + alpha * alpha * (1 - mu * mu)) / mu
    root_in = np.sqrt(mu_in * mu_in + alpha * alpha * (1 - mu_in * mu_in)) / mu_in
    passed = np.where(seen, (1 + root_out) / (root_out + root_in), 0)
    weight = (1 - cosine) ** 5
    return float(np.mean(passed * (1 - weight))), float(np.mean(passed * weight))


def cosine_mean(row: NDArray[np.float64]) -> float:
    """Return 2 * integral of mu * row(mu) d mu, exactly for `row` (SIZE,) linear between nodes in x = sqrt(mu)."""
    x = np.linspace(0, 1, SIZE)
    lo, hi = x[:-1], x[1:]
    slope = np.diff(row) / (hi - lo)
    base = row[:-1] - slope * lo
    return float(np.sum(base * (hi**4 - lo**4) + 0.8 * slope * (hi**5 - lo**5)))


def rows(values: NDArray[np.float64]) -> str:
    """Return 16-bit fractions as C++ initialiser lines."""
    words = [f"{round(v * 65535)}," for v in values.ravel()]
    lines, line = [], "     "
    for word in words:
        if len(line) + 1 + len(word) > 120:
            lines.append(line)
            line = "     "
        line += " " + word
    return "\n".join([*lines, line])


HEAD = """\
// Written by tools/ggx_albedo_table.py; do not edit.
//
// The directional albedo of isotropic GGX reflection (Smith, height-correlated) under Schlick's Fresnel term is
// f0 * a + f90 * b. Rows: roughness (alpha is its square) from 0 to 1; columns: the square root of the cosine from 0 to
// 1; 16-bit fractions of 1.
#pragma once

#include "base/defs.h"

namespace destello {{

inline constexpr int kGgxAlbedoSize = {size};
"""

FUNCTION = """
// {doc}
DST_FN uint16_t {name}(int i) {{
  static constexpr uint16_t kTable[{count}] = {{
{values}
  }};
  return kTable[i];
}}"""


def main() -> None:
    """Print the header."""
    mus = np.maximum(np.linspace(0, 1, SIZE) ** 2, 1e-4)
    table = np.array([[split_albedo(mu, r * r) for mu in mus] for r in np.linspace(0, 1, SIZE)])
    means = np.array([[cosine_mean(row[:, part]) for part in (0, 1)] for row in table])
    print(HEAD.format(size=SIZE), end="")
    for k, part in enumerate("ab"):
        values = table[:, :, k]
        doc = f"Entry row * kGgxAlbedoSize + column of {part}."
        print(FUNCTION.format(doc=doc, name=f"ggx_albedo_{part}", count=values.size, values=rows(values)))
    for k, part in enumerate("ab"):
        values = means[:, k]
        doc = f"The cosine-weighted mean over directions of row i of {part}."
        print(FUNCTION.format(doc=doc, name=f"ggx_albedo_mean_{part}", count=SIZE, values=rows(values)))
    print("\n}  // namespace destello")


if __name__ == "__main__":
    main()
