"""One shop day: 21 parts with 24 holes around a square, in the order they were made.

Design A is a day as it is found: one program direction, holes on a regular pitch, one tool, one
shift with short breaks. Design B is a day as it would be planned: the program runs the other way
on every second part, holes are jittered, the tool is changed twice, and two long breaks let the
machine cool. Nothing here comes from the package that is judged with it.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Kind = Literal["A", "B"]

HOLES = 24
LOW, HIGH = 10.0, 140.0
CENTRE, HALF = 75.0, 65.0
"""Of the square that the holes stand on, mm."""
CYCLE_MIN, CYCLE_SPREAD_MIN = 20.0, 3.0
BREAKS_MIN: dict[Kind, dict[int, float]] = {
    "A": {4: 15.0, 9: 45.0, 15: 15.0},
    "B": {6: 150.0, 13: 90.0},
}
"""Minutes of rest after a part (counted from 0)."""
TOOL_CHANGES: dict[Kind, tuple[int, ...]] = {"A": (0,), "B": (0, 8, 13)}
"""The first part of each tool."""
RISE_K, WARMING_MIN, COOLING_MIN = 12.0, 72.0, 60.0
"""The spindle's rise at the end of a long run, and its time constants running and at rest."""
OPERATIONS = ("drilled", "milled")


class ShopDay:
    """The plan and the log of one day.

    `P` parts, `H` holes. `places` (H, 3) mm. `operation` (H,) codes into `operations`.
    `covariates` by the column's name, each in the smallest shape that broadcasts to (P, H):
    dir_x, dir_y (-1 or 1), time_min (when the part was started), sequence (from 1), tool_parts
    (parts that the tool has made before), T_spindle_degC, T_part_degC (when machined),
    T_cmm_degC (of the part when measured). `spindle_rise` (P,) is the spindle's true excess
    temperature, K; its column carries the sensor's noise of 0.2 K. The same kind, seed and
    number of parts make the same day.
    """

    def __init__(self, kind: Kind, seed: int, parts: int = 21) -> None:
        rng = np.random.default_rng([ord(kind), seed])
        self.kind: Kind = kind
        self.seed = seed
        self.P, self.H = parts, HOLES
        self.parts = tuple(f"P{p + 1:02d}" for p in range(parts))
        self.features = tuple(str(h + 1) for h in range(HOLES))
        self.operations = OPERATIONS
        self.operation: Ints = np.arange(HOLES) % 2
        side, plane = _around_the_square(kind, rng)
        raised = _raised(kind, side, rng)
        self.places: Floats = np.column_stack([plane, 25.0 * raised])
        dir_x, dir_y = _directions(kind, side, parts)
        start, run, rest = _schedule(kind, parts, rng)
        self.spindle_rise = spindle_rise(run, rest)
        phase = rng.uniform(0.0, 2 * np.pi)
        ambient = 0.25 * start / 60 + 0.5 * np.sin(np.pi * start / 180 + phase)
        logged = {
            "time_min": start,
            "sequence": np.arange(1.0, parts + 1),
            "tool_parts": _tool_parts(kind, parts),
            "T_spindle_degC": 20 + self.spindle_rise + rng.normal(0, 0.2, parts),
            "T_part_degC": 20 + ambient + rng.normal(0, 0.8, parts),
            "T_cmm_degC": 20 + rng.normal(0, 0.4, parts),
        }
        self.covariates: dict[str, Floats] = {"dir_x": dir_x, "dir_y": dir_y}
        self.covariates.update((name, values[:, None]) for name, values in logged.items())

    def full(self, name: str) -> Floats:
        """A covariate over the table, (P, H)."""
        return np.broadcast_to(self.covariates[name], (self.P, self.H))

    def place(self, axis: int) -> Floats:
        """Position along an axis over the table, (P, H), mm."""
        return np.broadcast_to(self.places[:, axis], (self.P, self.H))


def _around_the_square(kind: Kind, rng: np.random.Generator) -> tuple[Ints, Floats]:
    length = HIGH - LOW
    along = np.arange(HOLES) * (4 * length / HOLES)
    if kind == "B":
        along = (along + rng.uniform(-7.0, 7.0, HOLES)) % (4 * length)
    side = np.minimum(along // length, 3).astype(np.int64)
    way = along - length * side
    x = np.choose(side, [LOW + way, np.full(HOLES, HIGH), HIGH - way, np.full(HOLES, LOW)])
    y = np.choose(side, [np.full(HOLES, LOW), LOW + way, np.full(HOLES, HIGH), HIGH - way])
    return side, np.column_stack([x, y])


def _raised(kind: Kind, side: Ints, rng: np.random.Generator) -> Floats:
    """1 where a hole stands on the raised face (z = 25 mm), else 0."""
    if kind == "A":
        return np.where((side == 1) | (side == 2), 1.0, 0.0)
    return rng.permutation(np.repeat([0.0, 1.0], HOLES // 2))


def _directions(kind: Kind, side: Ints, parts: int) -> tuple[Floats, Floats]:
    """Travel is +x, +y, -x, -y along the sides; the axis at rest keeps its last direction."""
    forward_x = np.choose(side, [1.0, 1.0, -1.0, -1.0])
    forward_y = np.choose(side, [-1.0, 1.0, 1.0, -1.0])
    if kind == "A":
        return forward_x[None, :], forward_y[None, :]
    way = np.where(np.arange(parts) % 2 == 0, 1.0, -1.0)
    return np.outer(way, forward_x), np.outer(way, forward_y)


def _schedule(kind: Kind, parts: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Start of every part, minutes of running and of rest after it."""
    run = CYCLE_MIN + rng.uniform(-CYCLE_SPREAD_MIN, CYCLE_SPREAD_MIN, parts)
    rest = np.array([BREAKS_MIN[kind].get(p, 0.0) for p in range(parts)])
    start = np.concatenate([[0.0], np.cumsum(run + rest)[:-1]])
    return start, run, rest


def _tool_parts(kind: Kind, parts: int) -> Floats:
    order = np.arange(parts)
    first = np.array(TOOL_CHANGES[kind])
    made: Floats = order - first[np.searchsorted(first, order, side="right") - 1] * 1.0
    return made


def spindle_rise(run: Floats, rest: Floats) -> Floats:
    """Excess temperature at the start of every part, K: first order towards 12 K while running,
    towards 0 at rest.
    """
    now, found = 0.0, []
    for running, resting in zip(run, rest, strict=True):
        found.append(now)
        now = RISE_K + (now - RISE_K) * np.exp(-running / WARMING_MIN)
        now *= np.exp(-resting / COOLING_MIN)
    return np.array(found)
