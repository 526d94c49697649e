"""Single scattering by GGX facets, and the coordinates of its tables, which core/bsdf/openpbr/albedo.h has too.

Everything here is of one direction: its cosine is `x` squared. Facets have alphas `ax >= ay`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from microfacets import Floats, masked, toward, visible_normals

MOST_STRETCH = 0.961
"""Of (ax - ay) / (ax + ay): an aspect of 0.02."""
LEAST_ROUGHNESS = 2e-3
"""In place of none: rows at the end go on as they do towards it."""
MOST_RATIO = 8
"""Of a cosine that stands for facets over the one they are seen at."""


# --- coordinates -----------------------------------------------------------------------------------------------------


def place(x: Floats, roughness: Floats) -> Floats:
    """Return the direction's coordinate, in [0, 1]: it spreads out cosines about alpha, where facets lose most."""
    return x * (1 + roughness) / (x + roughness)


def place_to_x(c: float, roughness: float) -> float:
    """Return the inverse of `place`, kept off 0."""
    return float(np.clip(c * roughness / (1 + roughness - c), 0.03 * roughness, 1))


def seen_cosine(cosine: Floats, alpha: Floats) -> Floats:
    """Return the cosine to the facets that a direction sees, roughly; alpha is that along its azimuth."""
    return np.sqrt(cosine**2 + 0.5 * alpha**2 * (1 - cosine**2))


def steady(means: Floats, roughnesses: Floats) -> Floats:
    """Return mean losses (N, ...) over roughness^1.5: small ones keep their digits."""
    scaled = means / np.maximum(roughnesses, 1e-9).reshape(-1, *[1] * (means.ndim - 1)) ** 1.5
    none = roughnesses == 0
    scaled[none] = scaled[np.count_nonzero(none) : 2 * np.count_nonzero(none)]
    return scaled


# --- scattering ------------------------------------------------------------------------------------------------------


def fresnel(cosine: Floats, eta: Floats | float) -> tuple[Floats, Floats]:
    """Return the reflectance between dielectrics and the cosine of the refracted direction."""
    cos2 = 1 - (1 - cosine**2) / eta**2
    t = np.sqrt(np.maximum(cos2, 0))
    s, p = (cosine - eta * t) / (cosine + eta * t), (eta * cosine - t) / (eta * cosine + t)
    return np.where(cos2 > 0, (s * s + p * p) / 2, 1), t


@dataclass
class Facets:
    """The facets that a direction sees."""

    out: Floats
    h: Floats
    cosine: Floats
    kept: Floats
    """What masking leaves of reflection."""
    ax: float
    ay: float

    @staticmethod
    def seen(out: Floats, ax: float, ay: float, square: tuple[Floats, Floats]) -> Facets:
        """Return those for points of the unit square."""
        h, cosine = visible_normals(out, ax, ay, square)
        cosine = np.maximum(cosine, 1e-12)
        return Facets(out, h, cosine, masked(out, 2 * cosine[:, None] * h - out, ax, ay), ax, ay)

    def lost(self) -> float:
        """Return what is lost where facets reflect all."""
        return float(max(1 - np.mean(self.kept), 0))

    def reflected(self, eta: float) -> float:
        """Return the share that dielectrics reflect."""
        return float(np.mean(fresnel(self.cosine, eta)[0] * self.kept))

    def loss(self, eta: float) -> float:
        """Return what dielectrics neither reflect nor refract."""
        f, t = fresnel(self.cosine, eta)
        below = self.h * (self.cosine / eta - t)[:, None] - self.out / eta
        passed = (1 - f) * masked(self.out, below * [1, 1, -1], self.ax, self.ay)
        return float(np.clip(1 - np.mean(f * self.kept + passed), 0, 1))


def isotropic(c: float, roughness: float, square: tuple[Floats, Floats]) -> Facets:
    """Return what the direction at that place sees of facets of that roughness."""
    roughness = max(roughness, LEAST_ROUGHNESS)
    x = place_to_x(c, roughness)
    return Facets.seen(toward(min(x * x, 1 - 1e-12)), roughness**2, roughness**2, square)


def alphas(roughness: float, stretch: float) -> tuple[float, float]:
    """Return (ax, ay), whose mean square is roughness^4."""
    unit = roughness**2 / np.sqrt(1 + stretch**2)
    return unit * (1 + stretch), unit * (1 - stretch)


def anisotropic(c: float, turn: float, stretch: float, roughness: float, square: tuple[Floats, Floats]) -> Facets:
    """Return the same of stretched facets.

    `turn` is the root of how far the alpha along the direction's azimuth is from ay, at 0, to ax.
    """
    stretch = max(stretch, 1e-3)
    ax, ay = alphas(max(roughness, 0.05), stretch)
    along = ay + turn**2 * (ax - ay)
    x = place_to_x(c, float(np.sqrt(along)))
    cos_phi = np.sqrt(np.clip((along**2 - ay**2) / (ax**2 - ay**2), 0, 1))
    return Facets.seen(toward(min(x * x, 1 - 1e-12), float(cos_phi)), ax, ay, square)


# --- two cosines for all facets --------------------------------------------------------------------------------------

FIT_S = np.concatenate([[0.001, 0.004], np.linspace(0.01, 0.1, 7), np.linspace(0.14, 0.97, 18)])
FIT_ETAS = (1 + FIT_S) / (1 - FIT_S)
"""Ratios of indices at which the reflectance is fitted."""


def by_two(lost: Floats, low: Floats, high: Floats, weight: Floats, eta: Floats | float) -> Floats:
    """Return the reflected share by the fit's numbers; the cosines are absolute here."""
    return (1 - lost) * (weight * fresnel(low, eta)[0] + (1 - weight) * fresnel(high, eta)[0])


def two_cosines(facets: Facets, starts: list[Floats]) -> tuple[float, Floats]:
    """Return what facets lose, and (log of a cosine, log of another, logit of the first one's weight).

    The two stand for all: weighted so, their reflectances are the mean over the facets whatever the ratio of indices.
    Where that leaves a choice (all facets seen at one cosine), it is what the fits next to it, `starts`, have.
    """
    lost = facets.lost()
    goal = np.array([facets.reflected(eta) for eta in FIT_ETAS])
    along = np.hypot(facets.ax * facets.out[0], facets.ay * facets.out[1]) / np.hypot(*facets.out[:2])
    seen = float(seen_cosine(facets.out[2], along))
    near = np.mean(starts, axis=0) if starts else np.log([0.6, 1.3, 1.0])
    stiff = np.array([1e-4, 1e-4, 3e-4])

    def off(v: Floats) -> Floats:
        low, high = np.minimum(np.exp(v[:2]) * seen, 1)
        got = by_two(np.float64(lost), low, high, 1 / (1 + np.exp(-v[2])), FIT_ETAS)
        return np.concatenate([got - goal, stiff * (v - near)])

    top = np.log(MOST_RATIO)
    fits = [least_squares(off, np.clip(v, -4, top - 0.01), bounds=(-6, top)) for v in [near, *starts]]
    best = min(fits, key=lambda f: f.cost).x
    return lost, np.asarray(np.minimum(best, [-np.log(seen), -np.log(seen), np.inf]))
