"""The JSON document that every report is: its envelope, and numbers that JSON can hold.

Every number's unit is in its name, in full precision. What cannot be had is null, and a
warning says why. Three nulls are values and need none: degrees of freedom that are null are
infinite, `settings.trials` null means that the Monte Carlo chose the count itself (JCGM 101:2008,
7.9.4), `settings.coverage_factor` null that there is no one factor: `results` have each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import numpy as np

from mtu_cli import __version__
from mtu_cli.findings import Finding
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC, UM

SCHEMA_VERSION = 1


class InputFile(Protocol):
    """What a report says of an input file; `shown` is a relative path."""

    @property
    def role(self) -> str: ...
    @property
    def shown(self) -> str: ...
    @property
    def sha256(self) -> str: ...
    @property
    def rows(self) -> int | None: ...


def envelope(
    command: str,
    *,
    inputs: Iterable[InputFile],
    settings: Settings,
    results: Mapping[str, Any],
    warnings: Iterable[Finding] = (),
    at: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The whole document of a command, ``mtu/<command>/1``; `at` are the covariates given."""
    distinct = {(item.code, item.message): item for item in warnings}
    return {
        "schema": f"mtu/{command}/{SCHEMA_VERSION}",
        "tool": {"name": "mtu", "version": __version__},
        "inputs": [
            {"role": item.role, "path": item.shown, "sha256": item.sha256, "rows": item.rows}
            for item in inputs
        ],
        "settings": {
            "coverage_factor": finite(settings.coverage_factor),
            "seed": settings.seed,
            "correlation": settings.correlation,
            "digits": settings.digits,
            "trials": settings.trials,
            "at": {name: float(value) for name, value in (at or {}).items()},
        },
        "results": dict(results),
        "warnings": [item.to_dict() for item in distinct.values()],
    }


def finite(value: float | None) -> float | None:
    """`value` as a Python float; None where it is None, infinite or not a number."""
    if value is None or not math.isfinite(value):
        return None
    return float(value)


def um(value: float | None) -> float | None:
    """mm to um."""
    return None if value is None else finite(value / UM)


def um2(value: float | None) -> float | None:
    """mm^2 to um^2."""
    return None if value is None else finite(value / UM**2)


def arcsec(value: float | None) -> float | None:
    """rad to arcsec."""
    return None if value is None else finite(value / ARCSEC)


def root(variance: float) -> float:
    """The standard uncertainty of a variance; nan where a difference of mean squares is below 0."""
    return math.sqrt(variance) if variance >= 0 else math.nan


def matrix(values: FloatArray) -> list[Any]:
    """An array as nested lists, None where a number is not finite."""
    array = np.asarray(values, dtype=np.float64)
    if np.isfinite(array).all():
        found: list[Any] = array.tolist()
        return found
    if array.ndim == 1:
        return [finite(value) for value in array]
    return [matrix(row) for row in array]
