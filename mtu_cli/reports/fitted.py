"""What the report of fit-components says of one component, picked from fit and estimate."""

from __future__ import annotations

import numpy as np

from mtu_cli.model.estimates import ComponentEstimate, to_centre
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.positive_part import positive_part


def single_instrument(found: ComponentFit | None) -> InstrumentFit | None:
    """The fit of the one instrument that read a component; None for none or several."""
    return found.instruments[0] if found is not None and len(found.instruments) == 1 else None


def pass_center(found: ComponentFit | None) -> float:
    """Position (mm) at which the pass-to-pass intercept is stated: 0 without readings.

    With several instruments, the mean of all their readings.
    """
    if found is None:
        return 0.0
    if len(found.instruments) == 1:
        return float(found.instruments[0].fit.center)
    return float(np.concatenate([item.position for item in found.instruments]).mean())


def pass_covariance(estimate: ComponentEstimate, found: ComponentFit | None) -> FloatArray:
    """D (q, q) of the intercept at `pass_center` and the slope, as a covariance.

    q is 2, or 1 for a constant. The moment estimate less its negative part, which stands for
    passes that differ by less than repeatability alone would make them.
    """
    one = single_instrument(found)
    if one is not None:
        return _padded(one.fit.D, estimate)
    D = pass_covariance_moment(estimate, found)
    return D if np.linalg.eigvalsh(D)[0] >= 0 else positive_part(D)


def pass_covariance_moment(estimate: ComponentEstimate, found: ComponentFit | None) -> FloatArray:
    """The unbiased D (q, q) that predictions use, at `pass_center`; it may have a negative part."""
    one = single_instrument(found)
    if one is not None:
        return _padded(one.fit.D_moment, estimate)
    return to_centre(pass_center(found), estimate.pass_covariance)


def half_differences(estimate: ComponentEstimate, found: ComponentFit | None) -> FloatArray | None:
    """The mean square S_h (q, q) of runs there and back at `pass_center`; None without runs."""
    one = single_instrument(found)
    if one is not None:
        own = one.fit.half_differences
        return None if own is None else _padded(own, estimate)
    halves = estimate.half_differences
    return None if halves is None else to_centre(pass_center(found), halves)


def run_covariance(estimate: ComponentEstimate, found: ComponentFit | None) -> FloatArray | None:
    """K (q, q) of runs there and back at `pass_center`, of several instruments; else None."""
    K = estimate.run_covariance
    return None if K is None else to_centre(pass_center(found), K)


def _padded(D: FloatArray, estimate: ComponentEstimate) -> FloatArray:
    """Where some pass has one position only the level varies from pass to pass, not the slope."""
    q = min(2, len(estimate.coefficients))
    whole = np.zeros((q, q))
    whole[: len(D), : len(D)] = D
    return whole


def passes_read(item: InstrumentFit) -> int | None:
    """Number of passes of the readings; None where no pass is given."""
    return len(item.keys_read) or None
