"""Units and names that every view of a thermal fit shares."""

from __future__ import annotations

from mtu_cli.analyses.thermal_fit.evidence import FEWEST_NESTED
from mtu_cli.analyses.thermal_fit.result import ComponentDrift
from mtu_cli.reports.numbers import significant
from mtu_cli.units import ARCSEC, LENGTH, UM, Unit

DETAILED = 6
"""Components whose sensors are listed and drawn."""


def shown_in(unit: Unit) -> tuple[str, float]:
    """("um", mm in one um) for a length, ("arcsec", rad in one arcsec) for an angle."""
    return ("um", UM) if unit.dimension == LENGTH else ("arcsec", ARCSEC)


def by_share(item: ComponentDrift) -> list[str]:
    """The sensors of the model, the one with the largest part of the drift first."""
    return sorted(item.estimate.sensors, key=lambda name: -item.shares.get(name, 0.0))


def twins(item: ComponentDrift, sensor: str) -> tuple[str, ...]:
    """The sensors for which `sensor` stands beside itself."""
    for group in item.groups:
        if group[:1] == (sensor,):
            return group[1:]
    return ()


def change(before: float, after: float, size: float) -> str:
    """ "12.3 → 0.352": two root mean squares in units of `size`."""
    return f"{significant(before / size, 3)} → {significant(after / size, 3)}"


def nothing_held_out(item: ComponentDrift) -> str:
    """In plain words why there is no held-out figure, and what would give one."""
    cycles = len(item.cycles)
    if cycles <= 1:
        return (
            "all readings are of one cycle, so none is left to test the model on. How well it fits "
            "says little about another day; a second warm-up or cool-down would"
        )
    if cycles < FEWEST_NESTED:
        return (
            "both cycles were needed to fit and choose the model, so none is left to judge it; "
            "a third warm-up or cool-down would"
        )
    return f"its {cycles} cycles give none to test the model on; complete cycles would"
