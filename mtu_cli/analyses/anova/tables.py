"""The analysis of the tables of one kind: components, uncertainties, intervals, tests; outlying
parts, trends over the sequence of manufacture, capability of toleranced quantities.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import chdtri, nctdtrinc, ndtr, stdtr, stdtrit

from mtu_cli.files.part import LoadedPart, Tolerance
from mtu_cli.model.measured import Label, MeasuredTables
from mtu_cli.stats.anova import Components, OneWay, moments, one_way, paper, part_interval, reml
from mtu_cli.stats.coverage import FAMILY_RATE, TAIL, holm
from mtu_cli.stats.groups import known_mean
from mtu_cli.stats.least_squares import FloatArray, quotient
from mtu_cli.stats.outliers import outstanding_rows
from mtu_cli.stats.resolution import hidden
from mtu_cli.units import ARCSEC, UM

Method = Literal["paper", "anova", "reml"]
Kind = Literal["feature", "length", "angle"]


@dataclass(frozen=True, kw_only=True)
class Analysed:
    """Tables of one kind with their analysis; arrays (tables,) in mm or rad, squared.

    `labels` are those of the tables, of which the axis of a length is "length" and that of a
    right angle "angle". `rounding` (tables,) is the variance of a mean that the last digit hides
    from the readings (`stats.resolution`). `components` by the chosen method, `reml` those that
    scale the part means; `interval` (tables, 2) for the part variance, nan by the paper's method,
    which has none. `both` is MS_between, and `both_interval` (tables, 2) its interval, where
    without repeats it holds the part's and the CMM's variance together, else nan.

    With w = sum n_i^2/N^2, in which a part counts by its repeats, u^2 = w s_part^2 + s_repeat^2/N
    of the grand mean (`u_mean`) and s_part^2 more of a future part (`u_future`). Without repeats
    MS_between stands for both components. By the paper's method eqs. (32)-(33), of the repeat
    scatter alone. `rounding` is added to all. `dof_mean` and `dof_future` are effective degrees of
    freedom (JCGM 100, G.4.1), `interval_future` (tables, 2) the mean -+ t u_future.

    `p_parts` of F and `p_mean` of a mean of zero (t test) are adjusted for all tables of the kind
    (Holm). `order` of the tables is that of |mean| + k u_future, the largest first; `unusual` are
    the outlying parts of each table by itself.
    """

    kind: Kind
    method: Method
    coverage_factor: float
    tables: MeasuredTables
    labels: tuple[Label, ...]
    rounding: FloatArray
    one_way: OneWay
    components: Components
    reml: Components
    interval: FloatArray
    both: FloatArray
    both_interval: FloatArray
    u_mean: FloatArray
    u_future: FloatArray
    dof_mean: FloatArray
    dof_future: FloatArray
    interval_future: FloatArray
    p_parts: FloatArray
    p_mean: FloatArray
    order: tuple[int, ...]
    unusual: tuple[tuple[str, ...], ...] = ()

    def part_means(self, i: int) -> tuple[FloatArray, FloatArray]:
        """The mean of each part (parts,) in table `i`, nan where it is missing, and what the CMM's
        scatter makes of it: s_repeat/sqrt(n_i).
        """
        cells = self.tables.cells
        s = np.sqrt(np.nan_to_num(self.one_way.ms_within[i]))
        values = cells.origin[i] + cells.mean[i], s / np.sqrt(np.maximum(cells.n[i], 1))
        mean, u = (np.where(cells.present[i], each, np.nan) for each in values)
        return mean, u


def analysed(kind: Kind, tables: MeasuredTables, method: Method, k: float) -> Analysed:
    """The analysis of one kind by one method, with the coverage factor k."""
    table, by_reml = one_way(tables.cells, tables.rounding), reml(tables.cells)
    methods = {"paper": paper, "anova": moments}
    components = methods[method](table) if method in methods else by_reml
    separable = np.isfinite(by_reml.part)
    # Without repeats MS_between is the scatter of the readings.
    scatter = np.where(separable, by_reml.part + by_reml.repeat, table.ms_between)
    rounding = hidden(scatter, tables.rounding)
    interval = part_interval(tables.cells, table)
    share, part, repeat = table.share, components.part, components.repeat
    if method == "paper":
        share, part, repeat = 1 / table.N, table.ms_within, 0.0 * table.N
        interval, separable = np.full_like(interval, np.nan), np.zeros_like(separable)
    else:
        part = np.where(separable, part, table.ms_between)
        repeat = np.where(separable, repeat, 0.0)
    df = table.df_within if method == "paper" else table.df_between
    us, dofs = [], []
    for weight in (share, 1 + share):
        # weight * s_part^2 + s_repeat^2/N is c1 MS_between + c2 MS_within with c1 = weight/n0 and
        # c2 = 1/N - c1, of 1 to N - 1 degrees of freedom (JCGM 100, G.4.1).
        u2, c1 = weight * part + repeat / table.N, weight / table.n0
        between = (c1 * table.ms_between) ** 2 / np.maximum(table.df_between, 1)
        within = ((1 / table.N - c1) * table.ms_within) ** 2 / np.maximum(table.df_within, 1)
        dof = np.clip(quotient(u2**2, between + within), 1.0, np.maximum(table.N - 1, 1.0))
        dof = np.where(separable, dof, df)
        us.append(np.sqrt(u2 + rounding))
        dofs.append(np.where(dof > 0, dof, np.nan))
    (u_mean, u_future), (dof_mean, dof_future) = us, dofs
    # What is nan has no quantile.
    half = stdtrit(dof_future, 1 - TAIL) * u_future
    if method != "paper":
        # s_part^2 is a difference of mean squares, of which Satterthwaite leaves fewer degrees of
        # freedom than the parts have. There MS_between/n0 with theirs bounds it: the CMM's scatter
        # included it is too large, but its t is not (3 parts measured twice: half the width, and
        # 95 % or more still covered).
        between = (1 + share) * table.ms_between / table.n0
        bound = stdtrit(table.df_between, 1 - TAIL) * np.sqrt(between + rounding)
        half = np.where(dof_future < table.df_between, np.fmin(half, bound), half)
    both = np.where((table.df_within < 1) & (table.df_between > 0), table.ms_between, np.nan)
    df = np.maximum(table.df_between, 1.0)
    size = np.abs(table.mean) + np.nan_to_num(k * u_future)
    return Analysed(
        kind=kind,
        method=method,
        coverage_factor=k,
        tables=tables,
        labels=tuple((operation, name, axis or kind) for operation, name, axis in tables.labels),
        rounding=rounding,
        one_way=table,
        components=components,
        reml=by_reml,
        interval=interval,
        both=both,
        both_interval=np.column_stack([both * df / chdtri(df, p) for p in (TAIL, 1 - TAIL)]),
        u_mean=u_mean,
        u_future=u_future,
        dof_mean=dof_mean,
        dof_future=dof_future,
        interval_future=np.column_stack([table.mean - half, table.mean + half]),
        p_parts=holm(table.p),
        p_mean=holm(2 * stdtr(dof_mean, -quotient(np.abs(table.mean), u_mean))),
        order=tuple(np.argsort(-size, kind="stable").tolist()),
    )


PARTS, TRENDS = 0.6, 0.2
"""Shares of the family-wise rate, of clean studies with an alarm of any kind (weighted Bonferroni):
p of each kind are over its share. Not all of it is spent."""
FEWEST_PARTS = 4
"""Among fewer parts none can be called an outlier."""
MOVING_RANGE = 1.128
"""d2: mean difference of two normal values in standard deviations (Tippett, 1925)."""
T_FAR = 1000.0
"""Of Student's t: above it the series of the noncentral distribution hardly ends."""
WITHIN = 0.9973
"""Share of parts within the natural limits: what six standard deviations hold."""
Interval = tuple[float, float]
OPEN: Interval = (nan, nan)


class UnusualPart(NamedTuple):
    """An outlying part at the family-wise rate: its `deviation` in the table `where` it lies
    farthest from the mean of the others, and the `typical` one of these (root mean square), in the
    unit of the table: neither is pulled by the part. `singles` are all tables in which it is an
    outlier by itself.
    """

    part: str
    p: float
    where: Label
    deviation: float
    typical: float
    singles: tuple[Label, ...]


def unusual_parts(kinds: Sequence[Analysed], seed: int) -> tuple[UnusualPart, ...] | None:
    """Outlying parts at their share of the family-wise rate over all parts and tables, by a
    rotation test of the part means (parts, tables); None of too few parts.

    Unequal repeats are scaled to equal variance, which is s_part^2 + s_repeat^2/n_i, relative where
    it is not known. Tables of equal operation and axis are looked at together.
    """
    parts = kinds[0].tables.parts
    if len(parts) < FEWEST_PARTS:
        return None
    raws, scales = [], []
    for kind in kinds:
        cells = kind.tables.cells
        deviation = cells.mean - (kind.one_way.mean - cells.origin)[:, None]
        part, repeat = (np.nan_to_num(of)[:, None] for of in (kind.reml.part, kind.reml.repeat))
        variance = part + repeat / np.where(cells.present, cells.n, 1.0)
        raws.append(np.where(cells.present, deviation, np.nan))
        scales.append(np.sqrt(np.where(variance > 0, variance, 1.0)))
    raw, scale = np.concatenate(raws).T, np.concatenate(scales).T
    rounding = np.concatenate([kind.rounding for kind in kinds])
    labels = [label for kind in kinds for label in kind.labels]
    names = [(operation, axis) for operation, _, axis in labels]
    groups = np.unique(names, axis=0, return_inverse=True)[1].ravel()
    hidden = np.asarray(rounding / np.median(scale, axis=0) ** 2)
    test = outstanding_rows(raw / scale, groups, seed, hidden)
    p, rate = np.minimum(test.by_row, test.by_cell.min(axis=1)), PARTS * FAMILY_RATE
    result = []
    for i in np.flatnonzero(p <= rate).tolist():
        rest = np.arange(len(parts)) != i
        deviations = raw - np.nan_to_num(known_mean(raw[rest], axis=0))
        square = np.nan_to_num(known_mean(deviations[rest] ** 2, axis=0))
        size2 = square + rounding
        size = np.abs(np.nan_to_num(deviations[i])) / np.sqrt(np.where(size2 > 0, size2, 1.0))
        j = int(np.argmax(size))
        item = UnusualPart(
            part=parts[i],
            p=min(float(p[i]) / PARTS, 1.0),
            where=labels[j],
            deviation=float(deviations[i, j]),
            typical=float(np.sqrt(square[j])),
            singles=tuple(labels[k] for k in np.flatnonzero(test.by_cell[i] <= rate)),
        )
        result.append(item)
    return tuple(sorted(result, key=lambda item: item.p))


class Trend(NamedTuple):
    """A table whose values change with the sequence of manufacture by `slope` a part (mm or rad)
    with standard uncertainty `u`; family-wise `p`.
    """

    where: Label
    slope: float
    u: float
    p: float


def trends(kinds: Sequence[Analysed], sequence: Mapping[str, FloatArray]) -> tuple[Trend, ...]:
    """The slope of every table's part means over the sequence by least squares, with Student's t;
    p adjusted for all tables (Holm), at the share of trends of the family-wise rate.
    """
    places = np.array([sequence[label[0]] for kind in kinds for label in kind.labels])
    means = np.concatenate([kind.tables.cells.mean for kind in kinds])
    present = np.concatenate([kind.tables.cells.present for kind in kinds]) & np.isfinite(places)
    rounding = np.concatenate([kind.rounding for kind in kinds])
    n = present.sum(axis=1)
    arrays = (np.ma.array(values, mask=~present) for values in (places, means))
    x, y = (np.asarray((each - each.mean(axis=1)[:, None]).filled(0.0)) for each in arrays)
    spread = (x**2).sum(axis=1)
    valid = (n >= FEWEST_PARTS) & (spread > 0)
    spread, dof = np.where(valid, spread, np.nan), np.where(valid, n - 2.0, np.nan)
    slope = (x * y).sum(axis=1) / spread
    s2 = ((y - slope[:, None] * x) ** 2).sum(axis=1) / dof
    u = np.sqrt((s2 + rounding) / spread)
    # Values that are all equal have no trend, those on a line have one beyond doubt.
    t = np.where(valid & (slope != 0), np.inf, np.nan)
    np.divide(np.abs(slope), u, out=t, where=u > 0)
    p = np.minimum(holm(2 * stdtr(dof, -t)) / TRENDS, 1.0)
    labels = [label for kind in kinds for label in kind.labels]
    rows = zip(labels, slope.tolist(), u.tolist(), p.tolist(), strict=True)
    return tuple(Trend(*each) for each in rows if np.isfinite(each[-1]))


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


def capabilities(
    kinds: Sequence[Analysed], part: LoadedPart | None, sequence: Mapping[str, FloatArray]
) -> Iterator[Capability]:
    """Of everything in the part file that has a tolerance, and was measured on two parts."""
    if part is None:
        return
    tolerated: list[tuple[Of, str, Tolerance | None, float]] = [
        *(("length", each.id, each.tolerance, UM) for each in part.part.lengths),
        *(("angle", each.id, each.tolerance, ARCSEC) for each in part.part.orthogonality),
        *(
            ("position", name, Tolerance(0.0, each.position_um / 2), UM)
            for name, each in part.part.features.items()
            if each.position_um is not None
        ),
    ]
    limits = {(of, name): (x.low * unit, x.high * unit) for of, name, x, unit in tolerated if x}
    for kind in kinds:
        rows = {label: i for i, label in enumerate(kind.labels)}
        of: Of = "position" if kind.kind == "feature" else kind.kind
        for (operation, name, axis), i in rows.items():
            tables = [i, rows.get((operation, name, "y"), -1)] if of == "position" else [i]
            if (of, name) not in limits or axis in ("y", "z") or tables[-1] < 0:
                continue
            values = np.column_stack([kind.part_means(j)[0] for j in tables])
            order = np.argsort(sequence[operation], kind="stable")
            order = order[np.isfinite(values[order]).all(axis=1)]
            if len(order) < 2:
                continue
            indices, (low, high) = _of_position if of == "position" else _of_one, limits[of, name]
            yield Capability(
                kind=of,
                operation=operation,
                id=name,
                low=low,
                high=high,
                sequence=sequence[operation][order],
                **indices(values[order], low, high, float(kind.rounding[i])),
            )


def _of_one(values: FloatArray, low: float, high: float, r: float) -> dict[str, Any]:
    """Of a length or angle (parts, 1); `r` is the variance of a value that its last digit hides."""
    values, n = values[:, 0], len(values)
    mean, s = float(values.mean()), float(np.sqrt(values.var(ddof=1) + r))
    moving = np.abs(np.diff(values)).mean() / MOVING_RANGE
    s_moving, nearer = float(np.sqrt(moving**2 + r)), min(high - mean, mean - low)
    pp, ppk = _ratio(high - low, 6 * s), _ratio(nearer, 3 * s)
    scale, tails = 3 * np.sqrt(n), (1 - TAIL, TAIL)
    return {
        "values": values,
        "mean": mean,
        "s": s,
        "s_moving": s_moving,
        "pp": pp,
        "pp_interval": tuple(pp * float(np.sqrt(chdtri(n - 1, p) / (n - 1))) for p in tails),
        "ppk": ppk,
        "ppk_interval": tuple(noncentrality(n - 1, p, scale * ppk) / scale for p in tails),
        "cp": _ratio(high - low, 6 * s_moving),
        "cpk": _ratio(nearer, 3 * s_moving),
    }


def noncentrality(dof: float, probability: float, t: float) -> float:
    """The delta of which Student's noncentral t is at most `t` with this probability.

    Where |t| > T_FAR it is t sqrt(chi^2/dof) to four digits, as t W - Z with W^2 = chi^2/dof and Z
    normal is.

    >>> round(noncentrality(9, 0.975, 40.0), 3), round(noncentrality(9, 0.975, -4e6))
    (21.79, -5815346)
    """
    if abs(t) <= T_FAR or np.isnan(t):
        return float(nctdtrinc(dof, probability, t))
    upper = probability if t > 0 else 1 - probability
    return t * float(np.sqrt(chdtri(dof, upper) / dof))


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
