"""What the readings say of every component: lines, scatter, tests, and what stays undetermined."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.findings import Finding, counted, finding
from mtu_cli.model.basis import Powers
from mtu_cli.model.estimates import ComponentEstimate, Estimates, JointPasses
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.stats.covariance import positive_part
from mtu_cli.stats.family import significant
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import MAX_POSITIONS, FTest, Shift, by_runs
from mtu_cli.units import Unit

NOTHING = 1e-9
"""Share of the figures beside it below which a scatter is the rounding of their sums."""
Flags = Mapping[str, set[tuple[str, str]]]
"""By test the (component, role) that are significant among all of their kind."""
TESTS: dict[str, Callable[[InstrumentFit], FTest | Shift | None]] = {
    "drift": lambda item: item.scatter,
    "trend": lambda item: item.trend,
    "lack_of_fit": lambda item: item.lack_of_fit,
    "reversal": lambda item: item.reversal,
}


class Tested(NamedTuple):
    """A test: F or the size of a shift as `value` with its `u` (None of F), p, degrees of
    freedom; `significant` among all components (Bonferroni). `unit` is that of the component.
    """

    value: float
    u: float | None
    p: float
    dof: int | tuple[int, int]
    significant: bool
    unit: Unit


@dataclass(frozen=True, kw_only=True)
class Line:
    """What a line of the table states: of a component, or of one instrument that read it.

    `coefficients` with their `covariance`; `scatter` are s_repeat and s_pass, each only where the
    readings separate it from the other, and s_pass at the component's `pass_center`.
    """

    label: str
    of: str | None
    unit: Unit
    source: str
    coefficients: FloatArray
    covariance: FloatArray
    passes_read: int | None
    runs_read: int | None
    n: int | None
    dof: int | None
    s_repeat: float
    scatter: tuple[float | None, float | None]
    tests: Mapping[str, Tested]
    r2: float | None
    agreement_p: float | None = None


@dataclass(frozen=True, kw_only=True)
class Instrument(Line):
    """One instrument's readings of a component; `s` and `dof` of all readings as repeats."""

    role: str
    n_passes: int | None
    s: float


@dataclass(frozen=True, kw_only=True)
class Component(Line):
    """One component: all that predictions need, and what people ask.

    `pass_center` is the position (mm) at which the pass-to-pass intercept is stated: 0 without
    readings; with several instruments the mean of all their readings. There are, (q, q) of this
    intercept and the slope (q is 1 for a constant), the unbiased `pass_covariance_moment` that
    predictions use, which may have a negative part, `pass_covariance` less that part, the mean
    square `half_differences` of runs there and back (None without runs), and their
    `run_covariance`, of several instruments, else None.
    """

    estimate: ComponentEstimate
    says: str | None
    pass_center: float
    pass_covariance: FloatArray
    pass_covariance_moment: FloatArray
    half_differences: FloatArray | None
    run_covariance: FloatArray | None
    instruments: tuple[Instrument, ...]


class SharedPasses(NamedTuple):
    """Components that share passes; `units` (K, K) are products of their units' sizes."""

    group: JointPasses
    units: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class FitResult:
    """All components of a machine, those of the machine file too. `observability` is what the data
    do not determine, and which readings would.
    """

    machine: str
    fit: MachineFit
    estimates: Estimates
    components: Mapping[str, Component]
    joint: tuple[SharedPasses, ...]
    observability: tuple[NotDetermined, ...]
    coverage_factor: float
    warnings: tuple[Finding, ...]


def fit_result(
    machine: str,
    fit: MachineFit,
    estimates: Estimates,
    *,
    says: Mapping[str, str] | None = None,
    coverage_factor: float = 2.0,
) -> FitResult:
    """The figures of a fit; `estimates` holds the components of the machine file too."""
    items = [(x.name, item) for x in fit.components.values() for item in x.instruments]
    flags = {}
    for key, test in TESTS.items():
        made = {f"{name}\n{item.role}": test(item) for name, item in items}
        found = significant({pair: each.p for pair, each in made.items() if each is not None})
        flags[key] = {(name, role) for name, _, role in (pair.partition("\n") for pair in found)}
    undetermined = tuple(observability(fit, estimates))
    warnings = not_estimable(undetermined)
    if several := [name for name, x in fit.components.items() if len(x.instruments) > 1]:
        reason = "several instruments: see `instruments`"
        given = {"names": several, "reason": reason}
        warnings.append(finding("not-estimable", quantity="dof and r2", **given))
    shared = []
    for group in estimates.joint:
        units = [estimates.components[name].unit.to_internal for name in group.components]
        sizes = np.repeat(units, group.widths)
        shared.append(SharedPasses(group, np.outer(sizes, sizes)))
    return FitResult(
        machine=machine,
        fit=fit,
        estimates=estimates,
        components={
            name: _component(estimate, fit.components.get(name), (says or {}).get(name), flags)
            for name, estimate in estimates.components.items()
        },
        joint=tuple(shared),
        observability=undetermined,
        coverage_factor=coverage_factor,
        warnings=tuple(warnings),
    )


def _component(
    estimate: ComponentEstimate, fit: ComponentFit | None, says: str | None, flags: Flags
) -> Component:
    items = () if fit is None else fit.instruments
    one = items[0] if len(items) == 1 else None
    centre = float(np.concatenate([item.position for item in items]).mean()) if items else 0.0
    T = estimate.shape.at_centre(centre)
    moment, halves = T @ estimate.pass_covariance @ T.T, _turned(estimate.half_differences, T)
    D = moment if np.linalg.eigvalsh(moment)[0] >= 0 else positive_part(moment)
    if one is not None:
        # Where some pass has one position only the level varies from pass to pass, not the slope.
        centre, P = float(one.fit.center), np.eye(min(2, len(T[0])), len(one.fit.D))
        D, moment = P @ one.fit.D @ P.T, P @ one.fit.D_moment @ P.T
        halves = _turned(one.fit.half_differences, P)
    counts = [len(item.keys_read) for item in items]
    runs = sum(_runs(item) or 0 for item in items)
    s_pass, level = float(np.sqrt(D[0, 0])), float(estimate.coefficients[0])
    return Component(
        label=estimate.name,
        of=estimate.of,
        unit=estimate.unit,
        source="machine file" if fit is None else "readings",
        coefficients=estimate.coefficients,
        covariance=estimate.covariance,
        passes_read=sum(counts) if counts and all(counts) else None,
        runs_read=runs or None,
        n=sum(len(item.error) for item in items) if items else None,
        dof=None if one is None else int(one.fit.plain.dof),
        s_repeat=estimate.s_repeat,
        scatter=_scatter(estimate.s_repeat, s_pass, level, items),
        tests={} if one is None else _tests(estimate, one, flags),
        r2=None if one is None else _r2(one),
        agreement_p=None if fit is None else fit.agreement_p,
        estimate=estimate,
        says=says,
        pass_center=centre,
        pass_covariance=D,
        pass_covariance_moment=moment,
        half_differences=halves,
        run_covariance=_turned(estimate.run_covariance, T),
        instruments=tuple(_instrument(estimate, item, centre, flags) for item in items),
    )


def _instrument(
    estimate: ComponentEstimate, item: InstrumentFit, centre: float, flags: Flags
) -> Instrument:
    fit, b, s_repeat = item.fit, item.fit.plain.coefficients, float(np.sqrt(item.fit.s2))
    line = Powers(len(b) - 1)
    T = line.at_centre(centre) @ line.of_line(fit.center, len(fit.D))
    s_pass = float(np.sqrt(max((T @ fit.D @ T.T)[0, 0], 0.0)))
    return Instrument(
        label=f"  {item.role}",
        of="",
        unit=estimate.unit,
        source="readings",
        coefficients=b,
        covariance=fit.covariance,
        passes_read=len(item.keys_read) or None,
        runs_read=_runs(item),
        n=len(item.error),
        dof=int(fit.plain.dof),
        s_repeat=s_repeat,
        scatter=_scatter(s_repeat, s_pass, float(b[0]), [item]),
        tests=_tests(estimate, item, flags),
        r2=_r2(item),
        role=item.role,
        n_passes=fit.n_passes if fit.separated else None,
        s=float(np.sqrt(fit.plain.s2)),
    )


def _turned(D: FloatArray | None, T: FloatArray) -> FloatArray | None:
    return None if D is None else T @ D @ T.T


def _runs(item: InstrumentFit) -> int | None:
    """Runs, a pass there and the one back, of an instrument; None where no passes are given."""
    return None if item.read is None else len(np.unique(item.read.runs))


def _scatter(
    s_repeat: float, s_pass: float, level: float, items: Sequence[InstrumentFit]
) -> tuple[float | None, float | None]:
    """`items` are the instruments, none of a component of the machine file."""
    fits = [item.fit for item in items]
    s_pass = 0.0 if s_pass <= NOTHING * max(s_repeat, abs(level)) else s_pass
    repeated = not fits or any(not fit.separated or fit.within_dof > 0 for fit in fits)
    several = any(fit.separated for fit in fits) if fits else s_pass > 0
    return s_repeat if repeated else None, s_pass if several else None


def _tests(estimate: ComponentEstimate, item: InstrumentFit, flags: Flags) -> dict[str, Tested]:
    """By name, those that the readings allow."""
    result = {}
    for name, test in TESTS.items():
        if (made := test(item)) is None:
            continue
        flag = (estimate.name, item.role) in flags[name]
        if isinstance(made, FTest):
            dof = (made.df_numerator, made.df_denominator)
            result[name] = Tested(made.F, None, made.p, dof, flag, estimate.unit)
        else:
            result[name] = Tested(made.value, made.u, made.p, made.dof, flag, estimate.unit)
    return result


def _r2(item: InstrumentFit) -> float | None:
    """Share of the readings' variance that the polynomial explains; None for a constant."""
    about_mean = float(((item.error - item.error.mean()) ** 2).sum())
    if item.powers < 2 or about_mean == 0:
        return None
    return float(1.0 - item.fit.plain.rss / about_mean)


FEWEST_OF_TREND = 3
"""Runs there and back from which on a straight line leaves a degree of freedom."""
ALONE = "correlation of drift with other components"
GROUPS = "correlation of drift between the groups"


class NotDetermined(NamedTuple):
    """One thing that the data leave open, in plain words."""

    component: str
    not_determined: str
    because: str
    reading_that_would: str


def observability(fit: MachineFit, estimates: Estimates) -> list[NotDetermined]:
    """All that the readings of a machine do not determine, component by component."""
    result: list[NotDetermined] = []
    for name in estimates.components:
        if (component := fit.components.get(name)) is None:
            what = "drift, reversal and lack of fit"
            because = "it is known from the machine file only"
            would = "readings of it, given with --lbb or --laser"
            result.append(NotDetermined(name, what, because, would))
            continue
        without_axis = component.estimate.of is None
        for item in component.instruments:
            by = f" by {item.role}" if len(component.instruments) > 1 else ""
            checks = [*_of_scatter(item, without_axis=without_axis)]
            checks += [] if without_axis else [*_of_shape(item)]
            result += [NotDetermined(name, f"{what}{by}", *why) for what, *why in checks]
    return result + list(_apart(fit, estimates))


def not_estimable(found: Iterable[NotDetermined]) -> list[Finding]:
    """A note for each quantity, with all components of which the readings leave it open."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for item in found:
        # Components of a group stay together.
        shown = item.component.replace(", ", " + ")
        grouped.setdefault((item.not_determined, item.because), []).append(shown)
    return [
        finding("not-estimable", quantity=quantity, names=names, reason=reason)
        for (quantity, reason), names in grouped.items()
    ]


Checks = Iterator[tuple[str, str, str]]
"""What is not determined, why, and which readings would."""


def _of_scatter(item: InstrumentFit, *, without_axis: bool) -> Checks:
    """What readings, passes and repeats are too few for."""
    fit, passes = item.fit, len(item.keys_read)
    if not fit.plain.dof > 0:
        because = f"{counted(len(item.error), 'reading')} for as many coefficients"
        yield "uncertainty", because, "more readings of it, best in several passes"
    if not fit.separated:
        what = ("reading", "") if without_axis else ("pass", "passes")
        because = f"{counted(passes, *what)} only"
        yield (
            "pass-to-pass drift apart from repeatability",
            because if passes else "no `pass` is given",
            "repeat the run at least 3 times, numbered in `pass`",
        )
        return
    if len(fit.D) != min(2, item.powers):
        because = "some passes have one position only"
        would = "read every pass at two positions or more"
        yield "pass-to-pass change of slope", because, would
    if item.trend is None:
        read = counted(fit.n_passes, "pass", "passes")
        would = "at least 4 passes, in each direction where both are read"
        if by_runs(fit):
            read = f"{counted(len(fit.pairs), 'run')} there and back"
            would = f"at least {FEWEST_OF_TREND} runs there and back"
        yield "steady drift from pass to pass", f"{read}, too few or of equal levels", would
    if not fit.within_dof > 0:
        because = "nothing is repeated within a pass from the same side: all its scatter counts as "
        because += "pass-to-pass"
        would = "read it at least twice in a pass from the same side, in the same set-up"
        yield "repeatability of one visit", because, would


def _of_shape(item: InstrumentFit) -> Checks:
    """What directions and positions are too few for."""
    if item.reversal is None:
        ways = {int(np.sign(way)) for way in np.unique(item.direction)} - {0}
        because = {0: "no `direction` is given", 1: "read in one direction only"}.get(
            len(ways), "its passes are too few or do not differ"
        )
        would = "at least 3 passes, each in both directions, given in `direction`"
        yield "reversal", because, would
    if item.lack_of_fit is None and item.profile is None:
        positions, k = len(np.unique(item.position)), item.powers
        would = "the same positions again, in two passes or more"
        because = "no position is repeated often enough"
        if positions <= k:
            because = f"{counted(positions, 'position')} for {counted(k, 'coefficient')}"
            would = f"readings at {k + 1} positions or more"
        elif positions > MAX_POSITIONS:
            because = f"{positions} different positions; up to {MAX_POSITIONS} are compared"
        yield "lack of fit", because, would


def _apart(fit: MachineFit, estimates: Estimates) -> Iterator[NotDetermined]:
    """Components whose passes are not those of any other, or of some others only."""
    read = {name: x.instruments for name, x in fit.components.items()}
    read = {name: own for name, own in read.items() if any(item.fit.separated for item in own)}
    groups = [group.components for group in estimates.joint]
    would = "read it in the same passes (same set-up) as the others, or give `time` or `setup`"
    for name, own in read.items():
        if any(name in group for group in groups) or len(read) < 2:
            continue
        because, reading = "read in passes of its own", would
        if len(own) > 1:
            because = "read by several instruments"
            reading = "read it by one instrument, in the same passes as the others"
        yield NotDetermined(name, ALONE, because, reading)
    because = "each group was read in passes of its own, or in other directions"
    for group in groups if len(groups) > 1 else ():
        yield NotDetermined(", ".join(group), GROUPS, because, would)
