"""Write core/bsdf/ggx_albedo_table.h: the directional albedo of GGX reflection, by quadrature.

Usage: python tools/ggx_albedo_table.py > core/bsdf/ggx_albedo_table.h
"""

from __future__ import annotations

import numpy as np

from microfacets import Floats, cosine_mean, lines, masked, midpoints, toward, visible_normals

SIZE = 32  # entries along each axis
NODES = 256  # quadrature nodes along each of the two dimensions of a microfacet sample


def split_albedo(mu: float, alpha: float) -> tuple[float, float]:
    """Return (a, b): the albedo of isotropic GGX under Schlick's Fresnel term is f0 * a + f90 * b.

    `mu` is the cosine of the outgoing direction, in (0, 1]; `alpha` in [0, 1]. Integrates G2/G1 over the visible
    normals with Smith's height-correlated G2.
    """
    out = toward(mu)
    h, cosine = visible_normals(out, alpha, alpha, midpoints(NODES))
    passed = masked(out, 2 * cosine[:, None] * h - out, alpha, alpha)
    weight = (1 - cosine) ** 5
    return float(np.mean(passed * (1 - weight))), float(np.mean(passed * weight))


def rows(values: Floats) -> str:
    """Return 16-bit fractions as C++ initialiser lines."""
    return lines([f"{round(v * 65535)}," for v in values.ravel()])


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
