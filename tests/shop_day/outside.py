"""Effects that no family of the library describes, and those that only resemble one."""

import numpy as np

from shop_day.day import Floats, ShopDay
from shop_day.effects import AXES, Maker, Values, along, from_centre, made, single
from shop_day.truth import Shape, Truth, both, column

FIELD_LENGTH_MM = 40.0
LAG_MIN = 30.0


def smooth_field(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """A smooth random field over the plane in both axes, correlated over 40 mm."""
    apart = np.linalg.norm(day.places[:, None, :2] - day.places[None, :, :2], axis=-1)
    covariance = np.exp(-0.5 * (apart / FIELD_LENGTH_MM) ** 2) + 1e-8 * np.eye(day.H)
    field = np.linalg.cholesky(covariance) @ rng.normal(size=(day.H, 2))
    return single(None, both(day, field[:, 0], field[:, 1]), exact=False)


def thermal_bending(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """X bends as the spindle warms: Ey ~ (x^2 - mean) (T - mean)."""
    bent = from_centre(day, 0) ** 2
    warm = (day.spindle_rise - day.spindle_rise.mean())[:, None]
    return single(None, column(day, 1, warm * (bent - bent.mean())), exact=False)


def random_walk(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """The part's offset walks from part to part in both axes."""
    walk = np.cumsum(rng.normal(size=(day.P, 2)), axis=0)
    return single(None, both(day, walk[:, :1], walk[:, 1:]), exact=False)


OUTSIDE: dict[str, Maker] = {
    "smooth-field": smooth_field,
    "thermal-bending": thermal_bending,
    "random-walk": random_walk,
}


def outside_effect(day: ShopDay, family: str, rng: np.random.Generator, amplitude: float) -> Truth:
    """An effect outside the library, one of `OUTSIDE`."""
    return made(OUTSIDE, day, family, rng, amplitude)


def _cyclic(day: ShopDay, a: int, rng: np.random.Generator) -> Floats:
    pitch = float(np.exp(rng.uniform(np.log(8.0), np.log(40.0))))
    first, second = rng.uniform(0, 2 * np.pi, 2)
    turn = 2 * np.pi * day.place(a) / pitch
    return np.asarray(np.sin(turn + first) + 0.4 * np.sin(2 * turn + second))


def _lagging(day: ShopDay, a: int, rng: np.random.Generator) -> Floats:
    time, rise = day.full("time_min")[:, 0], day.spindle_rise
    lagged = np.zeros(day.P)
    for p in range(1, day.P):
        kept = np.exp(-(time[p] - time[p - 1]) / LAG_MIN)
        lagged[p] = rise[p] + (lagged[p - 1] - rise[p]) * kept
    return lagged[:, None]


def _worn(day: ShopDay) -> Floats:
    return np.sqrt(day.full("tool_parts") + 0.3)


def _ramp(day: ShopDay, a: int, rng: np.random.Generator) -> Floats:
    start = int(rng.integers(6, day.P - 5))
    return np.clip((day.full("sequence") - start) / 3, 0, 1)


def _kinked(day: ShopDay, along: int, rng: np.random.Generator) -> Floats:
    """Without the straight line in it, which is a scale or a squareness."""
    kinked = np.abs(from_centre(day, along) - rng.uniform(-0.5, 0.5))
    q = day.place(along) - day.place(along).mean()
    return np.asarray(kinked - q * np.sum(q * kinked) / np.sum(q**2))


def _two_constants(day: ShopDay, a: int, rng: np.random.Generator) -> Floats:
    time = day.full("time_min")
    return 0.7 * (1 - np.exp(-time / 18)) + 0.6 * (1 - np.exp(-time / 240))


def _thermal_growth(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """A sensor that is off by 0.3 K from part to part, and y grows less than x."""
    over = day.full("T_part_degC") - 20 + rng.normal(0, 0.3, (day.P, 1))
    grown = both(day, over * from_centre(day, 0), 0.8 * over * from_centre(day, 1))
    return single("thermal-growth", grown, "T_part_degC", exact=False)


def _radial(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Only one of the operations is displaced."""
    x, y = from_centre(day, 0), from_centre(day, 1)
    share = (day.operation == 1) / np.hypot(x, y)
    return single("radial", both(day, share * x, share * y), exact=False)


AXIS: dict[str, Values] = {
    # Lost motion that grows along the axis; a second harmonic; half an hour behind the sensor.
    "backlash": lambda day, a, rng: day.full(f"dir_{AXES[a]}") * (1 + 0.5 * from_centre(day, a)),
    "cyclic": _cyclic,
    "thermal-drift": _lagging,
    # A tool that wears fast at first; three parts to jump; a guideway, and a pitch, with a kink.
    "trend": lambda day, a, rng: _worn(day),
    "wear-approach": lambda day, a, rng: _worn(day) * day.full(f"dir_{AXES[a]}"),
    "step": _ramp,
    "straightness": lambda day, a, rng: _kinked(day, 1 - a, rng),
    "curvature": _kinked,
    # Two time constants, 18 and 240 min.
    "warm-up": _two_constants,
}
MISSHAPEN: dict[str, Maker] = {
    **{family: along(family, values, exact=False) for family, values in AXIS.items()},
    "thermal-growth": _thermal_growth,
    "radial": _radial,
}


def misshapen_effect(
    day: ShopDay, family: str, rng: np.random.Generator, amplitude: float
) -> Truth:
    """An effect of another shape than its family's, one of `MISSHAPEN`; `exact` is False."""
    return made(MISSHAPEN, day, family, rng, amplitude)
