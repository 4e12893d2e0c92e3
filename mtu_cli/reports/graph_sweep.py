"""The report of graph sweep: the grid, the fitted formula, and whose fault its error is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from mtu_cli.analyses.graph.surface import Formula
from mtu_cli.analyses.graph.sweep import GridPoint, Sweep
from mtu_cli.findings import Finding, finding
from mtu_cli.reports.document import finite
from mtu_cli.reports.graph_convergence import BOUNDS, chance_text, not_converged, one_sided
from mtu_cli.reports.numbers import (
    PLAIN_DIGITS,
    decimal_exponent,
    fixed,
    significant,
    with_u,
)
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.units import UM

MOST_DECIMALS = 4
"""Of a column of means; of less u each row has its own."""
ROUNDING_PERCENT = 1e-9
"""Of doubles that went through a fit: a smaller error of the formula is none."""
UNLIKELY = 0.01
"""Below this probability the formula's errors are not the Monte Carlo's alone."""


def document(result: Sweep) -> dict[str, Any]:
    """`grid` and `formula`; u and the mean in the output's unit, the formula's u in um for a
    length. `chance`: the means are chances. `unrelated`: what is varied without an effect.
    """
    return {
        "of": str(result.output),
        "unit": result.output.unit,
        "chance": result.chance,
        "varied": {name: list(values) for name, values in result.varied.items()},
        "unrelated": list(result.without),
        "grid": [_point(item) for item in result.grid],
        "formula": None if result.formula is None else _formula(result.formula),
    }


def _point(item: GridPoint) -> dict[str, Any]:
    return {
        **item.at,
        "mean": finite(item.mean),
        "u": finite(item.u),
        "interval95": [finite(end) for end in item.interval],
        "first_order_u": finite(item.first_order_u),
        "formula_u": finite(item.formula_u),
        "error_percent": finite(item.error_percent),
        "trials": item.trials,
        "converged": item.converged,
        "monte_carlo": {"se_mean": finite(item.se_mean), "se_u": finite(item.se_u)},
    }


def _formula(found: Formula) -> dict[str, Any]:
    return {
        "form": found.form,
        "coefficients": found.coefficients,
        "max_error_percent": finite(found.max_error_percent),
        "monte_carlo": {
            "standard_error_percent": finite(found.monte_carlo_percent),
            "expected_max_error_percent": finite(found.expected_max_percent),
            "p": finite(found.p),
        },
        "own_max_error_percent": finite(found.own_max_percent),
    }


def warnings(result: Sweep) -> list[Finding]:
    """No formula; a formula that the Monte Carlo contradicts; an output without first order; what
    is varied for nothing; grid points that have not converged.
    """
    noted = _unrelated(result) + _not_converged(result)
    found = result.formula
    if found is None:
        if not result.chance:
            noted.append(finding("no-formula", reason=result.no_formula))
    elif found.p < UNLIKELY and found.max_error_percent > 1.0:
        noted.append(
            finding("formula-does-not-fit", error_percent=found.max_error_percent, p=found.p)
        )
    if found is not None and math.isnan(found.own_max_percent):
        reason = "the first-order uncertainty is 0, or a small part of u"
        noted.append(
            finding(
                "not-estimable",
                quantity="the error of the formula",
                names=[str(result.output)],
                reason=reason,
            )
        )
    return noted


def _unrelated(result: Sweep) -> list[Finding]:
    if not result.without or (result.formula is None and not result.chance):
        return []
    return [finding("unrelated", output=str(result.output), names=result.without)]


def _not_converged(result: Sweep) -> list[Finding]:
    short = [item for item in result.grid if not item.converged]
    if not short:
        return []
    most = max(item.trials for item in short)
    where = f"at {len(short)} of {len(result.grid)} points of the grid"
    return [not_converged(most, result.digits, f"{_known_to(result)}; {where}")]


def _known_to(result: Sweep) -> str:
    if result.chance:
        return f"the standard error of a chance is up to {significant(result.largest_error)}"
    if math.isnan(result.largest_error):
        return "no trial made it jump, and none rules out that it may"
    return f"the standard error of u is up to {significant(100 * result.largest_error)} %"


def table(result: Sweep, digits: int = 2) -> list[Sheet]:
    """One row a grid point: mean and u, in um for a length; or the chance."""
    names = list(result.varied)
    titles = [name.replace("_um", "\num") if "_" in name else f"{name}\n" for name in names]
    varied = [Column(title=title, names=True) for title in titles]
    columns, cells = _chances(result) if result.chance else _uncertainties(result, digits)
    rows = [
        [*(f"{item.at[name]:g}" for name in names), *own, str(item.trials)]
        for item, own in zip(result.grid, cells, strict=True)
    ]
    title = f"{'chance' if result.chance else 'u'} of {result.output}"
    columns = [*varied, *columns, Column(title="trials\n")]
    return [Sheet(title=title, columns=columns, rows=rows, notes=_notes(result))]


def _chances(result: Sweep) -> tuple[list[Column], list[list[str]]]:
    columns = [Column(title="chance of 1\n± standard error")]
    return columns, [[chance_text(item.mean, item.se_mean, item.trials)] for item in result.grid]


def _uncertainties(result: Sweep, digits: int) -> tuple[list[Column], list[list[str]]]:
    factor, unit = _shown(result)
    u = [item.u * factor for item in result.grid]
    columns = [
        Column(title=f"mean less nominal\n{unit}"),
        Column(title=f"u\n{unit}"),
        Column(title=f"first-order u\n{unit}"),
        Column(title=f"formula\n{unit}"),
        Column(title="error\n%"),
    ]
    scatter = math.nan if result.formula is None else result.formula.monte_carlo_percent
    means = _in_one_place([item.deviation * factor for item in result.grid], u, digits)
    cells = [
        [
            mean,
            significant(item.u * factor, 4),
            significant(item.first_order_u * factor, 4),
            significant(item.formula_u * factor, 4),
            _known(item.error_percent, scatter),
        ]
        for item, mean in zip(result.grid, means, strict=True)
    ]
    return columns, cells


def _percent(error: float) -> str:
    """An error of the formula, without what rounding leaves of none."""
    return significant(0.0 if abs(error) < ROUNDING_PERCENT else error)


def _known(error: float, standard_error: float) -> str:
    """An error of the formula in percent, to the first digit of how well the Monte Carlo knows u
    (in percent of it): digits beyond are noise.
    """
    if standard_error > ROUNDING_PERCENT:
        return with_u(error, standard_error, 1)[0]
    return _percent(error)


def _differences(found: Formula, points: int) -> str:
    """How far formula and Monte Carlo are apart, and how far chance alone would bring them."""
    scatter = found.monte_carlo_percent
    if scatter <= ROUNDING_PERCENT:
        return f"formula and Monte Carlo differ by {_percent(found.max_error_percent)} % at most"
    return (
        f"formula and Monte Carlo differ by {_known(found.max_error_percent, scatter)} % at most; "
        f"the Monte Carlo knows each u to {significant(scatter, 1)} %, so that by chance alone the "
        f"largest of {points} differences is about {significant(found.expected_max_percent, 1)} %"
    )


def _in_one_place(values: Sequence[float], u: Sequence[float], digits: int) -> list[str]:
    """Values of one column: all to the last place of the least u but 0, where it is readable."""
    known = [own for own in u if math.isfinite(own) and own > 0]
    last = min((decimal_exponent(own, digits) for own in known), default=0) - digits + 1
    if not known or not -MOST_DECIMALS <= last < 0:
        return [with_u(value, own, digits)[0] for value, own in zip(values, u, strict=True)]
    return [fixed(value, -last) for value in values]


def _shown(result: Sweep) -> tuple[float, str]:
    return (1.0 / UM, "um") if result.output.unit == "mm" else (1.0, result.output.unit)


def _notes(result: Sweep) -> list[str]:
    found = result.formula
    if result.chance:
        bounded = any(one_sided(item.mean, item.se_mean) for item in result.grid)
        return [
            f"{result.output} is 0 or 1: the chance of 1 is the share of the trials in which it "
            "is; no formula is fitted to it",
            *([BOUNDS] if bounded else []),
        ]
    at_nominal = f"nominal {significant(result.nominal, PLAIN_DIGITS)} {result.output.unit}"
    if found is None:
        return [at_nominal]
    values = ", ".join(f"{name} = {significant(v, 4)}" for name, v in found.coefficients.items())
    notes = [
        f"{found.form}; {values}",
        _differences(found, len(result.grid)),
    ]
    if len(result.grid) == len(found.terms):
        notes[1] = "as many terms as grid points: it meets them all, and nothing checks it"
    if math.isfinite(found.own_max_percent):
        own = found.own_max_percent
        text = "less than 0.001" if own < 0.001 else significant(own)
        notes.append(f"the formula's own largest error, on the first-order u: {text} %")
    return [*notes, at_nominal]


def csv_rows(result: Sweep) -> tuple[list[str], Iterable[Sequence[object]]]:
    """One row a grid point."""
    names = list(result.varied)
    header = [
        *names, "unit", "mean", "u", "interval95_low", "interval95_high", "first_order_u",
        "formula_u", "error_percent", "se_mean", "se_u", "trials", "converged",
    ]  # fmt: skip
    rows = [
        [
            *item.at.values(),
            result.output.unit,
            item.mean,
            item.u,
            *item.interval,
            item.first_order_u,
            finite(item.formula_u),
            finite(item.error_percent),
            finite(item.se_mean),
            finite(item.se_u),
            item.trials,
            item.converged,
        ]
        for item in result.grid
    ]
    return header, rows
