"""Readings of error components to estimates, by instrument, combined, and jointly by passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mtu_cli.files.machine import AUTO
from mtu_cli.files.readings import Readings
from mtu_cli.findings import error
from mtu_cli.model.estimates import (
    ComponentEstimate,
    JointPasses,
    between_passes,
    covariance_in_run,
)
from mtu_cli.model.visits import Passes, PassKey, passes_read
from mtu_cli.stats.covariance import as_covariance
from mtu_cli.stats.coverage import welch_satterthwaite, yao_p
from mtu_cli.stats.kernels import (
    FEWEST_TARGETS,
    MOST_AUTO,
    PolynomialShape,
    SmoothProfile,
    TableShape,
    chosen_degree,
    smooth_profile,
)
from mtu_cli.stats.least_squares import FloatArray, IntArray, polynomial
from mtu_cli.stats.mixed_model import PassFit, fit_passes, joint_passes
from mtu_cli.stats.pass_tests import FTest, Shift, lack_of_fit, pass_scatter, pass_trend, reversal
from mtu_cli.stats.resolution import rounding_variance
from mtu_cli.units import UNITS

TESTS = {
    "drift": "drift between passes",
    "trend": "trend",
    "lack_of_fit": "misfit of the polynomial",
    "reversal": "reversal",
}
"""Of the readings of one instrument, in words."""


@dataclass(frozen=True, kw_only=True)
class InstrumentReadings:
    """One component as one instrument read it; arrays in mm, rad and the readings' order. `group`
    (n,) is the pass of each reading among the passes `read`, both None where no pass is given.
    `rounding` is the variance of a reading by its last digit; `files` are named in messages.
    """

    role: str
    files: str
    position: FloatArray
    error: FloatArray
    direction: FloatArray
    group: IntArray | None
    read: Passes | None
    rounding: float = 0.0

    @property
    def runs(self) -> IntArray | None:
        """The run there and back (n,) of each reading."""
        return None if self.read is None else self.read.runs[self.group]

    def lines(self, degree: int, bend: FloatArray | float = 0.0) -> PassFit:
        """The lines of the passes, of the readings less a `bend` (n,)."""
        y, x = self.error - bend, self.position
        return fit_passes(y, x, degree, self.group, self.direction, self.runs)


@dataclass(frozen=True, kw_only=True)
class InstrumentFit(InstrumentReadings):
    """The fit of these readings; of a table `profile` is the bend, and `fit` of the readings less
    it. The tests on the passes are made when they are first asked for.
    """

    fit: PassFit
    profile: SmoothProfile | None = None

    @cached_property
    def passes(self) -> Passes | None:
        """The passes in the order of the fit, without what broke off early: it does not take part
        in what compares passes.
        """
        read = self.read
        return read if read is None or not self.fit.separated else read.only(self.fit.groups)

    @property
    def keys_read(self) -> tuple[PassKey, ...]:
        """Of all passes, those that broke off early too; none where no pass is given."""
        return () if self.read is None else self.read.keys

    @property
    def powers(self) -> int:
        """Coefficients of the polynomial."""
        return len(self.fit.plain.coefficients)

    @cached_property
    def tests(self) -> dict[str, FTest | Shift]:
        """By TESTS, those that passes, directions and positions allow; a table fits by design."""
        r, passes = self.rounding, self.passes
        made: dict[str, FTest | Shift | None] = {"drift": pass_scatter(self.fit, r)}
        if passes is not None:
            made["trend"] = pass_trend(self.fit, passes.order, r)
        if self.profile is None:
            y, x, degree = self.error, self.position, self.powers - 1
            made["lack_of_fit"] = lack_of_fit(y, x, degree, self.group, r)
        if passes is not None:
            made["reversal"] = reversal(self.fit, passes.order, timed=passes.timed, r=r)
        return {name: test for name, test in made.items() if test is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentFit:
    """The fit of a component by every instrument that read it, the combined estimate, and the p
    value that the instruments agree (None with one instrument).
    """

    instruments: tuple[InstrumentFit, ...]
    estimate: ComponentEstimate
    agreement_p: float | None


def fit_component(readings: Readings, name: str, component: Any) -> ComponentFit:
    """Fits one component from all its readings; `component` is the machine file's entry: `of`,
    `unit`, `degree`. Instruments (ball bar, laser) are fitted separately, each with its own
    variances, and combined.

    Raises InputError for one of several instruments whose readings show no scatter, and for tables
    of several.
    """
    rows = np.flatnonzero(readings.code == readings.components.index(name))
    roles = np.array([x.role for x in readings.sources])[readings.file_index[rows]]
    series = [
        _read(readings, rows[roles == role], role, component)
        for role in dict.fromkeys(roles.tolist())
    ]
    degree = None if component.is_table else component.degree
    fits = [_fitted(name, each, degree) for each in series]
    if degree == AUTO and len(fits) > 1:
        # One shape for all: the highest degree that any of them chooses, in place of a table.
        highest = max(MOST_AUTO if x.profile else x.powers - 1 for x in fits)
        highest = min(highest, *(len(np.unique(x.position)) - 1 for x in fits))
        fits = [_fitted(name, each, highest) for each in series]
    if len(fits) > 1 and component.is_table:
        reason = f"{name!r} was read by several instruments, whose tables are not combined"
        expected = "readings of one instrument, or a degree"
        raise error("not-applicable", reason=reason, expected=expected)
    estimates = [_estimate(name, component, fit) for fit in fits]
    agreement_p = None
    if len(fits) > 1:
        for fit, estimate in zip(fits, estimates, strict=True):
            if not (np.diag(estimate.covariance) > 0).all():
                what = f"the readings of {name!r} by {fit.role} do not scatter"
                expected = "more readings, with all their digits"
                raise error("too-little-data", what=what, file=fit.files, expected=expected)
        estimates = _at_both_ways(estimates, fits)
        agreement_p = agreement(estimates[0], estimates[1])
    estimate = combine(estimates, [len(fit.error) for fit in fits])
    return ComponentFit(instruments=tuple(fits), estimate=estimate, agreement_p=agreement_p)


def _read(readings: Readings, rows: IntArray, role: str, component: Any) -> InstrumentReadings:
    """The readings `rows` (n,) of a component by one instrument."""
    position = readings.position_mm[rows].astype(np.float64)
    group = read = None
    if component.of is None or readings.has_pass[rows].all():
        group, read = passes_read(readings, rows, component.of)
    files = dict.fromkeys(readings.sources[i].shown for i in readings.file_index[rows])
    return InstrumentReadings(
        role=role,
        files=", ".join(files),
        position=np.zeros(len(rows)) if component.of is None else position,
        error=readings.error[rows],
        direction=readings.direction[rows].astype(np.float64),
        group=group,
        read=read,
        rounding=reading_rounding(readings, rows),
    )


def _fitted(name: str, series: InstrumentReadings, degree: int | str | None) -> InstrumentFit:
    """The fit of a `degree`, or of that (or the table) which the readings choose; None: a table,
    the passes' lines and its bend.

    Raises InputError for too few readings for a table.
    """
    if degree == AUTO:
        degree = chosen_degree(series.position, series.error, series.group, series.runs)
    if degree is not None:
        return InstrumentFit(**vars(series), fit=series.lines(int(degree)))
    group = np.zeros(len(series.error), np.int64) if series.group is None else series.group
    profile = smooth_profile(
        series.position, series.error, group, group if series.runs is None else series.runs
    )
    if profile is None:
        raise error(
            "too-little-data",
            what=f"the readings of {name!r} for a table",
            file=series.files,
            expected=f"at least {FEWEST_TARGETS} positions, each read in several passes",
        )
    fit = series.lines(1, profile.bend_at(series.position))
    fields: dict[str, Any] = {
        "s2": profile.s2,
        "within_rss": profile.rss,
        "within_dof": profile.dof,
        "pooled_rss": fit.pooled_rss - (fit.within_rss - profile.rss),
        "pooled_dof": fit.pooled_dof - (fit.within_dof - profile.dof),
    }
    return InstrumentFit(**vars(series), fit=replace(fit, **fields), profile=profile)


def reading_rounding(readings: Readings, rows: IntArray) -> float:
    """The variance of a reading by its last digit (`stats.resolution`), mm^2 or rad^2, where
    coarsest.
    """
    files, unit, result = readings.file_index[rows], readings.unit[rows], 0.0
    for file, code in {*zip(files.tolist(), unit.tolist(), strict=True)}:
        values = readings.error[rows[(files == file) & (unit == code)]]
        size = list(UNITS.values())[code].to_internal
        result = max(result, rounding_variance(values, size))
    return result


def _estimate(name: str, component: Any, fit: InstrumentFit) -> ComponentEstimate:
    lines, plain, profile = fit.fit, fit.fit.plain, fit.profile
    low, high = float(fit.position.min()), float(fit.position.max())
    table, b, C, s2 = None, plain.coefficients, lines.covariance, plain.s2
    C_independent = s2 * plain.unscaled_covariance
    if profile is not None:
        # Line and bend at the positions that were read.
        y, at = fit.error, np.searchsorted(profile.knots, fit.position)
        L = polynomial(profile.knots, 1)
        counts = np.bincount(at)
        # The bend holds no line of the readings, however many there are at each position.
        free = np.eye(len(L)) - L @ np.linalg.solve((L.T * counts) @ L, L.T * counts)
        s2 = float(((y - (np.bincount(at, y) / counts)[at]) ** 2).sum()) / max(len(y) - len(L), 1)
        table = TableShape(
            at=profile.knots, roughness=profile.roughness, own=profile.own, own_dof=profile.own_dof
        )
        b, C = L @ b + profile.bend, L @ C @ L.T + free @ profile.covariance @ free.T
        C_independent = np.diag(s2 / counts)
    T = (table or PolynomialShape(fit.powers - 1)).of_line(lines.center, len(lines.D))
    D = T @ lines.D_moment @ T.T
    halves = None if lines.half_differences is None else T @ lines.half_differences @ T.T
    return ComponentEstimate(
        name=name,
        of=component.of,
        unit=UNITS[component.unit],
        coefficients=b,
        covariance=C,
        pass_covariance=(D + D.T) / 2,
        s_repeat=float(np.sqrt(lines.s2)),
        pass_dof=float(lines.pass_dof),
        repeat_dof=float(lines.within_dof) if lines.within_dof else np.inf,
        n_passes=lines.n_passes if lines.separated else None,
        independent_covariance=C_independent,
        independent_s=float(np.sqrt(s2)),
        position_range=None if component.of is None else (low, high),
        half_differences=None if halves is None else (halves + halves.T) / 2,
        table=table,
    )


def combine(estimates: Sequence[ComponentEstimate], counts: Sequence[int]) -> ComponentEstimate:
    """One estimate from several instruments'.

    b = sum W_i b_i with scalar weights from each instrument's own repeatability over its `counts`
    n_i readings and the machine's pass-to-pass drift, which is one for all instruments:
    1/W_i proportional to d^2/G_i + s_i^2/n_i. The inverses of whole covariances that few
    passes estimate would follow their errors (95 % intervals then cover 80 %).
    C = sum W_i^2 C_i whatever the weights. The scatter of passes and of visits is pooled by
    degrees of freedom, and so is what passes there and back of a run share: an instrument's own
    noise stays in s_repeat, which is then an upper bound of the machine's.
    """
    first = estimates[0]
    if len(estimates) == 1:
        return first

    def each(name: str) -> FloatArray:
        return np.array([getattr(item, name) for item in estimates])

    def pooled(values: FloatArray, dofs: FloatArray) -> FloatArray:
        """Mean weighted by degrees of freedom; those without any have weight 0."""
        weights = np.where(np.isinf(dofs), 1e9, dofs)
        return np.average(values, axis=0, weights=weights) if weights.any() else 0 * values[0]

    passes, repeats, n = each("pass_dof"), each("repeat_dof"), np.array(counts, np.float64)
    D = pooled(each("pass_covariance"), passes)
    runs = [(K, item.pass_dof) for item in estimates if (K := covariance_in_run(item)) is not None]
    in_run = pooled(*map(np.array, zip(*runs, strict=True))) if runs else None
    ranges = [item.position_range for item in estimates if item.position_range is not None]
    # By the variance of the level in the middle of the range.
    x = np.mean(ranges or 0.0) ** np.arange(len(D))
    drift = max(float(x @ D @ x), 0.0)
    of_passes = np.array([drift / item.n_passes if item.n_passes else 0.0 for item in estimates])
    variance = of_passes + each("s_repeat") ** 2 / n
    # One reading a pass has no repeatability to weigh it by.
    W = 1.0 / variance if (variance > 0).all() else n
    W = W / W.sum()
    covariance = np.tensordot(W**2, each("covariance"), axes=1)
    # Welch-Satterthwaite over the mean squares behind C, by its trace; 0 where no instrument
    # separates passes: then one mean square stands behind all.
    by_trace = np.array([np.sum(np.diag(C) / np.diag(covariance)) for C in each("covariance")])
    dof = float(welch_satterthwaite(W**2 * by_trace, np.where(passes != 0, passes, repeats)))
    plain = n - len(first.coefficients)
    return ComponentEstimate(
        name=first.name,
        of=first.of,
        unit=first.unit,
        coefficients=W @ each("coefficients"),
        covariance=covariance,
        pass_covariance=D,
        s_repeat=float(np.sqrt(pooled(each("s_repeat") ** 2, repeats))),
        pass_dof=dof if passes.any() else 0.0,
        repeat_dof=float(repeats.sum()),
        independent_covariance=np.tensordot(W**2, each("independent_covariance"), axes=1),
        independent_s=float(np.sqrt(pooled(each("independent_s") ** 2, plain))),
        position_range=(min(r[0] for r in ranges), max(r[1] for r in ranges)) if ranges else None,
        run_covariance=in_run,
    )


def _at_both_ways(
    estimates: Sequence[ComponentEstimate], fits: Sequence[InstrumentFit]
) -> list[ComponentEstimate]:
    """Lines of the mean of both directions, which predictions are for: an instrument that ran one
    way alone, w = +1 or -1, reads a line half of the reversal value h away: b_0 - w h/2, with
    u(h)^2/4 more variance, h of one that ran both ways. Without such a one it stays as it is.
    """
    shift = next((fit.tests["reversal"] for fit in fits if "reversal" in fit.tests), None)
    result = list(estimates)
    for i, fit in enumerate(fits):
        ways = np.unique(fit.direction)
        if isinstance(shift, Shift) and len(ways) == 1 and ways[0]:
            b, C = result[i].coefficients.copy(), result[i].covariance.copy()
            b[0] -= ways[0] * shift.value / 2
            C[0, 0] += shift.u**2 / 4
            result[i] = replace(result[i], coefficients=b, covariance=C)
    return result


def agreement(a: ComponentEstimate, b: ComponentEstimate) -> float:
    """p value that two instruments read the same line, by the mean squares behind either C."""
    sources: list[tuple[FloatArray, float]] = []
    for item in (a, b):
        S, halves = between_passes(item), item.half_differences
        if S is None or item.n_passes is None:
            sources.append((item.covariance, item.pass_dof or item.repeat_dof))
            continue
        of_passes = (S if halves is None else 2 * (S - halves)) / item.n_passes
        sources += [(of_passes, item.pass_dof), (item.covariance - of_passes, item.repeat_dof)]
    return yao_p(a.coefficients - b.coefficients, a.covariance + b.covariance, sources)


def shared_passes(fits: Mapping[str, ComponentFit]) -> tuple[JointPasses, ...]:
    """The groups of components that share passes, with their joint covariances: one instrument read
    them in the same (pass, direction) pairs and runs and, with a `setup` column, in the same
    set-ups, or, with times, in passes that overlap. Without either, passes of one ball-bar file are
    shared; those of two files are not, nor those of a laser, which reads one component a set-up.
    """
    groups: list[list[ComponentFit]] = []
    for fit in fits.values():
        if len(fit.instruments) != 1 or not fit.instruments[0].fit.separated:
            continue
        fellows = [group for group in groups if _share(group[0].instruments[0], fit.instruments[0])]
        if fellows:
            fellows[0].append(fit)
        else:
            groups.append([fit])
    return tuple(_joint(group) for group in groups if len(group) > 1)


def _share(first: InstrumentFit, second: InstrumentFit) -> bool:
    a, b = first.passes, second.passes
    if first.role != second.role or a is None or b is None:
        return False
    same = [key[1:] for key in a.keys] == [key[1:] for key in b.keys]
    if not same or not np.array_equal(first.fit.pairs, second.fit.pairs):
        return False
    if any(a.setups) or any(b.setups):
        return a.setups == b.setups
    if np.isfinite([a.starts, b.starts]).all():
        return bool(((a.starts <= b.ends) & (b.starts <= a.ends)).all())
    return first.role == "lbb" and a.keys == b.keys


def _joint(group: Sequence[ComponentFit]) -> JointPasses:
    """All were read in the same passes: their runs are the same, too."""
    from scipy.linalg import block_diag

    fits = [item.instruments[0].fit for item in group]
    shapes = [item.estimate.shape for item in group]
    T = block_diag(*(x.of_line(f.center, len(f.D)) for f, x in zip(fits, shapes, strict=True)))
    C = block_diag(*(item.estimate.covariance for item in group))
    between, D, halves = joint_passes(fits, T)
    return JointPasses(
        components=tuple(item.estimate.name for item in group),
        widths=tuple(len(item.estimate.coefficients) for item in group),
        covariance=as_covariance(C + between),
        pass_covariance=D,
        pass_dof=float(fits[0].pass_dof),
        n_passes=fits[0].n_passes,
        half_differences=halves,
    )
