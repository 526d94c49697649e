"""Materials under test: every type in the list, with parameters chosen by hand and parameters drawn at random.

A new material needs nothing here: it gets its defaults and random draws from its own declared ranges. Hand-made cases
in ``BY_HAND`` add what matters in particular.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from destello._core import testing

Array = NDArray[np.float32]

RANDOM_CASES = 4

BY_HAND: dict[str, list[dict[str, Any]]] = {
    "diffuse": [{"reflectance": (0.9, 0.5, 0.1), "roughness": 0.3}, {"reflectance": 1.0, "roughness": 1.0}],
    "fuzzy_metal": [{"fuzz": f, "albedo": (0.8, 0.6, 0.2)} for f in (0.01, 0.05, 0.5, 1.0)],
    "conductor": [
        {"roughness": 0.1},
        {"roughness": 0.3, "reflectance": (0.9, 0.6, 0.2)},
        {"roughness": 0.5, "anisotropy": 0.8, "fresnel": "eta_k", "eta": (0.2, 0.9, 1.1), "k": (3.9, 2.4, 2.2)},
        {"roughness": 0.7, "anisotropy": -0.6, "fresnel": "none"},
        {"roughness": 1.0, "reflectance": 1.0},
        {"fresnel": "eta_k"},
    ],
    "dielectric": [
        *({"roughness": r, "inside": i} for r in (0.15, 0.4, 1.0) for i in (False, True)),
        {"inside": True},
        {"ior": 2.4, "roughness": 0.3, "tint": (0.9, 0.4, 0.1), "reflection_tint": (0.3, 0.6, 1.0)},
        {"fresnel": "schlick", "roughness": 0.5, "inside": True},
        {"ior": 1.2, "outside_ior": 1.5, "roughness": 0.3},
        {"ior": 1.6, "abbe": 25.0, "wavelength": 430.0, "roughness": 0.3, "inside": True},
        {"ior": 1.5, "outside_ior": 1.5, "roughness": 0.5, "tint": (0.5, 0.6, 0.7)},
        {"ior": 1.33, "outside_ior": 1.33},
    ],
    "metallic_roughness": [
        {"metallic": 0.0, "roughness": 0.1},
        {"metallic": 0.0, "roughness": 0.5, "base_color": (0.8, 0.3, 0.1)},
        {"metallic": 0.5, "roughness": 0.3, "base_color": (0.8, 0.3, 0.1), "transmission": 0.5},
        {"metallic": 0.0, "roughness": 0.4, "transmission": 1.0},
        {"metallic": 1.0, "roughness": 0.15, "base_color": (0.9, 0.6, 0.2)},
        {"metallic": 0.3, "roughness": 0.7, "transmission": 0.6},
        {"metallic": 0.0, "roughness": 0.0},
        {"metallic": 0.0, "roughness": 0.0, "transmission": 1.0, "ior": 2.0},
        {"metallic": 0.0, "roughness": 0.6, "specular": 0.5, "specular_color": (3.0, 1.0, 0.2)},
    ],
    "openpbr": [
        {"base_metalness": 1.0, "specular_roughness": 0.5, "specular_color": (0.9, 0.6, 0.3)},
        {"base_metalness": 1.0, "specular_roughness": 0.4, "specular_roughness_anisotropy": 0.7},
        *(
            {"transmission_weight": 1.0, "specular_roughness": r, "inside": i}
            for r in (0.0, 0.4)
            for i in (False, True)
        ),
        {
            "transmission_weight": 0.7,
            "subsurface_weight": 0.5,
            "specular_roughness": 0.6,
            "base_diffuse_roughness": 0.5,
        },
        {"transmission_weight": 0.7, "subsurface_weight": 0.5, "base_metalness": 0.2, "inside": True},
        {"transmission_weight": 0.6, "specular_ior": 1.2, "outside_ior": 1.5, "subsurface_weight": 0.5},
        {"transmission_weight": 0.5, "geometry_thin_walled": True, "transmission_color": (0.9, 0.5, 0.2)},
        {"subsurface_weight": 1.0, "geometry_thin_walled": True, "subsurface_scatter_anisotropy": 0.4},
        {"subsurface_weight": 1.0},
        {"subsurface_weight": 1.0, "inside": True},
        {"thin_film_weight": 1.0, "base_metalness": 0.5, "specular_roughness": 0.2},
        {"thin_film_weight": 1.0, "transmission_weight": 1.0, "inside": True},
        {"coat_weight": 1.0, "coat_roughness": 0.2, "coat_color": (0.9, 0.5, 0.2), "base_color": (0.8, 0.2, 0.1)},
        {"coat_weight": 0.7, "coat_roughness_anisotropy": 0.5, "coat_roughness": 0.4, "base_metalness": 1.0},
        {"coat_weight": 1.0, "coat_roughness": 0.3, "geometry_coat_normal": (0.75, 0.4, 0.9)},
        {"coat_weight": 1.0, "coat_roughness": 0.4, "transmission_weight": 0.5, "tilt": (50, 0.2, 20, 0.6)},
        {"coat_weight": 0.8, "coat_roughness": 0.5, "base_metalness": 0.5, "tilt": (75, 0.4, 30, 0.1)},
        {"fuzz_weight": 1.0, "fuzz_color": (0.3, 0.5, 0.9), "fuzz_roughness": 0.3},
        {"transmission_weight": 1.0, "transmission_dispersion_scale": 1.0, "wavelength": 430.0},
    ],
}

NOT_RECIPROCAL = {"fuzzy_metal"}
"""Models that are defined by how they sample; see their headers."""

LAYERS = ("coat_weight", "fuzz_weight")
"""OpenPBR's layers on top scale what lies below by wo alone: with them it is not reciprocal."""


def is_reciprocal(case: Case) -> bool:
    """Does the material claim to be reciprocal, with radiance's eta^2?"""
    return case.type not in NOT_RECIPROCAL and not any(case.params.get(name, 0) > 0 for name in LAYERS)


OUTGOING = [(1.0, 0.0), (0.85, 0.11), (0.45, 0.42), (0.07, 0.8)]
"""Directions of view: cosine of the polar angle, azimuth in turns."""


@dataclass(frozen=True)
class Case:
    """One material with all parameters and surroundings set."""

    type: str
    params: dict[str, Any] = field(default_factory=dict)
    front: bool = True
    outside_ior: float = 1.0
    wavelength: float = 0.0
    label: str = ""
    tilt: tuple[float, float, float, float] | None = None
    """How layers' normals lean from the surface's: degrees and turns of the base's, then of the interpolated one."""

    def context(self, *, flipped: bool = False) -> Any:
        """Surroundings as the core takes them; ``flipped``: seen from the other side."""
        return testing.BsdfContext(self.front != flipped, self.outside_ior, self.wavelength, self.normals())

    def normals(self) -> list[list[float]]:
        """What the core's LayerNormals holds; nothing if all is one."""
        if self.tilt is None:
            return []
        base, turns, plain, plain_turns = self.tilt
        mapped, normal = (direction(np.cos(np.radians(a)), t) for a, t in ((base, turns), (plain, plain_turns)))
        along, other = direction(0.6, turns + 0.3), direction(0.1, 0.05)
        return [v.tolist() for v in (mapped, along, normal, other)]

    def eval(self, wo: ArrayLike, wi: ArrayLike, *, flipped: bool = False) -> NDArray[np.float64]:
        """f |cos| (N, 3)."""
        out = testing.bsdf_eval(self.type, self.params, rows(wo), rows(wi), self.context(flipped=flipped))
        return np.asarray(out, np.float64)

    def pdf(self, wo: ArrayLike, wi: ArrayLike) -> NDArray[np.float64]:
        """Density (N,), 1/sr."""
        return np.asarray(testing.bsdf_pdf(self.type, self.params, rows(wo), rows(wi), self.context()), np.float64)

    def sample(self, wo: ArrayLike, u: ArrayLike) -> Samples:
        """Samples for uniform numbers (N, 3)."""
        return Samples(testing.bsdf_sample(self.type, self.params, rows(wo), rows(u), self.context()))

    def traits(self) -> dict[str, bool]:
        """delta_only, is_delta, needs_wavelength."""
        return dict(testing.bsdf_traits(self.type, self.params, self.context()))

    def seed(self, *more: object) -> int:
        """A seed that depends on nothing but the case."""
        return zlib.crc32(repr((self.type, self.label, *more)).encode())


class Samples:
    """What ``sample`` returned, as float64 arrays and masks."""

    def __init__(self, raw: dict[str, Any]) -> None:
        self.wi = np.asarray(raw["wi"], np.float64)
        self.weight = np.asarray(raw["weight"], np.float64)
        self.pdf = np.asarray(raw["pdf"], np.float64)
        self.eta = np.asarray(raw["eta"], np.float64)
        self.flags = np.asarray(raw["flags"])
        self.ok = self.pdf > 0
        self.delta = self.ok & ((self.flags & testing.DELTA) != 0)
        self.spread = self.ok & ~self.delta
        self.transmitted = self.ok & ((self.flags & testing.TRANSMISSION) != 0)

    def power(self) -> NDArray[np.float64]:
        """Weights as fractions of power (N, 3): radiance without the 1/eta^2 of refraction; 0 for failed samples."""
        return np.where(self.ok[:, None], self.weight * self.eta[:, None] ** 2, 0)

    def directions(self) -> NDArray[np.float64]:
        """Directions with a density (N, 3); NaN where the sample failed or took a delta lobe."""
        return np.where(self.spread[:, None], self.wi, np.nan)


def rows(a: ArrayLike) -> Array:
    """(N, 3) float32, C order, from (N, 3) or (3,)."""
    return np.ascontiguousarray(np.atleast_2d(np.asarray(a)), np.float32)


def direction(cosine: float, turns: float) -> Array:
    """Unit vector (3,) by polar cosine and azimuth."""
    sine = np.sqrt(max(1 - cosine * cosine, 0.0))
    return np.array([sine * np.cos(2 * np.pi * turns), sine * np.sin(2 * np.pi * turns), cosine], np.float32)


def make_case(kind: str, words: dict[str, Any], label: str) -> Case:
    """Split words into the surroundings and the material's parameters."""
    words = dict(words)
    front = not words.pop("inside", False)
    outside, wavelength = words.pop("outside_ior", 1.0), words.pop("wavelength", 0.0)
    return Case(kind, words, front, outside, wavelength, label, words.pop("tilt", None))


def random_case(kind: str, index: int) -> Case:
    """Parameters drawn from the ranges that the material declares; also the side and what is outside."""
    rng = np.random.default_rng(zlib.crc32(f"{kind} {index}".encode()))
    words: dict[str, Any] = {"inside": bool(rng.random() < 0.5), "outside_ior": float(rng.choice([1.0, 1.33]))}
    for p in testing.bsdf_params(kind):
        lo, hi = max(p["min"], -4.0), min(p["max"], 4.0)
        if p["kind"] == "enum":
            words[p["name"]] = str(rng.choice(p["choices"].split()))
        elif p["kind"] == "bool":
            words[p["name"]] = bool(rng.random() < 0.5)
        elif p["kind"] == "scalar":
            words[p["name"]] = float(rng.uniform(lo, hi))
        else:
            words[p["name"]] = tuple(float(x) for x in rng.uniform(lo, hi, 3))
    return make_case(kind, words, f"random{index}")


def all_cases() -> list[Case]:
    """Every material of the list: defaults, by hand, at random."""
    cases = []
    for kind in testing.bsdf_types():
        cases.append(Case(kind, label="default"))
        for words in BY_HAND.get(kind, []):
            label = ",".join(f"{k}={v}".replace(" ", "") for k, v in words.items())
            cases.append(make_case(kind, words, label))
        if testing.bsdf_params(kind):
            cases += [random_case(kind, i) for i in range(RANDOM_CASES)]
    return cases


CASES = all_cases()
IDS = [f"{c.type}-{c.label}" for c in CASES]
