"""Two sizes of one effect: the rate of the t test, what is told of it, and what stands beside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table
from loop_bench.folds import LIBRARY
from scipy.stats import binom

from mtu_cli.analyses.close_loop.added import added
from mtu_cli.analyses.close_loop.jointly import jointly
from mtu_cli.analyses.close_loop.prepare import Prepared, prepare
from mtu_cli.analyses.close_loop.same_in_all import (
    Disagreement,
    disagreements,
    with_constants,
    with_disagreement,
)
from mtu_cli.analyses.close_loop.scan import calibrated
from mtu_cli.analyses.close_loop.state import Step
from mtu_cli.model.effect_library import candidates

GROWTH, NOISE = 12e-6, 1.3e-3
"""1/K and mm."""
X, Y = np.meshgrid([20.0, 140.0, 265.0, 380.0], [15.0, 140.0, 290.0])
PLACES = np.stack([X.ravel(), Y.ravel(), np.full(12, 10.0)], axis=1)
FEW = replace(LIBRARY, families=tuple(
    own for own in LIBRARY.families if own.family.family in ("scale", "thermal-growth")
))  # fmt: skip


def day(seed: int, scale: float = 0.0, turn: float = 4e-6) -> tuple[Prepared, Step]:
    """Eight parts at 24 to 28 degC: what grows by 6 K on the mean is near to a scale of 72 um/m.
    The growth counted from 20 degC as it would be found; each part's scale is `turn` off.
    """
    rng = np.random.default_rng(seed)
    T = rng.permutation(np.linspace(24.0, 28.0, 8))[:, None]
    own = table(8, 12, axes=("x",), places=PLACES, covariates={"T_scale_degC": T})
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    errors = rng.normal(0.0, NOISE, (8, 12)) + rng.normal(0.0, 2e-3, (8, 1))
    errors += (scale + GROWTH * (T - 20.0) + rng.normal(0.0, turn, (8, 1))) * (X.ravel() - 200.0)
    own = replace(own, errors=errors[..., None])
    prepared = prepare(own, candidates(own, FEW), own.pass_dof)
    names = [c.name for c in prepared.candidates]
    index = names.index("thermal-growth-x")
    first = sum(len(columns) for columns in prepared.scan.columns[:index])
    (member,) = (
        m
        for m in range(first, first + len(prepared.scan.columns[index]))
        if "(T_scale_degC - 20)" in prepared.members[m].equations["Ex"]
    )
    return prepared, Step(
        index=index, member=member, p=0.0, log_bayes=9.0, posterior=1.0, credible=(index,)
    )


def told(prepared: Prepared, step: Step) -> Disagreement:
    (own,) = disagreements(prepared, prepared.whole([step.member]), [step.member])
    return own


def test_both_sizes_disagree_by_chance_as_often_as_stated() -> None:
    runs = 400
    p = np.array([told(*day(seed)).p for seed in range(runs)])
    for alpha in (0.05, 0.3):
        # Welch's degrees of freedom are no more than near.
        hits = int((p < alpha).sum())
        assert binom.ppf(1e-3, runs, 0.7 * alpha) <= hits <= binom.ppf(1 - 1e-3, runs, 1.2 * alpha)


def test_the_two_sizes_are_those_of_the_parts_slopes() -> None:
    """Against the slopes of single parts, their line in the temperature, and their mean."""
    prepared, step = day(3, scale=60e-6)
    x = X.ravel() - 200.0
    slopes = prepared.table.errors[..., 0] - prepared.table.errors[..., 0].mean(axis=1)[:, None]
    slopes = slopes @ (x - x.mean()) / ((x - x.mean()) @ (x - x.mean()))
    T = prepared.table.covariates["T_scale_degC"][:, 0] - 20.0
    line, (s2,), *_ = np.linalg.lstsq(np.stack([T, np.ones(8)], axis=1), slopes)
    C = np.linalg.inv(np.stack([T, np.ones(8)]) @ np.stack([T, np.ones(8)], axis=1)) * s2 / 6
    own = told(prepared, step)
    _, apart = jointly(prepared, [*prepared.whole([step.member]), (own.column,)])
    assert apart.beta[0] == pytest.approx(line[0], rel=1e-9)
    # The slopes in y that go along with those in x by chance are weighted, too.
    assert apart.beta[1] == pytest.approx(line[1] / T.mean(), rel=0.01)
    # By the scatter of single entries and of parts, where the line's is one of six: chi^2 of it.
    assert line[1] / np.sqrt(C[1, 1]) / own.t == pytest.approx(1.0, abs=0.3)
    assert own.dof == pytest.approx(6.0, abs=1.5)


@pytest.mark.parametrize("scale", [0.0, 10e-6, 20e-6, 60e-6])
def test_the_growth_is_covered_whatever_scale_there_is(scale: float) -> None:
    runs, held, beside = 60, 0, 0
    for seed in range(runs):
        prepared, step = day(seed, scale)
        gate = calibrated(prepared.scan, 99, 1)
        steps = with_constants(prepared, gate, [step])
        names = [prepared.candidates[own.index].name for own in steps]
        assert names in (["thermal-growth-x"], ["thermal-growth-x", "scale-x"])
        beside += len(steps) - 1
        columns = prepared.whole([own.member for own in steps])
        _, fit = jointly(prepared, columns)
        fit = with_disagreement(prepared, columns, [own.member for own in steps], fit)
        held += abs(fit.beta[0] - GROWTH) < 2.3 * np.sqrt(fit.covariance[0, 0])
    # Where a scale is not told, the growth has it, and its u how far that may be.
    assert held >= binom.ppf(1e-3, runs, 0.95 if scale in (0.0, 60e-6) else 0.85)
    assert beside <= binom.ppf(1 - 1e-3, runs, 0.012) if scale == 0.0 else True
    assert beside >= 0.9 * runs if scale == 60e-6 else True


def test_what_stands_beside_has_the_p_of_all_tests() -> None:
    prepared, step = day(2, 60e-6)
    gate = calibrated(prepared.scan, 199, 1)
    (_, constant) = with_constants(prepared, gate, [step])
    own = told(prepared, step)
    assert own.p < constant.p == pytest.approx(gate.family_p(np.array([-np.log(own.p)]))[0])
    assert constant.constant
    # A candidate that is not looked for is not taken.
    assert with_constants(prepared, gate, [step], frozenset({constant.index})) == [step]
    # Beside it there is nothing left to disagree.
    members = [step.member, constant.member]
    assert not [*disagreements(prepared, prepared.whole(members), members)]


def test_the_covariance_holds_what_both_sizes_are_apart() -> None:
    prepared, step = day(5, 25e-6)
    columns, members = prepared.whole([step.member]), [step.member]
    _, fit = jointly(prepared, columns)
    own = told(prepared, step)
    (moved,) = own.moved
    more = with_disagreement(prepared, columns, members, fit).covariance - fit.covariance
    assert more[0, 0] == pytest.approx(moved**2, rel=1e-9)
    found = replace_search(prepared, step)
    assert found[0, 0] == pytest.approx((fit.covariance + more)[0, 0], rel=1e-9)


def replace_search(prepared: Prepared, step: Step) -> np.ndarray:
    """The covariance of all that is added where the step alone was found."""
    from mtu_cli.analyses.close_loop.search import search

    gate = calibrated(prepared.scan, 99, 1)
    nothing = search(prepared, gate, alpha=1e-300, most=1)
    fit = added(prepared, replace(nothing, steps=(step,))).fit
    assert fit is not None
    return fit.covariance
