"""Members where columns scatter differently: dense covariance, drawn tables, plain strata."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats, made, sizes, whole_frame
from scipy.stats import chi2

from mtu_cli.close_loop_sealed.stats.column_groups import Column, Packed, packed
from mtu_cli.close_loop_sealed.stats.profile_ratio import member_ratios
from mtu_cli.close_loop_sealed.stats.uneven import uneven

P, H, A = 8, 10, 2
STRATA = made(P, H, A)
FRAME = whole_frame(STRATA)
DOF = sizes(STRATA)
PLAIN = np.broadcast_to(np.eye(STRATA.lines), (A, STRATA.lines, STRATA.lines))
LOUD = np.arange(H) >= 7
VARIANCE = np.repeat(np.where(LOUD, 6.0, 1.0)[:, None], A, axis=1)


def noisy(seed: int, *shape: int) -> Floats:
    return np.asarray(np.random.default_rng(seed).normal(size=shape))


MEMBERS: tuple[tuple[Column, ...], ...] = (
    (FRAME.column({0: np.eye(H)[8][None]}),),
    (FRAME.column({0: np.eye(H)[2][None]}),),
    (FRAME.column({0: np.arange(float(P))[:, None]}),),
    (FRAME.column({1: noisy(1, 1, H)}), FRAME.column({1: noisy(2, 1, H)})),
    (FRAME.column({0: noisy(3, P, H) * LOUD}),),
    (FRAME.column({0: noisy(4, P, H), 1: noisy(5, P, H)}),),
)
PACK = packed(STRATA, DOF, PLAIN, [[member] for member in MEMBERS])
UNEVEN = uneven(PACK, VARIANCE, VARIANCE)


def covariance() -> Floats:
    """Of all coordinates, from tables with one entry each."""
    tables = np.eye(P * H * A).reshape(-1, P, H, A)
    J = STRATA.coordinates(tables)[0]
    v = np.broadcast_to(VARIANCE, (P, H, A)).reshape(-1)
    return np.asarray((J.T * v) @ J)


def spread(pack: Packed) -> dict[int, Floats]:
    """Of each member, by stratum of those it lies in."""
    found: dict[int, Floats] = {}
    for one in pack.one:
        found |= {int(m): np.array([f]) for m, f in zip(one.members, one.spread, strict=True)}
    for many in pack.many:
        found |= {
            int(m): f[np.einsum("sii->s", G) > 1e-12]
            for m, f, G in zip(many.members, many.spread, many.G, strict=True)
        }
    return found


def test_the_share_is_that_of_the_dense_covariance() -> None:
    V = covariance()
    found = spread(UNEVEN)
    for m, member in enumerate(MEMBERS):
        expected = []
        for index, stratum in enumerate(STRATA.all):
            own = [column[index] for column in member if index in column]
            if not own or np.linalg.norm(own[0]) < 1e-9:
                continue
            Q = np.linalg.qr(np.stack(own, axis=1))[0]
            block = V[stratum.slice, stratum.slice]
            mean = np.trace(block) / len(block)
            expected.append(np.trace(Q.T @ block @ Q) / mean / Q.shape[1])
        np.testing.assert_allclose(found[m], expected, rtol=1e-9)


def test_columns_of_one_scatter_change_nothing() -> None:
    y = noisy(11, 3, STRATA.size)
    even = uneven(PACK, np.full((H, A), 4.0), np.full((H, A), 0.3))
    found = member_ratios(even, y).ratio
    np.testing.assert_allclose(found, member_ratios(PACK, y).ratio, rtol=1e-9)


@pytest.mark.parametrize("at", ["loud", "calm", "part", "cells"])
def test_of_drawn_tables_the_ratio_is_that_of_one_scatter(at: str) -> None:
    P, H = 10, 60
    strata = made(P, H, 1)
    frame, loud = whole_frame(strata), np.arange(H) >= 45
    variance = np.where(loud, 3.0, 1.0)[:, None]
    values = {
        "loud": np.eye(H)[50][None],
        "calm": np.eye(H)[7][None],
        "part": np.arange(float(P))[:, None],
        "cells": noisy(6, P, H) * loud,
    }
    k = strata.lines
    dof, plain = sizes(strata), np.eye(k)[None]
    pack = packed(strata, dof, plain, [[(frame.column({0: values[at]}),)]])
    normal = np.random.default_rng(5).normal(size=(4000, P, H, 1))
    drawn = strata.coordinates(normal * np.sqrt(variance))[0]
    expected = member_ratios(pack, strata.coordinates(normal)[0]).ratio[:, 0]
    found = member_ratios(uneven(pack, variance, variance), drawn).ratio[:, 0]
    limit = chi2.isf(0.05, 1)
    # A share f of n coordinates leaves (n - f) / (n - 1) of the mean in the rest, and that
    # rest has fewer effective degrees of freedom: of the order of (f - 1) / n, f <= 2, n >= 57.
    se = np.sqrt((np.var(expected) + np.var(found)) / len(normal))
    assert abs(np.mean(found) - np.mean(expected)) < 4 * se + 2 / 57
    p = float(np.mean(expected > limit))
    assert abs(np.mean(found > limit) - p) < 4 * np.sqrt(2 * p / len(normal)) + 2 / 57 * 0.2
    if at in ("loud", "cells"):
        # Judged by the scatter of all it is too often large.
        plainly = member_ratios(pack, drawn).ratio[:, 0]
        assert np.mean(plainly > limit) > 2 * p


@pytest.mark.parametrize("extra", [0.0, 3.0, 20.0])
@pytest.mark.parametrize("where", ["middle", "ends"])
def test_what_the_parts_scatter_is_no_share_of_the_entries(where: str, extra: float) -> None:
    # Along a smooth direction the mean over the parts scatters by `extra` times what the entries
    # make of it, whatever operation they belong to: whitened, most of it is the parts' own.
    P, H = 20, 24
    strata = made(P, H, 1)
    k, lead = strata.lines, strata.columns[:, 1]
    inner = np.abs(lead) < np.quantile(np.abs(lead), 0.5)
    variance = np.where(inner if where == "middle" else ~inner, 9.0, 1.0)[:, None]
    whitening = np.eye(k)[None].copy()
    whitening[0, 0, 0] = 1 / np.sqrt(1 + extra)
    member = (whole_frame(strata).column({0: lead[None]}),)
    pack = packed(strata, sizes(strata), whitening, [[member]])
    rng = np.random.default_rng(7)
    tables = rng.normal(size=(4000, P, H, 1)) * np.sqrt(variance)
    y = strata.coordinates(tables)[0]
    column = strata.find("column", 0)
    assert column is not None
    y[:, column.start] += rng.normal(size=4000) * np.sqrt(extra * variance.mean())
    LR = member_ratios(uneven(pack, variance, variance), pack.without_found(y)).ratio[:, 0]
    # One of 23 coordinates: F(1, 22) by its ratio passes chi^2's 5 % in 6.4 %; two binomial
    # limits of 4000 and the few effective degrees of freedom of operations as unlike as 1:9.
    assert 0.045 < np.mean(chi2.isf(0.05, 1) < LR) < 0.08


def test_a_strong_effect_on_one_axis_has_a_finite_ratio_on_two() -> None:
    """The estimate for both axes makes one of them worse: its ratio is below 0, never nan."""
    P, H, A = 20, 24, 2
    strata = made(P, H, A)
    loud = np.arange(H) >= 12
    variance = np.repeat(np.where(loud, 9.0, 1.0)[:, None], A, axis=1)
    turned = np.where(np.arange(H) % 2, 1.0, -1.0)
    calm = np.outer((np.arange(P) >= 10) * 1.0, ~loud * turned)
    plain = np.broadcast_to(np.eye(strata.lines), (A, strata.lines, strata.lines))
    member = (whole_frame(strata).column({0: calm, 1: calm}),)
    judged = uneven(packed(strata, sizes(strata), plain, [[member]]), variance, variance)
    rng = np.random.default_rng(3)
    for size in (1.0, 5.0, 50.0, 500.0):
        tables = rng.normal(size=(40, P, H, A)) * np.sqrt(variance)
        tables[..., 0] += size * calm
        assert np.isfinite(member_ratios(judged, strata.coordinates(tables)[0]).ratio).all()
