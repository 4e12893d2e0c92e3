"""Temperatures in degC that look like degrees Fahrenheit."""

from __future__ import annotations

from collections.abc import Mapping

from mtu_cli.files.covariates import is_temperature

COLDEST_F, HOTTEST_F = 59.0, 95.0
"""What a shop is in Fahrenheit, 15 to 35 degC; a sensor that is always so hot in degC is rare."""


def fahrenheit_words(extents: Mapping[str, tuple[float, float]]) -> str | None:
    """What is to be said of covariates whose values all lie from (low, high), where a sensor's
    would be those of a shop in Fahrenheit; None where they are plain temperatures.
    """
    odd = [
        name
        for name, (low, high) in extents.items()
        if is_temperature(name) and COLDEST_F <= low <= high <= HOTTEST_F
    ]
    if not odd:
        return None
    low, high = extents[odd[0]]
    others = f" (and {len(odd) - 1} more sensors like it)" if len(odd) > 1 else ""
    return (
        f"{odd[0]} is {_span(low, high)} degC{others}; in Fahrenheit it would be "
        f"{_span(_degc(low), _degc(high))} degC: check its unit"
    )


def _degc(value: float) -> float:
    return (value - 32.0) / 1.8


def _span(low: float, high: float) -> str:
    return " to ".join(dict.fromkeys(f"{value:.4g}" for value in (low, high)))
