"""Modelled errors of measured points, a few at a time, with the history that lags need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.model.covariates import rows_of
from mtu_cli.model.machine_model import AXES, TIME, MachineModel
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.visits import IntArray
from mtu_cli.stats.least_squares import FloatArray

PIECE = 64
"""Points whose own variances are predicted at once."""
REACH = 12.0
"""Time constants after which a temperature is forgotten: exp(-12) is 6e-6."""
MOMENTS = 512
"""Earlier moments that a lag is given at most."""
SLACK = 0.005
"""Share of a measured range by which points, which carry the errors, may leave it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RowErrors:
    """The machine at the measured points: `places` (n, 3) mm, covariates by name.

    `outside` gathers what lies beyond the measured ranges, once a feature and component.
    """

    model: MachineModel
    points: Points
    places: FloatArray
    covariates: Mapping[str, FloatArray | float]
    independent: bool
    outside: dict[tuple[str, str], tuple[str, str, float, float, float]] = field(
        default_factory=dict
    )

    @property
    def columns(self) -> list[int]:
        """The axes (0, 1, 2) of the model's equations."""
        return [AXES.index(axis) for axis in self.model.axes]

    def predicted(self, rows: IntArray) -> Prediction:
        """The prediction at `rows` (m,), under the earlier temperatures where a drift lags."""
        every = np.concatenate([rows, self._history(rows)])
        names = [self.points.features[code] for code in self.points.feature[every]]
        places = self.places[every]
        # Of other moments only the temperatures matter.
        places[len(rows) :] = places[0]
        prediction = predict(self.model, names, places, rows_of(self.covariates, every))
        prediction = prediction.first(len(rows))
        for entry in prediction.outside:
            _, _, position, low, high = entry
            if max(low - position, position - high) > SLACK * (high - low):
                self.outside.setdefault(entry[:2], entry)
        return prediction

    def _history(self, rows: IntArray) -> IntArray:
        """Rows (m,) of earlier and intermediate moments, one a moment, thinned evenly."""
        longest = max((d.time_constants.max() for d in self.model.drifts()), default=0.0)
        times = np.asarray(self.covariates.get(TIME, 0.0))
        if longest == 0 or times.ndim == 0:
            return np.zeros(0, np.int64)
        now = times[rows]
        near = (times >= now.min() - REACH * longest) & (times <= now.max())
        result = np.flatnonzero(near & ~np.isin(times, now))
        result = result[np.unique(times[result], return_index=True)[1]]
        if len(result) > MOMENTS:
            result = result[np.linspace(0, len(result) - 1, MOMENTS).round().astype(int)]
        return result

    def variances(self, prediction: Prediction, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Variances (m,) of the measurands A E and their effective degrees of freedom (m,)."""
        if self.independent:
            total: FloatArray = A**2 @ prediction.independent_variance
            return total, np.full(len(A), np.inf)
        result = prediction.variance(A)
        # A difference of mean squares may leave a little less than nothing.
        return np.maximum(result.total, 0.0), result.dof

    def covariance(self, prediction: Prediction, A: FloatArray) -> FloatArray:
        """Covariance (m, m) of the measurands A E, mm^2."""
        if self.independent:
            return np.diag(A**2 @ prediction.independent_variance)
        return np.asarray(A @ prediction.covariance @ A.T)

    def errors(self) -> tuple[FloatArray, FloatArray]:
        """Error and standard uncertainty (n, 3), mm: nan along axes that have no equation or were
        not measured.
        """
        n, a = len(self.points), len(self.model.axes)
        error, u = np.full((2, n, 3), np.nan)
        for start in range(0, n, PIECE):
            rows = np.arange(start, min(start + PIECE, n))
            prediction, place = self.predicted(rows), np.ix_(rows, np.array(self.columns))
            variance, _ = self.variances(prediction, np.eye(len(rows) * a))
            error[place] = prediction.mean.reshape(-1, a)
            u[place] = np.sqrt(variance).reshape(-1, a)
        lost = np.isnan(self.points.measured)
        return np.where(lost, np.nan, error), np.where(lost, np.nan, u)
