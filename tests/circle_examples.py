"""Traces of a circular test that are made of known causes, by the equations of motion."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from mtu_cli.files.readings import Trace, Traces
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True)
class Causes:
    """Of a machine with axes a and b; mm, rad, s, mm/min."""

    radius: float = 150.0
    feed: float = 2000.0
    centre: tuple[float, float] = (0.005, -0.003)
    scale: tuple[float, float] = (60e-6, 40e-6)
    lean: float = 30e-6
    lag: tuple[float, float] = (1.5e-3, 1.0e-3)
    backlash: tuple[float, float] = (0.004, 0.002)
    bow: tuple[float, float] = (0.002, -0.001)
    spike: tuple[float, float] = (0.003, 0.0015)

    def expected(self) -> dict[str, float]:
        """What the diagnosis names each, in its unit."""
        return {
            "scale-mismatch": (self.scale[0] - self.scale[1]) * 1e6,
            "squareness": self.lean * 1e6,
            "servo-mismatch": (self.lag[0] - self.lag[1]) * 1e3,
            "backlash-a": self.backlash[0] * 1e3,
            "backlash-b": self.backlash[1] * 1e3,
            "straightness-a": self.bow[0] / 4 * 1e3,
            "straightness-b": -self.bow[1] / 4 * 1e3,
            "reversal-spike-a": self.spike[0] * 1e3,
            "reversal-spike-b": self.spike[1] * 1e3,
            # A bow has a first harmonic, too, which looks like an offset.
            "centre-offset": 1e3
            * float(np.hypot(self.centre[0] + self.bow[1] / 4, self.centre[1] + self.bow[0] / 4)),
        }


def radius_error(angle: FloatArray, sign: int, causes: Causes, *, exact: bool) -> FloatArray:
    """Radial deviation (n,): the displaced point's distance from the given centre, `exact` or of
    first order.
    """
    R, c, s = causes.radius, np.cos(angle), np.sin(angle)
    v = causes.feed / 60.0
    vx, vy = -sign * v * s, sign * v * c
    ex = causes.centre[0] + causes.scale[0] * R * c + causes.lean * R * s - causes.lag[0] * vx
    ey = causes.centre[1] + causes.scale[1] * R * s - causes.lag[1] * vy
    ex += -causes.backlash[0] / 2 * np.sign(vx) + causes.bow[1] * s**2
    ey += -causes.backlash[1] / 2 * np.sign(vy) + causes.bow[0] * c**2
    found: FloatArray = ex * c + ey * s
    if exact:
        found = np.hypot(R * c + ex, R * s + ey) - R
    for height, first in zip(causes.spike, (0.0, np.pi / 2), strict=True):
        for at in (first, first + np.pi):
            past = np.degrees(np.mod(sign * (angle - at), 2 * np.pi))
            found = found + height * np.where(past <= 5, np.sin(np.pi * past / 5) ** 2, 0.0)
    return found


def noise(rng: np.random.Generator, n: int, s: float, phi: float) -> FloatArray:
    """Errors (n,) of which each follows the last: autocorrelation phi^k."""
    steps = rng.standard_normal(n) * np.sqrt(1 - phi**2) * s
    steps[0] = rng.standard_normal() * s
    return np.asarray(lfilter([1.0], [1.0, -phi], steps))


def made(
    causes: Causes,
    ways: str = "ccw cw",
    n: int = 720,
    s: float = 0.0,
    phi: float = 0.9,
    seed: int = 0,
    exact: bool = False,
) -> Traces:
    """A trace in each direction, with noise of standard deviation `s`, mm."""
    rng = np.random.default_rng(seed)
    angle = np.radians((np.arange(n) + 0.4) * 360.0 / n)
    traces = []
    for number, way in enumerate(ways.split(), 1):
        own = Trace(
            file="made.csv", number=number, direction=way, feed=causes.feed, angle=angle,
            deviation=np.zeros(n),
        )  # fmt: skip
        deviation = radius_error(angle, own.sign, causes, exact=exact)
        traces.append(replace(own, deviation=deviation + noise(rng, n, s, phi) * (s > 0)))
    return Traces(traces=tuple(traces), plane="XY", radius=causes.radius, sources=())


def csv_text(traces: Traces, columns: str = "direction radius_mm feed_mm_min plane pass") -> str:
    """The traces as a file, which says that it is made."""
    names = columns.split()
    lines = ["# Made for a test: no machine was measured."]
    lines.append(",".join(["angle_deg", "deviation_um", *names]))
    for trace in traces.traces:
        known = {
            "direction": trace.direction, "radius_mm": f"{traces.radius:g}",
            "feed_mm_min": f"{trace.feed:g}", "plane": str(traces.plane),
            "pass": str(trace.number),
        }  # fmt: skip
        rest = "".join(f",{known[name]}" for name in names)
        pairs = zip(np.degrees(trace.angle), trace.deviation * 1e3, strict=True)
        lines += [f"{angle:.3f},{value:.3f}{rest}" for angle, value in pairs]
    return "\n".join(lines) + "\n"
