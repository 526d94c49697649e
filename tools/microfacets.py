"""What the tables' writers share: microfacets seen from a direction, means over directions, and C++ text."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def toward(mu: float, cos_phi: float = 1) -> Floats:
    """Return the unit vector of polar cosine `mu` and of that cosine of its azimuth."""
    sine = np.sqrt(1 - mu * mu)
    return np.array([sine * cos_phi, sine * np.sqrt(1 - cos_phi * cos_phi), mu])


def midpoints(nodes: int) -> tuple[Floats, Floats]:
    """Return the midpoint rule with `nodes` along each side of the unit square."""
    u = (np.arange(nodes) + 0.5) / nodes
    u1, u2 = (x.ravel() for x in np.meshgrid(u, u))
    return u1, u2


def lattice(index: int) -> tuple[Floats, Floats]:
    """Return the Fibonacci lattice of as many points as that Fibonacci number: edges cross it nowhere in a row."""
    before, n = 1, 1
    for _ in range(index - 2):
        before, n = n, before + n
    i = np.arange(n) + 0.5
    return (i * before / n) % 1, i / n


def visible_normals(out: Floats, ax: float, ay: float, square: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return normals of GGX seen from `out` (3,), all equally likely, and their cosines to it.

    Spherical caps (Dupuy and Benyoub 2023) for those points of the unit square.
    """
    if ax == 0:
        return np.array([[0.0, 0.0, 1.0]]), out[2:]
    u1, u2 = square
    stretched = out * [ax, ay, 1]
    stretched /= np.linalg.norm(stretched)
    z = (1 - u2) * (1 + stretched[2]) - stretched[2]
    radius = np.sqrt(np.clip(1 - z * z, 0, 1))
    h = np.stack([radius * np.cos(2 * np.pi * u1), radius * np.sin(2 * np.pi * u1), z], -1) + stretched
    h *= [ax, ay, 1]
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    return h, h @ out


def masked(out: Floats, wi: Floats, ax: float, ay: float) -> Floats:
    """Return G2 / G1 of Smith's height-correlated masking and shadowing for `wi` (N, 3), 0 where it is not above."""
    seen = wi[:, 2] > 0
    z = np.where(seen, wi[:, 2], 1)
    root_out = np.sqrt(out[2] ** 2 + (ax * out[0]) ** 2 + (ay * out[1]) ** 2) / out[2]
    root_in = np.sqrt(z * z + (ax * wi[:, 0]) ** 2 + (ay * wi[:, 1]) ** 2) / z
    return np.where(seen, (1 + root_out) / (root_out + root_in), 0)


def cosine_mean(rows: Floats) -> Floats:
    """Return 2 * integral of mu * row(mu) d mu over the last axis, exactly for rows linear in sqrt(mu)."""
    x = np.linspace(0, 1, rows.shape[-1])
    lo, hi = x[:-1], x[1:]
    slope = np.diff(rows) / (hi - lo)
    base = rows[..., :-1] - slope * lo
    return np.asarray(np.sum(base * (hi**4 - lo**4) + 0.8 * slope * (hi**5 - lo**5), axis=-1))


def evened(values: Floats, axis: int) -> Floats:
    """Return node values so that what is interpolated between them is off half as much, and to both sides.

    Linear interpolation is off by up to an eighth of the second difference, a twelfth in the mean. Values at both ends
    stay.
    """
    v = np.moveaxis(values, axis, 0).copy()
    v[1:-1] -= np.diff(v, 2, axis=0) / 12
    return np.moveaxis(v, 0, axis)


def lines(words: list[str]) -> str:
    """Return words as C++ initialiser lines."""
    out, line = [], "     "
    for word in words:
        if len(line) + 1 + len(word) > 120:
            out.append(line)
            line = "     "
        line += " " + word
    return "\n".join([*out, line])
