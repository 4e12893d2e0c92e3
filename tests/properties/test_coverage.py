"""Intervals cover as often as they say, on simulated machines."""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from correct_examples import ring_part, ring_places, ring_points
from machine_trials import Drift, coverage_by_machine, machine, make_parts, read_machine
from model_examples import Segment, loaded, model_of, readings
from scipy.stats import binom
from support import codes
from synthetic_drift import REFERENCE, UM, Plan, one, sensor_names

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.sizes import Size
from mtu_cli.files.machine import Component, LoadedMachine
from mtu_cli.files.part import LoadedPart
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import fit_component
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.prediction import predict
from mtu_cli.model.settings import Settings
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

CENTRE_OF_RING = (80.0, 80.0)
DIAMETER = 120.0


Fitted = list[tuple[MachineModel, np.random.Generator]]
"""Models of machines that were read, each with the generator as the readings left it."""


def rings_of(
    fitted: Fitted, drift: Drift, part: LoadedPart, rings: int, *, probing: float, repeats: int
) -> Iterator[CorrectResult]:
    """Rings that each machine measures, corrected."""
    true = ring_places(CENTRE_OF_RING, DIAMETER)
    names = [f"ring {i}" for i in range(rings) for _ in range(repeats)]
    nominal = np.tile(true, (len(names), 1))
    nominal[:, 2] = np.nan
    for model, after_readings in fitted:
        rng = deepcopy(after_readings)
        noise = probing * rng.standard_normal((rings, repeats, *true.shape))
        own = np.zeros((rings, 1, *true.shape))
        own[..., :2] = make_parts(rng, drift, rings, true)[:, None]
        measured = (true + own + noise).reshape(-1, 3)
        points = ring_points(measured, names, list(range(1, repeats + 1)) * rings)
        yield correct(model, part, replace(points, nominal=nominal), Settings())


def _held(found: Sequence[Size], size: float) -> float:
    return float(np.mean([x.interval95[0] <= size <= x.interval95[1] for x in found]))


MODELS, PARTS = 100, 25


@pytest.mark.parametrize(
    "drift", [Drift(1.0), Drift(0.0), Drift(1.0, common=True)], ids=["drift", "none", "common"]
)
def test_intervals_cover(drift: Drift, tmp_path: Path) -> None:
    found = coverage_by_machine(machine(tmp_path), drift, MODELS, 11, PARTS)
    coefficients = [shares for name, shares in found.items() if "[" in name]
    for name in (name for name in found if "[" not in name):
        # Many parts of few machines: 0.8 %.
        standard_error = found[name].std(ddof=1) / np.sqrt(MODELS)
        assert standard_error < 0.01, name
        assert abs(found[name].mean() - 0.95) < 3.5 * standard_error, name
    # The coefficients of one machine are nearly independent of each other.
    total = np.sqrt(0.95 * 0.05 / MODELS) / np.sqrt(len(coefficients) / 2)
    assert abs(np.mean(coefficients) - 0.95) < 3.5 * total


# The 95 % interval of a corrected diameter and length holds the true one in 95 % of machines.


MACHINES, RINGS = 60, 4
"""Rings of one machine have passes and noise of their own, and only its coefficients in common."""
NONE, SOME = Drift(0.0), Drift(1.0)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Drift], Fitted]:
    """The machines of a drift as the package knows them; all cases start from the same readings."""
    known = machine(tmp_path_factory.mktemp("machine"))

    def machines(drift: Drift) -> Fitted:
        streams = np.random.default_rng(5).spawn(MACHINES)
        fits = [fit_machine(known, read_machine(rng, drift)) for rng in streams]
        models = [build_model(known, estimates_from_fit(known, fit)) for fit in fits]
        return list(zip(models, streams, strict=True))

    return cache(machines)


@pytest.mark.parametrize(
    ("drift", "probing", "repeats"), [(NONE, 0.0, 1), (SOME, 0.3e-3, 1), (SOME, 1e-3, 2)]
)
def test_intervals_of_a_ring_cover(
    fitted: Callable[[Drift], Fitted], drift: Drift, probing: float, repeats: int, tmp_path: Path
) -> None:
    """A length between two points of the one ring that tells the scatter is held too often: a
    large error of it shows in the residuals, too. Less than one of a ring it is never."""
    part = ring_part(tmp_path, "lengths: [{from: r0, to: r5}]\n")
    true = ring_places(CENTRE_OF_RING, DIAMETER)
    found = rings_of(fitted(drift), drift, part, RINGS, probing=probing, repeats=repeats)
    length = float(np.linalg.norm(true[0] - true[5]))
    shares = []
    for result in found:
        circles, lengths = result.of_kind("circle"), result.of_kind("length")
        assert len(circles) == len(lengths) == RINGS
        shares.append([_held(circles, DIAMETER), _held(lengths, length)])
    standard_error = np.sqrt(0.95 * 0.05 / (MACHINES * RINGS))
    # As if each ring had a machine of its own: what machines differ by is next to nothing.
    assert (np.std(shares, axis=0) / np.sqrt(MACHINES) < 1.3 * standard_error).all()
    assert (np.abs(np.mean(shares, axis=0) - 0.95) < 3.5 * standard_error).all()


def test_a_round_ring_is_rarely_left_with_a_form(
    fitted: Callable[[Drift], Fitted], tmp_path: Path
) -> None:
    found = rings_of(fitted(SOME), SOME, ring_part(tmp_path), 1, probing=0.3e-3, repeats=3)
    called = sum("form-left" in codes(result) for result in found)
    assert called <= binom.ppf(1 - 1e-3, MACHINES, 0.05)


# The 95 % interval of an error under drift with temperature holds the true one 95 times in 100.
#
# Every machine has drift tests of its own: four warm-ups and cool-downs, two components read at
# three positions, thermocouples with noise, and a drift that no sensor follows. The part that is
# made afterwards has temperatures, noise of its thermocouples and unfollowed drift of its own.


DRIFTING = 45
CYCLES, N, STEP_MIN = 4, 32, 6.0
PLACES = (0.0, 150.0, 300.0)
LEVEL = {"px": np.array([2.0, -1.0]), "py": np.array([-1.5, 3.0])}
SLOPE = {"px": np.array([0.010, 0.004]), "py": np.array([-0.006, 0.008])}
"""um/K and um/K/mm of two sensors."""
SENSOR_K, LEFTOVER_UM = 0.02, 0.5
POINTS = np.array([[40.0, 260.0, np.nan], [280.0, 90.0, np.nan]])
MACHINE = """
components:
  px: {of: x, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]], s_repeat: 0}
  py: {of: y, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]], s_repeat: 0}
equations: {Ex: px, Ey: py}
"""


def warmed(rng: np.random.Generator, warm: bool) -> FloatArray:
    """True temperatures (N, 2): the room steps by 6 K, each sensor has draughts."""
    t = STEP_MIN * np.arange(N)[:, None]
    step = 1 - np.exp(-t / np.array([25.0, 90.0]))
    draughts = np.cumsum(0.12 * rng.standard_normal((N, 2)), axis=0)
    return np.asarray(REFERENCE + 6 * (step if warm else 1 - step) + draughts)


def held(rng: np.random.Generator, known: LoadedMachine) -> tuple[bool, ...]:
    """Whether the intervals of Ex and Ey at the first point, and of x2 - x1, hold the true ones."""
    T = np.array([warmed(rng, cycle % 2 == 0) for cycle in range(CYCLES)])
    thermal = {}
    for axis, name in enumerate(LEVEL):
        gradients = np.array([LEVEL[name] + p * SLOPE[name] for p in PLACES])
        plan = Plan(gradients=gradients, positions=PLACES, cycles=CYCLES, n=N, step=STEP_MIN,
                    noise=0.3, slow=(LEFTOVER_UM,), memory=0.8, sensor_noise=SENSOR_K)  # fmt: skip
        estimate = one(plan.read(rng, T)).estimate
        thermal[name] = replace(estimate, component=name, of="xy"[axis])
    model = build_model(known, replace(estimates_from_fit(known, None), thermal=thermal))
    u = warmed(rng, warm=True)[rng.integers(N // 4, N)] - REFERENCE
    read = REFERENCE + u + SENSOR_K * rng.standard_normal(2)
    slow = LEFTOVER_UM * rng.standard_normal(2)
    true = np.array([
        u @ (LEVEL[name] + POINTS[i, axis] * SLOPE[name]) + slow[axis]
        for i in range(2) for axis, name in enumerate(LEVEL)
    ])  # fmt: skip
    at = dict(zip(sensor_names(2), read.tolist(), strict=True))
    found = predict(model, ("a", "b"), POINTS, dict(at))
    A = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [-1.0, 0, 1.0, 0]])
    variance = found.variance(A)
    k = np.array([coverage_factor(0.95, dof) for dof in variance.dof])
    off = np.abs(A @ (found.mean - UM * true))
    return tuple((off <= k * np.sqrt(variance.total)).tolist())


def test_intervals_of_errors_and_lengths_cover(tmp_path: Path) -> None:
    known = loaded(tmp_path, MACHINE)
    found = np.array([held(rng, known) for rng in np.random.default_rng(7).spawn(DRIFTING)])
    # Errors along two axes have nothing in common.
    of_errors = found[:, :2]
    assert abs(of_errors.mean() - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / of_errors.size)
    # A length is held too often: the coefficients answer for all that held-out cycles show, and
    # what both of its ends share is no error of it.
    assert found[:, 2].mean() > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / DRIFTING)


# Passes that broke off, few runs, coarse displays: what is estimated of them stays a covariance,
# and the mean squares behind a variance add up to it.


AT = np.linspace(0.0, 350.0, 8)
DESIGNS = 40
HOLES = np.array([[0.0, 0, 0], [100.0, 0, 0], [350.0, 0, 0]])
MEASURANDS = np.vstack([np.eye(3), [-1.0, 0, 1.0]])


def uneven(rng: np.random.Generator, runs: int, degree: int) -> ComponentEstimate:
    """Runs there and back of which one pass lost up to six of its eight readings; or they agree
    to the last digit of a coarse display, or do not scatter.
    """
    lines = rng.choice([0.0, 2.0]) * rng.normal(size=(runs, 1, 2))
    lines = (lines + rng.choice([0.0, 2.0]) * rng.normal(size=(runs, 2, 2))) * [1, 0.01]
    error = lines[..., :1] + lines[..., 1:] * (AT - AT.mean())
    error = error + rng.normal(size=error.shape)
    error = np.round(error) if rng.random() < 0.3 else error
    kept = np.ones(error.shape, bool)
    kept[0, 0, len(AT) - int(rng.integers(0, 7)) :] = False
    found = Segment(
        name="c",
        position=np.tile(AT, 2 * runs)[kept.ravel()],
        error=error[kept],
        passes=np.repeat(np.arange(runs) + 1, 2 * len(AT))[kept.ravel()],
        direction=np.tile(np.repeat([1, -1], len(AT)), runs)[kept.ravel()],
    )
    component = Component(of="x", unit="mm", degree=degree)
    return fit_component(readings([found]), "c", component).estimate


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("runs", [1, 2, 3, 5])
def test_what_few_and_broken_passes_give_is_a_covariance(runs: int, degree: int) -> None:
    rng = np.random.default_rng([runs, degree])
    for _ in range(DESIGNS):
        estimate = uneven(rng, runs, degree)
        C = estimate.covariance
        scale = np.sqrt(np.where(np.diag(C) > 0, np.diag(C), 1.0))
        assert np.linalg.eigvalsh(C / np.outer(scale, scale)).min() > -1e-9
        model = model_of([(estimate, {"x": "1"})], axes=("x",))
        found = predict(model, ["a", "b", "c"], HOLES).variance(MEASURANDS)
        assert (found.total >= 0).all()
        assert (found.dof > 0).all()
        squares = found.squares
        of_mean, of_part = squares.of_mean.sum(axis=0), squares.of_part.sum(axis=0)
        np.testing.assert_allclose(of_mean, found.coefficients, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(of_mean + of_part, found.total, rtol=1e-6)
