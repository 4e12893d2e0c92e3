"""What a thermal model does not hold, and what its readings lacked, in plain words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.analyses.thermal_fit.columns import Library
from mtu_cli.analyses.thermal_fit.evidence import FEWEST_NESTED
from mtu_cli.analyses.thermal_fit.result import ComponentDrift, HeldOut
from mtu_cli.analyses.thermal_fit.series import Series
from mtu_cli.analyses.thermal_fit.uncertainty import Rest
from mtu_cli.errors import Warned
from mtu_cli.findings import Finding
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


def component_warnings(
    series: Series, lib: Library, drift: ComponentDrift, method: str
) -> list[Finding]:
    """Warnings of one component's model."""
    found = [*_of_held_out(lib, drift)]
    if drift.condition > COLLINEAR:
        found.append(
            (
                "collinear",
                f"the sensors move together (condition number {drift.condition:.0f}): "
                "single coefficients are not to be read on their own",
            )
        )
    found += _of_lags(series, lib, drift, method)
    if len(drift.positions) == 1 and drift.estimate.of is not None:
        found.append(
            (
                "one-position",
                f"the drift was read at {drift.positions[0]:g} mm only: that it is the "
                f"same all along {drift.estimate.of} is assumed, not tested",
            )
        )
    found += _of_reference(drift)
    found += _of_files(series)
    if not drift.estimate.sensors:
        why = "the readings do not differ, r2 cannot be had: " if series.still else ""
        found.append(("no-sensor", f"{why}no sensor explains the drift"))
    if drift.residuals.normality_p is None:
        found.append(_not_tested(drift.residuals.effective))
    return [Warned(code=code, message=f"{drift.name}: {text}") for code, text in found]


def _not_tested(number: float) -> tuple[str, str]:
    """Why the residuals' normality is not tested, of so many independent ones."""
    why = "they are 0"
    if number < FEWEST_FOR_NORMALITY:
        why = f"{number:.3g} of them count as independent"
    return "normality-not-tested", f"the residuals are not tested: {why}"


def _of_files(series: Series) -> Iterator[tuple[str, str]]:
    """Rows whose order or cycle is not what the files say at first sight."""
    if series.shuffled and not series.complete:
        yield (
            "rows-out-of-order",
            "readings of one cycle are not in the order of their times, and too many to be "
            "sorted: their autocorrelation is that of the file's order",
        )
    several = {cycle: names for (_, cycle), names in series.files.items() if len(names) > 1}
    if several:
        cycle, names = next(iter(several.items()))
        what = f"cycle {cycle!r}" if cycle else "what no column 'cycle' tells apart"
        yield (
            "cycle-in-two-files",
            f"{what} stands in {' and '.join(sorted(names))} and counts as one warm-up or "
            "cool-down: different ones need different names in the column 'cycle'",
        )


def _of_lags(
    series: Series, lib: Library, drift: ComponentDrift, method: str
) -> Iterator[tuple[str, str]]:
    """Why a model has no lags where they were asked for."""
    if method in ("auto", "lagged") and len(lib.time_constants) < 2:
        yield "no-lags", f"models with lags are not tried: {_no_lags(series)}"
    elif method == "lagged" and len(lib.cycles) < 2:
        yield (
            "no-lags",
            "lags are chosen on held-out cycles, and there is one: the model is ridge",
        )
    if drift.without_lag:
        yield (
            "no-lag-found",
            "lagged, but no lag was found: no time constant lowers the held-out error enough, "
            "the model is ridge on the sensors as they were read",
        )


def _no_lags(series: Series) -> str:
    if not series.complete:
        return "there are too many readings"
    if np.isnan(series.kept().time).any():
        return "no times are given"
    return "the times do not run on within the cycles"


def _of_reference(drift: ComponentDrift) -> Iterator[tuple[str, str]]:
    """Drift that was zeroed far from the reference: its zero is extrapolated."""
    span, reference = drift.estimate.temperature_range, drift.estimate.reference
    if span is None or not len(span):
        return
    beyond = (span[:, 0] > reference + FAR) | (span[:, 1] < reference - FAR)
    if beyond.mean() > 0.5:
        yield (
            "reference-not-read",
            f"the sensors were read from {span[:, 0].min():.4g} to {span[:, 1].max():.4g} degC, "
            f"not at the reference of {reference:g} degC: predictions are of the drift from there "
            "and extrapolate (reference_temperature_degC of the machine file)",
        )


def _of_held_out(lib: Library, drift: ComponentDrift) -> Iterator[tuple[str, str]]:
    """What the next warm-up may show that the cycles of the fit do not."""
    if len(lib.cycles) < FEWEST_NESTED:
        many = "no cycles are told apart" if len(lib.cycles) < 2 else "there are two cycles only"
        yield (
            "not-held-out",
            f"{many}: no cycle can be held out of fit and choice, and the fit's own "
            "rms says little of the next warm-up (three cycles or more, column 'cycle')",
        )
    held = drift.held_out
    if held is not None and drift.rms_after > 0 and held.after > OVER_FIT * drift.rms_after:
        yield (
            "over-fit",
            f"rms {drift.shown(drift.rms_after)} on the cycles of the fit, "
            f"{drift.shown(held.after)} on held-out ones: believe the latter",
        )
    if held is not None and held.after > held.before:
        text = "on held-out cycles the temperatures make it worse: the model is not to be used"
        yield "no-better", text
    elif held is not None and drift.estimate.sensors:
        yield from _of_gain(held)


def _of_gain(held: HeldOut) -> Iterator[tuple[str, str]]:
    """A model that explains no more of held-out cycles than chance does."""
    if held.after > (1 - LEAST_GAIN) * held.before and not _consistent(held):
        percent = 100 * (1 - held.after / held.before)
        text = (
            f"on held-out cycles the rms falls by {percent:.2g} % only, no more than they scatter: "
            "the temperatures explain next to nothing, the model is not to be used"
        )
        yield "no-better", text


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
    series: Series, lib: Library, sensors: tuple[str, ...], rest: Rest, drift: ComponentDrift
) -> list[Finding]:
    """Sensors that do not move, and readings whose cycles begin apart."""
    span = series.range()
    still = [sensors[s] for s in range(len(sensors)) if span[s, 0] == span[s, 1]]
    found = [
        Warned(
            code="sensor-still",
            message=f"{name} reads {span[sensors.index(name), 0]:g} degC throughout: left out",
        )
        for name in still
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
            text = (
                f"{drift.name}{where}: the cycles begin up to {drift.shown(float(apart))} apart "
                "at the same temperatures: where the probe was set anew, count each cycle's "
                "readings from its first"
            )
            return [Warned(code="cycles-begin-apart", message=text)]
    return []
