"""Whether there are readings enough for a thermal model and for its uncertainty."""

from __future__ import annotations

from mtu_cli.analyses.thermal_fit.models import Fitted, Spec
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.findings import InputError, counted, error

_ROUNDING = 1e-6


def check_least(series: Series) -> None:
    """Raises InputError for fewer readings than any thermal model needs.

    The smallest has a level at each of p positions, which is no drift, and the gradient of one
    sensor: p + 1 quantities, so that one of p + 2 readings is left to tell s^2, of n - p - 1
    degrees of freedom.
    """
    places = len(series.positions)
    if series.n < places + 2:
        levels = "a level" if places == 1 else f"a level at each of {places} positions"
        what = f"{levels} and the gradient of one sensor"
        raise _too_few(series, what, f"at least {places + 2}")


def check_fitted(series: Series, spec: Spec, found: Fitted) -> None:
    """Raises InputError where the model has taken up all readings: it then goes through them, and
    its uncertainty would come out as none.
    """
    if series.n - found.used >= 1 - _ROUNDING:
        return
    gradients = found.coefficients.size
    what = f"the {spec.kind} model of {gradients} gradients"
    # Sensors that depend on each other need fewer.
    enough = f"{len(series.positions) + gradients + 1} (these are always enough)"
    raise _too_few(
        series, what, enough if spec.kind == "stepwise" else f"{enough}, or --model stepwise"
    )


def _too_few(series: Series, what: str, enough: str) -> InputError:
    files = sorted({name for names in series.files.values() for name in names})
    return error(
        "too-little-data",
        what=f"{counted(series.n, 'reading')} of {series.name} for {what}",
        file=files[0] if len(files) == 1 else None,
        expected=f"{enough}: one more than is fitted gives the uncertainty",
    )
