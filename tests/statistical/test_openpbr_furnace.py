"""OpenPBR in a white furnace, over a grid of roughness, cosine and index: what goes in comes out, lobe by lobe.

`test_openpbr.py` has the same for random materials. Numbers are the same in every run; limits are the worst on the grid
with a little room, and docs/materials.md names them.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import qmc

from bsdf_cases import Case, direction

MANY = qmc.Sobol(3, rng=7).random(2**16).astype(np.float32).clip(0, 1 - 2**-24)
U = MANY[:8192]
WHITE = {"base_color": 1.0, "subsurface_color": 1.0}
COSINES, TURNS = (0.01, 0.05, 0.2, 0.5, 0.9), (0.0, 0.06, 0.13, 0.19, 0.25)
ROUGHNESSES, FEWER = (0.0, 0.05, 0.12, 0.22, 0.4, 0.6, 0.8, 1.0), (0.2, 0.45, 0.7, 1.0)
INDICES = (0.15, 0.6, 1.1, 1.5, 2.4, 4.0, 10.0)
EXTREME = (1e-3, 0.04, 30.0, 1e9)
STRETCHED = (0.3, 0.6, 0.8, 0.95)

METAL, GLASS, SUBSURFACE = ({name: 1.0} for name in ("base_metalness", "transmission_weight", "subsurface_weight"))
SHEET = {"geometry_thin_walled": True, "transmission_weight": 0.5, "subsurface_weight": 0.5}
COAT = {"coat_weight": 1.0, "specular_weight": 0.0}
FUZZ = {"fuzz_weight": 1.0, "specular_weight": 0.0}
ALL = {"coat_weight": 0.7, "coat_roughness": 0.4, "fuzz_weight": 0.5, "base_metalness": 0.3} | {
    "transmission_weight": 0.3, "subsurface_weight": 0.4, "base_diffuse_roughness": 0.5
}  # fmt: skip
LOBES = [
    ("gloss", {}, "specular", (True,), 0.005, 0.006),
    ("rough diffuse", {"base_diffuse_roughness": 1.0}, "specular", (True,), 0.008, 0.011),
    ("metal", METAL, "specular", (True,), 0.004, 0.005),
    ("glass from outside", GLASS, "specular", (True,), 0.006, 0.008),
    ("glass from inside", GLASS, "specular", (False,), 0.006, 0.022),
    ("subsurface", SUBSURFACE, "specular", (True, False), 0.005, 0.006),
    ("sheet", SHEET, "specular", (True,), 0.006, 0.005),
    ("coat", COAT, "coat", (True,), 0.005, 0.006),
    ("all", ALL, "specular", (True,), 0.005, 0.006),
]


def off(
    words: dict[str, Any], cosine: float, turns: float, *, front: bool, wavelength: float = 0
) -> NDArray[np.float64]:
    """What a white surface gives back beyond what came, (3,)."""
    case = Case("openpbr", {**WHITE, **words}, front=front, wavelength=wavelength)
    return np.asarray(case.sample(direction(cosine, turns), U).power().mean(axis=0) - 1)


@pytest.mark.parametrize(("words", "layer", "sides", "limit"), [lobe[1:5] for lobe in LOBES], ids=[x[0] for x in LOBES])
def test_isotropic(words: dict[str, Any], layer: str, sides: tuple[bool, ...], limit: float) -> None:
    for index, roughness, cosine, front in itertools.product(INDICES, ROUGHNESSES, COSINES, sides):
        case = {f"{layer}_ior": index, f"{layer}_roughness": roughness, **words}
        error = np.abs(off(case, cosine, 0.1, front=front)).max()
        assert error < limit, f"{case} from {cosine}, front={front}: {error:.4f}"


@pytest.mark.parametrize(("words", "layer", "sides"), [x[1:4] for x in LOBES], ids=[x[0] for x in LOBES])
def test_extreme_indices(words: dict[str, Any], layer: str, sides: tuple[bool, ...]) -> None:
    for index, roughness, cosine, front in itertools.product(EXTREME, ROUGHNESSES[::2], COSINES, sides):
        case = {f"{layer}_ior": index, f"{layer}_roughness": roughness, **words}
        error = np.abs(off(case, cosine, 0.1, front=front)).max()
        limit = 0.025 if "base_diffuse_roughness" in words and layer == "specular" else 0.012
        assert error < limit, f"{case} from {cosine}, front={front}: {error:.4f}"


@pytest.mark.parametrize(
    ("words", "layer", "sides", "limit"), [(*x[1:4], x[5]) for x in LOBES], ids=[x[0] for x in LOBES]
)
def test_anisotropic(words: dict[str, Any], layer: str, sides: tuple[bool, ...], limit: float) -> None:
    cells = itertools.product((1.3, 2.0), STRETCHED, FEWER, COSINES[1:], TURNS, sides)
    for index, stretch, roughness, cosine, turns, front in cells:
        case = {f"{layer}_ior": index, f"{layer}_roughness": roughness, **words}
        case[f"{layer}_roughness_anisotropy"] = stretch
        error = np.abs(off(case, cosine, turns, front=front)).max()
        assert error < limit, f"{case} from {cosine}, {turns} turns, front={front}: {error:.4f}"


def test_fuzz() -> None:
    for roughness, cosine in itertools.product((0.0, 0.1, 0.13, *ROUGHNESSES[3:]), (*COSINES, 0.12, 0.35)):
        error = np.abs(off({**FUZZ, "fuzz_roughness": roughness}, cosine, 0.1, front=True)).max()
        assert error < 0.003, f"{roughness} from {cosine}: {error:.4f}"


@pytest.mark.parametrize("index", [1.2, 1.4, 1.9, 2.5])
def test_thin_film_over_white(index: float) -> None:
    for thickness, roughness, cosine in itertools.product((0.15, 0.3, 0.5, 1.0, 2.0), ROUGHNESSES[::2], COSINES):
        film = {"thin_film_weight": 1.0, "thin_film_ior": index, "thin_film_thickness": thickness}
        error = np.abs(off({**film, "specular_roughness": roughness}, cosine, 0.1, front=True)).max()
        assert error < 0.006, f"{film}, roughness {roughness} from {cosine}: {error:.4f}"


@pytest.mark.parametrize(
    ("model", "words", "most"),
    [
        ("openpbr", METAL, 8),
        ("openpbr", GLASS, 80),
        ("openpbr", SHEET, 8),
        ("metallic_roughness", {"metallic": 1.0}, 8),
        ("metallic_roughness", {"metallic": 0.0, "transmission": 1.0}, 10),
    ],
)
def test_lost_light_is_drawn_where_it_goes(model: str, words: dict[str, Any], most: float) -> None:
    """No fireflies: drawn evenly, what narrow facets give back at grazing angles came in weights of thousands."""
    key = {"openpbr": "specular_roughness", "metallic_roughness": "roughness"}[model]
    stretches = (0.0, 0.9) if model == "openpbr" else (0.0,)
    cells = itertools.product((0.03, 0.06, *ROUGHNESSES[2:]), COSINES, stretches, (True, False))
    for roughness, cosine, stretch, front in cells:
        aspect = {"specular_roughness_anisotropy": stretch} if stretch else {}
        case = Case(model, {"base_color": 1.0, **words, key: roughness, **aspect}, front=front)
        power = case.sample(direction(cosine, 0.12), MANY).power()
        assert power.max() < most, f"{roughness}, {aspect} from {cosine}, front={front}: {power.max():.1f}"
        assert power.std() < 0.75, f"{roughness}, {aspect} from {cosine}, front={front}: {power.std():.2f}"


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("diffuse", {"reflectance": 1.0}),
        ("openpbr", {"base_color": 1.0, "specular_weight": 0.0}),
        ("openpbr", {"base_color": 1.0, "specular_roughness": 0.5}),
        ("openpbr", {"base_color": 1.0, "specular_weight": 0.0, "coat_weight": 1.0, "coat_roughness": 0.3}),
    ],
    ids=["diffuse", "bare", "gloss", "coat"],
)
def test_rough_diffuse_draws_grazing_directions_at_grazing_angles(model: str, words: dict[str, Any]) -> None:
    """By the cosine alone weights were up to 280, in OpenPBR up to 76."""
    key = {"openpbr": "base_diffuse_roughness", "diffuse": "roughness"}[model]
    for roughness, cosine in itertools.product((0.1, 0.3, 1.0), COSINES):
        power = Case(model, {**words, key: roughness}).sample(direction(cosine, 0.12), MANY).power()
        assert power.max() < 3.5, f"{roughness} from {cosine}: {power.max():.1f}"
        assert power.std() < 0.75, f"{roughness} from {cosine}: {power.std():.2f}"


FILMED = [
    ("gloss", {}, (True,)),
    ("subsurface", SUBSURFACE, (True, False)),
    ("sheet", SHEET, (True,)),
]


@pytest.mark.parametrize(("words", "sides"), [x[1:] for x in FILMED], ids=[x[0] for x in FILMED])
@pytest.mark.parametrize(("stretched", "limit"), [(False, 0.008), (True, 0.012)])
def test_random_thin_films_over_white(
    words: dict[str, Any], sides: tuple[bool, ...], stretched: bool, limit: float
) -> None:
    """Half of them at one wavelength, where fringes are sharpest."""
    rng = np.random.default_rng(31)
    for i in range(150):
        film = {
            "thin_film_weight": 1.0,
            "thin_film_ior": rng.uniform(1, 3),
            "thin_film_thickness": rng.uniform(0, 2),
            "specular_ior": rng.uniform(1.1, 4),
            "specular_roughness": rng.uniform(0.2 if stretched else 0, 1),
            "specular_roughness_anisotropy": rng.uniform(0, 0.95) if stretched else 0.0,
        }
        cosine, turns = max(rng.random() ** 2, 0.01), rng.random()
        nm = rng.uniform(390, 700) * (i % 2)
        error = np.abs(off({**film, **words}, cosine, turns, front=sides[i % len(sides)], wavelength=nm)).max()
        assert error < limit, f"{film} from {cosine}, {turns} turns, {nm} nm: {error:.4f}"
