"""Undeclared effects by the names of the library, of random sign, axis and parameter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shop_day.day import CENTRE, HALF, Floats, ShopDay
from shop_day.truth import Shape, Truth, both, column, columns, scaled, scatter_only

AXES = "xy"
PITCH_MM = (4.5, 40.0)
TAU_MIN = (24.0, 180.0)


def from_centre(day: ShopDay, axis: int) -> Floats:
    """Position from the centre of the square in half its width, (P, H)."""
    return (day.place(axis) - CENTRE) / HALF


def orders(day: ShopDay, axis: int) -> tuple[Floats, Floats]:
    """Second order about the holes' mean, and third order without the straight line in it,
    which is a scale or a squareness; (P, H) each.
    """
    q = day.place(axis) - day.place(axis).mean()
    q = q / HALF
    return q**2, q**3 - q * np.sum(q**4) / np.sum(q**2)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _single(name: str, columns: Floats, covariate: str | None = None, **found: float) -> Shape:
    return Shape(
        name=name, columns=columns, weights=np.ones(1), covariate=covariate, searched=found
    )


def _along(day: ShopDay, family: str, a: int, values: Floats, covariate: str | None) -> Shape:
    return _single(f"{family}-{AXES[a]}", column(day, a, values), covariate)


def backlash(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    name = f"dir_{AXES[a]}"
    return _along(day, "backlash", a, day.full(name), name)


def scale(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _along(day, "scale", a, (day.place(a) - CENTRE) / 1000, None)


def abbe(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _along(day, "abbe", a, day.place(2) / 1000, None)


def thermal_drift(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _along(day, "thermal-drift", a, day.spindle_rise[:, None], "T_spindle_degC")


def trend(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _along(day, "trend", a, day.full("tool_parts"), "tool_parts")


def wear_approach(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    values = day.full("tool_parts") * day.full(f"dir_{AXES[a]}")
    return _along(day, "wear-approach", a, values, "tool_parts")


def operation(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _along(day, "operation", a, np.where(day.operation == 1, 1.0, 0.0), None)


def warm_up(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    tau = log_uniform(rng, *TAU_MIN)
    risen = column(day, a, 1 - np.exp(-day.full("time_min") / tau))
    return _single(f"warm-up-{AXES[a]}", risen, "time_min", tau_min=tau)


def _from_on(day: ShopDay, rng: np.random.Generator) -> tuple[Floats, float]:
    """1 from one of the parts 6 to P - 4 (counted from 1) on, (P, H), and between which two."""
    at = float(rng.integers(6, day.P - 3)) - 0.5
    return np.where(day.full("sequence") > at, 1.0, 0.0), at


def step(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    after, at = _from_on(day, rng)
    return _single(f"step-{AXES[a]}", column(day, a, after), "sequence", at=at)


def backlash_step(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    after, at = _from_on(day, rng)
    play = column(day, a, after * day.full(f"dir_{AXES[a]}"))
    return _single(f"backlash-step-{AXES[a]}", play, "sequence", at=at)


def cyclic(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    pitch = log_uniform(rng, *PITCH_MM)
    phase = rng.uniform(0, 2 * np.pi)
    turn = 2 * np.pi * day.place(a) / pitch
    return Shape(
        name=f"cyclic-{AXES[a]}",
        columns=columns(day, a, np.sin(turn), np.cos(turn)),
        weights=np.array([np.cos(phase), np.sin(phase)]),
        searched={"pitch_mm": pitch},
    )


def _bent(day: ShopDay, family: str, a: int, along: int, rng: np.random.Generator) -> Shape:
    """Second and third order, the angle between them at random."""
    angle = rng.uniform(0, 2 * np.pi)
    second, third = orders(day, along)
    return Shape(
        name=f"{family}-{AXES[a]}",
        columns=columns(day, a, second, third),
        weights=np.array([np.cos(angle) / second.std(), np.sin(angle) / third.std()]),
    )


def curvature(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _bent(day, "curvature", a, a, rng)


def straightness(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    return _bent(day, "straightness", a, 1 - a, rng)


def squareness(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Ex ~ y, Ey ~ x, or half of each: as the part's zero line was set."""
    x, y = ((day.place(i) - CENTRE) / 1000 for i in (0, 1))
    share = ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5))[rng.integers(3)]
    return _single("squareness-xy", both(day, share[0] * y, share[1] * x))


def thermal_growth(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Both axes grow with the part's temperature, when machined or when measured."""
    name = ("T_part_degC", "T_cmm_degC")[rng.integers(2)]
    over = day.full(name) - 20
    x, y = ((day.place(i) - CENTRE) / 1000 for i in (0, 1))
    return _single("thermal-growth", both(day, over * x, over * y), name)


def radial(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    x, y = from_centre(day, 0), from_centre(day, 1)
    far = np.hypot(x, y)
    return _single("radial", both(day, x / far, y / far))


def _outlier(family: str, day: ShopDay, rng: np.random.Generator, hit: Floats) -> Shape:
    angle = rng.uniform(0, 2 * np.pi)
    return Shape(
        name=family,
        columns=np.concatenate([column(day, 0, hit), column(day, 1, hit)]),
        weights=np.array([np.cos(angle), np.sin(angle)]),
        searched={family.partition("-")[0]: float(np.argwhere(hit.ravel())[0, 0])},
    )


def feature_outlier(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """`searched` holds the feature's column, counted from 0."""
    return _outlier("feature-outlier", day, rng, np.eye(day.H)[rng.integers(day.H)])


def part_outlier(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """`searched` holds the part's row, counted from 0."""
    return _outlier("part-outlier", day, rng, np.eye(day.P)[rng.integers(day.P)][:, None])


def rotation_scatter(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Every part is turned by an angle of its own."""
    angle = rng.normal(size=(day.P, 1))
    x, y = ((day.place(i) - CENTRE) / 1000 for i in (0, 1))
    return _single("rotation-scatter", both(day, -angle * y, angle * x))


Maker = Callable[[ShopDay, int, np.random.Generator], Shape]

SHAPES: dict[str, Maker] = {
    "backlash": backlash, "cyclic": cyclic, "curvature": curvature, "straightness": straightness,
    "squareness": squareness, "scale": scale, "abbe": abbe, "thermal-drift": thermal_drift,
    "warm-up": warm_up, "trend": trend, "step": step, "wear-approach": wear_approach,
    "thermal-growth": thermal_growth, "radial": radial, "operation": operation,
    "feature-outlier": feature_outlier, "part-outlier": part_outlier,
    "rotation-scatter": rotation_scatter, "backlash-step": backlash_step,
}  # fmt: skip
FAMILIES: tuple[str, ...] = (*SHAPES, "operation-scatter")


def made(
    makers: dict[str, Maker], day: ShopDay, family: str, rng: np.random.Generator, amplitude: float
) -> Truth:
    """One of `makers` at its amplitude; `family` may name the axis, which is drawn else."""
    plain, _, axis = family.rpartition("-")
    drawn = int(rng.integers(2))
    sign = float(rng.choice([-1.0, 1.0]))
    if axis in tuple(AXES) and plain in makers:
        return scaled(plain, makers[plain](day, AXES.index(axis), rng), amplitude, sign)
    return scaled(family, makers[family](day, drawn, rng), amplitude, sign)


def effect(day: ShopDay, family: str, rng: np.random.Generator, amplitude: float) -> Truth:
    """An effect of the library.

    `family` is one of `FAMILIES`, or one with its axis (`backlash-x`); `amplitude` the root mean
    square over the affected axes in units of sigma. For `operation-scatter` it sets the
    standard deviation of one operation to sqrt(1 + 2 amplitude^2) times that of the other.
    """
    if family == "operation-scatter":
        factor = np.where(day.operation == 1, np.sqrt(1 + 2 * amplitude**2), 1.0)
        return scatter_only(day, family, factor)
    return made(SHAPES, day, family, rng, amplitude)


ARCSEC_URAD = 4.84813681109536


def parameters(truth: Truth) -> dict[str, float]:
    """By the library's names and units, of families where they mean one thing."""
    if not len(truth.coefficients) or not truth.exact:
        return {}
    size = float(truth.coefficients[0])
    named = {
        "backlash": "lost_motion", "scale": "scale", "thermal-drift": "drift", "trend": "slope",
        "thermal-growth": "growth", "wear-approach": "wear", "step": "jump", "operation": "shift",
        "backlash-step": "lost_motion", "radial": "radius",
    }  # fmt: skip
    if truth.family in named:
        return {named[truth.family]: size}
    if truth.family == "abbe":
        return {"tilt": size / ARCSEC_URAD}
    if truth.family == "feature-outlier":
        return {f"shift_{axis}": float(c) for axis, c in zip("xy", truth.coefficients, strict=True)}
    return {}
