"""The report of fit-components: all that the prediction commands need, and what people ask.

Per component everything is in the component's own `unit` and mm: `coefficients` in unit,
unit/mm, ..., covariances in products of these. `n_passes` is the number of passes over which
the between-pass mean square was averaged: null where there is none (one pass, several
instruments, a component of the machine file); `passes_read` counts the passes of the
readings. `pass_covariance` is for people, `pass_covariance_moment` for predictions: the same
before its negative part, if any, was set to zero. `half_difference_mean_square` is the part of
the between-pass mean square that is of runs there and back, as `pass_covariance` stands, and
`pass_dof` then counts runs: null where all passes count as independent, and of several
instruments, of which `run_covariance` is that of the two passes of a run. `runs` lists the passes
of each run there and back, in time; null where no passes are given. `dof`, `r2` and the tests at
the top are of the one instrument that read the component; with several they stand in
`instruments`; `per_pass` counts there and back as one. `pass_dof` and `repeat_dof` null are
infinite. Null tests are explained in `observability`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mtu_cli.findings import Finding, finding
from mtu_cli.model.estimates import ComponentEstimate, EffectEstimates, Estimates, JointPasses
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.reports.document import finite, matrix
from mtu_cli.reports.fit_figure import figure
from mtu_cli.reports.fit_table import table
from mtu_cli.reports.fitted import (
    half_differences,
    pass_center,
    pass_covariance,
    pass_covariance_moment,
    passes_read,
    run_covariance,
    single_instrument,
)
from mtu_cli.reports.observability import not_estimable, observability
from mtu_cli.reports.runs import runs_fields
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import FTest, Shift

__all__ = ["csv_rows", "document", "figure", "table", "warnings"]


def document(
    machine: str,
    fit: MachineFit,
    estimates: Estimates,
    *,
    says: Mapping[str, str] | None = None,
    effects: EffectEstimates | None = None,
) -> dict[str, Any]:
    """`results` of the report, which `files.reports_read` reads back.

    `estimates` holds the components of the machine file too; `says` their meaning in words.
    `effects` are parameters of the machine's effects, which close-loop reports beside them.
    """
    results = {
        "machine": machine,
        "components": {
            name: _component(fit.components.get(name), estimate, (says or {}).get(name))
            for name, estimate in estimates.components.items()
        },
        "joint_pass_covariance": [_joint(fit, estimates, group) for group in estimates.joint],
        "observability": [item.fields() for item in observability(fit, estimates)],
    }
    return results if effects is None else results | {"effects": effects_document(effects)}


def effects_document(effects: EffectEstimates) -> dict[str, Any]:
    """`results.effects`: every parameter in its unit, the covariance in products of these."""
    f = np.array([unit.to_internal for unit in effects.units])
    return {
        "parameters": list(effects.names),
        "units": [unit.name for unit in effects.units],
        "values": matrix(effects.values / f),
        "covariance": matrix(effects.covariance / np.outer(f, f)),
    }


def _component(
    found: ComponentFit | None, estimate: ComponentEstimate, says: str | None
) -> dict[str, Any]:
    one = single_instrument(found)
    instruments = () if found is None else found.instruments
    f = estimate.unit.to_internal
    D = pass_covariance(estimate, found) / f**2
    halves, in_run = half_differences(estimate, found), run_covariance(estimate, found)
    return {
        "of": estimate.of,
        "unit": estimate.unit.name,
        "says": says,
        "source": "machine file" if found is None else "readings",
        "degree": estimate.degree,
        "n": None if found is None else sum(len(item.error) for item in instruments),
        "n_passes": estimate.n_passes,
        "passes_read": _sum_or_none([passes_read(item) for item in instruments]),
        "runs": runs_fields(found),
        "coefficients": matrix(estimate.coefficients / f),
        "covariance": matrix(estimate.covariance / f**2),
        "covariance_independent": None
        if estimate.independent_covariance is None
        else matrix(estimate.independent_covariance / f**2),
        "s": _in(estimate.independent_s, f),
        "dof": None if one is None else one.fit.plain.dof,
        "s_repeat": _in(estimate.s_repeat, f),
        "pass_covariance": matrix(D),
        "pass_covariance_moment": matrix(pass_covariance_moment(estimate, found) / f**2),
        "half_difference_mean_square": None if halves is None else matrix(halves / f**2),
        "run_covariance": None if in_run is None else matrix(in_run / f**2),
        "pass_center_mm": pass_center(found),
        "s_pass": finite(float(np.sqrt(D[0, 0]))),
        "pass_dof": finite(estimate.pass_dof),
        "repeat_dof": finite(estimate.repeat_dof),
        "position_range_mm": estimate.position_range and list(map(float, estimate.position_range)),
        **_tests(one, f),
        "instruments": [_instrument(item, f) for item in instruments],
        "agreement_p": None if found is None else finite(found.agreement_p),
    }


def _instrument(item: InstrumentFit, f: float) -> dict[str, Any]:
    fit = item.fit
    return {
        "role": item.role,
        "n": len(item.error),
        "n_passes": fit.n_passes if fit.separated else None,
        "passes_read": passes_read(item),
        "coefficients": matrix(fit.plain.coefficients / f),
        "covariance": matrix(fit.covariance / f**2),
        "s": _in(float(np.sqrt(fit.plain.s2)), f),
        "dof": fit.plain.dof,
        "s_repeat": _in(float(np.sqrt(fit.s2)), f),
        **_tests(item, f),
    }


def _tests(item: InstrumentFit | None, f: float) -> dict[str, Any]:
    """The tests of one instrument's readings, all null without it."""
    if item is None:
        return dict.fromkeys(("drift", "trend", "lack_of_fit", "reversal", "r2"))
    return {
        "drift": _f_test(item.scatter),
        "trend": _shift(item.trend, f, "per_pass"),
        "lack_of_fit": _f_test(item.lack_of_fit),
        "reversal": _shift(item.reversal, f, "mean"),
        "r2": _r2(item),
    }


def _f_test(test: FTest | None) -> dict[str, Any] | None:
    if test is None:
        return None
    df = [test.df_numerator, test.df_denominator]
    return {"F": finite(test.F), "p": finite(test.p), "df": df}


def _shift(shift: Shift | None, f: float, name: str) -> dict[str, Any] | None:
    if shift is None:
        return None
    return {name: _in(shift.value, f), "u": _in(shift.u, f), "p": finite(shift.p), "dof": shift.dof}


def _r2(item: InstrumentFit) -> float | None:
    """Share of the readings' variance that the polynomial explains; null for a constant."""
    about_mean = float(((item.error - item.error.mean()) ** 2).sum())
    if len(item.fit.plain.coefficients) < 2 or about_mean == 0:
        return None
    return finite(1.0 - item.fit.plain.rss / about_mean)


def _in(value: float | None, f: float) -> float | None:
    return None if value is None else finite(value / f)


def _sum_or_none(counts: list[int | None]) -> int | None:
    known = [count for count in counts if count is not None]
    return sum(known) if counts and len(known) == len(counts) else None


def _joint(fit: MachineFit, estimates: Estimates, group: JointPasses) -> dict[str, Any]:
    """`correlation` is that of the passes' own levels and slopes, repeatability included."""
    scale = np.concatenate(
        [
            np.full(width, estimates.components[name].unit.to_internal)
            for name, width in zip(group.components, group.widths, strict=True)
        ]
    )
    units = np.outer(scale, scale)
    names, correlation = _correlation(fit, group)
    return {
        "components": list(group.components),
        "widths": list(group.widths),
        "coefficient_covariance": matrix(group.covariance / units),
        "pass_covariance": matrix(group.pass_covariance / units),
        "half_difference_mean_square": None
        if group.half_differences is None
        else matrix(group.half_differences / units),
        "correlation_of": names,
        "correlation": matrix(correlation),
        "pass_dof": finite(group.pass_dof),
        "n_passes": group.n_passes,
    }


def _correlation(fit: MachineFit, group: JointPasses) -> tuple[list[str], FloatArray]:
    """Of the deviations of the passes' lines from their mean by direction."""
    names: list[str] = []
    columns = []
    for name in group.components:
        deviations = fit.components[name].instruments[0].fit.deviations
        names += [f"{name} {what}" for what in ("level", "slope")[: deviations.shape[1]]]
        columns.append(deviations)
    together = np.column_stack(columns)
    size = np.linalg.norm(together, axis=0)
    # Passes without any scatter have no correlation; null says so.
    size[size == 0] = np.nan
    return names, (together / size).T @ (together / size)


def warnings(fit: MachineFit, estimates: Estimates) -> list[Finding]:
    """Why fields of the report are null."""
    noted = []
    if found := observability(fit, estimates):
        noted += not_estimable(found)
    several = [name for name, item in fit.components.items() if len(item.instruments) > 1]
    if several:
        reason = "several instruments: see `instruments`"
        noted.append(finding("not-estimable", quantity="dof and r2", names=several, reason=reason))
    return noted + _order_of_files(fit)


def _order_of_files(fit: MachineFit) -> list[Finding]:
    """Of trends through several files without times: the order of the files is their time."""
    names = [
        name
        for name, found in fit.components.items()
        for item in found.instruments
        if item.trend is not None and item.trend_of_files
    ]
    if not names:
        return []
    return [finding("order-of-files", names=list(dict.fromkeys(names)), expected="a column time")]


CSV_COLUMNS = [
    "component", "of", "unit", "source", "degree", "n", "n_passes", "passes_read", "s", "dof",
    "s_repeat", "s_pass", "pass_center_mm", "pass_dof", "repeat_dof", "drift_F", "drift_p",
    "trend_per_pass", "trend_u", "trend_p", "lack_of_fit_F", "lack_of_fit_p", "reversal_mean",
    "reversal_u", "reversal_p", "r2",
]  # fmt: skip
_NESTED = ("drift", "trend", "lack_of_fit", "reversal")


def csv_rows(fit: MachineFit, estimates: Estimates) -> tuple[list[str], Iterable[list[object]]]:
    """One row a component, in its own unit; coefficients and their u at the end."""
    components = document("", fit, estimates)["components"]
    most = max((len(item["coefficients"]) for item in components.values()), default=0)
    header = list(CSV_COLUMNS)
    for i in range(most):
        header += [f"coefficient_{i}", f"u_coefficient_{i}"]
    known = estimates.components
    return header, (_flat(name, item, known[name], most) for name, item in components.items())


def _flat(name: str, item: dict[str, Any], estimate: ComponentEstimate, most: int) -> list[object]:
    row: list[object] = [name]
    for column in CSV_COLUMNS[1:]:
        test = next((key for key in _NESTED if column.startswith(f"{key}_")), None)
        if test is None:
            row.append(item[column])
        else:
            row.append((item[test] or {}).get(column.removeprefix(f"{test}_")))
    f = estimate.unit.to_internal
    u = np.sqrt(np.diag(estimate.covariance)) / f
    for i in range(most):
        row += [item["coefficients"][i], finite(float(u[i]))] if i < len(u) else [None, None]
    return row
