"""One component read by several instruments: combined, and whether they agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.model.estimates import ComponentEstimate, between_passes, covariance_in_run
from mtu_cli.stats.coverage import dof_of_shares, welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.stats.pass_tests import Shift


def combine(
    estimates: Sequence[ComponentEstimate], counts: Sequence[int]
) -> tuple[ComponentEstimate, float | None]:
    """One estimate from several instruments' and the p value that they agree.

    b = sum W_i b_i with scalar weights from each instrument's own repeatability over its `counts`
    n_i readings and the machine's pass-to-pass drift, which is one for all instruments:
    1/W_i proportional to d^2/G_i + s_i^2/n_i. The inverses of whole covariances that few
    passes estimate would follow their errors (95 % intervals then cover 80 %).
    C = sum W_i^2 C_i whatever the weights. The scatter of passes and of visits is pooled by
    degrees of freedom, and so is what passes there and back of a run share: an instrument's own
    noise stays in s_repeat, which is then an upper bound of the machine's.
    """
    if len(estimates) == 1:
        return estimates[0], None
    first = estimates[0]
    passes = np.array([item.pass_dof for item in estimates])
    repeats = np.array([item.repeat_dof for item in estimates])
    D = _pooled([item.pass_covariance for item in estimates], passes)
    n = np.array(counts, dtype=np.float64)
    W, plain = _weights(estimates, D, n), n - len(first.coefficients)
    combined = ComponentEstimate(
        name=first.name,
        of=first.of,
        unit=first.unit,
        coefficients=_weighted([item.coefficients for item in estimates], W),
        covariance=_weighted([item.covariance for item in estimates], W**2),
        pass_covariance=D,
        s_repeat=_pooled_deviation([item.s_repeat for item in estimates], repeats),
        pass_dof=_combined_dof(estimates, W, passes, repeats),
        repeat_dof=float(repeats.sum()),
        independent_covariance=_weighted(
            [e.independent_covariance for e in estimates if e.independent_covariance is not None],
            W**2,
        ),
        independent_s=_pooled_deviation([item.independent_s or 0.0 for item in estimates], plain),
        position_range=_whole_range(estimates),
        run_covariance=_in_run(estimates),
    )
    return combined, agreement(estimates[0], estimates[1])


def at_both_ways(
    estimates: Sequence[ComponentEstimate],
    ways: Sequence[int | None],
    reversals: Sequence[Shift | None],
) -> list[ComponentEstimate]:
    """Lines of the mean of both directions, which predictions are for.

    An instrument that ran one way alone (`ways`: +1 forward, -1; None: both, or not told) reads
    the line of that way, which is half of the reversal value h away: b_0 - w h/2, with u(h)^2/4
    more variance, h of one that ran both ways. Without such a one it stays as it is.
    """
    known = next((own for own in reversals if own is not None), None)
    if known is None:
        return list(estimates)
    found = []
    for item, way in zip(estimates, ways, strict=True):
        if way is None:
            found.append(item)
            continue
        b, C = item.coefficients.copy(), item.covariance.copy()
        b[0] -= way * known.value / 2
        C[0, 0] += known.u**2 / 4
        found.append(replace(item, coefficients=b, covariance=C))
    return found


def _in_run(estimates: Sequence[ComponentEstimate]) -> FloatArray | None:
    """K (k, k) of those that know it; None where none does."""
    known = [(covariance_in_run(item), item.pass_dof) for item in estimates]
    told = [(K, dof) for K, dof in known if K is not None]
    return _pooled([K for K, _ in told], np.array([dof for _, dof in told])) if told else None


def _whole_range(estimates: Sequence[ComponentEstimate]) -> tuple[float, float] | None:
    """Positions that any of the instruments has read, mm."""
    ranges = [item.position_range for item in estimates if item.position_range is not None]
    return (min(r[0] for r in ranges), max(r[1] for r in ranges)) if ranges else None


def _weights(estimates: Sequence[ComponentEstimate], D: FloatArray, n: FloatArray) -> FloatArray:
    """W (instruments,), summing to 1, by the variance of the level in the middle of the range."""
    middle = np.mean([np.mean(item.position_range or (0.0, 0.0)) for item in estimates])
    x = middle ** np.arange(len(D))
    drift = max(float(x @ D @ x), 0.0)
    variance = np.array(
        [
            (drift / item.n_passes if item.n_passes else 0.0) + item.s_repeat**2 / count
            for item, count in zip(estimates, n, strict=True)
        ]
    )
    # One reading a pass has no repeatability of its own to weigh it by.
    known = variance if (variance > 0).all() else 1.0 / n
    W: FloatArray = (1.0 / known) / np.sum(1.0 / known)
    return W


def _weighted(values: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    total: FloatArray = np.tensordot(weights, np.array(values), axes=1)
    return total


def _combined_dof(
    estimates: Sequence[ComponentEstimate], W: FloatArray, passes: FloatArray, repeats: FloatArray
) -> float:
    """Welch-Satterthwaite over the instruments' mean squares behind C, by its trace.

    0 where no instrument tells passes apart: then one mean square stands behind all.
    """
    if not passes.any():
        return 0.0
    scale = np.diag(_weighted([item.covariance for item in estimates], W**2))
    traces = [
        float(w**2 * np.sum(np.diag(item.covariance) / scale))
        for w, item in zip(W, estimates, strict=True)
    ]
    dofs = [float(p or r) for p, r in zip(passes, repeats, strict=True)]
    return welch_satterthwaite(np.array(traces), np.array(dofs))


def agreement(a: ComponentEstimate, b: ComponentEstimate) -> float:
    """p value that two instruments read the same line.

    T^2 = d' (C_a + C_b)^-1 d with d = b_a - b_b, referred to F with the effective degrees of
    freedom of its covariance (Yao, Biometrika 52 (1965) 139, with Welch's weights taken over
    all coefficients): a chi-square would reject far too often, the covariances being estimated.
    """
    from mtu_cli.stats.joint_test import hotelling_p

    d = a.coefficients - b.coefficients
    V = a.covariance + b.covariance
    scale = np.sqrt(np.diag(V))
    inverse = np.linalg.pinv(V / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    inverse /= np.outer(scale, scale)
    k = int(np.linalg.matrix_rank(inverse * np.outer(scale, scale)))
    sources = [source for item in (a, b) for source in _sources(item)]
    shares = np.array([float(np.trace(part @ inverse)) / k for part, _ in sources])
    nu = dof_of_shares(shares, np.array([dof for _, dof in sources]))
    return hotelling_p(float(d @ inverse @ d), k, nu)


def _sources(item: ComponentEstimate) -> list[tuple[FloatArray, float]]:
    """The mean squares that make up C, with their degrees of freedom."""
    S = between_passes(item)
    if S is None or item.n_passes is None:
        return [(item.covariance, item.pass_dof or item.repeat_dof)]
    halves = item.half_differences
    of_passes = (S if halves is None else 2 * (S - halves)) / item.n_passes
    return [(of_passes, item.pass_dof), (item.covariance - of_passes, item.repeat_dof)]


def _pooled_deviation(values: Sequence[float], dofs: FloatArray) -> float:
    return float(np.sqrt(_pooled([np.array(s**2) for s in values], dofs)))


def _pooled(values: Sequence[FloatArray], dofs: FloatArray) -> FloatArray:
    """Mean weighted by degrees of freedom; those without any have no say."""
    finite = np.where(np.isinf(dofs), 1e9, dofs)
    if finite.sum() == 0:
        return np.zeros_like(values[0])
    pooled: FloatArray = np.tensordot(finite / finite.sum(), np.array(values), axes=1)
    return pooled
