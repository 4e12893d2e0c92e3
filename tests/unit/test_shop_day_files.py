"""Files of the simulated shop day, read back by the package, and its machine by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shop_day import (
    ShopDay,
    effect,
    geometric_errors,
    measure_repeats,
    predicted_errors,
    write_csv,
    write_machine,
    write_part,
)
from shop_day.day import Kind
from shop_day.machine import AXY_URAD, KNOWN

from mtu_cli.files.machine import load_machine
from mtu_cli.files.part import load_part
from mtu_cli.files.points import read_points


@pytest.mark.parametrize("kind", ["A", "B"])
def test_points_come_back_as_they_were(kind: Kind, tmp_path: Path) -> None:
    day, rng = ShopDay(kind, 1), np.random.default_rng(2)
    repeats = measure_repeats(day, rng, [effect(day, "abbe", rng, 1.0)])
    part = load_part(write_part(day, tmp_path / "part.yaml")).part
    points = read_points([(write_csv(day, repeats, tmp_path / "cmm.csv"), "cmm")], part.places())
    assert len(points) == 21 * 24 * 3
    assert points.operations == day.operations
    p = points.part
    h = np.array([int(points.features[i]) - 1 for i in points.feature])
    r = points.repeat - 1
    np.testing.assert_allclose(points.nominal, day.places[h], atol=1e-12)
    error = 1000 * (points.measured[:, :2] - points.nominal[:, :2])
    np.testing.assert_allclose(error, repeats[p, h, :, r], atol=1e-5)
    np.testing.assert_array_equal(points.operation, day.operation[h])
    np.testing.assert_array_equal(points.sequence, p + 1)
    np.testing.assert_allclose(points.time_min, day.full("time_min")[p, h], rtol=1e-9)
    for axis, name in enumerate(("dir_x", "dir_y")):
        np.testing.assert_array_equal(points.direction[:, axis], day.full(name)[p, h])
    logged = ["tool_parts", "T_spindle_degC", "T_part_degC", "T_cmm_degC"]
    assert list(points.covariates) == logged
    for name in logged:
        np.testing.assert_allclose(
            points.covariates[name].astype(float), day.full(name)[p, h], rtol=1e-9
        )


@pytest.mark.parametrize("known", [False, True])
def test_the_machine_file_states_what_is_predicted(known: bool, tmp_path: Path) -> None:
    """Ex = dx_x + dx_y - y axy, Ey = dy_x + dy_y with the coefficients of the file, by hand."""
    day = ShopDay("A", 1)
    machine = load_machine(write_machine(tmp_path / "machine.yaml", known=known)).machine
    if not known:
        assert all(item.coefficients == [0] for item in machine.components.values())
        return
    place = {"x": day.places[:, 0], "y": day.places[:, 1]}

    def value(name: str) -> np.ndarray:
        item = machine.components[name]
        assert item.coefficients is not None
        assert item.of is not None
        line: np.ndarray = item.coefficients[0] + item.coefficients[1] * place[item.of]
        return line

    axy = machine.components["axy"].coefficients
    assert axy == [AXY_URAD]
    by_hand = np.column_stack(
        [
            value("dx_x") + value("dx_y") - 1e-3 * AXY_URAD * place["y"],
            value("dy_x") + value("dy_y"),
        ]
    )
    np.testing.assert_allclose(predicted_errors(day), by_hand, atol=1e-9)


def test_the_machine_scatters_as_its_file_says(tmp_path: Path) -> None:
    """Means and variances over days against J C J' and J D J' from the file's matrices."""
    day = ShopDay("A", 1)
    machine = load_machine(write_machine(tmp_path / "machine.yaml", known=True)).machine
    n = 400
    drawn = np.array([geometric_errors(day, np.random.default_rng(s)) for s in range(n)])
    x, y = day.places[:, 0], day.places[:, 1]
    common, states = np.zeros((24, 2)), np.zeros((24, 2))
    for name, axis in (("dx_x", 0), ("dx_y", 0), ("dy_x", 1), ("dy_y", 1)):
        item = machine.components[name]
        assert item.covariance is not None
        assert item.pass_covariance is not None
        assert item.pass_center_mm is not None
        along = x if KNOWN[name].of == "x" else y
        J = np.column_stack([np.ones(24), along])
        common[:, axis] += np.einsum("hi,ij,hj->h", J, np.array(item.covariance), J)
        J = np.column_stack([np.ones(24), along - item.pass_center_mm])
        states[:, axis] += np.einsum("hi,ij,hj->h", J, np.array(item.pass_covariance), J)
    axy = machine.components["axy"].covariance
    assert axy is not None
    common[:, 0] += (1e-3 * y) ** 2 * axy[0][0]
    between = drawn.mean(axis=1).var(axis=0, ddof=1)
    np.testing.assert_allclose(between, common + states / 21, rtol=4.5 * np.sqrt(2 / n))
    within = drawn.var(axis=1, ddof=1).mean(axis=0)
    np.testing.assert_allclose(within, states, rtol=4.5 * np.sqrt(2 / (20 * n)))
    spread = np.sqrt((common + states / 21) / n)
    assert np.all(np.abs(drawn.mean(axis=(0, 1)) - predicted_errors(day)) < 4.5 * spread)
