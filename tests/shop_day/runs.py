"""Laser runs of one axis, as many kinds of them as shops make; with an effect or without.

All errors are in um, positions in mm, temperatures in K from 20 degC.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from shop_day.day import Floats, Ints

NOISE = 0.6
"""Of a single reading, um."""
MACHINE = """\
schema: mtu/machine/1
name: one axis
components:
  px: {of: x, unit: um}
equations: {Ex: px}
"""
UNITS = {"backlash": ("lost_motion", 1.0), "thermal-drift": ("drift", 1.0),
         "thermal-growth": ("growth", 1e3), "trend": ("slope", 1.0)}  # fmt: skip
"""The parameter that means the same in every form that a library may have of the family, and its
value for an effect of 1 um, 1 um/K, 1 um/mm/K, 1 um a pass.
"""
RUN_FAMILIES = (*UNITS, "cyclic", "curvature", "warm-up", "step")
SCATTER = {False: (0.3, 3.0), True: (0.1, 2.0)}
"""Of passes over that of readings: of clean runs, and of those with an effect, some of which lie in
whole passes.
"""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Positions (n,), passes, directions, times (min) and temperatures of n readings, in the order
    they were taken; `scatter` of passes, and the `step` of a reading.
    """

    position: Floats
    passes: Ints
    direction: Ints
    minutes: Floats
    warm: Floats
    scatter: float
    step: float

    def column(self, family: str, rng: np.random.Generator) -> Floats:
        """What an effect of 1 does."""
        x, middle = self.position, self.position.mean()
        if family == "step":
            return np.asarray(self.passes > rng.integers(2, self.passes.max() - 1), float)
        # Shorter than three targets a wave is what single targets may have.
        phase, pitch = rng.uniform(0, 2 * np.pi), np.ptp(x) * rng.uniform(0.3, 0.5)
        settling = np.exp(rng.uniform(np.log(24.0), np.log(120.0)))
        columns: dict[str, Floats] = {
            "backlash": self.direction.astype(float),
            "thermal-drift": self.warm,
            "thermal-growth": x * self.warm,
            "trend": self.passes.astype(float),
            "cyclic": np.sin(2 * np.pi * x / pitch + phase),
            "curvature": (x - middle) ** 2,
            "warm-up": 1 - np.exp(-self.minutes / settling),
        }
        return columns[family]

    def size(self, column: Floats) -> float:
        """Of an effect that leaves an rms of a reading's noise beside the readings' own line."""
        X = np.column_stack([np.ones_like(self.position), self.position / 100])
        left = column - X @ np.linalg.lstsq(X, column, rcond=None)[0]
        return NOISE / float(np.sqrt(np.mean(left**2)))

    def readings(self, rng: np.random.Generator, effect: Floats | float = 0.0) -> str:
        """As CSV, rounded; every pass and direction has a level and slope of its own."""
        group = self.passes * 2 + (self.direction > 0)
        level, slope = self.scatter * rng.normal(size=(2, group.max() + 1))
        half = np.ptp(self.position) / 2
        error = 2.0 + 0.03 * self.position + level[group]
        error += 0.5 * slope[group] * (self.position - self.position.mean()) / half
        error += NOISE * rng.normal(size=len(error)) + effect
        sensor = 20 + self.warm + 0.05 * rng.normal(size=len(error))
        more = {"time_min": self.minutes, "T_x_degC": np.round(sensor, 2)}
        rounded = np.round(error / self.step) * self.step
        return csv("px", self.position, self.passes, self.direction, rounded, more)


def csv(
    component: str,
    position: Floats | None,
    passes: Ints,
    direction: Ints,
    error: Floats,
    covariates: Mapping[str, Floats] | None = None,
    digits: int = 3,
) -> str:
    """Readings in the columns of the contract; without positions where a component has no axis."""
    at = [] if position is None else ["position_mm"]
    covariates = covariates or {}
    lines = [",".join(["component", *at, "pass", "direction", "error", "unit", *covariates])]
    for i, value in enumerate(error):
        where = [] if position is None else [f"{position[i]:.4f}"]
        way = "forward" if direction[i] > 0 else "reverse"
        more = [f"{values[i]:.6g}" for values in covariates.values()]
        cells = [component, *where, str(passes[i]), way, f"{value:.{digits}f}", "um", *more]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def layout(rng: np.random.Generator, *, planted: bool) -> Layout:
    """5 to 10 passes over 8 to 14 uneven targets, there and back or (one clean run in four) there
    alone, a reading in 0.3 to 2 min, while the axis warms up by 2 to 8 K; one run in four has gaps.
    """
    passes, targets = int(rng.integers(5, 11)), int(rng.integers(8, 15))
    even = np.linspace(0, 400, targets)
    one = np.sort(np.round(even + rng.uniform(-0.3, 0.3, targets) * 400 / targets))
    back = one[::-1] if rng.random() < 0.75 or planted else one[:0]
    n = passes * (targets + len(back))
    minutes = np.arange(1.0, n + 1) * float(rng.uniform(0.3, 2.0))
    warm = rng.uniform(2, 8) * (1 - np.exp(-minutes / rng.uniform(20, 90)))
    there = rng.random(n) > (0.03 if rng.random() < 0.25 else 0.0)
    least, most = SCATTER[planted]
    return Layout(
        position=np.tile(np.concatenate([one, back]), passes)[there],
        passes=np.repeat(np.arange(passes) + 1, targets + len(back))[there],
        direction=np.tile(np.repeat([1, -1], [targets, len(back)]), passes)[there],
        minutes=minutes[there],
        warm=warm[there],
        scatter=NOISE * float(np.exp(rng.uniform(np.log(least), np.log(most)))),
        step=float(rng.choice([0.01, 0.1, 0.2])),
    )


Profile = Callable[[Floats], Floats]


@dataclass(frozen=True, kw_only=True)
class Axis:
    """An axis that is measured there and back at some targets, run after run, and has a profile.

    Every run has a level and a slope (um over half the travel) of its own, and perhaps a bend of
    the amplitude `own`; `zeroed`: the first reading of every run was set to nought.
    """

    targets: Floats
    profile: Profile
    zeroed: bool
    runs: int = 5
    sigma: float = 0.5
    level: float = 0.4
    slope: float = 0.2
    lost: float = 3.0
    own: float = 0.0

    def _run(self, rng: np.random.Generator) -> Callable[[Floats, float], Floats]:
        """What a run would read without noise at places, forward or back (1 or -1)."""
        level, slope = rng.normal(0, [self.level, self.slope])
        travel = float(self.targets[-1])
        bent = bend(travel, self.own, rng, 0.0) if self.own else np.zeros_like
        return lambda x, way: self._at(x, way, level, slope) + bent(x)

    def _at(self, x: Floats, way: float, level: float, slope: float) -> Floats:
        travel = self.targets[-1]
        bent = self.profile(x) + slope * (2 * x / travel - 1)
        return np.asarray(bent + level + way * self.lost / 2)

    def taken(self, rng: np.random.Generator) -> Floats:
        """Readings (runs, 2, targets), forward first."""
        taken = []
        for _ in range(self.runs):
            run = self._run(rng)
            pair = np.stack([run(self.targets, way) for way in (1.0, -1.0)])
            pair += rng.normal(0, self.sigma, pair.shape)
            taken.append(pair - pair[0, 0] if self.zeroed else pair)
        return np.array(taken)

    def readings(self, rng: np.random.Generator) -> str:
        T = len(self.targets)
        passes = np.repeat(np.arange(self.runs) + 1, 2 * T)
        direction = np.tile(np.repeat([1, -1], T), self.runs)
        position = np.tile(self.targets, 2 * self.runs)
        return csv("px", position, passes, direction, self.taken(rng).ravel())

    def true(self, x: Floats) -> Floats:
        """Mean error going forward."""
        mean = self._at(x, 1.0, 0.0, 0.0)
        return mean - self._at(np.zeros(1), 1.0, 0.0, 0.0) if self.zeroed else mean

    def future(self, x: Floats, rng: np.random.Generator) -> Floats:
        """Single readings going forward, each of a run of its own."""
        taken = []
        for one in x:
            pair = self._run(rng)(np.array([one, 0.0]), 1.0) + rng.normal(0, self.sigma, 2)
            taken.append(pair[0] - pair[1] if self.zeroed else pair[0])
        return np.array(taken)

    def half_width(self, x: Floats) -> Floats:
        """Half of the 95 % interval of such readings who knows the profile and the variances."""
        near = self.slope * (2 * x / self.targets[-1] - 1)
        variance = self.sigma**2 + self.level**2 + near**2 + self.own**2 / 2
        if self.zeroed:
            variance = 2 * self.sigma**2 + (self.slope * 2 * x / self.targets[-1]) ** 2
        return np.asarray(1.96 * np.sqrt(variance))


def targets(rng: np.random.Generator, count: int, travel: float, *, regular: bool) -> Floats:
    x = np.linspace(0, travel, count)
    if not regular:
        apart = travel / (count - 1)
        x[1:-1] += rng.uniform(-0.35, 0.35, count - 2) * apart
    return np.round(x, 3)


def bend(
    travel: float, amplitude: float, rng: np.random.Generator, steepest: float = 0.02
) -> Profile:
    """A smooth S-bend of rms amplitude/sqrt 2 about its line, um, on a line of its own."""
    wave, phase = rng.uniform(0.55, 1.6) * travel, rng.uniform(0, 2 * np.pi)
    line = rng.uniform(-steepest, steepest)

    def raw(x: Floats) -> Floats:
        turn = 2 * np.pi * x / wave
        return np.asarray(np.sin(turn + phase) + 0.4 * np.sin(1.7 * turn + 2 * phase))

    fine = np.linspace(0, travel, 201)
    straight = np.polyfit(fine, raw(fine), 1)
    size = amplitude / np.sqrt(2) / np.std(raw(fine) - np.polyval(straight, fine))
    return lambda x: size * (raw(x) - np.polyval(straight, x)) + line * x


def wave(pitch: float, amplitude: float, rng: np.random.Generator) -> Profile:
    phase, line = rng.uniform(0, 2 * np.pi), rng.uniform(-0.02, 0.02)
    return lambda x: amplitude * np.sin(2 * np.pi * x / pitch + phase) + line * x
