"""What OpenPBR's tests hold its lobes against, in NumPy: Fresnel's equations and single scattering of GGX facets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def fresnel(cosine: Any, eta: float) -> Any:
    """Reflectance of a boundary between dielectrics, unpolarised; eta: index beyond over index before it."""
    c = np.asarray(cosine, np.float64)
    t = np.sqrt(np.maximum(1 - (1 - c**2) / eta**2, 0))
    return (((c - eta * t) / (c + eta * t)) ** 2 + ((eta * c - t) / (eta * c + t)) ** 2) / 2


def root(w: Floats, ax: float, ay: float) -> Floats:
    """1 + 2 Lambda of Smith's function."""
    return np.asarray(np.sqrt(1 + ((ax * w[..., 0]) ** 2 + (ay * w[..., 1]) ** 2) / w[..., 2] ** 2))


def ggx(wo: Any, wi: Floats, ax: float, ay: float) -> Floats:
    """f |cos| (N,) of single scattering where facets reflect all."""
    wo = np.asarray(wo, np.float64)
    h = wo + wi
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    d = 1 / (np.pi * ax * ay * ((h[:, 0] / ax) ** 2 + (h[:, 1] / ay) ** 2 + h[:, 2] ** 2) ** 2)
    g = 2 / (root(wo, ax, ay) + root(wi, ax, ay))
    return np.asarray(d * g / (4 * wo[2]))


Reflectance = Callable[[Floats], Floats]


def single_scattering(wo: Any, alpha: float, reflectance: Reflectance | None = None, n: int = 400) -> Any:
    """What isotropic facets reflect of a direction: () where they reflect all, else of `reflectance`'s shape.

    A midpoint rule over the normals: 1 / (1 + r^2) is uniform in the slopes' radius r, and its fourth root spreads the
    nodes far into the tail, on which grazing views depend.
    """
    wo = np.asarray(wo, np.float64)
    u = (np.arange(n) + 0.5) / n
    uu, vv = (a.ravel() for a in np.meshgrid(u, u, indexing="ij"))
    r = alpha * np.sqrt(1 / uu**4 - 1)
    h = np.stack([r * np.cos(2 * np.pi * vv), r * np.sin(2 * np.pi * vv), np.ones_like(r)], -1)
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    c = h @ wo
    wi = 2 * c[:, None] * h - wo
    ok = (c > 0) & (wi[:, 2] > 0)
    h, c, wi, weight = h[ok], c[ok], wi[ok], 4 * uu[ok] ** 3 / n**2
    weight *= 2 / (root(wo, alpha, alpha) + root(wi, alpha, alpha)) * c / (wo[2] * h[:, 2])
    return float(weight.sum()) if reflectance is None else weight @ reflectance(c)


def mean_over_cosines(f: Callable[[Floats], Floats], n: int = 64) -> Floats:
    """Mean (K,) over cosine-distributed directions of f, which takes cosines (N,) and returns (N, K)."""
    z, w = np.polynomial.legendre.leggauss(n)
    c = (z + 1) / 2
    return np.asarray((w * c) @ f(c))
