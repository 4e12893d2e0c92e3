"""What the thermal model of a component has to warn of."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mtu_cli.analyses.thermal_fit.choice import FEWEST_NESTED
from mtu_cli.analyses.thermal_fit.models import Library
from mtu_cli.analyses.thermal_fit.result import ComponentDrift
from mtu_cli.findings import Finding, finding
from mtu_cli.stats.residuals import FEWEST_FOR_NORMALITY

OVER_FIT = 2.0


def thermal_warnings(lib: Library, drift: ComponentDrift, method: str) -> Iterator[Finding]:
    """Warnings of one component's model."""
    name, series = drift.name, lib.series
    yield from _of_held_out(drift)
    yield from _of_inseparable(drift)
    yield from _of_order(lib, drift)
    if (reason := _without_lags(lib, drift, method)) is not None:
        yield finding("no-effect-of-temperature", component=name, what="lags", reason=reason)
    if len(drift.positions) == 1 and (axis := drift.estimate.of) is not None:
        reason = f"it was read at {drift.positions[0]:g} mm only, and is taken as the same"
        what = f"the drift along {axis}"
        yield finding("not-tested", what=what, items=name, component=name, reason=reason)
    if not drift.estimate.sensors:
        reason = "none explains the drift"
        reason += " (the readings do not differ, so that r2 is undefined)" if series.still else ""
        yield finding("no-effect-of-temperature", component=name, what="sensor", reason=reason)
    if drift.residuals.normality_p is None:
        number = drift.residuals.effective
        few = f"{number:.3g} of them count as independent"
        reason = few if number < FEWEST_FOR_NORMALITY else "they are 0"
        what = "the normality of the residuals"
        yield finding("not-tested", what=what, items=name, component=name, reason=reason)
    if series.every > 1:
        reason = f"of {series.total} readings every {series.every}th of a cycle is fitted"
        yield finding("not-used", what="readings", names=[name], reason=reason)
    for sensor, (low, high) in zip(lib.sensors, series.range.tolist(), strict=True):
        if low == high:
            where = f" at {low:g} degC"
            yield finding("sensor-still", sensor=sensor, where=where, consequence="left out")


def _of_order(lib: Library, drift: ComponentDrift) -> Iterator[Finding]:
    """Cycles that are not what the files say at first sight."""
    judged, shared = drift.zeroed, lib.series.shared
    if judged.offsets and judged.by != "setting":
        why = "the first reading of each is 0" if judged.p is None else f"p = {judged.p:.1g}"
        reason = f"the probe was zeroed in every cycle ({why}): each has an offset of its own"
        yield finding("order-of-cycles", component=drift.name, reason=reason)
    if shared is not None:
        of = f"cycle {shared!r}" if shared else "one cycle without a name"
        files = " and ".join(lib.series.files)
        yield finding(
            "order-of-cycles",
            component=drift.name,
            reason=f"{of} is in {files} and counts as one warm-up or cool-down",
            files=files,
            expected="another name for each warm-up in the column 'cycle'",
        )


def _of_inseparable(drift: ComponentDrift) -> Iterator[Finding]:
    """Sensors whose gradients are reliable together only, of the position with the most."""
    for group in max((at.inseparable for at in drift.at_positions), key=len, default=()):
        first, *others = group.sensors
        value, u = group.value / drift.size, (group.u or 0.0) / drift.size
        # Both to the second digit of u.
        places = max(1 - math.floor(math.log10(u)), 0) if u > 0 else 3
        error = f" ± {u:.{places}f}" if u > 0 else ""
        shown = f"{value:.{places}f}{error} {drift.unit.name} per degC"
        where = "" if group.position is None else f" at {group.position:g} mm"
        yield finding(
            "not-separable",
            component=drift.name,
            what=f"{drift.name}: {first}",
            others=others,
            consequence=f"reliable together only, {shown} of {first}{where}",
        )


def _without_lags(lib: Library, drift: ComponentDrift, method: str) -> str | None:
    """Why a model has no lags where they were asked for."""
    if method in ("auto", "lagged") and len(lib.time_constants) < 2:
        untimed = bool(np.isnan(lib.series.time).any())
        return "no times are given" if untimed else "the times do not run on within the cycles"
    if method == "lagged" and len(drift.cycles) < 2:
        return "lags are chosen on held-out cycles, and there is one; the model is ridge"
    if method == "lagged" and lib.groups and drift.model != "lagged":
        return "no time constant lowers the held-out error enough; the model is ridge"
    return None


def _of_held_out(drift: ComponentDrift) -> Iterator[Finding]:
    """What the next warm-up may show that the cycles of the fit do not."""
    name, held, count = drift.name, drift.held_out, len(drift.cycles)
    if count < FEWEST_NESTED:
        cycles = "the readings have no cycles" if count < 2 else "there are two cycles"
        expected = "three cycles or more, column 'cycle'"
        yield finding("not-held-out", component=name, cycles=cycles, expected=expected)
    if held is None:
        return
    if drift.rms_after > 0 and held.after > OVER_FIT * drift.rms_after:
        fitted, held_out = drift.shown(drift.rms_after), drift.shown(held.after)
        yield finding("over-fit", component=name, fitted=fitted, held_out=held_out)
    if held.after > held.before:
        yield finding("no-better", component=name, effect="increase the rms")
