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


def whole(table: Floats) -> Floats:
    """Return (a, b) in the last axis as multiples of 1/65535 that never sum to more than 1."""
    lost, a = (np.round(part * 65535) for part in (np.maximum(1 - table.sum(-1), 0), table[..., 0]))
    return np.stack([a, 65535 - lost - a], -1)


HEAD = """\
// Written by tools/ggx_albedo_table.py; do not edit.
//
// The directional albedo of isotropic GGX reflection (Smith, height-correlated) under Schlick's Fresnel term is
// f0 * a + f90 * b. Rows: roughness (alpha is its square) from 0 to 1; columns: the square root of the cosine from 0 to
// 1; 16-bit fractions of 1, and means of what these say.
#pragma once

#include "base/defs.h"

namespace destello {{

inline constexpr int kGgxAlbedoSize = {size};
"""

FUNCTION = """
// {doc}
DST_FN {type} {name}(int i) {{
  static constexpr {type} kTable[{count}] = {{
{values}
  }};
  return kTable[i];
}}"""


def main() -> None:
    """Print the header."""
    mus = np.maximum(np.linspace(0, 1, SIZE) ** 2, 1e-4)
    table = whole(np.array([[split_albedo(mu, r * r) for mu in mus] for r in np.linspace(0, 1, SIZE)]))
    print(HEAD.format(size=SIZE), end="")
    for k, part in enumerate("ab"):
        doc, values = f"Entry row * kGgxAlbedoSize + column of {part}.", table[:, :, k].ravel()
        words = lines([f"{v:.0f}," for v in values])
        print(FUNCTION.format(doc=doc, type="uint16_t", name=f"ggx_albedo_{part}", count=values.size, values=words))
    means = cosine_mean(np.moveaxis(table, -1, 0)) / 65535
    lost = cosine_mean(65535 - table.sum(-1)) / 65535
    for name, what, row in (("mean_a", "a", means[0]), ("mean_b", "b", means[1]), ("mean_lost", "1 - a - b", lost)):
        doc = f"The cosine-weighted mean over directions of row i of {what}."
        words = lines([f"{v:#.8g}f," for v in row])
        print(FUNCTION.format(doc=doc, type="float", name=f"ggx_albedo_{name}", count=SIZE, values=words))
    print("\n}  // namespace destello")


if __name__ == "__main__":
    main()
