"""Effects that no family of the library describes, and those that only resemble one."""

from __future__ import annotations

import numpy as np

from shop_day.day import Floats, ShopDay
from shop_day.effects import AXES, Maker, from_centre, made
from shop_day.truth import Shape, Truth, both, column

FIELD_LENGTH_MM = 40.0
LAG_MIN = 30.0


def _of(family: str | None, columns: Floats, covariate: str | None = None) -> Shape:
    return Shape(name=family, columns=columns, weights=np.ones(1), covariate=covariate, exact=False)


def smooth_field(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """A smooth random field over the plane in both axes, correlated over 40 mm."""
    apart = np.linalg.norm(day.places[:, None, :2] - day.places[None, :, :2], axis=-1)
    covariance = np.exp(-0.5 * (apart / FIELD_LENGTH_MM) ** 2) + 1e-8 * np.eye(day.H)
    field = np.linalg.cholesky(covariance) @ rng.normal(size=(day.H, 2))
    return _of(None, both(day, field[:, 0], field[:, 1]))


def thermal_bending(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """X bends as the spindle warms: Ey ~ (x^2 - mean) (T - mean)."""
    bent = from_centre(day, 0) ** 2
    warm = (day.spindle_rise - day.spindle_rise.mean())[:, None]
    return _of(None, column(day, 1, warm * (bent - bent.mean())))


def random_walk(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """The part's offset walks from part to part in both axes."""
    walk = np.cumsum(rng.normal(size=(day.P, 2)), axis=0)
    return _of(None, both(day, walk[:, :1], walk[:, 1:]))


OUTSIDE: dict[str, Maker] = {
    "smooth-field": smooth_field,
    "thermal-bending": thermal_bending,
    "random-walk": random_walk,
}


def outside_effect(day: ShopDay, family: str, rng: np.random.Generator, amplitude: float) -> Truth:
    """An effect outside the library, one of `OUTSIDE`."""
    return made(OUTSIDE, day, family, rng, amplitude)


def _like(family: str, day: ShopDay, a: int, values: Floats, covariate: str | None) -> Shape:
    return _of(f"{family}-{AXES[a]}", column(day, a, values), covariate)


def _backlash(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Lost motion that grows along the axis."""
    name = f"dir_{AXES[a]}"
    return _like("backlash", day, a, day.full(name) * (1 + 0.5 * from_centre(day, a)), name)


def _cyclic(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """With a second harmonic."""
    pitch = float(np.exp(rng.uniform(np.log(8.0), np.log(40.0))))
    first, second = rng.uniform(0, 2 * np.pi, 2)
    turn = 2 * np.pi * day.place(a) / pitch
    return _like("cyclic", day, a, np.sin(turn + first) + 0.4 * np.sin(2 * turn + second), None)


def _thermal_drift(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """The structure lags the sensor by half an hour."""
    time, rise = day.full("time_min")[:, 0], day.spindle_rise
    lagged = np.zeros(day.P)
    for p in range(1, day.P):
        kept = np.exp(-(time[p] - time[p - 1]) / LAG_MIN)
        lagged[p] = rise[p] + (lagged[p - 1] - rise[p]) * kept
    return _like("thermal-drift", day, a, lagged[:, None], "T_spindle_degC")


def _worn(day: ShopDay) -> Floats:
    """A tool that wears fast at first."""
    return np.sqrt(day.full("tool_parts") + 0.3)


def _trend(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _like("trend", day, a, _worn(day), "tool_parts")


def _wear_approach(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    values = _worn(day) * day.full(f"dir_{AXES[a]}")
    return _like("wear-approach", day, a, values, "tool_parts")


def _step(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """A ramp over three parts."""
    start = int(rng.integers(6, day.P - 5))
    ramp = np.clip((day.full("sequence") - start) / 3, 0, 1)
    return _like("step", day, a, ramp, "sequence")


def _kinked(family: str, day: ShopDay, a: int, along: int, rng: np.random.Generator) -> Shape:
    """Without the straight line in it, which is a scale or a squareness."""
    kinked = np.abs(from_centre(day, along) - rng.uniform(-0.5, 0.5))
    q = day.place(along) - day.place(along).mean()
    return _like(family, day, a, kinked - q * np.sum(q * kinked) / np.sum(q**2), None)


def _straightness(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """A guideway with a kink."""
    return _kinked("straightness", day, a, 1 - a, rng)


def _curvature(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """A pitch that changes at one place."""
    return _kinked("curvature", day, a, a, rng)


def _warm_up(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Two time constants, 18 and 240 min."""
    time = day.full("time_min")
    risen = 0.7 * (1 - np.exp(-time / 18)) + 0.6 * (1 - np.exp(-time / 240))
    return _like("warm-up", day, a, risen, "time_min")


def _thermal_growth(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """A sensor that is off by 0.3 K from part to part, and y grows less than x."""
    over = day.full("T_part_degC") - 20 + rng.normal(0, 0.3, (day.P, 1))
    along = both(day, over * from_centre(day, 0), 0.8 * over * from_centre(day, 1))
    return _of("thermal-growth", along, "T_part_degC")


def _radial(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Only one of the operations is displaced."""
    x, y = from_centre(day, 0), from_centre(day, 1)
    share = (day.operation == 1) / np.hypot(x, y)
    return _of("radial", both(day, share * x, share * y))


MISSHAPEN: dict[str, Maker] = {
    "backlash": _backlash, "cyclic": _cyclic, "thermal-drift": _thermal_drift, "trend": _trend,
    "wear-approach": _wear_approach, "step": _step, "straightness": _straightness,
    "curvature": _curvature, "warm-up": _warm_up, "thermal-growth": _thermal_growth,
    "radial": _radial,
}  # fmt: skip


def misshapen_effect(
    day: ShopDay, family: str, rng: np.random.Generator, amplitude: float
) -> Truth:
    """An effect of another shape than its family's, one of `MISSHAPEN`; `exact` is False."""
    return made(MISSHAPEN, day, family, rng, amplitude)
