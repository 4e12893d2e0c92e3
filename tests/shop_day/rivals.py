"""The library's families as plain columns, written apart from it, to find the best rival.

Each family has members of k columns over the table: (members, k, P, H, 2).
"""

import numpy as np

from shop_day.day import CENTRE, Floats, ShopDay
from shop_day.effects import AXES, from_centre, orders
from shop_day.truth import both, column, columns

TEMPERATURES = ("T_spindle_degC", "T_part_degC", "T_cmm_degC")
REFERENCE_DEGC = 20.0
COUNTS = ("sequence", "tool_parts")
TAUS_MIN = np.geomspace(10.0, 800.0, 16)
FREQUENCIES = np.arange(1 / 130, 0.25, 1 / 1040)
"""Of cyclic errors, 1/mm: waves of 4 mm to the span, at an eighth of the inverse span."""


def rival_columns(day: ShopDay) -> dict[str, list[Floats]]:
    """Every family's members, grouped by their number of columns; without a column that does not
    change over the table. Growth and squareness with temperature vanish at 20 degC.
    """
    found = _of_axis(day, 0) | _of_axis(day, 1) | _of_plane(day)
    return {name: kept for name, stacks in found.items() if (kept := _changing(stacks))}


def margin_columns(day: ShopDay, family: str, a: int, over: Floats) -> list[Floats]:
    """The lower-order terms of a product, which are fitted free beside it: columns (1, P, H, 2).

    `over`: its temperature, count or step over the table; `a`: the axis of families of one axis.
    """
    at = [from_centre(day, i) for i in (0, 1)]
    both_ways = [column(day, i, over) for i in (0, 1)]
    if family == "thermal-growth":
        return [*(column(day, i, at[i]) for i in (0, 1)), *both_ways]
    if family == "thermal-squareness-xy":
        return [*(column(day, i, at[1 - i]) for i in (0, 1)), *both_ways]
    factor = {
        "thermal-growth-": at[a],
        "wear-approach-": day.full(f"dir_{AXES[a]}"),
        "backlash-step-": day.full(f"dir_{AXES[a]}"),
    }.get(family[:-1])
    return [] if factor is None else [column(day, a, factor), column(day, a, over)]


def rival_margins(day: ShopDay) -> dict[str, Floats]:
    """Margins of the members of families that are products, (members, m, P, H, 2)."""
    counts = [day.full(c) for c in (*COUNTS, *COUNTS)]
    sensors, steps = _warmth(day, None), list(_steps(day))
    members = {
        "thermal-growth": sensors,
        "thermal-squareness-xy": [t for t in sensors for _ in "xyz"],
    }
    for axis in AXES:
        members |= {f"thermal-growth-{axis}": sensors, f"wear-approach-{axis}": counts,
                    f"backlash-step-{axis}": steps}  # fmt: skip
    found = {}
    for name, values in members.items():
        a = AXES.find(name[-1]) if name[-2] == "-" else 0
        own = [np.concatenate(margin_columns(day, name, a, over)) for over in values]
        found[name] = np.stack(own)
    return found


def _steps(day: ShopDay) -> Floats:
    after = day.covariates["sequence"] - np.arange(2.5, day.P - 1)[:, None, None]
    return np.asarray((after > 0) * np.ones((day.P, day.H)))


def _changing(stacks: list[Floats]) -> list[Floats]:
    kept = []
    for stack in stacks:
        level = stack.mean(axis=(2, 3), keepdims=True)
        moves = np.abs(stack - level).max(axis=(2, 3, 4)) > 1e-9 * np.abs(stack).max()
        if moves.all(axis=1).any():
            kept.append(stack[moves.all(axis=1)])
    return kept


def _of_axis(day: ShopDay, a: int) -> dict[str, list[Floats]]:
    name = AXES[a]
    direction, own = day.full(f"dir_{name}"), from_centre(day, a)

    def singles(*values: Floats) -> list[Floats]:
        return [np.stack([column(day, a, item) for item in values])]

    sensors = _warmth(day, REFERENCE_DEGC)
    counts = [day.full(c) - day.full(c).mean() for c in COUNTS]
    since = [day.full(c) - day.full(c).min() for c in COUNTS]
    steps = _steps(day)
    time = day.full("time_min")
    second = {"curvature": orders(day, a), "straightness": orders(day, 1 - a)}
    found = {
        f"backlash-{name}": singles(direction),
        f"scale-{name}": singles(own),
        f"abbe-{name}": singles(day.place(2)),
        f"thermal-drift-{name}": singles(*sensors),
        f"thermal-growth-{name}": singles(*(t * own for t in sensors)),
        f"trend-{name}": singles(*counts),
        f"wear-approach-{name}": singles(*(c * direction for c in (*counts, *since))),
        f"step-{name}": singles(*steps),
        f"backlash-step-{name}": singles(*(s * direction for s in steps)),
        f"warm-up-{name}": singles(*(1 - np.exp(-time / tau) for tau in TAUS_MIN)),
        f"operation-{name}": singles((day.operation == 1) * np.ones((day.P, 1))),
        f"cyclic-{name}": [_cyclic(day, a)],
    }
    for family, pair in second.items():
        found[f"{family}-{name}"] = [*singles(*pair), columns(day, a, *pair)[None]]
    return found


def _warmth(day: ShopDay, zero: float | None) -> list[Floats]:
    full = [day.full(name) for name in TEMPERATURES]
    return [t - (t.mean() if zero is None else zero) for t in full]


def _cyclic(day: ShopDay, a: int) -> Floats:
    turns = 2 * np.pi * FREQUENCIES[:, None, None] * day.place(a)
    return np.stack([columns(day, a, np.sin(turn), np.cos(turn)) for turn in turns])


def _of_plane(day: ShopDay) -> dict[str, list[Floats]]:
    x, y = (day.place(i) - CENTRE for i in (0, 1))
    far = np.hypot(x, y)
    still = np.zeros((day.P, day.H))
    sensors = _warmth(day, REFERENCE_DEGC)
    squares = ((y, still), (still, x), (y, x))
    one_feature = np.eye(day.H)[:, None, :] * np.ones((day.P, 1))
    one_part = np.eye(day.P)[:, :, None] * np.ones(day.H)

    def members(pairs: list[tuple[Floats, Floats]]) -> list[Floats]:
        return [np.stack([both(day, *pair) for pair in pairs])]

    return {
        "squareness-xy": members(list(squares)),
        "rotation-z": members([(-y, x)]),
        "thermal-growth": members([(t * x, t * y) for t in sensors]),
        "thermal-squareness-xy": members([(t * u, t * v) for t in sensors for u, v in squares]),
        "radial": members([(x / far, y / far)]),
        "feature-outlier": [_both_axes(day, one_feature)],
        "part-outlier": [_both_axes(day, one_part)],
    }


def _both_axes(day: ShopDay, hits: Floats) -> Floats:
    return np.stack([np.concatenate([column(day, a, hit) for a in (0, 1)]) for hit in hits])
