"""Readings of error components to estimates, by instrument, combined, and jointly by passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mtu_cli.files.machine_contract import AUTO
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.basis import Powers
from mtu_cli.model.estimates import (
    ComponentEstimate,
    JointPasses,
    between_passes,
    covariance_in_run,
)
from mtu_cli.model.passes import Passes, PassKey, passes_of
from mtu_cli.model.shapes import MOST_AUTO, as_table, chosen_degree, fit_table
from mtu_cli.stats.covariance import as_covariance
from mtu_cli.stats.coverage import dof_of_shares, welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import IntArray, PassFit, covariance_in_runs, fit_passes
from mtu_cli.stats.pass_tests import (
    FTest,
    Shift,
    lack_of_fit,
    pass_scatter,
    pass_trend,
    reversal,
    trend_units,
)
from mtu_cli.stats.resolution import rounding_variance
from mtu_cli.stats.smooth_profile import FEWEST_TARGETS, SmoothProfile
from mtu_cli.units import UNITS, Unit


@dataclass(frozen=True, kw_only=True)
class InstrumentFit:
    """One component as one instrument read it; arrays in mm, rad and the readings' order.

    `group` (n,) is the pass of each reading among the passes `read`; `passes` are those of the fit,
    in its order, which leaves out what broke off early; all three None where no pass is given. Of
    a table `profile` is the bend, and `fit` of the readings less it. The
    tests on the passes are made when they are first asked for: predictions need not all of them.
    `rounding` is the variance of a reading by its last digit.
    """

    role: str
    position: FloatArray
    error: FloatArray
    direction: FloatArray
    group: IntArray | None
    read: Passes | None
    passes: Passes | None
    fit: PassFit
    rounding: float = 0.0
    profile: SmoothProfile | None = None

    @property
    def keys_read(self) -> tuple[PassKey, ...]:
        """Of all passes, those that broke off early too; none where no pass is given."""
        return () if self.read is None else self.read.keys

    @property
    def way(self) -> int | None:
        """The direction that all readings have, +1 forward or -1; None of both, or of none."""
        found = np.unique(self.direction).astype(int).tolist()
        return found[0] if found in ([1], [-1]) else None

    @cached_property
    def scatter(self) -> FTest | None:
        """Whether the passes differ by more than repeatability."""
        return pass_scatter(self.fit, self.rounding)

    @cached_property
    def trend(self) -> Shift | None:
        """The drift a pass."""
        return (
            None if self.passes is None else pass_trend(self.fit, self.passes.order, self.rounding)
        )

    @property
    def trend_of_files(self) -> bool:
        """Whether the order in which files are given, and no times, makes the trend what it is."""
        passes = self.passes
        if passes is None or passes.timed:
            return False
        return passes.files_in_turn(trend_units(self.fit))

    @cached_property
    def reversal(self) -> Shift | None:
        """The mean reversal value."""
        if self.passes is None:
            return None
        timed = self.passes.timed
        return reversal(self.fit, self.passes.order, timed=timed, r=self.rounding)

    @cached_property
    def lack_of_fit(self) -> FTest | None:
        """Whether free means at the positions fit better than the polynomial; None of a table."""
        if self.profile is not None:
            return None
        degree = len(self.fit.plain.coefficients) - 1
        return lack_of_fit(self.error, self.position, degree, self.group, self.rounding)


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentFit:
    """A component, its fit by every instrument that read it, and the combined estimate.

    `agreement_p` is the p value that the instruments agree, None with one instrument.
    """

    name: str
    unit: Unit
    instruments: tuple[InstrumentFit, ...]
    estimate: ComponentEstimate
    agreement_p: float | None


def fit_component(readings: Readings, name: str, component: Any) -> ComponentFit:
    """Fits one component from all its readings.

    `component` is the machine file's entry: `of`, `unit`, `degree`. Readings of several
    instruments (ball bar, laser) are fitted apart, each with its own variances, and combined
    by generalised least squares with the inverse of their covariances as weights.

    Raises InputError for one of several instruments whose readings show no scatter.
    """
    code = readings.components.index(name)
    rows = np.flatnonzero(readings.code == code)
    unit = UNITS[component.unit]
    roles = np.array(readings.roles)[readings.file_index[rows]]
    by_role = [rows[roles == role] for role in dict.fromkeys(roles.tolist())]
    degree = None if component.is_table else component.degree
    named = [(str(roles[rows == own[0]][0]), own) for own in by_role]
    fits = tuple(_fit_instrument(readings, own, role, component, degree) for role, own in named)
    if degree == AUTO and len(fits) > 1:
        # One shape for all: the highest degree that any of them chooses, in place of a table.
        chosen = [MOST_AUTO if x.profile else len(x.fit.plain.coefficients) - 1 for x in fits]
        degree = min(max(chosen), *(len(np.unique(x.position)) - 1 for x in fits))
        fits = tuple(_fit_instrument(readings, own, role, component, degree) for role, own in named)
    if len(fits) > 1 and any(fit.profile is not None for fit in fits):
        reason = f"{name!r} was read by several instruments, whose tables are not combined"
        expected = "readings of one instrument, or a degree"
        raise InputError([finding("not-applicable", reason=reason, expected=expected)])
    estimates = [_estimate(name, component, unit, fit) for fit in fits]
    if len(fits) > 1:
        # Without scatter an instrument has no weight against the others.
        problems = [
            finding(
                "too-little-data",
                what=f"the readings of {name!r} by {fit.role} do not scatter, so that they have no "
                "weight beside the others",
                file=", ".join(s.shown for s in readings.sources if s.role == fit.role) or None,
                expected="more readings, with all their digits",
            )
            for fit, estimate in zip(fits, estimates, strict=True)
            if not (np.diag(estimate.covariance) > 0).all()
        ]
        if problems:
            raise InputError(problems)
        ways, reversals = [fit.way for fit in fits], [fit.reversal for fit in fits]
        estimates = at_both_ways(estimates, ways, reversals)
    estimate, agreement = combine(estimates, [len(fit.error) for fit in fits])
    return ComponentFit(
        name=name, unit=unit, instruments=fits, estimate=estimate, agreement_p=agreement
    )


def _fit_instrument(
    readings: Readings, rows: IntArray, role: str, component: Any, degree: int | str | None
) -> InstrumentFit:
    """Of a `degree`, or that (or the table) which its readings choose; None: a table."""
    position = readings.position_mm[rows].astype(np.float64)
    if component.of is None:
        position = np.zeros(len(rows))
    error = readings.error[rows]
    direction = readings.direction[rows].astype(np.float64)
    group = read = runs = None
    numbers, sign = readings.pass_number[rows], readings.direction[rows].astype(np.int64)
    numbered = bool(readings.has_pass[rows].all())
    if not numbered and component.of is None:
        # Read once a pass: readings without a number are passes of their own.
        numbers, sign = np.arange(1, len(rows) + 1), np.zeros(len(rows), np.int64)
    if numbered or component.of is None:
        group, read = passes_of(readings, rows, numbers, sign)
        runs = read.runs[group]
    if degree == AUTO:
        degree = chosen_degree(position, error, group, runs)
    profile = None
    if degree is not None:
        fit = fit_passes(error, position, int(degree), group, direction, runs)
    elif (found := fit_table(position, error, group, direction, runs)) is not None:
        fit, profile = found
    else:
        raise InputError(_too_few_for_table(readings, rows))
    return InstrumentFit(
        role=role,
        position=position,
        error=error,
        direction=direction,
        group=group,
        read=read,
        # Passes that broke off early do not take part in what compares passes.
        passes=read.only(fit.groups) if read is not None and fit.separated else read,
        fit=fit,
        profile=profile,
        rounding=_rounding(readings, rows, UNITS[component.unit]),
    )


def _rounding(readings: Readings, rows: IntArray, stated: Unit) -> float:
    """The variance of a reading by its last digit (`stats.resolution`), mm^2 or rad^2, in the file
    and unit where it is coarsest.
    """
    codes = readings.file_index[rows] * len(UNITS)
    if readings.unit is not None:
        codes = codes + readings.unit[rows]
    found = []
    for code in np.unique(codes).tolist():
        unit = stated if readings.unit is None else list(UNITS.values())[code % len(UNITS)]
        found.append(rounding_variance(readings.error[rows[codes == code]], unit.to_internal))
    return max(found, default=0.0)


def _too_few_for_table(readings: Readings, rows: IntArray) -> Finding:
    """That a table cannot be fitted to these readings."""
    name = readings.components[int(readings.code[rows[0]])]
    source = readings.sources[int(readings.file_index[rows[0]])]
    what = f"the readings of {name!r} for a table"
    expected = f"at least {FEWEST_TARGETS} positions, each read in several passes"
    return finding("too-little-data", what=what, file=source.shown, expected=expected)


def _estimate(name: str, component: Any, unit: Unit, found: InstrumentFit) -> ComponentEstimate:
    fit = found.fit
    T = Powers(len(fit.plain.coefficients) - 1).of_line(fit.center, len(fit.D))
    D = T @ fit.D_moment @ T.T
    halves = None if fit.half_differences is None else T @ fit.half_differences @ T.T
    low, high = float(found.position.min()), float(found.position.max())
    estimate = ComponentEstimate(
        name=name,
        of=component.of,
        unit=unit,
        coefficients=fit.plain.coefficients,
        covariance=fit.covariance,
        pass_covariance=(D + D.T) / 2,
        s_repeat=float(np.sqrt(fit.s2)),
        pass_dof=float(fit.pass_dof),
        repeat_dof=float(fit.within_dof) if fit.within_dof else np.inf,
        n_passes=fit.n_passes if fit.separated else None,
        independent_covariance=fit.plain.s2 * fit.plain.unscaled_covariance,
        independent_s=float(np.sqrt(fit.plain.s2)),
        position_range=None if component.of is None else (low, high),
        half_differences=None if halves is None else (halves + halves.T) / 2,
    )
    if found.profile is None:
        return estimate
    return as_table(estimate, fit, found.profile, found.position, found.error)


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
    ranges = [item.position_range for item in estimates if item.position_range is not None]
    runs = [(K, item.pass_dof) for item in estimates if (K := covariance_in_run(item)) is not None]
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
        position_range=(min(r[0] for r in ranges), max(r[1] for r in ranges)) if ranges else None,
        run_covariance=_pooled([K for K, _ in runs], np.array([dof for _, dof in runs]))
        if runs
        else None,
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
    from mtu_cli.stats.family import hotelling_p

    d = a.coefficients - b.coefficients
    V = a.covariance + b.covariance
    scale = np.sqrt(np.diag(V))
    inverse = np.linalg.pinv(V / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    inverse /= np.outer(scale, scale)
    k = int(np.linalg.matrix_rank(inverse * np.outer(scale, scale)))
    sources: list[tuple[FloatArray, float]] = []
    for item in (a, b):
        # The mean squares that make up C, with their degrees of freedom.
        S, halves = between_passes(item), item.half_differences
        if S is None or item.n_passes is None:
            sources.append((item.covariance, item.pass_dof or item.repeat_dof))
            continue
        of_passes = (S if halves is None else 2 * (S - halves)) / item.n_passes
        sources.append((of_passes, item.pass_dof))
        sources.append((item.covariance - of_passes, item.repeat_dof))
    shares = np.array([float(np.trace(part @ inverse)) / k for part, _ in sources])
    nu = dof_of_shares(shares, np.array([dof for _, dof in sources]))
    return hotelling_p(float(d @ inverse @ d), k, nu)


def _pooled_deviation(values: Sequence[float], dofs: FloatArray) -> float:
    return float(np.sqrt(_pooled([np.array(s**2) for s in values], dofs)))


def _pooled(values: Sequence[FloatArray], dofs: FloatArray) -> FloatArray:
    """Mean weighted by degrees of freedom; those without any have no say."""
    finite = np.where(np.isinf(dofs), 1e9, dofs)
    if finite.sum() == 0:
        return np.zeros_like(values[0])
    pooled: FloatArray = np.tensordot(finite / finite.sum(), np.array(values), axes=1)
    return pooled


def shared_passes(fits: Mapping[str, ComponentFit]) -> tuple[JointPasses, ...]:
    """The groups of components that share passes, with their joint covariances.

    Two components share passes if one instrument read both in the same (pass, direction)
    pairs and the same runs there and back and, with a `setup` column, in the same set-ups, or,
    with times, in passes that overlap. Without either, passes of one ball-bar file are shared;
    those of two files are not, nor those of a laser, which reads one component a set-up.
    """
    groups: list[list[ComponentFit]] = []
    for fit in fits.values():
        if len(fit.instruments) != 1 or not fit.instruments[0].fit.separated:
            continue
        for group in groups:
            if _share(group[0].instruments[0], fit.instruments[0]):
                group.append(fit)
                break
        else:
            groups.append([fit])
    return tuple(_joint(group) for group in groups if len(group) > 1)


def _share(first: InstrumentFit, second: InstrumentFit) -> bool:
    a, b = first.passes, second.passes
    if first.role != second.role or a is None or b is None:
        return False
    if [key[1:] for key in a.keys] != [key[1:] for key in b.keys]:
        return False
    if not np.array_equal(first.fit.pairs, second.fit.pairs):
        return False
    if any(a.setups) or any(b.setups):
        return a.setups == b.setups
    if np.isfinite([a.starts, b.starts]).all():
        return bool(((a.starts <= b.ends) & (b.starts <= a.ends)).all())
    return first.role == "lbb" and a.keys == b.keys


def _joint(group: Sequence[ComponentFit]) -> JointPasses:
    fits = [item.instruments[0].fit for item in group]
    shapes = [item.estimate.shape for item in group]
    T = _block([x.of_line(f.center, len(f.D)) for f, x in zip(fits, shapes, strict=True)])
    deviations = np.column_stack([fit.deviations for fit in fits])
    n = fits[0].n_passes
    S = deviations.T @ deviations / fits[0].divisor
    inside = _block([np.ones_like(fit.D) for fit in fits]) > 0
    off = np.where(inside, 0.0, S)
    D = _block([fit.D_moment for fit in fits]) + off
    # All were read in the same passes: their runs are the same, too.
    pairs = fits[0].pairs
    K = 2 * len(pairs) / n * covariance_in_runs(deviations, pairs, S)
    off_runs = np.where(inside, 0.0, K)
    C = _block([item.estimate.covariance for item in group]) + (T @ (off + off_runs) @ T.T) / n
    own = [fit.half_differences for fit in fits if fit.half_differences is not None]
    halves = _block(own) + (off - off_runs) / 2 if own else None
    return JointPasses(
        components=tuple(item.name for item in group),
        widths=tuple(len(item.estimate.coefficients) for item in group),
        covariance=as_covariance(C),
        pass_covariance=(T @ D @ T.T + (T @ D @ T.T).T) / 2,
        pass_dof=float(fits[0].pass_dof),
        n_passes=n,
        half_differences=None if halves is None else as_covariance(T @ halves @ T.T),
    )


def _block(parts: Sequence[FloatArray]) -> FloatArray:
    """Block-diagonal matrix of the parts."""
    ends = np.cumsum([part.shape for part in parts], axis=0)
    whole = np.zeros(ends[-1])
    for part, (row, column) in zip(parts, ends, strict=True):
        whole[row - part.shape[0] : row, column - part.shape[1] : column] = part
    return whole
