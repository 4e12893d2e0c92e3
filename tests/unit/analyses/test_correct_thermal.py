"""Points corrected for drifts that lag behind temperatures, whose readings have a noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    ROUNDING,
    codes,
    error_at,
    machine,
    ring_part,
    ring_places,
    ring_points,
)
from numpy.typing import NDArray

from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.correct.rows import REACH
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.machine_model import MachineModel, drift_terms
from mtu_cli.model.settings import Settings
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.units import UNITS

SETTINGS = Settings()
Columns = dict[str, NDArray[np.float64] | NDArray[np.object_]]


def machine_u(result: CorrectResult) -> float:
    """The u of the first ring without the scatter of its points, which here hold real form."""
    ring, scatter = result.sizes[0], result.scatter
    assert scatter is not None
    return float(np.sqrt(ring.u**2 - ring.sensitivity * scatter.variance))


def lagging(model: MachineModel, taus: tuple[float, float], sensor_u: float = 0.0) -> MachineModel:
    """The model with drifts of px and py that follow one sensor with a lag each."""
    terms = list(model.terms)
    for name, tau in zip(("px", "py"), taus, strict=True):
        (term,) = [item for item in model.terms if item.estimate.name == name]
        drift = ThermalEstimate(
            component=name, of=None, unit=UNITS["um"], sensors=("T_a_degC",), reference=20.0,
            coefficients=np.array([[2e-3]]), covariance=np.zeros((1, 1)), coefficient_dof=np.inf,
            leftover=np.zeros((1, 1)), leftover_dof=np.inf, time_constants=np.array([tau]),
            sensor_u=np.array([sensor_u]), temperature_range=np.array([[20.0, 26.0]]),
        )  # fmt: skip
        terms.append(drift_terms(drift, term.levers)[0])
    return replace(model, terms=tuple(terms))


def test_a_drift_that_lags_sees_the_history_of_all_parts(tmp_path: Path) -> None:
    count, taus = 20, (40.0, 15.0)
    time = 2.0 * np.arange(11.0 * count)
    sensor = 20 + 6 * (1 - np.exp(-time / 50))
    place = np.tile(ring_places(), (count, 1))
    own: Columns = {
        "T_scale_degC": np.full(len(time), 20.0),
        "T_a_degC": sensor,
    }
    parts = [f"p{i}" for i in range(count)]
    model = lagging(machine(tmp_path), taus)
    order = np.random.default_rng(1).permutation(len(time))
    # The rows of a file need not be in the order of time.
    shuffled = [column[order] for column in (time, sensor)]
    points = ring_points(place, parts, None, own | {"T_a_degC": shuffled[1]}, time=shuffled[0])
    result = correct(model, None, points, SETTINGS)
    settled = error_at(place, np.full(len(time), 20.0))
    lagged = first_order_lag(sensor[:, None], time, np.array(taus))[:, order, 0]
    for axis in (0, 1):
        drift = result.error[:, axis] - settled[:, axis]
        # What is more than REACH time constants ago is forgotten, of 6 degC at most.
        forgotten = 2e-3 * 6 * np.exp(-REACH)
        assert drift == pytest.approx(2e-3 * (lagged[axis] - 20), abs=forgotten)
    # It matters: a drift that began anew with every part would be off by the whole lag.
    assert np.abs(2e-3 * (shuffled[1] - lagged[0])).max() > 1e3 * forgotten
    still = ring_points(place, parts, None, own)
    assert "settled-temperatures" in codes(correct(model, None, still, SETTINGS))
    hot = ring_points(place, parts, None, own | {"T_a_degC": sensor + 2}, time=time)
    assert "outside-measured-range" in codes(correct(model, None, hot, SETTINGS))


def test_a_shared_reading_is_wrong_by_the_same_for_all_points_of_a_ring(tmp_path: Path) -> None:
    """Offsets of px and py that the noise of one reading gives move a ring, not its diameter."""
    place = np.tile(ring_places(), (2, 1))
    place[11:] += 0.001
    own: Columns = {"T_scale_degC": np.full(22, 20.0), "T_a_degC": np.repeat([22.0, 23.0], 11)}
    points = ring_points(place, ["a", "b"], None, own)
    part, model = ring_part(tmp_path), machine(tmp_path)
    without = correct(lagging(model, (0.0, 0.0)), part, points, SETTINGS)
    noisy = correct(lagging(model, (0.0, 0.0), sensor_u=0.5), part, points, SETTINGS)
    for exact, found in zip(without.sizes, noisy.sizes, strict=True):
        assert found.u == pytest.approx(exact.u, rel=ROUNDING)
    # A single point is moved by 2 um per degC.
    more = noisy.u[:, 0] ** 2 - without.u[:, 0] ** 2
    assert more == pytest.approx(0.001**2, rel=ROUNDING)
    each = replace(points, covariates=own | {"T_a_degC": 22 + 0.1 * np.arange(22.0)})
    apart = correct(lagging(model, (0.0, 0.0), sensor_u=0.5), part, each, SETTINGS)
    # Each point is off by as much along x as along y, and g = 2/n (cos, sin) of each in 2 r;
    # corrections turn these directions a little.
    turned = np.nanmax(np.abs(without.error)) / 90
    of_noise = machine_u(apart) ** 2 - machine_u(without) ** 2
    assert of_noise == pytest.approx(4 / 11 * 0.001**2, rel=2 * turned)
