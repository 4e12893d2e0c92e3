"""Capability of toleranced quantities, and trends over the sequence of manufacture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mtu_cli.analyses.anova.outliers import FEWEST_PARTS, TRENDS
from mtu_cli.analyses.anova.tables import Analysed, Label
from mtu_cli.files.points import Points
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.model.visits import operations_of
from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, UM

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart

MOVING_RANGE = 1.128
"""d2: mean difference of two normal values in standard deviations (Tippett, 1925)."""
WITHIN = 0.9973
"""Share of parts within the natural limits: what six standard deviations hold."""

Interval = tuple[float, float]
OPEN: Interval = (nan, nan)
Of = Literal["position", "length", "angle"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Capability:
    """Capability of one toleranced quantity in one operation; mm or rad, nan where undefined.

    The quantity must lie from `low` to `high`; of a position the radial error must, from 0 to half
    the diameter of its zone. `values` (parts,) are the means of the repeats in the order of
    `sequence` (parts,), `s` their overall standard deviation, `s_moving` = mean moving range/1.128
    that of neighbours. With 95 % intervals for normal values (nan: undefined)

        pp = (high - low)/(6 s),    ppk = min(high - mean, mean - low)/(3 s),

    chi-squared and noncentral t of the nearer limit; `cp` and `cpk` have `s_moving` for s. Of a
    position ppk = high/q, q the 99.73 % quantile of the radial error of a bivariate normal law.
    """

    kind: Of
    operation: str
    id: str
    low: float
    high: float
    sequence: FloatArray
    values: FloatArray
    mean: float
    s: float = nan
    s_moving: float = nan
    pp: float = nan
    pp_interval: Interval = OPEN
    ppk: float
    ppk_interval: Interval = OPEN
    cp: float = nan
    cpk: float = nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """A table whose values change with the sequence of manufacture by `slope` a part (mm or rad)
    with standard uncertainty `u`; family-wise `p`.
    """

    where: Label
    slope: float
    u: float
    p: float


def sequences(points: Points) -> dict[str, FloatArray]:
    """Of every operation the place (parts,) of each part in the sequence, nan where it is not."""
    operations, operation = operations_of(points)
    result = np.full((len(operations), len(points.parts)), np.nan)
    result[operation, points.part] = points.sequence
    return dict(zip(operations, result, strict=True))


def trends(kinds: Sequence[Analysed], sequence: dict[str, FloatArray]) -> tuple[Trend, ...]:
    """The slope of every table's part means over the sequence by least squares, with Student's t;
    p adjusted for all tables (Holm), at the share of trends of the family-wise rate.
    """
    from scipy.special import stdtr

    result: list[tuple[Label, float, float]] = []
    p_values: list[FloatArray] = []
    for kind in kinds:
        cells = kind.tables.cells
        x = np.array([sequence[label[0]] for label in kind.labels])
        there = cells.present & np.isfinite(x)
        n = there.sum(axis=1)
        x, y = (_centred(values, there) for values in (x, cells.mean))
        spread = (x**2).sum(axis=1)
        known = (n >= FEWEST_PARTS) & (spread > 0)
        spread, dof = np.where(known, spread, 1.0), np.where(known, n - 2.0, 1.0)
        slope = (x * y).sum(axis=1) / spread
        s2 = ((y - slope[:, None] * x) ** 2).sum(axis=1) / dof
        u = np.sqrt((s2 + kind.rounding) / spread)
        # Values that are all equal have no trend, those on a line have one beyond doubt.
        known &= (u > 0) | (slope != 0)
        t = np.divide(np.abs(slope), u, out=np.full_like(u, np.inf), where=u > 0)
        p_values.append(np.where(known, 2 * stdtr(dof, -t), np.nan))
        result += zip(kind.labels, slope.tolist(), u.tolist(), strict=True)
    p = np.minimum(holm(np.concatenate(p_values)) / TRENDS, 1.0).tolist()
    return tuple(
        Trend(where=where, slope=slope, u=u, p=each)
        for (where, slope, u), each in zip(result, p, strict=True)
        if np.isfinite(each)
    )


def _centred(values: FloatArray, there: np.ndarray) -> FloatArray:
    """Values (tables, parts) less the mean of each table, 0 where there is none."""
    known = np.where(there, values, 0.0)
    mean = known.sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    return np.where(there, known - mean[:, None], 0.0)


def capabilities(
    kinds: Sequence[Analysed], part: LoadedPart | None, sequence: dict[str, FloatArray]
) -> tuple[Capability, ...]:
    """Of everything in the part file that has a tolerance, and was measured on two parts."""
    limits, result = {} if part is None else _limits(part), []
    for kind in kinds:
        rows = {label: i for i, label in enumerate(kind.labels)}
        of: Of = "position" if kind.kind == "feature" else kind.kind
        for (operation, name, axis), i in rows.items():
            if (of, name) not in limits or (of == "position" and axis != "x"):
                continue
            chosen = [i, rows.get((operation, name, "y"), -1)] if of == "position" else [i]
            if chosen[-1] < 0:
                continue
            values = np.column_stack([kind.part_means(j)[0] for j in chosen])
            order = np.argsort(sequence[operation], kind="stable")
            order = order[np.isfinite(values[order]).all(axis=1)]
            if len(order) < 2:
                continue
            (low, high), r = limits[of, name], float(kind.rounding[i])
            indices = _of_one if len(chosen) == 1 else _of_position
            result.append(
                Capability(
                    kind=of,
                    operation=operation,
                    id=name,
                    low=low,
                    high=high,
                    sequence=sequence[operation][order],
                    **indices(values[order], low, high, r),
                )
            )
    return tuple(result)


def _limits(part: LoadedPart) -> dict[tuple[Of, str], Interval]:
    """The tolerances of the part file, mm or rad."""
    result: dict[tuple[Of, str], Interval] = {}
    for length in part.part.lengths:
        if length.tolerance is not None:
            result["length", length.id] = length.tolerance.low * UM, length.tolerance.high * UM
    for angle in part.part.orthogonality:
        if angle.tolerance is not None:
            low, high = angle.tolerance.low, angle.tolerance.high
            result["angle", angle.id] = low * ARCSEC, high * ARCSEC
    for name, feature in part.part.features.items():
        if feature.position_um is not None:
            result["position", name] = 0.0, feature.position_um * UM / 2
    return result


def _of_one(values: FloatArray, low: float, high: float, r: float) -> dict[str, Any]:
    """Of a length or angle (parts, 1); `r` is the variance of a value that its last digit hides."""
    from scipy.special import chdtri, nctdtrinc

    values, n = values[:, 0], len(values)
    mean, s = float(values.mean()), float(np.sqrt(values.var(ddof=1) + r))
    ranges = np.abs(np.diff(values))
    s_moving = float(np.sqrt((ranges.mean() / MOVING_RANGE) ** 2 + r))
    nearer = min(high - mean, mean - low)
    tail, scale = (1 - PROBABILITY) / 2, 3 * np.sqrt(n)
    pp, ppk = _ratio(high - low, 6 * s), _ratio(nearer, 3 * s)
    factors = [float(np.sqrt(chdtri(n - 1, p) / (n - 1))) for p in (1 - tail, tail)]
    ends = [float(nctdtrinc(n - 1, p, scale * ppk) / scale) for p in (1 - tail, tail)]
    return {
        "values": values,
        "mean": mean,
        "s": s,
        "s_moving": s_moving,
        "pp": pp,
        "pp_interval": (pp * factors[0], pp * factors[1]),
        "ppk": ppk,
        "ppk_interval": (ends[0], ends[1]),
        "cp": _ratio(high - low, 6 * s_moving),
        "cpk": _ratio(nearer, 3 * s_moving),
    }


def _of_position(errors: FloatArray, _: float, high: float, r: float) -> dict[str, Any]:
    """Of the position of a feature, from its errors (parts, 2)."""
    C, radial = np.cov(errors.T) + r * np.eye(2), np.hypot(*errors.T)
    ppk = _ratio(high, radial_quantile(errors.mean(axis=0), C, WITHIN)) if C.any() else nan
    return {"values": radial, "mean": float(radial.mean()), "ppk": ppk}


def _ratio(part: float, whole: float) -> float:
    """Of a process that does not scatter there is none: nan."""
    return part / whole if whole > 0 else nan


def radial_quantile(mean: FloatArray, C: FloatArray, probability: float) -> float:
    """The quantile of the length of a normal vector with `mean` (2,) and covariance `C` (2, 2).

    P(length <= R) is integrated along the principal axis of the larger variance, with the normal
    law of the other one in closed form.

    >>> round(radial_quantile(np.zeros(2), np.eye(2), 0.9973), 3)  # sqrt(-2 ln 0.0027)
    3.439
    """
    from scipy.integrate import quad
    from scipy.optimize import brentq
    from scipy.special import ndtr

    variances, axes = np.linalg.eigh(C)
    unit = float(np.sqrt(variances[1]))
    ratio = np.sqrt(max(float(variances[0]) / unit**2, 1e-12))
    (across, along), root = axes.T @ mean / unit, np.sqrt(2 * np.pi)

    def beyond(R: float) -> float:
        def density(x: float) -> float:
            half = np.sqrt(max(R**2 - x**2, 0.0))
            share = ndtr((half - across) / ratio) - ndtr((-half - across) / ratio)
            return float(np.exp(-((x - along) ** 2) / 2) * share / root)

        low, high = max(-R, along - 9), min(R, along + 9)
        return float(quad(density, low, high)[0] if low < high else 0.0) - probability

    return unit * float(brentq(beyond, 0.0, np.hypot(across, along) + 9))
