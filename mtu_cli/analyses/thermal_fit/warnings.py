"""What a thermal model does not hold, and what its readings lacked, in plain words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.analyses.thermal_fit.columns import Library
from mtu_cli.analyses.thermal_fit.evidence import FEWEST_NESTED
from mtu_cli.analyses.thermal_fit.result import ComponentDrift, HeldOut
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.analyses.thermal_fit.uncertainty import Rest
from mtu_cli.findings import Finding, finding
from mtu_cli.stats.residuals import FEWEST_FOR_NORMALITY

OVER_FIT = 2.0
FEWEST_ROWS = 10
COLLINEAR = 30.0
"""Condition number from which on single coefficients are not to be trusted (Belsley, Kuh &
Welsch 1980, ch. 3)."""
LEAST_GAIN, GAIN_P = 0.05, 0.05
"""Fall of the held-out rms from which on a model is of use whatever its cycles' scatter, and the
level at which a smaller one is told from none."""
FAR = 1.0
"""degC beyond the reference from which on it counts as not read."""
AT_ONE_SHARE, LEVELS_APART = 0.1, 0.5
"""Cycles that begin within this share of what the sensors move begin at one temperature; readings
there are apart from this share of what they move in a cycle on.
"""
NOTHING = "no-effect-of-temperature"


def component_warnings(
    series: Series, lib: Library, drift: ComponentDrift, method: str
) -> list[Finding]:
    """Warnings of one component's model."""
    name = drift.name
    found = [*_of_held_out(lib, drift)]
    if drift.condition > COLLINEAR:
        found.append(
            finding(
                "not-separable",
                component=name,
                what=f"{name}: the sensors are",
                others=["each other"],
                consequence=f"single coefficients mean nothing (condition {drift.condition:.0f})",
            )
        )
    found += _of_lags(series, lib, drift, method)
    if len(drift.positions) == 1 and (axis := drift.estimate.of) is not None:
        at = drift.positions[0]
        reason = f"it was read at {at:g} mm only, and is taken as the same"
        what = f"the drift along {axis}"
        found.append(finding("not-tested", what=what, items=name, component=name, reason=reason))
    found += _of_reference(drift)
    found += _of_files(series, name)
    if not drift.estimate.sensors:
        reason = "none explains the drift"
        reason += " (the readings do not differ, so that r2 is undefined)" if series.still else ""
        found.append(finding(NOTHING, component=name, what="sensor", reason=reason))
    if drift.residuals.normality_p is None:
        number = drift.residuals.effective
        few = f"{number:.3g} of them count as independent"
        reason = few if number < FEWEST_FOR_NORMALITY else "they are 0"
        what = "the normality of the residuals"
        found.append(finding("not-tested", what=what, items=name, component=name, reason=reason))
    return found


def _of_files(series: Series, name: str) -> Iterator[Finding]:
    """Rows whose order or cycle is not what the files say at first sight."""
    if series.shuffled and not series.complete:
        reason = "readings of one cycle are not in the order of their times, and too many to be "
        reason += "sorted: their autocorrelation is that of the file"
        yield finding("order-of-cycles", component=name, reason=reason)
    several = {cycle: names for (_, cycle), names in series.files.items() if len(names) > 1}
    if several:
        cycle, names = next(iter(several.items()))
        own = f"cycle {cycle!r}" if cycle else "one cycle without a name"
        files = " and ".join(sorted(names))
        yield finding(
            "order-of-cycles",
            component=name,
            reason=f"{own} is in {files} and counts as one warm-up or cool-down",
            files=files,
            expected="another name for each warm-up in the column 'cycle'",
        )


def _of_lags(series: Series, lib: Library, drift: ComponentDrift, method: str) -> Iterator[Finding]:
    """Why a model has no lags where they were asked for."""
    if method in ("auto", "lagged") and len(lib.time_constants) < 2:
        yield finding(NOTHING, component=drift.name, what="lags", reason=_no_lags(series))
    elif method == "lagged" and len(lib.cycles) < 2:
        reason = "lags are chosen on held-out cycles, and there is one; the model is ridge"
        yield finding(NOTHING, component=drift.name, what="lags", reason=reason)
    if drift.without_lag:
        reason = "no time constant lowers the held-out error enough; the model is ridge"
        yield finding(NOTHING, component=drift.name, what="lags", reason=reason)


def _no_lags(series: Series) -> str:
    if not series.complete:
        return "there are too many readings"
    if np.isnan(series.kept().time).any():
        return "no times are given"
    return "the times do not run on within the cycles"


def _of_reference(drift: ComponentDrift) -> Iterator[Finding]:
    """Drift that was zeroed far from the reference: its zero is extrapolated."""
    span, reference = drift.estimate.temperature_range, drift.estimate.reference
    if span is None or not len(span):
        return
    beyond = (span[:, 0] > reference + FAR) | (span[:, 1] < reference - FAR)
    if beyond.mean() > 0.5:
        yield finding(
            "outside-measured-range",
            component=drift.name,
            what=f"the reference of {reference:g} degC",
            names=[f"the sensors of {drift.name}"],
            low=float(span[:, 0].min()),
            high=float(span[:, 1].max()),
            unit="degC",
        )


def _of_held_out(lib: Library, drift: ComponentDrift) -> Iterator[Finding]:
    """What the next warm-up may show that the cycles of the fit do not."""
    name, held = drift.name, drift.held_out
    if len(lib.cycles) < FEWEST_NESTED:
        count = "the readings have no cycles" if len(lib.cycles) < 2 else "there are two cycles"
        expected = "three cycles or more, column 'cycle'"
        yield finding("not-held-out", component=name, cycles=count, expected=expected)
    if held is None:
        return
    if drift.rms_after > 0 and held.after > OVER_FIT * drift.rms_after:
        fitted, held_out = drift.shown(drift.rms_after), drift.shown(held.after)
        yield finding("over-fit", component=name, fitted=fitted, held_out=held_out)
    if held.after > held.before:
        yield finding("no-better", component=name, effect="increase the rms")
        return
    small = held.after > (1 - LEAST_GAIN) * held.before
    if drift.estimate.sensors and small and not _consistent(held):
        percent = 100 * (1 - held.after / held.before)
        effect = f"reduce the rms by {percent:.2g} % only, within its scatter"
        yield finding("no-better", component=name, effect=effect)


def _consistent(held: HeldOut) -> bool:
    """Whether the cycles gain beyond their scatter: Student's t of ln(before/after), one-sided.

    Ratios, because a cycle of large drift would be all that differences of squares show.
    """
    from scipy.special import stdtrit

    before, after = np.array([own[1:] for own in held.cycles]).T
    if not (before > 0).all() or not (after > 0).all():
        return True
    gain = np.log(before / after)
    n, s = len(gain), float(np.std(gain, ddof=1))
    return float(gain.mean() * np.sqrt(n)) > float(stdtrit(n - 1, 1 - GAIN_P)) * s


def sensor_warnings(
    series: Series, sensors: tuple[str, ...], rest: Rest, drift: ComponentDrift
) -> list[Finding]:
    """Sensors that do not move, and readings whose cycles begin apart."""
    span = series.range()
    found = [
        finding("sensor-still", sensor=name, where=f" at {low:g} degC", consequence="left out")
        for name, (low, high) in zip(sensors, span.tolist(), strict=True)
        if low == high
    ]
    return found + _levels(rest, drift)


def _levels(rest: Rest, drift: ComponentDrift) -> list[Finding]:
    """Cycles that begin apart at one temperature: a probe that was set anew has another zero."""
    kept = rest.kept
    for position in drift.positions or (None,):
        at = (kept.at(position, c) for c in range(len(drift.cycles)))
        rows = [own for own in at if len(own) >= FEWEST_ROWS]
        if len(rows) < 2 or not kept.temperature.shape[1]:
            continue
        first = np.array([own[0] for own in rows])
        readings = [kept.error[own] for own in rows]
        moves = np.ptp(kept.temperature[np.concatenate(rows)], axis=0)
        same = np.ptp(kept.temperature[first], axis=0) <= AT_ONE_SHARE * moves
        apart, within = np.ptp(kept.error[first]), np.median([np.ptp(own) for own in readings])
        if same.all() and apart > LEVELS_APART * within:
            where = "" if position is None else f" at {position:g} mm"
            shown = drift.shown(float(apart))
            reason = f"the cycles begin up to {shown} apart{where} at the same temperatures: was "
            reason += "the probe set anew? count the readings of each cycle from its first"
            return [
                finding(
                    "order-of-cycles", component=drift.name, reason=reason, apart=shown, where=where
                )
            ]
    return []
