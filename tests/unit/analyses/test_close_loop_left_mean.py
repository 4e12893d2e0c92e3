"""A mean error that no test finds, beside an effect of its axis."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from close_loop_examples import effect, on_table, result
from effect_tables import table
from loop_bench.folds import LIBRARY
from scipy.stats import binom
from scipy.stats import t as student

from mtu_cli.close_loop_sealed.analyses.loop import left_mean
from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.left_mean import LIKELY, left_means
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.result import LeftMean
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search, search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.reports.close_loop import document
from mtu_cli.close_loop_sealed.reports.close_loop import table as sheets
from mtu_cli.close_loop_sealed.reports.close_loop_curves import curves
from mtu_cli.reports.tables import plain_text

X, Y = np.meshgrid([20.0, 140.0, 265.0, 380.0], [15.0, 140.0, 290.0])
PLACES = np.stack([X.ravel(), Y.ravel(), np.full(12, 10.0)], axis=1)
FEW = replace(LIBRARY, families=tuple(
    own for own in LIBRARY.families if own.family.family in ("squareness", "offset")
))  # fmt: skip


@cache
def ready() -> Prepared:
    """What days have in common: all but the errors."""
    own = table(10, 12, places=PLACES, covariates={})
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    own = replace(own, errors=np.random.default_rng(0).normal(0.0, 1e-3, own.errors.shape))
    return prepare(own, candidates(own, FEW), own.pass_dof)


def day(seed: int, mean: float) -> tuple[Prepared, Search]:
    """Ten parts, leaning by 6 arcsec, off along both axes by `mean`; no search has been made."""
    rng, own = np.random.default_rng(seed), ready().table
    errors = mean + rng.normal(0.0, 1.3e-3, own.errors.shape) + rng.normal(0.0, 2e-3, (10, 1, 2))
    errors[..., 0] += 30e-6 * PLACES[:, 1]
    prepared = ready().with_table(replace(own, errors=errors))
    nothing = search(prepared, calibrated(prepared.scan, 99, 1), alpha=1e-300, most=1)
    return prepared, nothing


def told(prepared: Prepared, nothing: Search, *steps: Step) -> Described:
    found = replace(nothing, steps=steps)
    return Described(prepared=prepared, found=found, effects=added(prepared, found, 1), chosen=())


def squareness(prepared: Prepared) -> Step:
    """That of the error along x."""
    index = prepared.scan.names.index("squareness-xy")
    (member,) = (
        m
        for i, m, _ in prepared.scan.walk()
        if i == index and set(prepared.members[m].equations) == {"Ex"}
    )
    return Step(index=index, member=member, p=0.0, log_bayes=9.0, posterior=1.0, credible=(index,))


def test_the_mean_is_that_of_the_parts_means(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(left_mean, "LIKELY", 1.1)
    prepared, nothing = day(3, 4e-3)
    (own,) = left_means(told(prepared, nothing, squareness(prepared)))
    means = prepared.table.errors[..., 0].mean(axis=1)
    assert own.axis == "x"
    assert own.value == pytest.approx(means.mean())
    # Of the parts' means, of the columns' and of what readings leave: of the first at least.
    assert own.u >= 0.9 * means.std(ddof=1) / np.sqrt(10)
    assert own.u < 2 * means.std(ddof=1) / np.sqrt(10)


def test_only_axes_of_effects_without_an_offset_are_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(left_mean, "LIKELY", 1.1)
    prepared, nothing = day(3, 4e-3)
    own = squareness(prepared)
    index = len(prepared.scan.columns) + prepared.scan.offsets.index(0)
    offset = replace(own, index=index, member=-1, credible=(index,))
    assert left_means(told(prepared, nothing)) == ()
    assert left_means(told(prepared, nothing, own, offset)) == ()


def test_it_is_told_by_chance_as_often_as_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(left_mean, "LIKELY", 1.1)
    runs, p = 200, []
    for seed in range(runs):
        prepared, nothing = day(seed, 0.0)
        # The leaning axis is off on the mean by what it leans.
        leans = np.where(np.arange(2) == 0, 30e-6 * PLACES[:, 1].mean(), 0.0)
        prepared = replace(prepared, grand=prepared.grand - leans)
        (own,) = left_means(told(prepared, nothing, squareness(prepared)))
        p.append(own.p)
    # Of the parts', the columns' and the readings' scatter some counts twice: a little too rarely.
    for alpha in (LIKELY, 0.05, 0.5):
        hits = int((np.array(p) < alpha).sum())
        assert hits <= binom.ppf(1 - 1e-3, runs, alpha)
        assert hits >= binom.ppf(1e-3, runs, 0.6 * alpha)


def test_it_is_noted_below_the_effects() -> None:
    own = LeftMean(axis="x", value=-4.45e-3, u=0.75e-3, p=0.0012)
    item = replace(on_table("named", (effect(),)), left_means=(own,))
    shown = " ".join(plain_text(sheets(result(item))).split())
    assert (
        "beside these effects X is off by -4.45 ± 0.75 um on the mean (p 0.001 by itself, no "
        "finding among all tests): that is not written, and `mtu compare` may call it biased"
    ) in shown
    (curve,) = curves(item)
    assert curve.line == "the effect, and the mean error, which is not written"
    (of_y,) = curves(replace(item, left_means=(replace(own, axis="y"),)))
    assert of_y.line == ""
    assert document(result(item))["left_means"] == [
        {"axis": "x", "value_um": pytest.approx(-4.45), "u_um": pytest.approx(0.75), "p": 0.0012}
    ]


def warming(seed: int, mean: float) -> Described:
    """Errors that warm up by 10 um and are off by `mean` besides, without a level."""
    with_time = {"time_min": 20.0 * np.arange(10.0)[:, None]}
    own = replace(table(10, 12, places=PLACES, covariates=with_time), operations=("",))
    own = replace(own, operation=np.zeros(12, np.int64))
    rng = np.random.default_rng(seed)
    errors = rng.normal(0.0, 1.3e-3, own.errors.shape) + rng.normal(0.0, 1e-3, (10, 1, 2))
    errors[..., 0] += mean + 10e-3 * (1 - np.exp(-with_time["time_min"] / 60.0))
    known = [c for c in candidates(own, LIBRARY) if c.name in ("warm-up-x", "offset-x")]
    prepared = prepare(replace(own, errors=errors), known)
    nothing = search(prepared, calibrated(prepared.scan, 99, 1), alpha=1e-300, most=1)
    searched = [m.searched["tau_min"] for m in prepared.members]
    member = int(np.argmin(np.abs(np.log(searched) - np.log(60.0))))
    step = Step(index=0, member=member, p=0.0, log_bayes=9.0, posterior=1.0, credible=(0,))
    return told(prepared, nothing, step)


def test_beside_an_equation_with_a_mean_one_that_agrees_is_told_where_it_is_doubtful() -> None:
    """Without a level what is written is off by the mean; that is told of p below 20 %, with the
    figures of the level that is not opened.
    """
    seen = 0
    for seed in range(12):
        own = warming(seed, 1.0e-3)
        levels = [level for level in own.effects.levels if level.axis == 0]
        means = left_means(own)
        whole = added(own.prepared, own.found, owners={0: 0})
        assert whole.fit is not None
        at = whole.levels[0].index
        value, u = whole.fit.beta[at], np.sqrt(whole.fit.covariance[at, at])
        p = 2 * student.sf(abs(value) / u, max(whole.fit.dof[at], 1.0))
        assert bool(means) == (not levels and p < left_mean.NOT_SURE)
        if means:
            assert means[0].axis == "x"
            assert (means[0].value, means[0].u) == pytest.approx((value, u), rel=1e-12)
            assert means[0].p == pytest.approx(p, rel=1e-9)
        seen += bool(means)
    assert seen > 0
