"""What the readings do not determine, why, and which readings would."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from mtu_cli.findings import Finding, counted, finding
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.estimation import InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.stats.pass_tests import MAX_POSITIONS, by_runs

FEWEST_OF_TREND = 3
"""Runs there and back from which on a straight line leaves a degree of freedom."""
ALONE = "correlation of drift with other components"
GROUPS = "correlation of drift between the groups"


@dataclass(frozen=True, slots=True)
class NotDetermined:
    """One thing that the data leave open, in plain words."""

    component: str
    not_determined: str
    because: str
    reading_that_would: str

    @property
    def shown(self) -> str:
        """The component in a list of several; those of a group stay together."""
        return self.component.replace(", ", " + ")


def observability(fit: MachineFit, estimates: Estimates) -> list[NotDetermined]:
    """All that the readings of a machine do not determine, component by component."""
    result: list[NotDetermined] = []
    for name in estimates.components:
        component = fit.components.get(name)
        if component is None:
            what = "drift, reversal and lack of fit"
            because = "it is known from the machine file only"
            would = "readings of it, given with --lbb or --laser"
            result.append(NotDetermined(name, what, because, would))
            continue
        without_axis = component.estimate.of is None
        for item in component.instruments:
            by = f" by {item.role}" if len(component.instruments) > 1 else ""
            checks = [*_of_scatter(item, without_axis=without_axis)]
            checks += [] if without_axis else [*_of_shape(item)]
            result += [
                NotDetermined(name, f"{what}{by}", why, would) for what, why, would in checks
            ]
    return result + list(_apart(fit, estimates))


def not_estimable(found: Iterable[NotDetermined]) -> list[Finding]:
    """A note for each quantity, with all components of which the readings leave it open."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for item in found:
        grouped.setdefault((item.not_determined, item.because), []).append(item.shown)
    return [
        finding("not-estimable", quantity=quantity, names=names, reason=reason)
        for (quantity, reason), names in grouped.items()
    ]


Checks = Iterator[tuple[str, str, str]]
"""What is not determined, why, and which readings would."""


def _of_scatter(item: InstrumentFit, *, without_axis: bool) -> Checks:
    """What readings, passes and repeats are too few for."""
    fit, passes = item.fit, len(item.keys_read)
    if not fit.plain.dof > 0:
        because = f"{counted(len(item.error), 'reading')} for as many coefficients"
        yield "uncertainty", because, "more readings of it, best in several passes"
    if not fit.separated:
        what = ("reading", "") if without_axis else ("pass", "passes")
        because = f"{counted(passes, *what)} only"
        yield (
            "pass-to-pass drift apart from repeatability",
            because if passes else "no `pass` is given",
            "repeat the run at least 3 times, numbered in `pass`",
        )
        return
    if len(fit.D) != min(2, item.powers):
        because = "some passes have one position only"
        would = "read every pass at two positions or more"
        yield "pass-to-pass change of slope", because, would
    if item.trend is None:
        read = counted(fit.n_passes, "pass", "passes")
        would = "at least 4 passes, in each direction where both are read"
        if by_runs(fit):
            read = f"{counted(len(fit.pairs), 'run')} there and back"
            would = f"at least {FEWEST_OF_TREND} runs there and back"
        yield "steady drift from pass to pass", f"{read}, too few or of equal levels", would
    if not fit.within_dof > 0:
        because = "nothing is repeated within a pass from the same side: all its scatter counts as "
        because += "pass-to-pass"
        would = "read it at least twice in a pass from the same side, in the same set-up"
        yield "repeatability of one visit", because, would


def _of_shape(item: InstrumentFit) -> Checks:
    """What directions and positions are too few for."""
    if item.reversal is None:
        ways = {int(np.sign(way)) for way in np.unique(item.direction)} - {0}
        because = {0: "no `direction` is given", 1: "read in one direction only"}.get(
            len(ways), "its passes are too few or do not differ"
        )
        would = "at least 3 passes, each in both directions, given in `direction`"
        yield "reversal", because, would
    if item.lack_of_fit is None and item.profile is None:
        positions, k = len(np.unique(item.position)), item.powers
        would = "the same positions again, in two passes or more"
        because = "no position is repeated often enough"
        if positions <= k:
            because = f"{counted(positions, 'position')} for {counted(k, 'coefficient')}"
            would = f"readings at {k + 1} positions or more"
        elif positions > MAX_POSITIONS:
            because = f"{positions} different positions; up to {MAX_POSITIONS} are compared"
        yield "lack of fit", because, would


def _apart(fit: MachineFit, estimates: Estimates) -> Iterator[NotDetermined]:
    """Components whose passes are not those of any other, or of some others only."""
    read = {name: x.instruments for name, x in fit.components.items()}
    read = {name: own for name, own in read.items() if any(item.fit.separated for item in own)}
    groups = [group.components for group in estimates.joint]
    # A time or a set-up makes none of passes that went other ways.
    ways = {frozenset(item.direction.tolist()) for own in read.values() for item in own}
    would = "read it in the same passes (same set-up) as the others, or give `time` or `setup`"
    if len(ways) > 1:
        would = "read it in the same directions of the same passes (same set-up) as the others"
    for name, own in read.items():
        if any(name in group for group in groups) or len(read) < 2:
            continue
        because, reading = "read in passes of its own", would
        if len(own) > 1:
            because = "read by several instruments"
            reading = "read it by one instrument, in the same passes as the others"
        yield NotDetermined(name, ALONE, because, reading)
    because = "each group was read in passes of its own, or in other directions"
    for group in groups if len(groups) > 1 else ():
        yield NotDetermined(", ".join(group), GROUPS, because, would)
