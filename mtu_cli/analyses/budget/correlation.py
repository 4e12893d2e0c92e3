"""Covariance of the inputs: stated correlations and those of simultaneous readings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError, finding, listed
from mtu_cli.stats.least_squares import FloatArray

ROUNDING = 1e-9
"""An eigenvalue of a correlation matrix below minus this is no rounding."""
SHOWN_PAIRS = 6


def input_covariance(loaded: LoadedBudget, inputs: Sequence[InputQuantity]) -> FloatArray:
    """V (n, n) of the inputs' estimates, in the products of their units.

    A stated coefficient r(x_i, x_j) belongs to the whole of both inputs: r u(x_i) u(x_j),
    whatever they are made of. Readings x_ik, x_jk taken together give
    s(mean_i, mean_j) = sum (x_ik - mean_i)(x_jk - mean_j) / (n (n - 1)), GUM eq. (17), for
    their type A parts alone.

    Raises InputError where the coefficients belong to no joint distribution; they are never
    altered.
    """
    place = {item.name: i for i, item in enumerate(inputs)}
    u = np.array([item.u for item in inputs])
    covariance = np.diag(u**2)
    for group in loaded.budget.simultaneous:
        rows = [place[name] for name in group]
        readings = np.array([inputs[i].readings for i in rows], dtype=np.float64)
        apart = readings - readings.mean(axis=1, keepdims=True)
        n = readings.shape[1]
        joint = apart @ apart.T / (n * (n - 1))
        np.fill_diagonal(joint, u[rows] ** 2)
        covariance[np.ix_(rows, rows)] = joint
    for first, second, r in loaded.budget.correlations:
        i, j = place[first], place[second]
        covariance[i, j] = covariance[j, i] = r * u[i] * u[j]
    _check(loaded, inputs, covariance)
    return covariance


def correlation_of(covariance: FloatArray) -> FloatArray:
    """r_ij = V_ij / sqrt(V_ii V_jj); nan beside a variance of 0, 1 on the diagonal."""
    s = np.sqrt(np.diag(covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        r = covariance / np.outer(s, s)
    r = np.asarray(np.clip(r, -1.0, 1.0), dtype=np.float64)
    np.fill_diagonal(r, 1.0)
    return r


def _check(loaded: LoadedBudget, inputs: Sequence[InputQuantity], covariance: FloatArray) -> None:
    r = np.nan_to_num(correlation_of(covariance))
    problems = []
    for members in clusters(r):
        values, vectors = np.linalg.eigh(r[np.ix_(members, members)])
        if values[0] >= -ROUNDING * len(members):
            continue
        # The pairs that pull the quadratic form of the worst direction below zero.
        w = vectors[:, 0]
        pull = [
            (w[a] * w[b] * r[i, j], i, j)
            for a, i in enumerate(members)
            for b, j in enumerate(members[:a])
            if r[i, j] != 0.0
        ]
        worst = sorted(pull)[:SHOWN_PAIRS]
        pairs = [f"{inputs[j].name}-{inputs[i].name} {r[i, j]:.6g}" for _, i, j in worst]
        why = f"the smallest eigenvalue of the correlation matrix is {values[0]:.4g}"
        expected = "a matrix without negative eigenvalues"
        problems.append(uncorrelatable(loaded, pairs, why, expected))
    if problems:
        raise InputError(problems)


def uncorrelatable(
    loaded: LoadedBudget, names: Sequence[str], why: str, expected: str, value: str | None = None
) -> Finding:
    """That inputs cannot be correlated as the file states."""
    reason = f"{listed(names)} cannot be correlated like this: {why}"
    line, file = loaded.line_of("correlations"), loaded.source.shown
    place = {"file": file, "line": line, "path": "correlations", "value": value}
    return finding("wrong-correlation", reason=reason, expected=expected, **place)


def clusters(linked: FloatArray) -> list[list[int]]:
    """Indices in connected sets of two or more: `linked` (n, n) is not zero between neighbours."""
    n = len(linked)
    waiting, found = set(range(n)), []
    while waiting:
        members, front = [], [min(waiting)]
        waiting.discard(front[0])
        while front:
            i = front.pop()
            members.append(i)
            near = [j for j in sorted(waiting) if linked[i, j] != 0.0]
            waiting.difference_update(near)
            front += near
        if len(members) > 1:
            found.append(sorted(members))
    return found


def factor_of(covariance: FloatArray) -> FloatArray:
    """F (n, rank) with F F' = `covariance`, which may be singular (r = 1)."""
    scale = np.sqrt(np.diag(covariance))
    r = np.nan_to_num(correlation_of(covariance))
    values, vectors = np.linalg.eigh(r)
    kept = values > 1e-14 * max(float(values[-1]), math.ulp(1.0))
    factor: FloatArray = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    return factor
