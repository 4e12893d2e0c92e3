"""Readings of a budget file that cannot tell their scatter, or that tell of a slip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import Decimal

from mtu_cli.errors import Notice
from mtu_cli.files.budget_contract import Budget, Contribution
from mtu_cli.files.yaml_file import YamlDocument
from mtu_cli.findings import Finding

GAPS = {4: 50.0, 5: 15.0}
"""By the number of readings, 5 or more alike: how many ranges of the others one may be away from
the next of them. Less than one set of normal readings in a thousand has such a gap.
"""
NEAR = 3.0
"""Ranges of the others about them within which a reading with its decimal point fits them ..."""
ALIKE = 0.05
"""... where those are alike: their range is no more than this share of their size."""


def reading_notices(budget: Budget, document: YamlDocument) -> tuple[Finding, ...]:
    """What is to be said of the readings of every input."""
    found = []
    for name, item in budget.inputs.items():
        readings = item.readings
        if readings is None:
            continue
        line = document.line_of("inputs", name, "readings")
        place = f"{document.source.shown}:{line}: inputs.{name}.readings"
        if min(readings) == max(readings):
            if not any(_width(part) for part in (item, *item.contributions)):
                found.append(Notice(code="equal-readings", message=place + _equal(readings)))
            continue
        text = _stands_out(readings)
        if text:
            found.append(Notice(code="reading-stands-out", message=place + text))
    return tuple(found)


def _equal(readings: Sequence[float]) -> str:
    """Readings without scatter, and nothing beside them that says how well they are known."""
    return (
        f": all {len(readings)} are {readings[0]:g}, so that u is 0: what "
        "they were rounded to hides their scatter; for a resolution r add half_width: r/2 and "
        "distribution: rectangular (JCGM 100, F.2.2.1)"
    )


def _width(part: Contribution) -> bool:
    """Whether a contribution has an uncertainty above 0."""
    limits = part.low is not None and part.high is not None
    return limits or any((part.u, part.half_width, part.U))


def _stands_out(readings: Sequence[float]) -> str:
    """A reading that is away from all others, which are together; "" where none is."""
    step = min(_step(value) for value in readings)
    order = sorted(range(len(readings)), key=lambda i: readings[i])
    for i, next_to in ((order[0], order[1]), (order[-1], order[-2])):
        others = [value for k, value in enumerate(readings) if k != i]
        spread = max(max(others) - min(others), step)
        gap = abs(readings[i] - readings[next_to]) / spread
        alike = len(others) > 1 and spread <= ALIKE * abs(others[0])
        slip = alike and any(
            min(others) - NEAR * spread <= meant <= max(others) + NEAR * spread
            for meant in _shifted(readings[i])
        )
        far = gap > GAPS.get(min(len(readings), max(GAPS)), float("inf"))
        if far or (slip and gap > NEAR):
            hint = "is its decimal point in its place?" if slip else "is it mistyped?"
            return (
                f"[{i}]: {readings[i]:.9g} stands out from the others, {min(others):.9g} to "
                f"{max(others):.9g}, and makes nearly all of u: {hint}"
            )
    return ""


def _step(value: float) -> float:
    """What the last digit of a number counts."""
    exponent = Decimal(repr(value)).normalize().as_tuple().exponent
    return 10.0 ** min(exponent, 0) if isinstance(exponent, int) else 0.0


def _shifted(value: float) -> Iterator[float]:
    """A number with its decimal point elsewhere."""
    return (value * 10.0**power for power in range(-6, 7) if power)
