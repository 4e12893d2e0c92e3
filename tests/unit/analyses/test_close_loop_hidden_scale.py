"""A growth from 20 degC is a scale at the mean temperature, too: which a scale of its own shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table
from loop_bench.folds import LIBRARY

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.same_in_all import constants, with_constants
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import candidates

GROWTH, NOISE = 12e-6, 0.8e-3
"""1/K and mm: the whole of x grows by 4.7 um for every kelvin."""
X, Y = np.meshgrid([20.0, 90.0, 150.0, 210.0, 300.0, 410.0], [15.0, 100.0, 230.0, 290.0])
PLACES = np.stack([X.ravel(), Y.ravel(), np.full(X.size, 10.0)], axis=1)


def found(seed: int, scale: float) -> tuple[Prepared, Search]:
    """Sixteen parts at 20 to 28 degC, x longer by `scale` at 20 degC and by GROWTH a kelvin."""
    rng = np.random.default_rng(seed)
    T = rng.uniform(20.0, 28.0, (16, 1))
    own = table(16, len(PLACES), places=PLACES, covariates={"T_scale_degC": T})
    own = replace(own, operations=("",), operation=np.zeros(len(PLACES), np.int64))
    errors = rng.normal(0.0, NOISE, own.errors.shape) + rng.normal(0.0, NOISE, (16, 1, 2))
    errors[..., 0] += (scale + GROWTH * (T - 20.0)) * PLACES[:, 0]
    own = replace(own, errors=errors)
    prepared = prepare(own, candidates(own, LIBRARY), own.pass_dof)
    gate = calibrated(prepared.scan, 499, 1)
    return prepared, search(prepared, gate, alpha=0.05, most=4)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("scale", [-18e-6, 6e-6])
def test_a_scale_beside_the_growth_is_found(seed: int, scale: float) -> None:
    prepared, seen = found(seed, scale)
    names = [prepared.candidates[step.index].name for step in seen.steps if step.member >= 0]
    assert {"thermal-growth-x", "scale-x"} <= set(names)
    effects = added(prepared, seen)
    assert effects.fit is not None
    at = effects.coefficients(names.index("thermal-growth-x"))[0]
    u = float(np.sqrt(effects.fit.covariance[at, at]))
    assert u < 0.4e-6
    assert abs(float(effects.fit.beta[at]) - GROWTH) < 4 * u


def test_a_growth_from_20_degc_alone_needs_none() -> None:
    """Nor any other effect: at 5 % of ten days, more than three have one in a thousandth."""
    more = 0
    for seed in range(10):
        prepared, seen = found(seed, 0.0)
        names = [prepared.candidates[step.index].name for step in seen.steps if step.member >= 0]
        assert "thermal-growth-x" in names
        more += bool({*names} - {"thermal-growth-x", "thermal-drift-x"})
    assert more <= 3


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("scale", [0.0, -18e-6])
def test_readings_less_their_own_polynomial_speak_for_no_other_size(
    degree: int, scale: float
) -> None:
    """What a polynomial took away is no disagreement: of degree 0 a scale still is one."""
    rng = np.random.default_rng(5)
    x = np.linspace(0.0, 550.0, 12)
    T = rng.uniform(20.0, 28.0, (8, 1))
    places = np.stack([x, np.full(12, np.nan), np.full(12, np.nan)], axis=1)
    own = table(
        8,
        12,
        axes=("x",),
        places=places,
        covariates={"T_scale_degC": T},
        component="dx_x",
        operations=("",),
        fitted_degree=degree,
    )
    errors = rng.normal(0.0, NOISE, (8, 12)) + (scale + GROWTH * (T - 20.0)) * x
    powers = np.vander((x - 275.0) / 275.0, degree + 1)
    errors -= powers @ np.linalg.lstsq(powers, errors.mean(axis=0), rcond=None)[0]
    own = replace(own, errors=errors[..., None])
    prepared = prepare(own, candidates(own, LIBRARY), own.pass_dof)
    names = [c.name for c in prepared.candidates]
    index = names.index("thermal-growth-x")
    first = sum(len(columns) for columns in prepared.scan.columns[:index])
    step = Step(index=index, member=first, p=0.0, log_bayes=9.0, posterior=1.0, credible=(index,))
    steps, _ = with_constants(prepared, calibrated(prepared.scan, 199, 1), [step], 0.05, 4)
    beside = ["scale-x"] if degree == 0 and scale != 0.0 else []
    assert [names[own.index] for own in steps] == ["thermal-growth-x", *beside]
    # A large scale is not hidden: the growth then counts for little in what all passes share.
    told = [*constants(prepared, [first])]
    assert [own.hidden for own in told] == ([scale == 0.0] if degree == 0 else [])
