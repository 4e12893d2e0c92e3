"""What a component's coefficients multiply: powers of a position, or those times temperatures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.findings import error
from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.lag import farthest_at_once, lag_of_moments
from mtu_cli.stats.least_squares import FloatArray, polynomial

Covariates = Mapping[str, FloatArray | float]
TIME = "time_min"
AGREE_DEGC = 0.5
"""Readings of one sensor at one moment differ by less: what differs by more is another time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolynomialBasis:
    """1, p, p^2, ... of the position along `of`; without an axis the constant alone."""

    of: str | None
    degree: int

    def inputs(self) -> tuple[str, ...]:
        """Covariates that it needs: none."""
        return ()

    def rows(self, place: Mapping[str, FloatArray], covariates: Covariates, n: int) -> FloatArray:
        """The columns (n, degree + 1) at n places."""
        return _powers(self.of, self.degree, place, n)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalBasis:
    """Powers of the position times temperature rises: p^m u_s, powers first."""

    estimate: ThermalEstimate

    def inputs(self) -> tuple[str, ...]:
        """The sensors."""
        return self.estimate.sensors

    def rows(self, place: Mapping[str, FloatArray], covariates: Covariates, n: int) -> FloatArray:
        """The columns (n, powers * sensors) at n places, with each sensor's lag."""
        estimate = self.estimate
        powers = _powers(estimate.of, estimate.degree, place, n)
        rise = self.temperatures(covariates, n) - estimate.reference
        product: FloatArray = (powers[:, :, None] * rise[:, None, :]).reshape(n, -1)
        return product

    def temperatures(self, covariates: Covariates, n: int) -> FloatArray:
        """Temperatures (n, s), lagged where the model says so and the rows tell a history.

        One temperature for all rows, or rows without times, count as settled. What lags is the
        mean over the rows of a moment; a sensor without lag is every row's own.

        Raises InputError for rows of a moment that cannot both be right.
        """
        found = np.empty((n, len(self.estimate.sensors)))
        for s, sensor in enumerate(self.estimate.sensors):
            found[:, s] = covariates[sensor]
        times = row_times(covariates)
        if times is None or not self.estimate.time_constants.any():
            return found
        self._check_moments(found, times)
        order = np.argsort(times, kind="stable")
        constants, index = np.unique(self.estimate.time_constants, return_inverse=True)
        lagged = lag_of_moments(found[order], times[order], constants)
        found[order] = lagged[index, :, np.arange(found.shape[1])].T
        return found

    def _check_moments(self, found: FloatArray, times: FloatArray) -> None:
        for s in np.flatnonzero(self.estimate.time_constants > 0):
            i, j, apart = farthest_at_once(found[:, s], times)
            if apart > AGREE_DEGC:
                raise error(
                    "contradicts",
                    path=self.estimate.sensors[s],
                    other=f"{found[i, s]:g} degC at the same time ({times[i]:g} min)",
                    value=f"{found[j, s]:g} degC",
                    expected=f"one temperature a moment: {TIME} that runs on over all rows",
                )


def row_times(covariates: Covariates) -> FloatArray | None:
    """Times (n,) of the rows, min; None where they tell no history."""
    times = covariates.get(TIME)
    return None if times is None or np.ndim(times) == 0 else np.asarray(times, float)


def _powers(of: str | None, degree: int, place: Mapping[str, FloatArray], n: int) -> FloatArray:
    return np.ones((n, 1)) if of is None else polynomial(place[of], degree)


Basis = PolynomialBasis | ThermalBasis
