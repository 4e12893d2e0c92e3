"""What a component's coefficients multiply: powers of a position, or those times temperatures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import polynomial

Covariates = Mapping[str, FloatArray | float]
TIME = "time_min"


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

        One temperature for all rows, or rows without times, count as settled.
        """
        found = np.empty((n, len(self.estimate.sensors)))
        for s, sensor in enumerate(self.estimate.sensors):
            found[:, s] = covariates[sensor]
        times = covariates.get(TIME)
        if times is None or np.ndim(times) == 0 or not self.estimate.time_constants.any():
            return found
        order = np.argsort(times, kind="stable")
        # Rows of one moment are one sample: a step of no length would start a new run.
        moments, first = np.unique(np.asarray(times)[order], return_index=True)
        constants, index = np.unique(self.estimate.time_constants, return_inverse=True)
        lagged = first_order_lag(found[order][first], moments, constants)
        place = np.searchsorted(moments, times)
        return lagged[index, :, np.arange(found.shape[1])].T[place]


def _powers(of: str | None, degree: int, place: Mapping[str, FloatArray], n: int) -> FloatArray:
    return np.ones((n, 1)) if of is None else polynomial(place[of], degree)


Basis = PolynomialBasis | ThermalBasis
