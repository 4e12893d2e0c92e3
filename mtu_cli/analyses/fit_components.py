"""Results for every component: lines, scatter, tests, and what the readings do not determine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.findings import Finding, counted, finding
from mtu_cli.model.estimates import ComponentEstimate, Estimates, JointPasses
from mtu_cli.model.estimation import InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.stats.covariance import positive_part
from mtu_cli.stats.kernels import PolynomialShape
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import MAX_POSITIONS, FTest, Shift
from mtu_cli.units import Unit

NOTHING = 1e-9
"""Share of the other figures below which a scatter is the rounding of their sums."""


class Tested(NamedTuple):
    """A test that was made in a component's `unit`; `significant` among all components."""

    made: FTest | Shift
    significant: bool
    unit: Unit


@dataclass(frozen=True, kw_only=True)
class Line:
    """What a line of the table states: of one instrument's readings of a component.

    `scatter` are s_repeat and s_pass, each only where the readings separate it from the other, and
    s_pass at the component's `pass_center`; `s` and `dof` are of all readings as repeats.
    """

    label: str
    of: str | None
    unit: Unit
    source: str = "readings"
    coefficients: FloatArray
    covariance: FloatArray
    passes_read: int | None = None
    n: int | None = None
    dof: int | None = None
    s_repeat: float
    scatter: tuple[float | None, float | None]
    tests: Mapping[str, Tested] = field(default_factory=dict)
    r2: float | None = None
    role: str = ""
    n_passes: int | None = None
    s: float | None = None
    agreement_p: float | None = None


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
    instruments: tuple[Line, ...]


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

    @property
    def drifts(self) -> list[str]:
        """Components whose passes differ by more than repeatability, or drift in one direction."""
        names = [
            f"{name} ({text})"
            for test, text in (("drift", "pass to pass"), ("trend", "trend"))
            for name, component in self.components.items()
            for instrument in component.instruments
            if test in instrument.tests and instrument.tests[test].significant
        ]
        return list(dict.fromkeys(names))


def fit_result(
    machine: str,
    fit: MachineFit,
    estimates: Estimates,
    *,
    says: Mapping[str, str] | None = None,
    coverage_factor: float = 2.0,
) -> FitResult:
    """The figures of a fit; `estimates` holds the components of the machine file too."""
    unknowns = tuple(observability(fit, estimates))
    groups: dict[tuple[str, str], list[str]] = {}
    for item in unknowns:
        groups.setdefault((item.not_determined, item.because), []).append(item.component)
    if several := [name for name, x in fit.components.items() if len(x.instruments) > 1]:
        groups["dof and r2", "several instruments: see `instruments`"] = several
    passes = []
    for group in estimates.joint:
        units = [estimates.components[name].unit.to_internal for name in group.components]
        sizes = np.repeat(units, group.widths)
        passes.append(SharedPasses(group, np.outer(sizes, sizes)))
    return FitResult(
        machine=machine,
        fit=fit,
        estimates=estimates,
        components={
            name: _component(estimate, fit, (says or {}).get(name))
            for name, estimate in estimates.components.items()
        },
        joint=tuple(passes),
        observability=unknowns,
        coverage_factor=coverage_factor,
        warnings=tuple(
            finding("not-estimable", quantity=quantity, names=names, reason=reason)
            for (quantity, reason), names in groups.items()
        ),
    )


def _component(estimate: ComponentEstimate, machine: MachineFit, says: str | None) -> Component:
    fit = machine.components.get(estimate.name)
    items = () if fit is None else fit.instruments
    centre = float(np.concatenate([item.position for item in items]).mean()) if items else 0.0
    T, moment, halves = (
        estimate.shape.at_centre(centre), estimate.pass_covariance, estimate.half_differences
    )  # fmt: skip
    K = estimate.run_covariance
    if len(items) == 1:
        # Where some pass has one position only the level varies from pass to pass, not the slope.
        single = items[0].fit
        centre, T = float(single.center), np.eye(min(2, len(T[0])), len(single.D))
        moment, halves = single.D_moment, single.half_differences
    moment, halves = T @ moment @ T.T, None if halves is None else T @ halves @ T.T
    D = positive_part(moment)
    if len(items) == 1:
        D = T @ items[0].fit.D @ T.T
    lines = tuple(_line(estimate, item, centre, machine) for item in items)
    passes = [each.passes_read for each in lines]
    facts: dict[str, Any] = {**vars(lines[0])} if len(lines) == 1 else {}
    level, s_pass = float(estimate.coefficients[0]), float(np.sqrt(D[0, 0]))
    facts |= {
        "label": estimate.name,
        "of": estimate.of,
        "unit": estimate.unit,
        "source": "readings" if items else "machine file",
        "passes_read": sum(filter(None, passes)) if passes and all(passes) else None,
        "n": sum(len(item.error) for item in items) or None,
        "agreement_p": None if fit is None else fit.agreement_p,
        "coefficients": estimate.coefficients,
        "covariance": estimate.covariance,
        "n_passes": estimate.n_passes,
        "s": estimate.independent_s,
        "s_repeat": estimate.s_repeat,
        "scatter": _scatter(estimate.s_repeat, s_pass, level, items),
    }
    return Component(
        **facts,
        estimate=estimate,
        says=says,
        pass_center=centre,
        pass_covariance=D,
        pass_covariance_moment=moment,
        half_differences=halves,
        run_covariance=None if K is None else T @ K @ T.T,
        instruments=lines,
    )


def _line(
    estimate: ComponentEstimate, item: InstrumentFit, centre: float, machine: MachineFit
) -> Line:
    fit, b, s_repeat = item.fit, item.fit.plain.coefficients, float(np.sqrt(item.fit.s2))
    powers = PolynomialShape(len(b) - 1)
    T = powers.at_centre(centre) @ powers.of_line(fit.center, len(fit.D))
    s_pass = float(np.sqrt(max((T @ fit.D @ T.T)[0, 0], 0.0)))
    about_mean = float(((item.error - item.error.mean()) ** 2).sum())
    explains = item.powers > 1 and about_mean > 0
    key = (estimate.name, item.role)
    return Line(
        label=f"  {item.role}",
        of="",
        unit=estimate.unit,
        coefficients=b,
        covariance=fit.covariance,
        passes_read=len(item.keys_read) or None,
        n=len(item.error),
        dof=int(fit.plain.dof),
        s_repeat=s_repeat,
        scatter=_scatter(s_repeat, s_pass, float(b[0]), [item]),
        tests={
            name: Tested(test, key in machine.significant[name], estimate.unit)
            for name, test in item.tests.items()
        },
        r2=float(1.0 - fit.plain.rss / about_mean) if explains else None,
        role=item.role,
        n_passes=fit.n_passes if fit.separated else None,
        s=float(np.sqrt(fit.plain.s2)),
    )


def _scatter(
    s_repeat: float, s_pass: float, level: float, items: Sequence[InstrumentFit]
) -> tuple[float | None, float | None]:
    """`items` are the instruments, none of a component of the machine file."""
    fits = [item.fit for item in items]
    s_pass = 0.0 if s_pass <= NOTHING * max(s_repeat, abs(level)) else s_pass
    repeated = not fits or any(not fit.separated or fit.within_dof > 0 for fit in fits)
    several = any(fit.separated for fit in fits) if fits else s_pass > 0
    return s_repeat if repeated else None, s_pass if several else None


class NotDetermined(NamedTuple):
    """One thing that the data do not determine, in plain words."""

    component: str
    not_determined: str
    because: str
    reading_that_would: str


def observability(fit: MachineFit, estimates: Estimates) -> Iterator[NotDetermined]:
    """All that the readings of a machine do not determine, component by component."""
    candidates = []
    for name, estimate in estimates.components.items():
        if (component := fit.components.get(name)) is None:
            what, because = "drift, reversal and lack of fit", "known from the machine file only"
            yield NotDetermined(name, what, because, "readings of it, given with --lbb or --laser")
            continue
        for item in component.instruments:
            by = f" by {item.role}" if len(component.instruments) > 1 else ""
            for what, *why in _undetermined(item, constant=estimate.of is None):
                yield NotDetermined(name, f"{what}{by}", *why)
        if any(item.fit.separated for item in component.instruments):
            candidates.append(name)
    # Components whose passes are not those of any other, or of some others only.
    groups = [", ".join(group.components) for group in estimates.joint]
    joint = {name for group in estimates.joint for name in group.components}
    # Where there is one group, all others are named.
    sets = [*groups * (len(groups) > 1), *(name for name in candidates if name not in joint)]
    what, would = "correlation of drift with other components", "read them in the same passes "
    would += "(same set-up) as the others, by one instrument, or give `time` or `setup`"
    for names in sets if len(candidates) > 1 else ():
        several = names in candidates and len(fit.components[names].instruments) > 1
        because = "read by several instruments" if several else "read in passes of their own"
        yield NotDetermined(names, what, because, would)


def _undetermined(item: InstrumentFit, *, constant: bool) -> Iterator[tuple[str, str, str]]:
    """What readings, passes, repeats, directions and positions are too few for, why, and which
    readings would do; a `constant` has neither directions nor positions.
    """
    fit, passes, positions = item.fit, len(item.keys_read), len(np.unique(item.position))
    if not fit.plain.dof > 0:
        because = f"{counted(len(item.error), 'reading')} for as many coefficients"
        yield "uncertainty", because, "more readings of it, best in several passes"
    if not fit.separated:
        # Of a constant each reading is a pass.
        count = counted(passes, *(("reading", "") if constant else ("pass", "passes")))
        because = f"{count} only" if passes else "no `pass` is given"
        would = "repeat the run at least 3 times, numbered in `pass`"
        yield "pass-to-pass drift apart from repeatability", because, would
    elif len(fit.D) != min(2, item.powers):
        because, would = "some passes have one position", "read every pass at two positions or more"
        yield "pass-to-pass change of slope", because, would
    if fit.separated and "trend" not in item.tests:
        because = f"{counted(fit.n_passes, 'pass', 'passes')}, too few or of equal levels"
        would = "4 passes, or 3 runs there and back"
        yield "steady drift from pass to pass", because, would
    if fit.separated and not fit.within_dof > 0:
        because = "nothing is repeated within a pass from the same side: all its scatter counts as "
        would = "read it at least twice in a pass from the same side, in the same set-up"
        yield "repeatability of one visit", because + "pass-to-pass", would
    if not constant and "reversal" not in item.tests:
        ways = {*np.sign(item.direction).tolist()} - {0}
        both = "its passes are too few or do not differ" if passes else "no `pass` is given"
        because = ("no `direction` is given", "read in one direction only", both)[len(ways)]
        yield "reversal", because, "at least 3 passes, each in both directions"
    if not constant and "lack_of_fit" not in item.tests and item.profile is None:
        because = "no position is repeated often enough, or its readings do not differ"
        would = "the same positions in 2 passes"
        if positions <= item.powers:
            because = f"{counted(positions, 'position')} for {counted(item.powers, 'coefficient')}"
            would = f"readings at {item.powers + 1} positions or more"
        elif positions > MAX_POSITIONS:
            because = f"{positions} different positions; up to {MAX_POSITIONS} are compared"
        yield "lack of fit", because, would
