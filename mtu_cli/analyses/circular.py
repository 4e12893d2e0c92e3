"""A circular test (ISO 230-4): its figures, and its causes by one joint fit of all traces.

The angle t counts from the plane's first axis A to its second, B; s = +1 counter-clockwise, -1
clockwise. Of first order a radial deviation is the error of position along the radius:
delta = ex cos t + ey sin t.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.files.readings import Trace, Traces
from mtu_cli.findings import Finding, error, finding
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import Block, SerialFit
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
LEAST_COVERED = 330.0
"""Degrees that a trace covers: of less it is an arc."""
FEWEST_CYCLES = 4.0
"""Cycles of a pitch over the diameter."""
MEANING = {
    "scale-mismatch": "scale error of the first axis minus that of the second",
    "squareness": "lean of the second axis towards the first: the angle is 90 degrees minus it",
    "servo-mismatch": "lag of the first axis minus that of the second",
    "squareness-or-servo": "sin 2t of both together: one direction does not separate them",
    "backlash-a": "lost motion of the first axis: reverse minus forward",
    "backlash-b": "lost motion of the second axis: reverse minus forward",
    "straightness-a": "three lobes sin 3t: a quarter of the bow across the first axis",
    "straightness-b": "three lobes cos 3t: minus a quarter of the bow across the second axis",
    "reversal-spike-a": "height of the spike after reversals of the first axis",
    "reversal-spike-b": "height of the spike after reversals of the second axis",
    "centre-offset": "distance of the circle's centre from the given one: of the set-up",
    "cyclic-a-forward": "amplitude of the pitch's wave, first axis, forward",
    "cyclic-a-reverse": "amplitude of the pitch's wave, first axis, reverse",
    "cyclic-b-forward": "amplitude of the pitch's wave, second axis, forward",
    "cyclic-b-reverse": "amplitude of the pitch's wave, second axis, reverse",
}
CYCLIC = [name for name in MEANING if name.startswith("cyclic")]


class Cause(NamedTuple):
    """A term of the diagnosis in mm, rad or s with its u, nan where it is not estimable; `size` of
    its unit; `range` peak to peak, `exceeds` whether it is above 2 u, `share` of the sum of all
    terms' ranges, nan of the set-up.
    """

    name: str
    value: float
    u: float
    unit: str
    size: float
    range: float
    exceeds: bool
    share: float = math.nan


class TraceFigures(NamedTuple):
    """The figures of one trace, mm: `G_lsc` about its least-squares circle; F from the nominal
    radius about the given centre.
    """

    trace: Trace
    G_lsc: float
    F_max: float
    F_min: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CircularResult:
    """Figures of all traces, the causes, and the remainder of the joint fit, mm; `fitted` is its
    prediction of each trace.
    """

    traces: Traces
    figures: tuple[TraceFigures, ...]
    G_bidirectional: float
    D: float
    causes: tuple[Cause, ...]
    remainder_rms: float
    remainder_range: float
    fitted: tuple[FloatArray, ...]
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


def about_circle(angle: FloatArray, deviation: FloatArray) -> FloatArray:
    """Residuals of a trace (n,) about its least-squares circle."""
    X = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    return np.asarray(deviation - X @ np.linalg.lstsq(X, deviation, rcond=None)[0])


class Fit(NamedTuple):
    """Parameters (p,), their covariance and u (nan: not estimable), residuals of each trace with
    nan in the windows, designs, autocovariances (lags,) of the residuals.
    """

    beta: FloatArray
    covariance: FloatArray
    u: FloatArray
    residuals: list[FloatArray]
    designs: list[FloatArray]
    acov: FloatArray


def waves(trace: Trace, radius: float, axis: int, pitch: float) -> FloatArray:
    """Sin and cos (n, 4) of 2 pi x/pitch of an axis, x = R cos t or R sin t, as radial deviations,
    where the axis moves forward and where in reverse.
    """
    along = np.cos(trace.angle - axis * math.pi / 2)
    forward = (-trace.sign * np.sin(trace.angle - axis * math.pi / 2) > 0)[:, None]
    phase = 2 * math.pi * radius * along / pitch
    wave = np.column_stack([np.sin(phase), np.cos(phase)]) * along[:, None]
    return np.hstack([wave * forward, wave * ~forward])


def joint_fit(traces: Traces, pitches: Sequence[float] = ()) -> Fit:
    """One least-squares fit of all traces: TERMS in common, a circle for each trace, and waves
    of `pitches`. Waves of fewer than FEWEST_CYCLES over the diameter, or of fewer than four
    samples, are 0.

    Samples that follow each other are correlated: generalised least squares by restricted
    likelihood (`stats.serial`), of many traces by the scatter between these. Long traces go in as
    means of neighbours, of samples and design alike, which leaves the equations exact.
    """
    count, designs, masks, blocks = len(traces.traces), [], [], []
    feeds = np.array([trace.feed for trace in traces.traces])
    speeds = feeds / feeds.mean() if np.isfinite(feeds).all() else np.ones(count)
    step = max(float(np.median(np.abs(np.diff(trace.angle)))) for trace in traces.traces)
    limit = MOST_SAMPLES * (3 if pitches else 1)
    reversals = [at for ends in REVERSALS.values() for at in ends]
    for k, (trace, speed) in enumerate(zip(traces.traces, speeds.tolist(), strict=True)):
        t, circle = trace.angle, np.zeros((len(trace.angle), 3 * count))
        circle[:, 3 * k : 3 * k + 3] = np.column_stack([np.ones_like(t), np.cos(t), np.sin(t)])
        columns = [terms(t, trace.sign, speed), circle]
        for axis, pitch in enumerate(pitches):
            valid = 2 * traces.radius / pitch >= FEWEST_CYCLES and traces.radius * step <= pitch / 4
            columns.append(valid * waves(trace, traces.radius, axis, pitch))
        design = np.hstack(columns)
        mask = np.all([after(t, trace.sign, at) > WINDOW for at in reversals], axis=0)
        group = np.arange(mask.sum()) // (int(mask.sum()) // limit + 1)
        rows = np.column_stack([design[mask], trace.deviation[mask]])
        means = [np.bincount(group, x) / np.bincount(group) for x in rows.T]
        if len(group):
            X = np.column_stack(means[:-1])
            blocks.append(Block(X, means[-1], k, np.zeros((X.shape[1],) * 2)))
        designs.append(design)
        masks.append(mask)
    n, p = sum(len(block.y) for block in blocks), designs[0].shape[1]
    if n < p + 2:
        what, expected = f"{n} samples away from the reversals", "samples around the circle"
        raise error("too-little-data", what=what, expected=expected)
    with one_blas_thread():
        fit = SerialFit(blocks, levels=False)
    parameters = fit.combinations(np.eye(p))
    beta, covariance = fit.transform @ fit.beta, fit.transform @ fit.covariance @ fit.transform.T
    residuals = [
        np.where(mask, trace.deviation - design @ beta, np.nan)
        for trace, design, mask in zip(traces.traces, designs, masks, strict=True)
    ]
    acov = []
    for k in range(min(map(len, residuals)) // 4):
        # Mean product of residuals k samples apart.
        products = np.concatenate([e[k:] * e[: len(e) - k] for e in residuals])
        acov.append(float(np.nanmean(products)) if np.isfinite(products).any() else 0.0)
    u = np.where(np.isfinite(parameters.u), parameters.u, np.nan)
    return Fit(beta, covariance, u, residuals, designs, np.array(acov))


def diagnose(traces: Traces, pitches: Sequence[float] = ()) -> CircularResult:
    """The figures of ISO 230-4 and the causes of the deviations; with the `pitches` (mm) of the
    axes' ball screws or scales, one of both or one of each, their cyclic errors, too.
    """
    fit = joint_fit(traces, (pitches[0], pitches[-1]) if pitches else ())
    R = traces.radius
    speed = float(np.mean([trace.feed for trace in traces.traces])) / 60.0
    timed = math.isfinite(speed) and speed > 0
    units = {
        "scale-mismatch": ("um/m", 2.0 / R, 1e-6),
        "squareness": ("um/m", 2.0 / R, 1e-6),
        "servo-mismatch": ("ms", 2.0 / speed if timed else math.nan, 1e-3),
    }

    def cause(name: str, value: float, u: float, span: float) -> Cause:
        """Of a value and u in mm whose range is `span` times it."""
        unit, factor, size = units.get(name, ("um", 1.0, UM))
        extent, exceeds = span * abs(value), abs(value) > 2 * u
        return Cause(name, value * factor, u * factor, unit, size, extent, exceeds)

    p, n = len(fit.beta), len(traces.traces)
    parameters, ranges = np.eye(p), np.ptp(terms(np.linspace(0, 2 * math.pi, 1441), 1.0), axis=0)
    items = [
        cause(name, float(beta) if u == u else math.nan, float(u), float(span))
        for name, beta, u, span in zip(TERMS, fit.beta, fit.u, ranges, strict=False)
    ]
    ways = dict.fromkeys(trace.direction for trace in traces.traces)
    unknown = [each.name for each in items if math.isnan(each.range)]
    if len(ways) == 1 and unknown == ["squareness", "servo-mismatch"]:
        # The coefficient of sin 2t, of both together.
        g = parameters[TERMS.index("squareness")]
        g = g + traces.traces[0].sign * parameters[TERMS.index("servo-mismatch")]
        u = math.sqrt(float(g @ fit.covariance @ g))
        items.append(cause("squareness-or-servo", float(g @ fit.beta), u, 2))
    items += [cause(name, *_spike(traces, fit, name), 1) for name in REVERSALS]
    for i, name in enumerate(CYCLIC if pitches else ()):
        first = len(TERMS) + 3 * n + 2 * i
        wave = _length(fit, parameters[first : first + 2])
        items.append(cause(name, *(wave if np.isfinite(fit.u[first]) else (math.nan,) * 2), 2))
    total = float(np.nansum([each.range for each in items]))
    causes = [each._replace(share=each.range / total if total > 0 else math.nan) for each in items]
    # The mean offset of the traces' centres.
    circles = parameters[len(TERMS) : len(TERMS) + 3 * n].reshape(n, 3, p)
    causes.append(cause("centre-offset", *_length(fit, circles.mean(axis=0)[1:]), 2))
    means = [np.mean([t.deviation.mean() for t in traces.traces if t.direction == way])
             for way in ways]  # fmt: skip
    both, residuals = len(ways) > 1, np.concatenate(fit.residuals)
    angle = np.concatenate([trace.angle for trace in traces.traces])
    deviation = np.concatenate([trace.deviation for trace in traces.traces])
    return CircularResult(
        traces=traces,
        figures=tuple(
            TraceFigures(
                each,
                float(np.ptp(about_circle(each.angle, each.deviation))),
                float(each.deviation.max()),
                float(each.deviation.min()),
            )
            for each in traces.traces
        ),
        G_bidirectional=float(np.ptp(about_circle(angle, deviation))) if both else math.nan,
        D=float(np.mean(means)) if both else math.nan,
        causes=tuple(causes),
        remainder_rms=float(np.sqrt(np.nanmean(residuals**2))),
        remainder_range=float(np.nanmax(residuals) - np.nanmin(residuals)),
        fitted=tuple(design @ fit.beta for design in fit.designs),
        warnings=tuple(_warnings(traces, causes, both, timed)),
    )


def _spike(traces: Traces, fit: Fit, name: str) -> tuple[float, float]:
    """The height of a bump sin^2(pi past/WINDOW) after the reversals of an axis, of the residuals
    of the joint fit there, and its u.
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
                             len(fit.acov) - 1)  # fmt: skip
            variance += max(float(h @ fit.acov[lag] @ h), float(fit.acov[0] * (h @ h)))
    h, e, X = np.concatenate(shape), np.concatenate(rest), np.vstack(rows)
    total = float(h @ h)
    if total < 1.0:
        return math.nan, math.nan
    g = X.T @ h / total
    return float(h @ e) / total, math.sqrt(variance / total**2 + max(g @ fit.covariance @ g, 0.0))


def _length(fit: Fit, pick: FloatArray) -> tuple[float, float]:
    """The length of two combinations `pick` (2, p) of the parameters, and its u."""
    pair, C = pick @ fit.beta, pick @ fit.covariance @ pick.T
    value = float(np.hypot(*pair))
    g = pair / value if value > 0 else np.full(2, math.sqrt(0.5))
    return value, math.sqrt(max(float(g @ C @ g), 0.0))


def _warnings(traces: Traces, causes: list[Cause], both: bool, timed: bool) -> Iterator[Finding]:
    """Of traces that are no whole circle, by their largest gap, and of every cause and figure that
    is unknown. Feeds separate squareness and servo lag of one direction, too.
    """
    coverage = []
    for trace in traces.traces:
        angle = np.sort(np.mod(trace.angle, 2 * math.pi))
        gap = np.diff(angle, append=angle[0] + 2 * math.pi).max()
        coverage.append(math.degrees(2 * math.pi - gap))
    if min(coverage) < LEAST_COVERED:
        where = traces.traces[int(np.argmin(coverage))].file
        value = f"{min(coverage):.0f} degrees"
        yield finding("partial-circle", file=where, value=value, expected="360 degrees")
    unknown = [x.name for x in causes if math.isnan(x.range)]
    alike = ["squareness", "servo-mismatch"]
    if both or not {*alike} <= {*unknown}:
        alike = []
    if not both:
        quantity = "causes and figures" if alike else "figures"
        reason = "traces in one direction only"
        reason += ": squareness and servo lag look alike" if alike else ""
        names = [*alike, "G_bidirectional", "D"]
        yield finding("not-estimable", quantity=quantity, names=names, reason=reason)
    if not timed and "servo-mismatch" not in unknown:
        reason = "no feed is stated (--feed, or a column feed_mm_min)"
        names = ["servo-mismatch"]
        yield finding("not-estimable", quantity="time", names=names, reason=reason)
    if rest := [name for name in unknown if name not in alike]:
        reason = "the samples do not separate them from the other terms"
        yield finding("not-estimable", quantity="causes", names=rest, reason=reason)
