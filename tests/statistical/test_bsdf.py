"""What holds for every material: the sampler follows the density, weight = f |cos| / pdf, reciprocity, energy."""

from __future__ import annotations

import numpy as np
import pytest

from bsdf_cases import CASES, IDS, OUTGOING, Case, direction, is_reciprocal
from destello._core import testing
from stats import assert_mean, chi2_directions, z_threshold

every_case = pytest.mark.parametrize("case", CASES, ids=IDS)
RECIPROCAL = [c for c in CASES if is_reciprocal(c)]
every_view = pytest.mark.parametrize("view", OUTGOING, ids=[f"cos={c}" for c, _ in OUTGOING])


def uniform(case: Case, n: int, *more: object) -> np.ndarray:
    return np.random.default_rng(case.seed(*more)).random((n, 3)).astype(np.float32).clip(0, 1 - 2**-24)


def test_every_type_is_covered() -> None:
    assert {c.type for c in CASES} == set(testing.bsdf_types())
    assert len(set(IDS)) == len(IDS)


@every_view
@every_case
def test_samples_follow_pdf(case: Case, view: tuple[float, float]) -> None:
    wo = direction(*view)
    u = uniform(case, 500, "probe", view)
    if not case.sample(wo, u).spread.any():
        # Nothing but delta lobes or nothing at all: then the density must be 0, everywhere.
        assert not case.pdf(wo, np.random.default_rng(1).normal(size=(1000, 3))).any()
        return
    result = chi2_directions(
        lambda v: case.sample(wo, v.astype(np.float32).clip(0, 1 - 2**-24)).directions(),
        lambda d: case.pdf(wo, d),
        seed=case.seed(view),
    )
    result.check(comparisons=len(CASES) * len(OUTGOING))


@every_view
@every_case
def test_weight_is_eval_over_pdf(case: Case, view: tuple[float, float]) -> None:
    wo = direction(*view)
    s = case.sample(wo, uniform(case, 20_000, "weight", view))
    assert np.isfinite(s.weight).all()
    assert np.isfinite(s.pdf).all()
    assert (s.weight[s.ok] >= 0).all()
    assert np.allclose(np.linalg.norm(s.wi[s.ok], axis=1), 1, atol=2e-6)
    np.testing.assert_array_equal((s.wi[:, 2] < 0)[s.ok], s.transmitted[s.ok])
    assert (s.pdf[s.delta] == 1).all()
    assert (s.eta[s.ok & ~s.transmitted] == 1).all()
    assert not (s.delta.any() and s.spread.any()) or not case.traits()["is_delta"]
    k = s.spread
    if not k.any():
        return
    wi = s.wi[k]
    pdf, f = case.pdf(wo, wi), case.eval(wo, wi)
    # Narrow lobes magnify the rounding of wi: their density changes by about 1e-7 sqrt(density) of itself.
    slack = 2e-3 + 2e-5 * np.sqrt(s.pdf[k])
    off = np.abs(pdf - s.pdf[k]) / s.pdf[k]
    # sqrt-shaped edges (fuzz) and grazing directions: a few samples may deviate more.
    assert np.mean(off > slack) < 2e-3, f"pdf of sample and pdf differ by up to {off.max():.2e}"
    ratio = f / pdf[:, None]
    good = (off <= slack) & (pdf > 0)
    error = np.abs(ratio - s.weight[k])[good] - (1e-4 + 2 * slack[good, None] * s.weight[k][good])
    assert np.mean(error > 0) < 2e-3, f"weight and eval / pdf differ by up to {error.max():.2e}"


@every_case
def test_pdf_covers_eval(case: Case) -> None:
    """Where light is reflected, it can be sampled; nothing is negative."""
    rng = np.random.default_rng(case.seed("cover"))
    for view in OUTGOING:
        wi = rng.normal(size=(4000, 3))
        wi /= np.linalg.norm(wi, axis=1, keepdims=True)
        f, pdf = case.eval(direction(*view), wi), case.pdf(direction(*view), wi)
        assert np.isfinite(f).all()
        assert np.isfinite(pdf).all()
        assert (f >= 0).all()
        assert (pdf >= 0).all()
        assert (pdf[f.max(axis=1) > 1e-6] > 0).all()


@pytest.mark.parametrize("case", RECIPROCAL, ids=[f"{c.type}-{c.label}" for c in RECIPROCAL])
def test_reciprocity(case: Case) -> None:
    """f(wo, wi) / n_o^2 = f(wi, wo) / n_i^2: with radiance's 1/eta^2, the same from both sides (Veach 1997, 5.2)."""
    compared = 0
    for view in OUTGOING:
        wo = direction(*view)
        s = case.sample(wo, uniform(case, 4000, "reciprocity", view))
        k = s.spread & (np.abs(s.wi[:, 2]) > 0.05)
        if not k.any():
            continue
        wi, eta = s.wi[k], s.eta[k]
        up = wi[:, 2] > 0
        forth = case.eval(wo, wi) / np.abs(wi[:, 2:])
        back = np.empty_like(forth)
        back[up] = case.eval(wi[up], wo) / wo[2] if up.any() else 0
        if (~up).any():  # from the other side: turn the frame by half a turn, so that wo' points up
            back[~up] = case.eval(-wi[~up], -wo, flipped=True) / wo[2]
        # scaled by n_o^2 / n_i^2 = 1 / eta^2
        expected = back / eta[:, None] ** 2
        slack = 5e-3 + 5e-5 * np.sqrt(s.pdf[k][:, None])
        off = np.abs(forth - expected) - slack * np.maximum(forth, expected) - 1e-6
        assert np.mean(off > 0) < 1e-3, f"f there and back differ by up to {off.max():.2e} beyond tolerance"
        compared += k.sum()
    traits = case.traits()
    assert compared > 1000 or traits["is_delta"] or traits["delta_only"]


@every_view
@every_case
def test_energy(case: Case, view: tuple[float, float]) -> None:
    """No more power leaves than came: the mean weight, with refraction's radiance factor taken out, is at most 1."""
    power = case.sample(direction(*view), uniform(case, 20_000, "energy", view)).power()
    sigma = power.std(axis=0) / np.sqrt(len(power))
    limit = 1 + 4e-3 + z_threshold(len(CASES) * len(OUTGOING) * 3) * sigma
    assert (power.mean(axis=0) <= limit).all(), f"albedo {power.mean(axis=0)} +- {sigma}"


@every_case
def test_numbers_at_the_edges(case: Case) -> None:
    """Extreme uniform numbers and views give finite values, and directions on the side that the flags say."""
    top = 1 - 2**-24
    u = np.array([(a, b, c) for a in (0, 0.5, top) for b in (0, 0.5, top) for c in (0, 0.5, top)], np.float32)
    for wo in ((0, 0, 1), (1, 0, 1e-6), (0.6, -0.8, 1e-3), (1e-4, 0, 1)):
        v = np.asarray(wo, np.float64)
        v /= np.linalg.norm(v)
        s = case.sample(v, u)
        for a in (s.wi, s.weight, s.pdf, case.eval(v, u - 0.5), case.pdf(v, u - 0.5)):
            assert np.isfinite(a).all()
        assert (s.wi[s.ok & ~s.transmitted, 2] > 0).all()
        assert (s.wi[s.transmitted, 2] < 0).all()


def test_delta_lobes_have_no_density() -> None:
    """Delta materials evaluate to 0 even in the very direction that they send light to."""
    checked = 0
    for case in CASES:
        for view in OUTGOING:
            s = case.sample(direction(*view), uniform(case, 200, "delta"))
            if not s.delta.any():
                continue
            checked += 1
            if case.traits()["is_delta"]:
                assert not case.eval(direction(*view), s.wi[s.delta]).any()
                assert not case.pdf(direction(*view), s.wi[s.delta]).any()
    assert checked > 20


def test_helpers_see_a_wrong_sampler() -> None:
    """The tests above can fail: a density off by a few percent, a missing lobe, and a wrong mean are found."""
    rough = next(c for c in CASES if c.type == "conductor" and c.params.get("roughness") == 0.3)
    wo = direction(0.85, 0.11)

    def draw(u: np.ndarray) -> np.ndarray:
        return rough.sample(wo, u.astype(np.float32).clip(0, 1 - 2**-24)).directions()

    for wrong in (
        lambda d: 0.95 * rough.pdf(wo, d),
        lambda d: rough.pdf(wo, d) * (1 + 0.1 * np.sign(d[:, 0])),
        lambda d: 0.99 * rough.pdf(wo, d) + 0.01 / (4 * np.pi),
    ):
        with pytest.raises(AssertionError):
            chi2_directions(draw, wrong, seed=1).check(comparisons=1000)
    with pytest.raises(AssertionError):
        assert_mean(np.random.default_rng(1).normal(0.02, 1, 100_000), 0, comparisons=100)
