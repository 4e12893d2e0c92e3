"""Temperatures in degC that look like degrees Fahrenheit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.files.covariates import is_temperature

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Bools = NDArray[np.bool_]

Extent = tuple[float, float]
"""The lowest and the highest of some temperatures, degC."""

FAHRENHEIT = "looks-like-fahrenheit"
"""The code of all such warnings."""
COLDEST_F, HOTTEST_F = 59.0, 95.0
"""What a shop is in Fahrenheit, 15 to 35 degC; a sensor that is always so hot in degC is rare."""
LEAST_STEP_K = 30.0
"""A log that goes on in Fahrenheit jumps by more, by 44 K in a cold shop, from degC ..."""
NEAR_K = 3.0
"""... to what, read as Fahrenheit, is at most so far beyond the other sensors ..."""
WARMER_K = 10.0
"""... or beyond its own other readings."""
FEWEST = 4
"""Readings in Fahrenheit among others in degC that are more than a fault of the sensor."""
MOST_CHANGES = 2
"""A log goes on in Fahrenheit, and back to degC at most."""
NAMED = 4
ANSWERLESS = 85.0
"""What a DS18B20 gives before it has measured: that is told as such."""


def fahrenheit_words(extents: Mapping[str, Extent]) -> str | None:
    """What is to be said of covariates whose values all lie from (low, high), where a sensor's
    would be those of a shop in Fahrenheit, or of the other sensors; None where they are plain
    temperatures.
    """
    odd = in_fahrenheit(extents)
    if not odd:
        return None
    others = f" (and {len(odd) - 1} more sensors like it)" if len(odd) > 1 else ""
    return f"{odd[0]} is {_span(extents[odd[0]])} degC{others}; {meant_words(extents[odd[0]])}"


def in_fahrenheit(extents: Mapping[str, Extent]) -> list[str]:
    """The sensors of which `fahrenheit_words` tells."""
    known = {name: own for name, own in extents.items() if is_temperature(name)}
    odd = {name for name, (low, high) in known.items() if COLDEST_F <= low <= high <= HOTTEST_F}
    plain = {name: own for name, own in known.items() if name not in odd and own[0] <= own[1]}
    return [
        name
        for name in known
        if name in odd or (name in plain and seem_fahrenheit(plain[name], _others(plain, name)))
    ]


def _others(extents: Mapping[str, Extent], name: str) -> list[Extent]:
    return [own for other, own in extents.items() if other != name]


def seem_fahrenheit(own: Extent, others: list[Extent], near: float = NEAR_K) -> bool:
    """Whether temperatures are far above all `others`, but `near` them if in Fahrenheit."""
    span = _joined(others)
    if span is None:
        return False
    low, high = span
    jumps = own[0] - high > LEAST_STEP_K
    return jumps and low - near <= _degc(own[0]) <= _degc(own[1]) <= high + near


def meant_words(own: Extent) -> str:
    """What temperatures would be in Fahrenheit."""
    return f"in Fahrenheit it would be {_span((_degc(own[0]), _degc(own[1])))} degC: check its unit"


def partly_words(own: Extent, others: Extent, where: str, count: str = "") -> str:
    """What is to be said of a sensor of which a part alone seems to be in Fahrenheit."""
    return f"{where} it is {_span(own)} degC{count}, else {_span(others)} degC; {meant_words(own)}"


def some_fahrenheit(values: Floats, run: NDArray[np.int64] | None = None) -> Bools | None:
    """Which values (n,) of a sensor seem to be in Fahrenheit while the others are not; None where
    they are alike, or too few, or change to and fro in a `run` (n,) as a spindle's do that is
    switched on and off.
    """
    odd: Bools = (values >= COLDEST_F) & (values <= HOTTEST_F) & (values != ANSWERLESS)
    if odd.sum() < FEWEST:
        return None
    run = np.zeros(len(values), np.int64) if run is None else run
    changes = (odd[1:] != odd[:-1]) & (run[1:] == run[:-1])
    if np.bincount(run[1:][changes]).max(initial=0) > MOST_CHANGES:
        return None
    rest = _rest(values, odd)
    if not len(rest) or not seem_fahrenheit(_of(values[odd]), [_of(rest)], WARMER_K):
        return None
    return odd


def cycles_words(extents: Mapping[str, Extent]) -> str | None:
    """What is to be said of a sensor's cycles with values from (low, high), some of them in
    Fahrenheit; None where they are alike.
    """
    odd = [cycle for cycle, (low, high) in extents.items() if COLDEST_F <= low <= high <= HOTTEST_F]
    rest = [own for cycle, own in extents.items() if cycle not in odd]
    own = _joined([extents[cycle] for cycle in odd])
    if own is None or not seem_fahrenheit(own, rest, WARMER_K):
        return None
    cycles = f"cycle{'s' if len(odd) > 1 else ''} {', '.join(map(repr, odd[:NAMED]))}"
    more = f" and {len(odd) - NAMED} more" if len(odd) > NAMED else ""
    return partly_words(own, _joined(rest) or own, f"in {cycles}{more}")


def _joined(extents: list[Extent]) -> Extent | None:
    if not extents:
        return None
    return min(low for low, _ in extents), max(high for _, high in extents)


def told_partly(values: Floats, odd: Bools, first_row: int) -> str:
    """`partly_words` of rows of a file, the first of them as an editor counts."""
    count = f" in {int(odd.sum())} of {len(odd)} rows"
    own, rest = _of(values[odd]), _of(_rest(values, odd))
    return partly_words(own, rest, f"from row {first_row} on", count)


def _rest(values: Floats, odd: Bools) -> Floats:
    found: Floats = values[np.isfinite(values) & ~odd & (values != ANSWERLESS)]
    return found


def _of(values: Floats) -> Extent:
    return float(values.min()), float(values.max())


def _degc(value: float) -> float:
    return (value - 32.0) / 1.8


def _span(extent: Extent) -> str:
    return " to ".join(dict.fromkeys(f"{value:.4g}" for value in extent))
