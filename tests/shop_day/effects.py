"""Undeclared effects by the names of the library, of random sign, axis and parameter."""

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


Maker = Callable[[ShopDay, int, np.random.Generator], Shape]
Values = Callable[[ShopDay, int, np.random.Generator], Floats]
"""What an effect of one axis adds to it, (P, H) or a shape that broadcasts."""
AXIS: dict[str, Values] = {
    "backlash": lambda day, a, rng: day.full(f"dir_{AXES[a]}"),
    "scale": lambda day, a, rng: (day.place(a) - CENTRE) / 1000,
    "abbe": lambda day, a, rng: day.place(2) / 1000,
    "thermal-drift": lambda day, a, rng: day.spindle_rise[:, None],
    "trend": lambda day, a, rng: day.full("tool_parts"),
    "wear-approach": lambda day, a, rng: day.full("tool_parts") * day.full(f"dir_{AXES[a]}"),
    "operation": lambda day, a, rng: np.where(day.operation == 1, 1.0, 0.0),
}
COVARIATES = {
    "backlash": "dir_{}", "thermal-drift": "T_spindle_degC", "trend": "tool_parts",
    "wear-approach": "tool_parts", "warm-up": "time_min", "step": "sequence",
    "backlash-step": "sequence",
}  # fmt: skip


def single(
    name: str | None, columns: Floats, covariate: str | None = None, *, exact: bool = True,
    **searched: float,
) -> Shape:  # fmt: skip
    """An effect of one column."""
    return Shape(
        name=name, columns=columns, weights=np.ones(1), covariate=covariate, searched=searched,
        exact=exact,
    )  # fmt: skip


def along(family: str, values: Values, *, exact: bool = True) -> Maker:
    """An effect of one axis."""

    def make(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
        covariate = COVARIATES.get(family)
        moved = column(day, a, values(day, a, rng))
        named = None if covariate is None else covariate.format(AXES[a])
        return single(f"{family}-{AXES[a]}", moved, named, exact=exact)

    return make


def warm_up(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    tau = log_uniform(rng, *TAU_MIN)
    risen = column(day, a, 1 - np.exp(-day.full("time_min") / tau))
    return single(f"warm-up-{AXES[a]}", risen, "time_min", tau_min=tau)


def _from_on(*, reversal: bool) -> Maker:
    """From one of the parts 6 to P - 4 (counted from 1) on."""

    def make(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
        at = float(rng.integers(6, day.P - 3)) - 0.5
        after = np.where(day.full("sequence") > at, 1.0, 0.0)
        values = after * day.full(f"dir_{AXES[a]}") if reversal else after
        name = f"{'backlash-' * reversal}step-{AXES[a]}"
        return single(name, column(day, a, values), "sequence", at=at)

    return make


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


def _bent(family: str, *, across: bool) -> Maker:
    """Second and third order along the axis or the other one, the angle between them at random."""

    def make(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
        angle = rng.uniform(0, 2 * np.pi)
        second, third = orders(day, 1 - a if across else a)
        return Shape(
            name=f"{family}-{AXES[a]}",
            columns=columns(day, a, second, third),
            weights=np.array([np.cos(angle) / second.std(), np.sin(angle) / third.std()]),
        )

    return make


def squareness(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Ex ~ y, Ey ~ x, or half of each: as the part's zero line was set."""
    x, y = ((day.place(i) - CENTRE) / 1000 for i in (0, 1))
    share = ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5))[rng.integers(3)]
    return single("squareness-xy", both(day, share[0] * y, share[1] * x))


def thermal_growth(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Both axes grow with the part's temperature, when machined or when measured."""
    name = ("T_part_degC", "T_cmm_degC")[rng.integers(2)]
    over = day.full(name) - 20
    x, y = ((day.place(i) - CENTRE) / 1000 for i in (0, 1))
    return single("thermal-growth", both(day, over * x, over * y), name)


def radial(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    x, y = from_centre(day, 0), from_centre(day, 1)
    far = np.hypot(x, y)
    return single("radial", both(day, x / far, y / far))


def _outlier(of: str) -> Maker:
    """`searched` holds the feature's column, or the part's row, counted from 0."""

    def make(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
        one = int(rng.integers(day.H if of == "feature" else day.P))
        hit = np.eye(day.H)[one] if of == "feature" else np.eye(day.P)[one][:, None]
        angle = rng.uniform(0, 2 * np.pi)
        return Shape(
            name=f"{of}-outlier",
            columns=np.concatenate([column(day, 0, hit), column(day, 1, hit)]),
            weights=np.array([np.cos(angle), np.sin(angle)]),
            searched={of: float(one)},
        )

    return make


def rotation_scatter(day: ShopDay, a: int, rng: np.random.Generator) -> Shape:
    """Every part is turned by an angle of its own."""
    angle = rng.normal(size=(day.P, 1))
    x, y = ((day.place(i) - CENTRE) / 1000 for i in (0, 1))
    return single("rotation-scatter", both(day, -angle * y, angle * x))


SHAPES: dict[str, Maker] = {
    **{family: along(family, values) for family, values in AXIS.items()},
    "warm-up": warm_up, "cyclic": cyclic, "squareness": squareness, "radial": radial,
    "curvature": _bent("curvature", across=False),
    "straightness": _bent("straightness", across=True),
    "step": _from_on(reversal=False), "backlash-step": _from_on(reversal=True),
    "thermal-growth": thermal_growth, "rotation-scatter": rotation_scatter,
    "feature-outlier": _outlier("feature"), "part-outlier": _outlier("part"),
}  # fmt: skip
FAMILIES = (
    "backlash", "cyclic", "curvature", "straightness", "squareness", "scale", "abbe",
    "thermal-drift", "warm-up", "trend", "step", "wear-approach", "thermal-growth", "radial",
    "operation", "feature-outlier", "part-outlier", "rotation-scatter", "backlash-step",
    "operation-scatter",
)  # fmt: skip
"""In the order that says which of the bench's sets is of which."""


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
