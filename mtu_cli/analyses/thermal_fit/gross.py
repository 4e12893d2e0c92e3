"""Drift readings that are no part of the others: a slip of one pulls the whole fit."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.thermal_fit.columns import Library
from mtu_cli.analyses.thermal_fit.result import ComponentDrift
from mtu_cli.analyses.thermal_fit.uncertainty import Rest
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.outliers import GROSS, IntArray, told_apart
from mtu_cli.stats.trimmed import trimmed_fit

FEW = 0.01
"""Share of the readings up to which those beyond the limit are slips; more must be apart from all
others."""
SHOWN = 5
MOST_FITTED = 20_000
"""Of more readings at most so many, in even steps, make up the fit."""


def gross_warnings(lib: Library, rest: Rest, drift: ComponentDrift) -> list[Warned]:
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
        f"standard deviations off what the others make one expect, the worst {places[0]}{more}: a "
        "slip of one reading pulls the whole fit"
    )
    return [Warned(code="outlier-readings", message=text)]


def _judged(
    lib: Library, rest: Rest, drift: ComponentDrift
) -> tuple[FloatArray, FloatArray, float]:
    """How far off the fit each reading (n,) is, the same in standard deviations, and the limit.

    Of very many readings some in even steps are fitted; all are judged.
    """
    n = len(rest.residual)
    rows = np.arange(n)[:: -(-n // MOST_FITTED)]
    kept, X = rest.kept, _columns(lib, rest, rows, drift)
    time = kept.time[rows]
    orders = [] if np.isnan(time).any() else [np.lexsort((time, kept.cycle[rows]))]
    found = trimmed_fit(X, kept.error[rows], orders)
    if len(rows) == n:
        return np.abs(kept.error - found.expected), found.distance, found.limit
    b = least_squares(X, found.expected).coefficients
    pieces = np.split(np.arange(n), range(MOST_FITTED, n, MOST_FITTED))
    expected = np.concatenate([_columns(lib, rest, own, drift) @ b for own in pieces])
    away = np.abs(kept.error - expected)
    return away, away / found.spread if found.spread > 0 else np.zeros(n), found.limit


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
