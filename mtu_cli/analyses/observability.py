"""What the readings do not determine, why, and which readings would."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from mtu_cli.findings import Finding, finding
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.stats.pass_tests import FEWEST_PASSES, MAX_POSITIONS, by_runs

FEWEST_OF_TREND = 3
"""Runs there and back from which on a straight line leaves a degree of freedom."""
_ALONE = "correlation of its drift with that of other components"
BY_ONE = "read it by one instrument, in the same passes as the others"
_GROUPS = "correlation of their drift with that of the other groups"
_SAID = {
    _ALONE: "correlation of the drift of {} with that of other components",
    _GROUPS: "correlation of the drifts of the groups {} with each other",
}


@dataclass(frozen=True, slots=True, kw_only=True)
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

    def of(self, names: str) -> str:
        """It said of several components that have it in common."""
        return _SAID.get(self.not_determined, f"{self.not_determined} of {{}}").format(names)


def observability(fit: MachineFit, estimates: Estimates) -> list[NotDetermined]:
    """All that the readings of a machine do not determine, component by component."""
    found: list[NotDetermined] = []
    for name in estimates.components:
        component = fit.components.get(name)
        if component is None:
            found.append(
                NotDetermined(
                    component=name,
                    not_determined="drift, reversal and lack of fit",
                    because="it is known from the machine file only",
                    reading_that_would="readings of it, given with --lbb or --laser",
                )
            )
            continue
        for item in component.instruments:
            found += _of_instrument(name, component, item)
    return found + list(_apart(fit, estimates))


def not_estimable(found: Iterable[NotDetermined]) -> list[Finding]:
    """A note for each quantity, with all components of which the readings leave it open."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for item in found:
        grouped.setdefault((item.not_determined, item.because), []).append(item.shown)
    return [
        finding("not-estimable", quantity=quantity, names=names, reason=reason)
        for (quantity, reason), names in grouped.items()
    ]


def _of_instrument(name: str, fit: ComponentFit, item: InstrumentFit) -> list[NotDetermined]:
    by = f" by {item.role}" if len(fit.instruments) > 1 else ""
    without_axis = fit.estimate.of is None
    checks = [_uncertainty(item), _drift(item, without_axis), _slope(item), _trend(item)]
    checks += [_repeatability(item)]
    if not without_axis:
        checks += [_reversal(item), _lack_of_fit(item)]
    return [
        NotDetermined(
            component=name,
            not_determined=f"{what}{by}",
            because=because,
            reading_that_would=would,
        )
        for what, because, would in (check for check in checks if check is not None)
    ]


Check = tuple[str, str, str] | None


def _uncertainty(item: InstrumentFit) -> Check:
    if item.fit.plain.dof > 0:
        return None
    return (
        "uncertainty",
        f"{_count(len(item.error), 'reading')} for as many coefficients",
        "more readings of it, best in several passes",
    )


def _drift(item: InstrumentFit, without_axis: bool) -> Check:
    if item.fit.separated:
        return None
    count = len(item.keys_read) or None
    what = "pass-to-pass drift apart from repeatability"
    if count is None:
        return what, "no `pass` is given", "repeat the run at least 3 times, numbered in `pass`"
    because = f"{_count(count, 'reading' if without_axis else 'pass')} only"
    return what, because, "repeat the run at least 3 times, numbered in `pass`"


def _slope(item: InstrumentFit) -> Check:
    if not item.fit.separated or len(item.fit.D) == min(2, len(item.fit.plain.coefficients)):
        return None
    return (
        "pass-to-pass change of slope",
        "some passes have one position only",
        "read every pass at two positions or more",
    )


def _trend(item: InstrumentFit) -> Check:
    if not item.fit.separated or item.trend is not None:
        return None
    enough, few = item.fit.pass_dof >= 2, f"{_count(item.fit.n_passes, 'pass')} only"
    would = "at least 4 passes, in each direction where both are read"
    if by_runs(item.fit):
        runs = len(item.fit.pairs)
        enough, few = runs >= FEWEST_OF_TREND, f"{_count(runs, 'run')} there and back only"
        would = f"at least {FEWEST_OF_TREND} runs there and back"
    because = "the levels of its passes do not differ" if enough else few
    return "steady drift from pass to pass", because, would


def _repeatability(item: InstrumentFit) -> Check:
    if not item.fit.separated or item.fit.within_dof > 0:
        return None
    return (
        "repeatability of one visit",
        "nothing is repeated within a pass (a move from the other side is no repeat): all its "
        "scatter counts as pass-to-pass",
        "read it at least twice in a pass from the same side, in the same set-up",
    )


def _reversal(item: InstrumentFit) -> Check:
    if item.reversal is not None:
        return None
    would = "run each pass in both directions, given in `direction`"
    seen = {int(sign) for sign in np.sign(item.direction)}
    if not seen & {-1, 1}:
        return "reversal", "no `direction` is given", would
    if {-1, 1} - seen:
        return "reversal", f"read {'forward' if 1 in seen else 'in reverse'} only", would
    if item.fit.separated and item.fit.n_passes >= FEWEST_PASSES:
        return "reversal", "its passes do not differ", "readings that scatter"
    few = "too few passes to judge it by their scatter"
    return "reversal", few, "at least 3 passes there and back"


def _lack_of_fit(item: InstrumentFit) -> Check:
    if item.lack_of_fit is not None:
        return None
    positions = len(np.unique(item.position))
    k = len(item.fit.plain.coefficients)
    if positions <= k:
        because = f"{_count(positions, 'position')} for {_count(k, 'coefficient')}"
        return "lack of fit", because, f"readings at {k + 1} positions or more"
    if positions > MAX_POSITIONS:
        because = f"{positions} different positions; up to {MAX_POSITIONS} are compared"
    else:
        because = "no position is repeated often enough"
    return "lack of fit", because, "the same positions again, in two passes or more"


def _apart(fit: MachineFit, estimates: Estimates) -> Iterator[NotDetermined]:
    """Components whose passes are not those of any other, or of some others only."""
    separated = {
        name: found
        for name, found in fit.components.items()
        if any(item.fit.separated for item in found.instruments)
    }
    groups = [group.components for group in estimates.joint]
    grouped = {name for group in groups for name in group}
    would = _together(separated.values())
    for name, found in separated.items():
        if name in grouped or len(separated) < 2:
            continue
        several = len(found.instruments) > 1
        yield NotDetermined(
            component=name,
            not_determined=_ALONE,
            because="read by several instruments" if several else "read in passes of its own",
            reading_that_would=BY_ONE if several else would,
        )
    for group in groups if len(groups) > 1 else ():
        yield NotDetermined(
            component=", ".join(group),
            not_determined=_GROUPS,
            because="each group was read in passes of its own, or in other directions",
            reading_that_would=would,
        )


def _together(components: Iterable[ComponentFit]) -> str:
    """What would make passes those of others, too: a time or a set-up makes none of passes that
    went other ways.
    """
    ways = {
        frozenset(np.unique(item.direction).tolist())
        for found in components
        for item in found.instruments
    }
    if len(ways) > 1:
        return "read it in the same directions of the same passes (same set-up) as the others"
    return "read it in the same passes (same set-up) as the others, or give `time` or `setup`"


def _count(count: int, what: str) -> str:
    plural = f"{what}es" if what.endswith("s") else f"{what}s"
    return f"{count} {what if count == 1 else plural}"
