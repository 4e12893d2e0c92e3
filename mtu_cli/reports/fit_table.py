"""The components for people: one row each, in units that fit a machine tool."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mtu_cli.findings import listed
from mtu_cli.model.estimates import ComponentEstimate, Estimates, from_centre, to_centre
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.reports.fitted import pass_center, pass_covariance, single_instrument
from mtu_cli.reports.numbers import MISSING, p_value, plus_minus, significant
from mtu_cli.reports.observability import NotDetermined, observability
from mtu_cli.reports.runs import runs_notes
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.stats.family import FAMILY_RATE
from mtu_cli.stats.family import significant as holding_out
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import PassFit
from mtu_cli.stats.pass_tests import FTest, Shift

MM_PER_M = 1000.0


TESTS: tuple[Callable[[InstrumentFit], FTest | Shift | None], ...] = (
    lambda item: item.scatter,
    lambda item: item.trend,
    lambda item: item.lack_of_fit,
    lambda item: item.reversal,
)

NOTHING = 1e-9
"""Share of the figures beside it below which a scatter is the rounding of their sums."""


def table(machine: str, fit: MachineFit, estimates: Estimates, digits: int = 2) -> list[Sheet]:
    """Coefficients with u, scatter and tests; what is not determined below."""
    titles = ["at 0\nunit", "slope\nunit/m", "s_repeat\nunit", "s_pass\nunit", "drift\np"]
    titles += ["trend\np", "misfit\np", "reversal\nunit"]
    columns = [
        Column(title="component\n", text=True, folds=True),
        Column(title="of\n", text=True),
        Column(title="unit\n", text=True),
        *(Column(title=title, begins=title.startswith("drift")) for title in titles),
    ]
    standing_out = [_standing_out(fit, test) for test in TESTS]
    rows: list[list[str]] = []
    for name, item in estimates.components.items():
        found = fit.components.get(name)
        rows.append(_row(name, item, found, standing_out, digits))
        rows += _by_instrument(name, found, standing_out, digits)
    legend = [
        "± is one standard uncertainty; drift: passes differ by more than repeatability; trend: "
        "steady from pass to pass; misfit: the polynomial does not fit",
        "reversal: forward minus reverse; * stands out among all components at "
        f"{100 * FAMILY_RATE:g} % (Bonferroni)",
    ]
    notes = [*legend, *_higher(estimates, digits), *_stated(fit, estimates), *_agreement(fit)]
    notes += [*_one_way(fit, digits), *runs_notes(fit), *_open(fit, estimates)]
    return [Sheet(title=f"Components of {machine}", columns=columns, rows=rows, notes=notes)]


def _standing_out(
    fit: MachineFit, test: Callable[[InstrumentFit], FTest | Shift | None]
) -> set[str]:
    """``component\\nrole`` of those whose test holds out among all of its kind, as the warnings
    count it.
    """
    p_values: dict[str, float] = {}
    for name, component in fit.components.items():
        for item in component.instruments:
            found = test(item)
            if found is not None:
                p_values[f"{name}\n{item.role}"] = found.p
    return set(holding_out(p_values))


def _row(
    name: str,
    estimate: ComponentEstimate,
    found: ComponentFit | None,
    standing_out: Sequence[set[str]],
    digits: int,
) -> list[str]:
    f, one = estimate.unit.to_internal, single_instrument(found)
    row = [name, estimate.of or MISSING, estimate.unit.name]
    row += _line(estimate.coefficients / f, estimate.covariance / f**2, digits)
    row += _scatter(estimate, found, digits)
    # Of several instruments each has tests of its own, below.
    if one is None:
        return row + [MISSING] * len(TESTS)
    return row + _tests(name, one, standing_out, f, digits)


def _by_instrument(
    name: str, found: ComponentFit | None, standing_out: Sequence[set[str]], digits: int
) -> list[list[str]]:
    """A row for each of several instruments that read a component."""
    if found is None or len(found.instruments) == 1:
        return []
    rows, f = [], found.unit.to_internal
    for item in found.instruments:
        fit, k = item.fit, len(item.fit.plain.coefficients)
        T = from_centre(fit.center, k, len(fit.D))
        # At the place that the component's own is of.
        s_pass = float(np.sqrt(max(to_centre(pass_center(found), T @ fit.D @ T.T)[0, 0], 0.0))) / f
        b, C = fit.plain.coefficients / f, fit.covariance / f**2
        row = [f"  {item.role}", "", "", *_line(b, C, digits)]
        row += _spread(float(np.sqrt(fit.s2)) / f, s_pass, float(b[0]), [fit], digits)
        rows.append(row + _tests(name, item, standing_out, f, digits))
    return rows


def _line(value: FloatArray, C: FloatArray, digits: int) -> list[str]:
    """Level and slope with u, in the component's unit."""
    u = np.sqrt(np.diag(C))
    slope = MISSING
    if len(value) > 1:
        slope = plus_minus(value[1] * MM_PER_M, _known(u[1] * MM_PER_M), digits)
    return [plus_minus(value[0], _known(u[0]), digits), slope]


def _scatter(estimate: ComponentEstimate, found: ComponentFit | None, digits: int) -> list[str]:
    """s_repeat and s_pass, each only where something tells it from the other."""
    f = estimate.unit.to_internal
    s_pass = float(np.sqrt(pass_covariance(estimate, found)[0, 0])) / f
    fits = [item.fit for item in found.instruments] if found else []
    return _spread(estimate.s_repeat / f, s_pass, float(estimate.coefficients[0]) / f, fits, digits)


def _spread(
    s_repeat: float, s_pass: float, level: float, fits: Sequence[PassFit], digits: int
) -> list[str]:
    """As text, in the unit of `level`; `fits` of the instruments, none of a stated component."""
    s_pass = 0.0 if s_pass <= NOTHING * max(s_repeat, abs(level)) else s_pass
    repeated = not fits or any(not fit.separated or fit.within_dof > 0 for fit in fits)
    several_passes = any(fit.separated for fit in fits) if fits else s_pass > 0
    return [
        significant(s_repeat, digits) if repeated else MISSING,
        significant(s_pass, digits) if several_passes else MISSING,
    ]


def _tests(
    name: str, one: InstrumentFit, standing_out: Sequence[set[str]], f: float, digits: int
) -> list[str]:
    """Cells of the four tests."""
    flags = ["*" if f"{name}\n{one.role}" in names else "" for names in standing_out]
    cells = [p_value(test.p if (test := t(one)) else None) for t in TESTS[:3]]
    back = one.reversal
    cells.append(MISSING if back is None else plus_minus(back.value / f, back.u / f, digits))
    return [f"{cell}{flag}" for cell, flag in zip(cells, flags, strict=True)]


def _known(u: float) -> float | None:
    """A machine file that states no covariance leaves none to show."""
    return float(u) if u > 0 else None


def _higher(estimates: Estimates, digits: int) -> list[str]:
    """Coefficients beyond the slope."""
    notes = []
    for name, item in estimates.components.items():
        f, u = item.unit.to_internal, np.sqrt(np.diag(item.covariance))
        for power in range(2, len(item.coefficients)):
            scale = MM_PER_M**power / f
            value, known = item.coefficients[power] * scale, _known(u[power] * scale)
            shown = plus_minus(value, known, digits)
            notes.append(f"{name}: {shown} {item.unit.name}/m^{power} with {item.of}^{power}")
    return notes


def _stated(fit: MachineFit, estimates: Estimates) -> list[str]:
    stated = [name for name in estimates.components if name not in fit.components]
    return [f"from the machine file: {listed(stated, 12)}"] if stated else []


def _agreement(fit: MachineFit) -> list[str]:
    """How well instruments agree, one line for all components that the same ones read."""
    grouped: dict[str, list[str]] = {}
    for name, item in fit.components.items():
        if item.agreement_p is not None:
            roles = " and ".join(found.role for found in item.instruments)
            grouped.setdefault(roles, []).append(f"{name} {p_value(item.agreement_p)}")
    return [
        f"read by {roles}; p that they agree: {listed(names, 12)}"
        for roles, names in grouped.items()
    ]


def _one_way(fit: MachineFit, digits: int) -> list[str]:
    """Of instruments that ran one way beside one that tells the reversal."""
    notes = []
    for name, item in fit.components.items():
        told = next((x for x in item.instruments if x.reversal is not None), None)
        one = [x.role for x in item.instruments if x.way is not None]
        if told is None or told.reversal is None or not one or len(item.instruments) < 2:
            continue
        f, back = item.unit.to_internal, told.reversal
        size = plus_minus(back.value / f, back.u / f, digits)
        notes.append(
            f"{name}: {' and '.join(one)} ran one way; half of the reversal of {told.role} "
            f"({size} {item.unit.name}) brings it to the mean of both directions"
        )
    return notes


def _open(fit: MachineFit, estimates: Estimates) -> list[str]:
    """What is not determined, one line for all components that lack the same."""
    grouped: dict[tuple[str, str, str], list[NotDetermined]] = {}
    for item in observability(fit, estimates):
        if item.component in fit.components or "," in item.component:
            key = (item.not_determined, item.because, item.reading_that_would)
            grouped.setdefault(key, []).append(item)
    return [
        f"not known: the {items[0].of(listed([item.shown for item in items], 12))}. "
        f"Why: {because}. To know it: {would}"
        for (_, because, would), items in grouped.items()
    ]
