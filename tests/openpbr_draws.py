"""Random OpenPBR materials: what the tests of `test_openpbr.py` and `test_openpbr_reciprocity.py` draw."""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

DRAWS = settings(max_examples=1000, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
"""A thousand draws for each property, the same ones in every run."""


# On grids, as Hypothesis takes floats from whatever is imported; what lies between and beyond is listed. Drawn evenly,
# by seeds of Hypothesis': its own integers are mostly small.
def even(first: int, last: int, steps: int) -> st.SearchStrategy[float]:
    return st.randoms(use_true_random=True).map(lambda r: r.randint(first, last) / steps)


unit = even(0, 10_000, 10_000)
tiny = st.sampled_from([1e-45, 1e-39, 4e-34, 1e-20, 1e-9, 1e-6, 9e-6, 1.1e-5, 1 - 2e-5, 1 - 1e-6, 1 - 2**-24])
share = st.one_of(st.sampled_from([0.0, 1.0]), unit, tiny)
extreme = st.sampled_from([1e-3, 0.02, 30.0, 100.0, 1e9])
index, any_index = even(1000, 3000, 1000), st.one_of(even(334, 3000, 1000), even(100, 10_000, 1000), extreme)
colour = st.tuples(unit, unit, unit)

BASE = {
    "base_metalness": share,
    "base_diffuse_roughness": unit,
    "specular_weight": unit,
    "specular_roughness": unit,
    "specular_ior": any_index,
    "transmission_weight": share,
    "subsurface_weight": share,
    "subsurface_scatter_anisotropy": even(-9, 9, 10),
    "geometry_thin_walled": st.booleans(),
}
TOP = {
    "coat_weight": share,
    "coat_roughness": unit,
    "coat_ior": any_index,
    "coat_darkening": unit,
    "fuzz_weight": share,
    "fuzz_roughness": unit,
}
COLOURS = {f"{lobe}_color": colour for lobe in ("base", "specular", "transmission", "subsurface", "coat", "fuzz")}
stretch = st.just(0.0) | even(0, 100, 100)
ANISOTROPY = {f"{lobe}_roughness_anisotropy": stretch for lobe in ("specular", "coat")}
MORE = ANISOTROPY | {
    "base_weight": unit,
    "thin_film_weight": share,
    "thin_film_thickness": unit,
    "thin_film_ior": index,
}
COAT = {
    "geometry_coat_normal": st.tuples(unit, unit, even(5000, 10_000, 10_000)),
    "geometry_coat_normal_scale": unit,
}
angle = st.integers(0, 80)
tilts = st.none() | st.tuples(angle, unit, angle, unit)
"""How the surface leans below a base whose normals a map has turned: see `Case.tilt`."""
views = st.tuples(even(5, 100, 100), unit)


def draws(*groups: dict[str, st.SearchStrategy[Any]]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({name: value for group in groups for name, value in group.items()})
