"""Drift readings that are no part of the others: a slip of one pulls the whole fit."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.thermal_fit.columns import Library
from mtu_cli.analyses.thermal_fit.result import ComponentDrift
from mtu_cli.analyses.thermal_fit.uncertainty import Rest
from mtu_cli.errors import Warned
from mtu_cli.findings import Finding
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.outliers import GROSS, IntArray, told_apart
from mtu_cli.stats.trimmed import trimmed_fit

FEW = 0.01
"""Share of the readings up to which those beyond the limit are slips; more must be apart from all
others."""
SHOWN = 5
MOST_FITTED = 20_000
"""Of more readings about so many, in even steps, make up the fit."""
AT_A_PLACE = 20
"""Readings of each place that are among them, or all that it has: those tell its intercept."""


def gross_warnings(lib: Library, rest: Rest, drift: ComponentDrift) -> list[Finding]:
    """Readings far off the temperatures' fit to the others, the farthest first.

    The fit to all of them is no measure: gross ones pull it, and choose its sensors.
    """
    away, distance, limit = _judged(lib, rest, drift)
    gross = told_apart(distance, limit, FEW)
    if not len(gross):
        return []
    worst = gross[np.argsort(-away[gross], kind="stable")][:SHOWN]
    places = [f"by {drift.shown(float(away[i]))} in {_where(rest, drift, i)}" for i in worst]
    more = f", then {', '.join(places[1:])}" if len(places) > 1 else ""
    more += f"; and {len(gross) - SHOWN} more" if len(gross) > SHOWN else ""
    text = (
        f"{drift.name}: {len(gross)} of {len(away)} readings are more than {GROSS:g} robust "
        f"standard deviations off what the others make one expect, the worst {places[0]}{more}. A "
        "slip of one reading pulls the whole fit"
    )
    return [Warned(code="outlier-readings", message=text)]


def _judged(
    lib: Library, rest: Rest, drift: ComponentDrift
) -> tuple[FloatArray, FloatArray, float]:
    """How far off the fit each reading (n,) is, the same in standard deviations, and the limit.

    Of very many readings some in even steps are fitted; all are judged.
    """
    n, kept = len(rest.residual), rest.kept
    rows = _fitted(_place(lib, rest), -(-n // MOST_FITTED))
    X, time = _columns(lib, rest, rows, drift), kept.time[rows]
    orders = [] if np.isnan(time).any() else [np.lexsort((time, kept.cycle[rows]))]
    found = trimmed_fit(X, kept.error[rows], orders)
    if len(rows) == n:
        return np.abs(kept.error - found.expected), found.distance, found.limit
    b = least_squares(X, found.expected).coefficients
    pieces = np.split(np.arange(n), range(MOST_FITTED, n, MOST_FITTED))
    expected = np.concatenate([_columns(lib, rest, own, drift) @ b for own in pieces])
    expected[rows] = found.expected
    away = np.abs(kept.error - expected)
    distance = away / found.spread if found.spread > 0 else np.zeros(n)
    distance[rows] = found.distance
    return away, distance, found.limit


def _place(lib: Library, rest: Rest) -> IntArray:
    """The number (n,) of each reading's position."""
    if None in lib.positions:
        return np.zeros(len(rest.residual), np.int64)
    return np.searchsorted(lib.places, rest.kept.position)


def _fitted(place: IntArray, step: int) -> IntArray:
    """Rows in even steps, smaller ones at a place of which too few would be left."""
    order, counts = np.argsort(place, kind="stable"), np.bincount(place)
    number = np.arange(len(place)) - (np.cumsum(counts) - counts)[place[order]]
    steps = np.clip(counts // AT_A_PLACE, 1, step)
    return np.sort(order[number % steps[place[order]] == 0])


def _columns(lib: Library, rest: Rest, rows: IntArray, drift: ComponentDrift) -> FloatArray:
    """An intercept a position and all groups of sensors, of the powers and lags of the model."""
    P = lib.powers(len(drift.estimate.coefficients) - 1)
    place = _place(lib, rest)[rows]
    own = P[place][:, :, None] * rest.rise[rows][:, None, :]
    return np.hstack([np.eye(len(P))[place], own.reshape(len(place), -1)])


def _where(rest: Rest, drift: ComponentDrift, row: int) -> str:
    """Cycle, time and position of a row, as far as they are given."""
    cycle, kept = drift.cycles[int(rest.kept.cycle[row])], rest.kept
    found = f"cycle {cycle!r}" if cycle else "the file"
    found += "" if np.isnan(kept.time[row]) else f" at {kept.time[row]:g} min"
    return found + ("" if len(drift.positions) < 2 else f" and {kept.position[row]:g} mm")
