"""A circular test (ISO 230-4): its figures, and its causes by one joint fit of all traces.

The angle t counts from the plane's first axis A to its second, B; s = +1 counter-clockwise, -1
clockwise. Of first order a radial deviation is the error of position along the radius:
delta = ex cos t + ey sin t.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.files.traces import Trace, Traces
from mtu_cli.findings import Finding, error, finding
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import Block, serial_fit
from mtu_cli.stats.threads import one_blas_thread
from mtu_cli.units import UM

WINDOW = math.radians(5.0)
"""After a reversal: samples there are left out of the joint fit, and show the spike."""
MOST_SAMPLES = 240
"""Of a trace, that the joint fit takes."""
REVERSALS = {"reversal-spike-a": (0.0, math.pi), "reversal-spike-b": (math.pi / 2, 1.5 * math.pi)}
"""Angles at which an axis reverses."""
TERMS = (
    *("scale-mismatch", "squareness", "servo-mismatch", "backlash-a", "backlash-b"),
    *("straightness-a", "straightness-b"),
)
CYCLIC = ("cyclic-a-forward", "cyclic-a-reverse", "cyclic-b-forward", "cyclic-b-reverse")
FEWEST_CYCLES = 4.0
"""Cycles of a pitch over the diameter."""
MEANING = {
    "scale-mismatch": "scale error of the first axis minus that of the second",
    "squareness": "lean of the second axis towards the first: the angle is 90 degrees minus it",
    "servo-mismatch": "lag of the first axis minus that of the second",
    "backlash-a": "lost motion of the first axis: reverse minus forward",
    "backlash-b": "lost motion of the second axis: reverse minus forward",
    "straightness-a": "three lobes sin 3t: a quarter of the bow across the first axis",
    "straightness-b": "three lobes cos 3t: minus a quarter of the bow across the second axis",
    "reversal-spike-a": "height of the spike after reversals of the first axis",
    "reversal-spike-b": "height of the spike after reversals of the second axis",
    "centre-offset": "distance of the circle's centre from the given one: of the set-up",
} | {
    name: f"amplitude of the pitch's wave, {axis} axis, {way}"
    for name, (axis, way) in zip(
        CYCLIC, [(a, w) for a in ("first", "second") for w in ("forward", "reverse")], strict=True
    )
}


class Cause(NamedTuple):
    """A term of the diagnosis in mm, rad or s with its u, nan where it is not estimable; `size` of
    its unit; `range` peak to peak, `share` of the sum of all terms' ranges, nan of the set-up.
    """

    name: str
    value: float
    u: float
    unit: str
    size: float
    range: float
    share: float = math.nan

    @property
    def meaning(self) -> str:
        """What it is."""
        return MEANING[self.name]


class TraceFigures(NamedTuple):
    """The figures of one trace, mm: `G_lsc` about its least-squares circle with this centre; F
    from the nominal radius about the given centre.
    """

    trace: Trace
    G_lsc: float
    F_max: float
    F_min: float
    centre_a: float
    centre_b: float


class Stated(NamedTuple):
    """A feature that a ballbar states itself, in its own unit and with its own sign."""

    file: str
    feature: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CircularResult:
    """Figures of all traces, the causes, and the remainder of the joint fit, mm; `fitted` is what
    it says of each trace; `instrument` what the instrument states. Without traces that is all.
    """

    traces: Traces
    figures: tuple[TraceFigures, ...] = ()
    G_bidirectional: float = math.nan
    D: float = math.nan
    causes: tuple[Cause, ...] = ()
    remainder_rms: float = math.nan
    remainder_range: float = math.nan
    fitted: tuple[FloatArray, ...] = ()
    instrument: tuple[Stated, ...] = ()
    warnings: tuple[Finding, ...] = ()

    def cause(self, name: str) -> Cause:
        """A cause by its name."""
        return next(each for each in self.causes if each.name == name)


def terms(angle: FloatArray, sign: float, speed: float = 1.0) -> FloatArray:
    """Radial deviation (n, terms) of each of TERMS at unit size, mm.

    Scales kA, kB: (kA - kB) R/2 cos 2t; squareness eps: eps R/2 sin 2t; servo lags: s (tA - tB)
    v/2 sin 2t, v relative as `speed`; lost motion ex = -b/2 sign(dx/dt): s b/2 sign(sin t) cos t,
    of B -s b/2 sign(cos t) sin t; straightness: sin 3t and cos 3t, as a bow ey = c (x/R)^2 is
    c/4 (sin t + sin 3t) and ex = c (y/R)^2 is c/4 (cos t - cos 3t).
    """
    t = angle
    return np.column_stack([
        np.cos(2 * t), np.sin(2 * t), sign * speed * np.sin(2 * t),
        sign * np.sign(np.sin(t)) * np.cos(t) / 2, -sign * np.sign(np.cos(t)) * np.sin(t) / 2,
        np.sin(3 * t), np.cos(3 * t),
    ])  # fmt: skip


def after(angle: FloatArray, sign: int, reversal: float) -> FloatArray:
    """How far the travel is past a reversal, rad, from 0 to 2 pi."""
    past = np.mod(sign * (angle - reversal), 2 * math.pi)
    return np.where(past > 2 * math.pi - 1e-9, 0.0, past)


def circle_fit(angle: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean radius deviation and centre (3,) of the least-squares circle, and what is left (n,)."""
    X = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    result = np.linalg.lstsq(X, deviation, rcond=None)[0]
    return result, deviation - X @ result


class Fit(NamedTuple):
    """Parameters (p,), their covariance and u (nan: not estimable), residuals of each trace with
    nan in the windows, designs, autocovariances (lags,) of the residuals.
    """

    beta: FloatArray
    covariance: FloatArray
    u: FloatArray
    left: list[FloatArray]
    designs: list[FloatArray]
    lagged: FloatArray


def _designs(traces: Traces) -> list[FloatArray]:
    """Of each trace (n, p): TERMS in common, a circle of each trace's own."""
    count, result = len(traces.traces), []
    feeds = np.array([trace.feed for trace in traces.traces])
    speeds = feeds / feeds.mean() if np.isfinite(feeds).all() else np.ones(count)
    for k, (trace, speed) in enumerate(zip(traces.traces, speeds.tolist(), strict=True)):
        t, circle = trace.angle, np.zeros((len(trace.angle), 3 * count))
        circle[:, 3 * k : 3 * k + 3] = np.column_stack([np.ones_like(t), np.cos(t), np.sin(t)])
        result.append(np.column_stack([terms(t, trace.sign, speed), circle]))
    return result


def joint_fit(traces: Traces) -> Fit:
    """One least-squares fit of all traces.

    Samples that follow each other are correlated: generalised least squares by restricted
    likelihood (`stats.serial`), of many traces by the scatter between these. Long traces go in as
    means of neighbours, of samples and design alike, which leaves the equations exact.
    """
    designs, blocks = _designs(traces), []
    used = [~_in_window(trace) for trace in traces.traces]
    for k, (trace, design, own) in enumerate(zip(traces.traces, designs, used, strict=True)):
        group = np.arange(own.sum()) // (int(own.sum()) // MOST_SAMPLES + 1)
        rows = np.column_stack([design[own], trace.deviation[own]])
        means = [np.bincount(group, x) / np.bincount(group) for x in rows.T]
        if len(group):
            X = np.column_stack(means[:-1])
            blocks.append(Block(X, means[-1], k, np.zeros((X.shape[1],) * 2)))
    n, p = sum(len(block.y) for block in blocks), designs[0].shape[1]
    if n < p + 2:
        what, expected = f"{n} samples away from the reversals", "samples around the circle"
        raise error("too-little-data", what=what, expected=expected)
    with one_blas_thread():
        fit = serial_fit(blocks, levels=False)
    stated = fit.combinations(np.eye(p))
    beta, covariance = fit.transform @ fit.beta, fit.transform @ fit.covariance @ fit.transform.T
    left = [
        np.where(own, trace.deviation - design @ beta, np.nan)
        for trace, design, own in zip(traces.traces, designs, used, strict=True)
    ]
    most = min(map(len, left)) // 4
    lagged = np.array([_lagged(left, k) for k in range(most)])
    u = np.where(np.isfinite(stated.u), stated.u, np.nan)
    return Fit(beta, covariance, u, left, designs, lagged)


def waves(traces: Traces, axis: int, pitch: float) -> list[FloatArray]:
    """Of each trace (n, 4): sin and cos of 2 pi x/pitch of an axis, x = R cos t or R sin t, as
    radial deviations, where the axis moves forward and where in reverse.
    """
    result = []
    for trace in traces.traces:
        along = np.cos(trace.angle - axis * math.pi / 2)
        forward = (-trace.sign * np.sin(trace.angle - axis * math.pi / 2) > 0)[:, None]
        phase = 2 * math.pi * traces.radius * along / pitch
        wave = np.column_stack([np.sin(phase), np.cos(phase)]) * along[:, None]
        result.append(np.hstack([wave * forward, wave * ~forward]))
    return result


def _cyclic(traces: Traces, pitches: tuple[float, float]) -> tuple[Traces, list[Cause]]:
    """The traces without the waves of the pitches, and these: amplitudes in each direction.

    All terms and waves by one least-squares fit, b = A X'y with A = (X'X)^-1; its covariance is
    A X'G X A with the autocovariance G of the remainder, up to where that first falls to 0. Waves
    of fewer than FEWEST_CYCLES over the diameter, or of fewer than four samples, are not estimable.
    """
    step = max(float(np.median(np.abs(np.diff(trace.angle)))) for trace in traces.traces)
    there = [2 * traces.radius / p >= FEWEST_CYCLES and traces.radius * step <= p / 4
             for p in pitches]  # fmt: skip
    own = [
        np.hstack([wave * here for wave, here in zip(each, there, strict=True)])
        for each in zip(*(waves(traces, i, p) for i, p in enumerate(pitches)), strict=True)
    ]
    used = [~_in_window(trace) for trace in traces.traces]
    X = [np.hstack([wave, design]) * u[:, None]
         for wave, design, u in zip(own, _designs(traces), used, strict=True)]  # fmt: skip
    y = [trace.deviation * u for trace, u in zip(traces.traces, used, strict=True)]
    A = np.linalg.pinv(sum(each.T @ each for each in X))
    beta = A @ sum(each.T @ value for each, value in zip(X, y, strict=True))
    left = [np.where(u, value - each @ beta, np.nan)
            for each, value, u in zip(X, y, used, strict=True)]  # fmt: skip
    S = np.zeros_like(A)
    for k in range(min(map(len, left)) // 4):
        if (lagged := _lagged(left, k)) <= 0:
            break
        products = sum(each[k:].T @ each[: len(each) - k] for each in X)
        S += lagged * (products + products.T * (k > 0))
    C, causes = A @ S @ A, []
    for i, name in enumerate(CYCLIC):
        at = slice(2 * i, 2 * i + 2)
        value = float(np.hypot(*beta[at]))
        g = beta[at] / value if value else np.full(2, math.sqrt(0.5))
        value, u = (value, math.sqrt(g @ C[at, at] @ g)) if there[i // 2] else (math.nan, math.nan)
        causes.append(Cause(name, value, u, "um", UM, 2 * value))
    without = tuple(replace(trace, deviation=trace.deviation - wave @ beta[:8])
                    for trace, wave in zip(traces.traces, own, strict=True))  # fmt: skip
    return replace(traces, traces=without), causes


def _in_window(trace: Trace) -> np.ndarray:
    past = [after(trace.angle, trace.sign, at) for ends in REVERSALS.values() for at in ends]
    return np.asarray((np.array(past) <= WINDOW).any(axis=0))


def _lagged(left: list[FloatArray], k: int) -> float:
    """Mean product of residuals k samples apart."""
    products = np.concatenate([own[k:] * own[: len(own) - k] for own in left])
    return float(np.nanmean(products)) if np.isfinite(products).any() else 0.0


def diagnose(
    traces: Traces,
    pitches: tuple[float, float] | None = None,
    features: Mapping[str, Mapping[str, Any]] | None = None,
) -> CircularResult:
    """The figures of ISO 230-4 and the causes of the deviations; with the `pitches` (mm) of the
    axes' ball screws or scales their cyclic errors, too; `features` by file, feature: those that
    the instrument states with `value` and `unit`.
    """
    instrument = tuple(
        Stated(file, name, each["value"], each["unit"])
        for file, stated in (features or {}).items()
        for name, each in stated.items()
    )
    if not traces.traces:
        return CircularResult(traces=traces, instrument=instrument)
    plain, cyclic = (traces, list[Cause]()) if pitches is None else _cyclic(traces, pitches)
    fit, R = joint_fit(plain), traces.radius
    speed = float(np.mean([trace.feed for trace in traces.traces])) / 60.0
    timed = math.isfinite(speed) and speed > 0
    units = {
        "scale-mismatch": ("um/m", 2.0 / R, 1e-6),
        "squareness": ("um/m", 2.0 / R, 1e-6),
        "servo-mismatch": ("ms", 2.0 / speed if timed else math.nan, 1e-3),
    }
    ranges = np.ptp(terms(np.linspace(0, 2 * math.pi, 1441), 1.0), axis=0)
    found = []
    for i, name in enumerate(TERMS):
        unit, factor, size = units.get(name, ("um", 1.0, UM))
        u = float(fit.u[i])
        value = float(fit.beta[i]) if u == u else math.nan
        span = abs(value) * float(ranges[i])
        found.append(Cause(name, value * factor, u * factor, unit, size, span))
    for name in REVERSALS:
        value, u = _spike(plain, fit, name)
        found.append(Cause(name, value, u, "um", UM, abs(value)))
    found += cyclic
    total = float(np.nansum([each.range for each in found]))
    causes = [each._replace(share=each.range / total if total > 0 else math.nan) for each in found]
    causes.append(_centre(fit, len(traces.traces)))
    figures = tuple(_figures(trace) for trace in traces.traces)
    both = len({trace.direction for trace in traces.traces}) > 1
    angle = np.concatenate([trace.angle for trace in traces.traces])
    deviation = np.concatenate([trace.deviation for trace in traces.traces])
    means = [
        np.mean([t.deviation.mean() for t in traces.traces if t.direction == way])
        for way in dict.fromkeys(trace.direction for trace in traces.traces)
    ]
    left = np.concatenate(fit.left)
    return CircularResult(
        traces=traces,
        figures=figures,
        G_bidirectional=float(np.ptp(circle_fit(angle, deviation)[1])) if both else math.nan,
        D=float(np.mean(means)) if both else math.nan,
        causes=tuple(causes),
        remainder_rms=float(np.sqrt(np.nanmean(left**2))),
        remainder_range=float(np.nanmax(left) - np.nanmin(left)),
        fitted=tuple(
            design @ fit.beta + whole.deviation - own.deviation
            for design, whole, own in zip(fit.designs, traces.traces, plain.traces, strict=True)
        ),
        instrument=instrument,
        warnings=tuple(_warnings(causes, both, timed)),
    )


def _spike(traces: Traces, fit: Fit, name: str) -> tuple[float, float]:
    """The height of a bump sin^2(pi past/WINDOW) after the reversals of an axis, of what the joint
    fit leaves there, and its u.
    """
    shape, rest, rows, variance = [], [], [], 0.0
    for trace, design in zip(traces.traces, fit.designs, strict=True):
        for at in REVERSALS[name]:
            past = after(trace.angle, trace.sign, at)
            inside = (past <= WINDOW) & (past > 0)
            h = np.sin(math.pi * past[inside] / WINDOW) ** 2
            shape.append(h)
            rest.append(trace.deviation[inside] - design[inside] @ fit.beta)
            rows.append(design[inside])
            lag = np.minimum(np.abs(np.subtract.outer(*[np.arange(len(h))] * 2)),
                             len(fit.lagged) - 1)  # fmt: skip
            variance += max(float(h @ fit.lagged[lag] @ h), float(fit.lagged[0] * (h @ h)))
    h, e, X = np.concatenate(shape), np.concatenate(rest), np.vstack(rows)
    total = float(h @ h)
    if total < 1.0:
        return math.nan, math.nan
    g = X.T @ h / total
    return float(h @ e) / total, math.sqrt(variance / total**2 + max(g @ fit.covariance @ g, 0.0))


def _centre(fit: Fit, count: int) -> Cause:
    """The mean offset of the traces' centres."""
    pick = np.zeros((2, len(fit.beta)))
    for k in range(count):
        pick[0, len(TERMS) + 3 * k + 1] = pick[1, len(TERMS) + 3 * k + 2] = 1.0 / count
    centre, C = pick @ fit.beta, pick @ fit.covariance @ pick.T
    value = float(np.hypot(*centre))
    g = centre / value if value > 0 else np.full(2, math.sqrt(0.5))
    u = math.sqrt(max(float(g @ C @ g), 0.0))
    return Cause("centre-offset", value, u, "um", UM, 2 * value)


def _figures(trace: Trace) -> TraceFigures:
    circle, left = circle_fit(trace.angle, trace.deviation)
    return TraceFigures(
        trace, float(np.ptp(left)), float(trace.deviation.max()), float(trace.deviation.min()),
        float(circle[1]), float(circle[2]),
    )  # fmt: skip


def _warnings(causes: list[Cause], both: bool, timed: bool) -> Iterator[Finding]:
    unknown = [x.name for x in causes if math.isnan(x.value) and x.name != "servo-mismatch"]
    if not both:
        reason = "traces in one direction only: squareness and servo lag look alike"
        names = ["squareness", "servo-mismatch", "G_bidirectional", "D"]
        yield finding("not-estimable", quantity="value", names=names, reason=reason)
    elif not timed:
        reason = "no feed is stated (--feed, or a column feed_mm_min)"
        names = ["servo-mismatch"]
        yield finding("not-estimable", quantity="time", names=names, reason=reason)
    if rest := [name for name in unknown if both or name != "squareness"]:
        reason = "the samples do not separate them from the other terms"
        yield finding("not-estimable", quantity="value", names=rest, reason=reason)
