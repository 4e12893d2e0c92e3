"""What must not matter to a fit and its predictions: units, the order of rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from machine_trials import POINTS, Drift, machine, read_machine
from model_examples import permuted, run_command
from support import leaves

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


@pytest.mark.parametrize("unit", ["mm", "nm"])
def test_the_unit_of_readings_does_not_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unit: str
) -> None:
    """The same readings in um and in another unit: the same reports but for rounding."""
    rng = np.random.default_rng(9)
    (tmp_path / "machine.yaml").write_text(
        "schema: mtu/machine/1\nname: m\ncomponents: {a: {of: x, unit: um}, b: {of: y, unit: um}}\n"
        "equations: {Ex: a, Ey: b}\n"
    )
    (tmp_path / "part.yaml").write_text(
        "schema: mtu/part/1\nname: p\n"
        "features: {a: {x_mm: 5, y_mm: 0}, b: {x_mm: 90, y_mm: 60}}\nlengths: [{from: a, to: b}]\n"
    )
    factor = {"um": 1.0, "mm": 1e-3, "nm": 1e3}
    lines = {name: ["component,position_mm,pass,direction,error,unit"] for name in ("um", unit)}
    for component in "ab":
        for number in range(1, 5):
            for direction in ("forward", "reverse"):
                level = rng.normal()
                for p in np.linspace(0, 100, 6):
                    value = 3 + 0.02 * p + level + rng.normal()
                    for name, rows in lines.items():
                        text = f"{value * factor[name]!r}".replace("np.float64(", "").rstrip(")")
                        rows.append(f"{component},{p:g},{number},{direction},{text},{name}")
    found = []
    for rows in lines.values():
        (tmp_path / "lbb.csv").write_text("\n".join(rows) + "\n")
        one: dict[str, Any] = {}
        for command in ("fit-components", "lengths"):
            words = [command, "-m", "machine.yaml", "--lbb", "lbb.csv"]
            words += ["-p", "part.yaml", "--trials", "20000"] if command == "lengths" else []
            code, report, text = run_command(monkeypatch, tmp_path, *words)
            assert code == 0, text
            one |= leaves(report["results"], command)
        found.append(one)
    assert list(found[0]) == list(found[1])
    for path, value in found[0].items():
        if "d_low" in path or "d_high" in path:
            continue
        other = found[1][path]
        if isinstance(value, float):
            assert other == pytest.approx(value, rel=1e-7, abs=1e-10), path
        else:
            assert other == value, path
