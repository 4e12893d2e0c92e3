"""Constructions know no machine: turned and moved inputs give turned and moved outputs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtu_cli.model.graph.transitions import TRANSITIONS, Step, Use
from mtu_cli.stats.least_squares import FloatArray

BOUND = {"ball", "hole", "meas", "compute"}
"""They read coordinates of the machine, or no geometry at all."""
MORE = {"circle": (3, 7), "plane": (3, 6), "sphere": (4, 8)}
CASES = [
    (do, use, count)
    for do, uses in TRANSITIONS.items()
    for use in uses
    if do not in BOUND and "coordinate" not in use.takes
    for count in (MORE[do] if "more" in use.takes else (0,))
]
TRIALS = 5


def unit(v: FloatArray) -> FloatArray:
    found: FloatArray = v / np.linalg.norm(v, axis=0)
    return found


def place(kind: str, rng: np.random.Generator) -> FloatArray:
    """A random place (.., m) of the kind."""
    point = rng.normal(size=(3, TRIALS)) * 50
    vector = rng.normal(size=(3, TRIALS))
    if kind == "constant":
        return np.abs(rng.normal(size=TRIALS)) + 5
    if kind in ("line", "plane"):
        return np.stack([point, unit(vector)])
    if kind == "frame":
        axes = np.stack([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(TRIALS)], axis=2)
        return np.concatenate([point[None], axes])
    return point if kind == "point" else vector


def round_points(count: int, flat: bool, rng: np.random.Generator) -> list[FloatArray]:
    """Points about a circle or sphere, 1 % off it, the same turn in all trials."""
    if flat:
        t = np.linspace(0, 5, count)
        nominal = np.stack([np.cos(t), np.sin(t), np.zeros(count)])
    else:
        golden = np.arange(count) * 2.39996
        z = np.linspace(-0.9, 0.95, count)
        nominal = np.stack(
            [np.cos(golden) * np.sqrt(1 - z**2), np.sin(golden) * np.sqrt(1 - z**2), z]
        )
    nominal = 20 * np.linalg.qr(rng.normal(size=(3, 3)))[0] @ nominal
    return [nominal[:, [i]] + 0.2 * rng.normal(size=(3, TRIALS)) for i in range(count)]


def moved(kind: str, value: FloatArray, R: FloatArray, t: FloatArray) -> FloatArray:
    if kind == "constant":
        return value
    if kind in ("point", "vector"):
        return np.asarray(R @ value + (t[:, None] if kind == "point" else 0.0))
    rows = [R @ row for row in value]
    rows[0] = rows[0] + t[:, None]
    return np.stack(rows)


def made(step: Step, nominal: list[FloatArray], places: list[FloatArray]) -> tuple[FloatArray, ...]:
    """The outputs of a step whose fits start from `nominal`."""
    values = dict(zip(step.inputs, places, strict=True))
    start = dict(zip(step.inputs, nominal, strict=True))
    step.ready(start)
    step.run(values)
    return tuple(values[name] for name in step.outputs)


def kinds_of(side: str) -> list[str]:
    """The kind of every place of one side of a use."""
    return [slot.rpartition(" ")[2] for slot in side.split(", ")]


@pytest.mark.parametrize(("do", "use", "count"), CASES, ids=lambda x: getattr(x, "takes", str(x)))
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_turned_and_moved(do: str, use: Use, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    taken, given = kinds_of(use.takes), kinds_of(use.makes)
    if count:
        inputs = round_points(count, do != "sphere", rng)
        inputs += [place(kind, rng) * 0 + 20 for kind in taken[1:]]
        kinds = ["point"] * count + taken[1:]
    else:
        kinds = taken
        inputs = [place(kind, rng) for kind in kinds]
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.linalg.det(R)
    t = rng.normal(size=3) * 100
    turned = [moved(kind, value, R, t) for kind, value in zip(kinds, inputs, strict=True)]
    names = tuple(map(str, range(len(inputs))))
    out = tuple(f"out{i}" for i in range(len(given)))
    step = Step(index=0, do=do, use=use, inputs=names, outputs=out)
    outputs = made(step, [item[..., :1] for item in inputs], inputs)
    others = made(step, [item[..., :1] for item in turned], turned)
    for kind, before, after in zip(given, outputs, others, strict=False):
        if do == "transform":
            # What is seen from a frame that moves along does not move.
            assert after == pytest.approx(before, rel=1e-7, abs=1e-7)
            continue
        wanted = moved(kind, before, R, t)
        scale = max(1.0, float(np.abs(wanted).max()))
        assert after == pytest.approx(wanted, rel=1e-7, abs=1e-9 * scale)
