"""What must not matter to a fit and its predictions: units, the order of rows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from budget_examples import loaded
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_trials import POINTS, Drift, machine, read_machine
from model_examples import permuted
from property_settings import tried

from mtu_cli.analyses.budget import FirstOrder, first_order
from mtu_cli.analyses.budget.inputs import inputs_of
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.graph.transitions import TRANSITIONS, Step, Use
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import Shift

seeds = st.integers(0, 2**32 - 1)


def figures(known: LoadedMachine, given: Readings) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means, variances and degrees of freedom of points and differences."""
    model = build_model(known, estimates_from_fit(known, fit_machine(known, given)))
    found = predict(model, list("abc"), POINTS)
    A = np.vstack([np.eye(6), np.eye(6)[2:4] - np.eye(6)[:2]])
    variance = found.variance(A)
    return A @ found.mean, variance.total, variance.dof


@tried(12)
@given(seeds, st.floats(1e-3, 1e3))
def test_order_and_size_of_readings_do_not_matter(tmp_path: Path, seed: int, size: float) -> None:
    """Larger readings make larger predictions."""
    rng, known = np.random.default_rng(seed), machine(tmp_path)
    plain = read_machine(rng, Drift(1.0))
    mean, variance, dof = figures(known, plain)
    other = permuted(plain, rng.permutation(len(plain.code)))
    found = figures(known, replace(other, error=size * other.error))
    assert found[0] == pytest.approx(size * mean, rel=1e-9)
    assert found[1] == pytest.approx(size**2 * variance, rel=1e-9)
    assert found[2] == pytest.approx(dof, rel=1e-8)


@tried(12)
@given(seeds)
def test_directions_may_change_their_names(tmp_path: Path, seed: int) -> None:
    """Forward for reverse: the reversal changes its sign, nothing else changes. Times say which was
    first; without them forward counts as first.
    """
    known = machine(tmp_path)
    plain = read_machine(np.random.default_rng(seed), Drift(1.0))
    times = (2 * plain.pass_number + (plain.direction < 0)).astype(np.float64)
    plain = replace(plain, time_min=times)
    turned = replace(plain, direction=(-plain.direction).astype(np.int8))
    for one, two in zip(figures(known, plain), figures(known, turned), strict=True):
        assert two == pytest.approx(one, rel=1e-9)
    first, second = (fit_machine(known, item).components["dx_x"] for item in (plain, turned))
    forward, back = (x.instruments[0].tests["reversal"] for x in (first, second))
    assert isinstance(forward, Shift)
    assert isinstance(back, Shift)
    assert back.value == pytest.approx(-forward.value, rel=1e-9)
    assert back.p == pytest.approx(forward.p, rel=1e-7)


# Budgets under what must not matter: units, the order of inputs, correlations of nothing.


positive = st.floats(0.01, 10.0)
signed = st.floats(-5.0, 5.0)
numbers = st.tuples(signed, signed, signed, positive, positive, positive, st.floats(-0.9, 0.9))


def output(text: str) -> FirstOrder:
    file = loaded(text)
    (found,) = first_order(file, inputs_of(file))
    return found


def budget(values: tuple[float, ...], order: str = "abc", scale: float = 1.0) -> str:
    x = dict(zip("abc", values[:3], strict=True))
    u = dict(zip("abc", values[3:6], strict=True))
    x["a"], u["a"] = x["a"] * scale, u["a"] * scale
    rows = "".join(f"  {n}: {{value: {x[n]!r}, u: {u[n]!r}, dof: 7}}\n" for n in order)
    equation = f"equation: (a/{scale!r})*b + exp(c/5)*(a/{scale!r}) + b**2\n"
    return equation + "inputs:\n" + rows + f"correlations: [[a, b, {values[6]!r}]]\n"


@given(
    numbers, st.sampled_from(["abc", "acb", "bca", "cba"]), st.sampled_from([1e-6, 1e-3, 25.4, 1e9])
)
@settings(max_examples=80, deadline=None)
def test_order_and_unit_of_inputs_do_not_matter(
    values: tuple[float, ...], order: str, scale: float
) -> None:
    first, other = output(budget(values)), output(budget(values, order, scale))
    assert other.u == pytest.approx(first.u)
    assert other.second_u == pytest.approx(first.second_u, rel=1e-5)
    assert other.dof == pytest.approx(first.dof)
    shares = np.nan_to_num(other.share)[[order.index(name) for name in "abc"]]
    assert shares == pytest.approx(np.nan_to_num(first.share), abs=1e-8)
    if first.u > 0.0:
        assert float(first.share.sum()) == pytest.approx(1.0)


# Constructions know no machine: turned and moved inputs give turned and moved outputs.


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
    golden, z = np.arange(count) * 2.39996, 0.0 * np.arange(count)
    if not flat:
        z = np.linspace(-0.9, 0.95, count)
    r = np.sqrt(1 - z**2)
    nominal = np.stack([r * np.cos(golden), r * np.sin(golden), z])
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
