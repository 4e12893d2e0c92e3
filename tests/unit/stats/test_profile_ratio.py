"""Likelihood ratios of candidates: least squares, direct maximisation, chi^2, Schwarz."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats, made, sizes, whole_frame
from scipy.optimize import minimize
from scipy.stats import f, ks_1samp

from mtu_cli.close_loop_sealed.stats.column_groups import Column, MemberColumns, packed
from mtu_cli.close_loop_sealed.stats.profile_ratio import (
    NEVER,
    member_ratios,
    ratios,
    solved,
    unit_information,
)

STRATA = made(8, 10, 2)
FRAME = whole_frame(STRATA)
DOF = sizes(STRATA)
PLAIN = np.broadcast_to(np.eye(STRATA.lines), (2, STRATA.lines, STRATA.lines))


def raw(member: MemberColumns) -> Floats:
    X = np.zeros((STRATA.size, len(member)))
    for j, column in enumerate(member):
        for index, values in column.items():
            X[STRATA.all[index].slice, j] = values
    return X


def data(seed: int, count: int = 1) -> Floats:
    """Coordinates whose strata have variances from 1 to 9."""
    rng = np.random.default_rng(seed)
    y = rng.normal(size=(count, STRATA.size))
    for i, stratum in enumerate(STRATA.all):
        y[:, stratum.slice] *= 1.0 + i % 3
    return np.asarray(y)


def noisy(seed: int, *shape: int) -> Floats:
    return np.asarray(np.random.default_rng(seed).normal(size=shape))


ONE: dict[str, tuple[Column, ...]] = {
    "trend": (FRAME.column({0: np.arange(8.0)[:, None]}),),
    "curve": (FRAME.column({1: noisy(1, 1, 10)}), FRAME.column({1: noisy(2, 1, 10)})),
    "both axes": (FRAME.column({0: noisy(3, 1, 10)}), FRAME.column({1: noisy(3, 1, 10)})),
    "bend": (FRAME.column({0: noisy(11, 1, 10)}), FRAME.column({0: noisy(12, 1, 10)})),
}
MANY: dict[str, tuple[Column, ...]] = {
    "squareness": (FRAME.column({0: noisy(4, 1, 10), 1: noisy(5, 1, 10)}),),
    "cells": (FRAME.column({0: noisy(6, 8, 10)}),),
    "wave": (FRAME.column({0: noisy(7, 8, 10)}), FRAME.column({0: noisy(8, 8, 10)})),
    "growth": (FRAME.column({0: noisy(9, 8, 10), 1: noisy(10, 8, 10)}),),
}


def slow(member: MemberColumns, y: Floats) -> float:
    """max over beta of sum n_s log(R_s(0) / R_s(beta)), by BFGS from several starts."""
    X = raw(member)

    def minus(beta: Floats) -> float:
        left = y - X @ beta
        ratios = [np.sum(y[s.slice] ** 2) / np.sum(left[s.slice] ** 2) for s in STRATA.all]
        return -float(DOF @ np.log(ratios))

    starts = [np.zeros(X.shape[1]), np.linalg.lstsq(X, y, rcond=None)[0]]
    starts += [
        np.linalg.lstsq(X[s.slice], y[s.slice], rcond=None)[0]
        for s in STRATA.all
        if np.linalg.matrix_rank(X[s.slice]) == X.shape[1]
    ]
    return max(-float(minimize(minus, start).fun) for start in starts)


@pytest.mark.parametrize("name", ONE)
def test_of_one_stratum_it_is_n_log_of_the_sums_of_squares(name: str) -> None:
    y = data(21, 5)
    X = raw(ONE[name])
    found = member_ratios(packed(STRATA, DOF, PLAIN, [[ONE[name]]]), y).ratio[:, 0]
    for own, value in zip(y, found, strict=True):
        expected = 0.0
        for stratum, n in zip(STRATA.all, DOF, strict=True):
            x, z = X[stratum.slice], own[stratum.slice]
            left = z - x @ np.linalg.lstsq(x, z, rcond=None)[0]
            expected += n * np.log((z @ z) / (left @ left))
        assert value == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("name", MANY)
@pytest.mark.parametrize("strength", [0.0, 0.3, 1.0, 10.0])
def test_of_many_strata_it_is_the_largest_profile_likelihood(name: str, strength: float) -> None:
    # Strength in standard deviations of one entry. What is missing to the maximum may not
    # reach what an effect of 0.2 standard errors would make: 0.04.
    X = raw(MANY[name])
    y = data(22, 3) + strength * X.sum(axis=1)
    found = member_ratios(packed(STRATA, DOF, PLAIN, [[MANY[name]]]), y).ratio[:, 0]
    for own, value in zip(y, found, strict=True):
        best = slow(MANY[name], own)
        assert value <= best + 1e-6 * max(1.0, best)
        assert value > best - 0.04


@pytest.mark.parametrize("name", [*ONE, *MANY])
def test_freedom_and_information_are_those_of_a_weighted_fit(name: str) -> None:
    """x' V^-1 x by a direct fit that is reweighted until it stands, beside what was found."""
    member = {**ONE, **MANY}[name]
    found = FRAME.column({0: noisy(13, 1, 10), 1: noisy(14, 1, 10)})
    pack = packed(STRATA, DOF, PLAIN, [[member]], [(found,)])
    y = pack.without_found(data(25))
    X = pack.without_found(raw(member).T).T
    own = np.zeros((len(pack.dof), STRATA.size))
    for s, stratum in enumerate(STRATA.all):
        own[s, stratum.slice] = 1.0
    R = own @ y[0] ** 2
    for _ in range(50):
        w = np.sqrt((pack.dof / R) @ own)
        R = own @ (y[0] - X @ np.linalg.lstsq(w[:, None] * X, w * y[0], rcond=None)[0]) ** 2
    held = pack.dof / R * (own @ (X**2).sum(axis=1))
    said = member_ratios(pack, y)
    # What REWEIGHTED rounds lack is second order where the ratio is largest.
    assert said.information[0, 0] == pytest.approx(held.sum() / len(member), rel=1e-3)
    # Strata judged one by one count whole; those weighted together by what they hold.
    dof = pack.dof[held > 0].sum() if name in ONE else held @ pack.dof / held.sum()
    assert said.dof[0, 0] == pytest.approx(dof, rel=1e-3)


def test_ratios_beside_what_was_found_are_those_of_the_residuals() -> None:
    found = (ONE["trend"], MANY["squareness"])
    pack = packed(STRATA, DOF, PLAIN, [[MANY["cells"]], [ONE["curve"]]], found)
    y = data(23)
    left = pack.without_found(y)
    LR = member_ratios(pack, left).ratio[0]
    spoilt = y + 50.0 * raw(ONE["trend"])[:, 0] - 20.0 * raw(MANY["squareness"])[:, 0]
    again = member_ratios(pack, pack.without_found(spoilt)).ratio[0]
    np.testing.assert_allclose(again, LR, rtol=1e-9)
    # The same by lstsq for the curve: nuisance first, then both, on the column stratum of y.
    (index,) = {i for column in ONE["curve"] for i in column}
    own = STRATA.all[index].slice
    nuisance = raw(MANY["squareness"])[own]
    both = np.concatenate([nuisance, raw(ONE["curve"])[own]], axis=1)
    R = [np.linalg.lstsq(X, y[0, own], rcond=None)[1][0] for X in (nuisance, both)]
    assert LR[1] == pytest.approx((DOF[index] - 1) * np.log(R[0] / R[1]), rel=1e-9)


def test_under_the_null_one_column_has_the_f_distribution() -> None:
    # F = (n - 1) (exp(LR / n) - 1) of one column among n coordinates is F(1, n - 1).
    y = data(24, 4000)
    LR = member_ratios(packed(STRATA, DOF, PLAIN, [[ONE["trend"]]]), y).ratio[:, 0]
    n = 7
    p = f.sf((n - 1) * np.expm1(LR / n), 1, n - 1)
    assert ks_1samp(p, lambda v: v).pvalue > 1e-3


def test_log_bayes_is_the_difference_of_schwarz_criteria() -> None:
    # -BIC/2 of k columns against none, with n -> 1 + n and the ratio less its own k / n.
    # Zellner's prior with g = n gives (n - k)/2 log(1 + n) - n/2 log(1 + n (1 - r2)), and
    # log(1 + n (1 - r2)) is within r2 / (n (1 - r2)) of log(1 + n) + log(1 - r2).
    for n, k, r2 in ((200.0, 1, 0.05), (5000.0, 2, 0.004), (40_000.0, 3, 0.001)):
        ratio = np.array(-n * np.log1p(-r2))
        found = unit_information(ratio, n, k)
        bic = 0.5 * ratio - 0.5 * k * np.log(n)
        assert bic - 0.5 * k / n * (1 + ratio) <= found <= bic
        zellner = 0.5 * (n - k) * np.log1p(n) - 0.5 * n * np.log1p(n * (1 - r2))
        assert -0.5 * k * ratio / n <= found - zellner <= 0.5 * r2 / (1 - r2)
    assert unit_information(np.zeros(1), 30.0, 2)[0] == pytest.approx(-np.log(31.0))


def test_a_candidate_has_its_best_member_and_the_mean_of_their_bayes_factors() -> None:
    candidates = [[ONE["trend"]], [MANY["cells"], ONE["curve"], MANY["wave"]], [MANY["growth"]]]
    pack = packed(STRATA, DOF, PLAIN, candidates)
    y = data(25, 6)
    own = member_ratios(pack, y)
    LR, log_bayes = own.ratio, own.log_bayes
    found = ratios(pack, y, 3)
    np.testing.assert_array_equal(found.best[:, 1], 1 + LR[:, 1:4].argmax(axis=1))
    np.testing.assert_array_equal(found.ratio[:, 1], LR[:, 1:4].max(axis=1))
    expected = np.log(np.exp(log_bayes[:, 1:4]).mean(axis=1))
    np.testing.assert_allclose(found.log_bayes[:, 1], expected, rtol=1e-12)
    np.testing.assert_array_equal(found.log_bayes[:, 0], log_bayes[:, 0])


def test_a_candidate_without_members_that_can_be_tested_has_no_part() -> None:
    pack = packed(STRATA, DOF, PLAIN, [[ONE["trend"]], [ONE["curve"]]], [ONE["trend"]])
    found = ratios(pack, pack.without_found(data(26)), 2)
    assert (found.best[0, 0], found.ratio[0, 0], found.log_bayes[0, 0]) == (-1, 0.0, NEVER)
    assert found.best[0, 1] == 1


def test_a_perfect_effect_stays_finite_and_keeps_its_rank() -> None:
    # A g-prior would give both the same Bayes factor here (Liang et al. 2008).
    X = raw(ONE["trend"])[:, 0]
    rival = FRAME.column({0: (np.arange(8.0) ** 1.2)[:, None]})
    pack = packed(STRATA, DOF, PLAIN, [[ONE["trend"]], [(rival,)]])
    found = ratios(pack, X[None] + 1e-9 * data(27), 2)
    assert np.isfinite(found.log_bayes).all()
    assert found.log_bayes[0, 0] > found.log_bayes[0, 1] + 10
    zero = ratios(pack, np.zeros((1, STRATA.size)), 2)
    assert (zero.ratio == 0).all()


def test_no_stratum_is_known_better_than_rounding() -> None:
    """What is left exactly 0 by chance, of rounded data, has the variance of rounding."""
    member = ONE["trend"]
    (index,) = member[0]
    stratum = STRATA.all[index]
    y = np.zeros((1, STRATA.size))
    y[0, stratum.slice] = member[0][index]
    n, square = DOF[index], float(member[0][index] @ member[0][index])
    least = np.full(len(DOF), 0.01 * square / n)
    pack = packed(STRATA, DOF, PLAIN, [[member]], least=least)
    assert member_ratios(pack, y).ratio[0, 0] == pytest.approx(n * np.log(100.0))
    # Below rounding nothing is told at all.
    assert member_ratios(pack, 0.05 * y).ratio[0, 0] == pytest.approx(0.0, abs=1e-9)
    both = packed(STRATA, DOF, PLAIN, [[MANY["cells"]]], least=np.full(len(DOF), 1e6))
    assert member_ratios(both, y).ratio[0, 0] <= 0


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e190])
@pytest.mark.parametrize("k", [1, 2, 3])
def test_small_systems_are_solved_whatever_their_size(k: int, scale: float) -> None:
    """Weights of a stratum without scatter are as large as numbers get."""
    rng = np.random.default_rng(k)
    X = rng.normal(size=(5, 4, 12, k)) * np.geomspace(1, 1e-3, k)
    A, wanted = np.swapaxes(X, -1, -2) @ X, rng.normal(size=(5, 4, k))
    b = (A @ wanted[..., None])[..., 0]
    np.testing.assert_allclose(solved(A * scale, b * scale), wanted, rtol=1e-7)


def test_of_equal_members_the_first_is_the_best() -> None:
    """Rounding must not choose: a squareness turns y along x or x along y, alike where parts are
    free to turn.
    """
    rng = np.random.default_rng(4)
    X = noisy(15, 1, 10)
    member = (FRAME.column({1: X}),)
    other = (FRAME.column({1: X * (1 + 1e-13)}),)
    for members in ([member, other], [other, member]):
        pack = packed(STRATA, DOF, PLAIN, [members])
        y = rng.normal(size=(50, STRATA.size))
        assert (ratios(pack, y, 1).best == 0).all()
