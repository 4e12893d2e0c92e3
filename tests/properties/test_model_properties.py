"""What must not matter to a fit and its predictions: units, the order of rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from machine_trials import POINTS, Drift, machine, read_machine
from model_examples import permuted

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import Shift

STEADY = settings(
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=12,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
seeds = st.integers(0, 2**32 - 1)


def figures(known: LoadedMachine, given: Readings) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means, variances and degrees of freedom of points and differences."""
    model = build_model(known, estimates_from_fit(known, fit_machine(known, given)))
    found = predict(model, list("abc"), POINTS)
    A = np.vstack([np.eye(6), np.eye(6)[2:4] - np.eye(6)[:2]])
    variance = found.variance(A)
    return A @ found.mean, variance.total, variance.dof


@STEADY
@given(seeds)
def test_the_order_of_readings_does_not_matter(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    known = machine(tmp_path)
    plain = read_machine(rng, Drift(1.0))
    one = figures(known, plain)
    two = figures(known, permuted(plain, rng.permutation(len(plain.code))))
    for first, second in zip(one, two, strict=True):
        assert second == pytest.approx(first, rel=1e-9)


@STEADY
@given(seeds, st.floats(1e-3, 1e3))
def test_larger_readings_make_larger_predictions(tmp_path: Path, seed: int, size: float) -> None:
    known = machine(tmp_path)
    plain = read_machine(np.random.default_rng(seed), Drift(0.5))
    mean, variance, dof = figures(known, plain)
    found = figures(known, replace(plain, error=size * plain.error))
    assert found[0] == pytest.approx(size * mean, rel=1e-9)
    assert found[1] == pytest.approx(size**2 * variance, rel=1e-9)
    assert found[2] == pytest.approx(dof, rel=1e-8)


@STEADY
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
