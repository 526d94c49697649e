"""OpenPBR there and back: f / n^2 is the same from both ends of a path, over random parameters.

Coat and fuzz take what they reflect from the light of what lies below by the direction of view alone (albedo scaling,
as the specification has it; docs/materials.md says why). So with them the sum is not reciprocal, but each of its parts
is once that factor is taken out: f(wo, wi) left(wi) = f(wi, wo) left(wo).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import qmc

from bsdf_cases import Case, direction
from destello._core import testing
from openpbr_draws import BASE, COAT, COLOURS, DRAWS, MORE, TOP, draws, views

Floats = NDArray[np.float64]

U = qmc.Sobol(3, rng=7).random(512).astype(np.float32).clip(0, 1 - 2**-24)
BLACK = {
    "base_metalness": 0.0, "base_color": 0.0, "specular_weight": 0.0,
    "transmission_weight": 0.0, "subsurface_weight": 0.0, "thin_film_weight": 0.0,
}  # fmt: skip
LEAST = 1e-5
"""What is less counts as nothing."""
AROUND = np.array([direction(c, t) for c in (0.25, 0.6, 0.95) for t in (0.0, 0.3, 0.7)], np.float64)


def directions(case: Case, wo: Any, count: int) -> tuple[Floats, Floats]:
    """Some that the material samples and that are not too sharp, and the ratio of indices that goes with each."""
    s = case.sample(wo, U[:count])
    k = s.spread & (s.pdf < 1e3) & (np.abs(s.wi[:, 2]) > 0.05)
    return s.wi[k], s.eta[k, None]


def there_and_back(f: Any, wo: Any, wi: Floats) -> tuple[Floats, Floats]:
    """f(view, other, flipped) over the other's cosine: of wo and wi (N, 3), and of the ways back."""
    up = wi[:, 2:] > 0
    view = np.where(up, wi, -wi)
    end = np.where(up, wo, -np.asarray(wo, np.float64))
    back = np.empty_like(wi)
    for side in (True, False):
        k = up[:, 0] == side
        if k.any():
            back[k] = [f(v, e[None], not side)[0] for v, e in zip(view[k], end[k], strict=True)]
    return f(wo, wi, False) / np.abs(wi[:, 2:]), back / wo[2]


@DRAWS
@given(draws(BASE, COAT, COLOURS, MORE), views, st.booleans(), st.sampled_from([0.0, 430.0, 610.0]))
def test_base(params: dict[str, Any], view: tuple[float, float], front: bool, wavelength: float) -> None:
    """Nothing on top: films, tints and anisotropy among the rest."""
    c, wo = Case("openpbr", params, front, wavelength=wavelength), direction(*view)
    wi, eta = directions(c, wo, 128)
    if len(wi) == 0:
        return
    forth, back = there_and_back(lambda v, o, flipped: c.eval(v, o, flipped=flipped), wo, wi)
    np.testing.assert_allclose(forth, back / eta**2, rtol=0.02, atol=1e-4)


# --- below layers ----------------------------------------------------------------------------------------------------


class Stack:
    """A material taken apart: what its layers leave to the base, and what of its light is the base's."""

    def __init__(self, params: dict[str, Any], *, front: bool) -> None:
        self.case, self.words = Case("openpbr", params, front), params
        self.coat, self.fuzz = (x if x >= LEAST else 0.0 for x in (params["coat_weight"], params["fuzz_weight"]))
        self.thin = params["geometry_thin_walled"]
        dielectric, through = 1 - params["base_metalness"], params["transmission_weight"]
        below = dielectric * (1 - through) * params["subsurface_weight"]
        self.solid = max(dielectric * through, below) >= LEAST and not self.thin
        alpha = params["coat_roughness"] ** 2
        aspect = max(1 - params["coat_roughness_anisotropy"], 0.02)
        wide = alpha * np.sqrt(2 / (1 + aspect**2)) if aspect < 1 and alpha >= 1e-4 else alpha
        self.alphas = (wide, max(wide * aspect, 1e-4)) if wide != alpha else (alpha, alpha)

    def inside(self, flipped: bool) -> bool:
        """Is the view from inside a solid?"""
        return self.solid and self.case.front == flipped

    def lit(self, flipped: bool, view: Any, other: Any, **changes: Any) -> Floats:
        """f |cos| (N, 3) of the material with some parameters changed."""
        changed = Case("openpbr", {**self.words, **changes}, self.case.front)
        return changed.eval(view, other, flipped=flipped)

    def past_fuzz(self, view: Any) -> float:
        """What the fuzz leaves."""
        return float(1 - self.fuzz * testing.openpbr_fuzz_albedo(float(view[2]), self.words["fuzz_roughness"]))

    def base(self, view: Any, other: Any, flipped: bool, **changes: Any) -> Floats:
        """The base's part of f |cos|, (N, 3)."""
        f = self.lit(flipped, view, other, **changes)
        if self.inside(flipped):
            return f
        f = f - self.lit(flipped, view, other, **BLACK, coat_weight=0.0)
        return f - self.lit(flipped, view, other, **BLACK, fuzz_weight=0.0) * self.past_fuzz(view)

    def darkened(self, view: Any, flipped: bool, also: Floats) -> Floats:
        """By what reflections below the coat scale the base, (3,): the same whatever direction light comes from."""
        around = np.concatenate([AROUND, also])
        dark, bare = (self.base(view, around, flipped, **more).sum(axis=0) for more in ({}, {"coat_darkening": 0.0}))
        return np.asarray(np.where(bare > 1e-6, dark / np.maximum(bare, 1e-6), 1))

    def left(self, view: Any, other: Any, flipped: bool) -> Floats:
        """What the layers leave of light that comes along `other` (N, 3) and goes to `view`, (N, 3)."""
        eta = np.clip(self.words["coat_ior"], 0.1, 10)

        def way(z: Any) -> Any:
            return 1 / np.sqrt(np.maximum(1 - (1 - z**2) / eta**2, 1e-4))

        up = other[:, 2] > 0
        color = np.asarray(self.words["coat_color"])
        if self.inside(flipped):
            absorbed = color ** (np.where(up, 0, way(other[:, 2])) / 2)[:, None]
            return np.asarray(1 + self.coat * (absorbed - 1))
        both = way(view[2]) + np.where(up | self.thin, way(other[:, 2]), 0)
        seen = testing.openpbr_albedos(tuple(float(x) for x in view), *self.alphas, eta)["reflected"]
        passed = 1 + self.coat * (color ** (both / 2)[:, None] * (1 - seen) - 1)
        return np.asarray(passed * self.darkened(view, flipped, other) * self.past_fuzz(view))


@DRAWS
@given(draws(BASE, TOP, COLOURS, MORE), views, st.booleans())
def test_base_below_coat_and_fuzz(params: dict[str, Any], view: tuple[float, float], front: bool) -> None:
    # A coat of a more extreme index leaves so little of the base that what its own lobe rounds to counts.
    params = {**params, "coat_ior": min(max(params["coat_ior"], 0.1), 10.0)}
    stack, wo = Stack(params, front=front), direction(*view)
    wi, eta = directions(stack.case, wo, 24)
    if len(wi) == 0:
        return
    forth, back = there_and_back(stack.base, wo, wi)
    all_forth, all_back = there_and_back(lambda v, o, flipped: stack.lit(flipped, v, o), wo, wi)
    to, fro = there_and_back(lambda v, o, flipped: stack.left(v, o, flipped), wo, wi)
    to, fro = to * np.abs(wi[:, 2:]), fro * wo[2]  # no cosine in these
    slack = 1e-4 + 1e-5 * np.maximum(all_forth, all_back)  # what taking the layers' lobes off leaves
    off = np.abs(forth * fro - back / eta**2 * to)
    limit = 0.02 * np.maximum(np.abs(forth * fro), np.abs(back / eta**2 * to)) + slack
    assert (off <= limit).all(), f"{(off / limit).max():.1f} times beyond tolerance"


@DRAWS
@given(draws(TOP, COLOURS, MORE), views)
def test_coat_and_fuzz_themselves(params: dict[str, Any], view: tuple[float, float]) -> None:
    """Of the fuzz where its lobe need not be held back to keep its albedo below 1."""
    wo = direction(*view)
    for layer, other in (("coat", "fuzz"), ("fuzz", "coat")):
        c = Case("openpbr", {**params, **BLACK, f"{other}_weight": 0.0, "coat_darkening": 0.0})
        wi, _ = directions(c, wo, 512)
        wi = wi[wi[:, 2] > 0]
        if layer == "fuzz":
            albedo = [testing.openpbr_fuzz_albedo(float(w[2]), params["fuzz_roughness"]) for w in [wo, *wi]]
            wi = wi[(np.array(albedo[1:]) < 1) & (albedo[0] < 1)]
        if len(wi) > 0:
            forth, back = c.eval(wo, wi) / wi[:, 2:], c.eval(wi, wo) / wo[2]
            np.testing.assert_allclose(forth, back, rtol=0.01, atol=1e-5)
