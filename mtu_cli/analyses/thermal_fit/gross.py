"""Drift readings that are no part of the others: a slip of one pulls the whole fit."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.thermal_fit.columns import Library
from mtu_cli.analyses.thermal_fit.result import ComponentDrift
from mtu_cli.analyses.thermal_fit.uncertainty import Rest
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import GROSS, IntArray, told_apart
from mtu_cli.stats.trimmed import trimmed_fit

FEW = 0.01
"""Share of the readings up to which those beyond the limit are slips; more must be apart from all
others."""
SHOWN = 5
MOST_JUDGED, FARTHEST = 20_000, 1000
"""Of more readings so many in even steps, and so many of those farthest off the model."""


def gross_warnings(lib: Library, rest: Rest, drift: ComponentDrift) -> list[Warned]:
    """Readings far off the temperatures' fit to the others, the farthest first.

    The fit to all of them is no measure: gross ones pull it, and choose its sensors.
    """
    rows = _rows(rest)
    time, error = rest.kept.time[rows], rest.kept.error[rows]
    orders = [] if np.isnan(time).any() else [np.lexsort((time, rest.kept.cycle[rows]))]
    found = trimmed_fit(_columns(lib, rest, rows, drift), error, orders)
    gross = told_apart(found.distance, found.limit, FEW)
    if not len(gross):
        return []
    away = np.abs(error - found.expected)
    worst = gross[np.argsort(-away[gross], kind="stable")][:SHOWN]
    places = [f"by {drift.shown(float(away[i]))} in {_where(rest, drift, rows[i])}" for i in worst]
    more = f", then {', '.join(places[1:])}" if len(places) > 1 else ""
    more += f"; and {len(gross) - SHOWN} more" if len(gross) > SHOWN else ""
    text = (
        f"{drift.name}: {len(gross)} of {len(away)} readings are more than {GROSS:g} robust "
        f"standard deviations off what the others make one expect, the worst {places[0]}{more}: a "
        "slip of one reading pulls the whole fit"
    )
    return [Warned(code="outlier-readings", message=text)]


def _rows(rest: Rest) -> IntArray:
    """Those that are judged, in their order."""
    n = len(rest.residual)
    if n <= MOST_JUDGED:
        return np.arange(n)
    away = np.abs(rest.residual - np.median(rest.residual))
    far = np.argpartition(away, n - FARTHEST)[n - FARTHEST :]
    return np.union1d(np.linspace(0, n - 1, MOST_JUDGED).astype(np.int64), far)


def _columns(lib: Library, rest: Rest, rows: IntArray, drift: ComponentDrift) -> FloatArray:
    """An intercept a position and all groups of sensors, of the powers and lags of the model."""
    P = lib.powers(len(drift.estimate.coefficients) - 1)
    place = np.zeros(len(rows), np.int64)
    if None not in lib.positions:
        place = np.searchsorted(lib.places, rest.kept.position[rows])
    own = P[place][:, :, None] * rest.rise[rows][:, None, :]
    return np.hstack([np.eye(len(P))[place], own.reshape(len(place), -1)])


def _where(rest: Rest, drift: ComponentDrift, row: int) -> str:
    """Cycle, time and position of a row, as far as they are given."""
    cycle, kept = drift.cycles[int(rest.kept.cycle[row])], rest.kept
    found = f"cycle {cycle!r}" if cycle else "the file"
    found += "" if np.isnan(kept.time[row]) else f" at {kept.time[row]:g} min"
    return found + ("" if len(drift.positions) < 2 else f" and {kept.position[row]:g} mm")
