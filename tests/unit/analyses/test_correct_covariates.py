"""What correct goes by: covariates, drifts that lag; what it sums up by feature."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    DIAMETER,
    ROUNDING,
    ROUNDING_MM,
    codes,
    error_at,
    machine,
    ring_part,
    ring_places,
    ring_points,
    rings,
)
from model_examples import part_of, stated
from numpy.typing import NDArray

from mtu_cli.analyses.correct import CorrectResult, correct, unused_warmth
from mtu_cli.analyses.correct.rows import REACH
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.machine_model import MachineModel, drift_terms
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import only_rows
from mtu_cli.stats.lag import first_order_lag
from mtu_cli.units import UNITS

SETTINGS = Settings()


def refused(model: MachineModel, part: object, points: object, **at: float) -> list[str]:
    with pytest.raises(InputError) as caught:
        correct(model, part, points, SETTINGS, at)  # type: ignore[arg-type]  # as given
    return [str(problem) for problem in caught.value.findings]


def test_covariates_come_from_the_rows_else_from_the_call(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    model, part = machine(tmp_path), ring_part(tmp_path)
    bare = ring_points(measured, ["a"])
    (message,) = refused(model, part, bare)
    assert "cmm.csv, column 'T_scale_degC': a value of T_scale_degC for the machine 'm'" in message
    assert "--at T_scale_degC=VALUE" in message
    given = correct(model, part, bare, SETTINGS, {"T_scale_degC": 20.0})
    assert given.error[:, :2] == pytest.approx(error_at(measured, np.full(11, 20.0))[:, :2])
    own = ring_points(measured, ["a"], None, {"T_scale_degC": temperature})
    both = correct(model, part, own, SETTINGS, {"T_scale_degC": 35.0})
    assert both.error[:, :2] == pytest.approx(error_at(measured, temperature)[:, :2])
    assert codes(both) == ["not-used"]


def test_cells_without_a_number_are_told_with_their_rows(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    model, part = machine(tmp_path), ring_part(tmp_path)
    holes = temperature.copy()
    holes[[3, 7]] = np.nan
    found = refused(model, part, ring_points(measured, ["a"], None, {"T_scale_degC": holes}))
    assert [text.split(":")[0] for text in found] == [
        "cmm.csv, row 5, column 'T_scale_degC'",
        "cmm.csv, row 9, column 'T_scale_degC'",
    ]
    texts = np.array([*(f"{value:.2f}" for value in temperature[:10]), "warm"], object)
    (message,) = refused(model, part, ring_points(measured, ["a"], None, {"T_scale_degC": texts}))
    assert "row 12, column 'T_scale_degC': not a number: 'warm'" in message


def test_what_was_not_measured_or_calibrated_is_said(tmp_path: Path) -> None:
    _, measured, temperature = rings(1)
    own: dict[str, NDArray[np.float64] | NDArray[np.object_]] = {"T_scale_degC": temperature}
    points = ring_points(measured, ["a"], None, own)
    model = machine(tmp_path)
    bare = correct(model, ring_part(tmp_path, calibrated_mm=""), points, SETTINGS)
    assert codes(bare) == ["not-estimable"]
    assert np.isnan(bare.sizes[0].error).all()
    assert bare.sizes[0].size[1] == pytest.approx(DIAMETER, abs=ROUNDING_MM)
    kept = np.arange(11) != 4
    found = correct(model, ring_part(tmp_path), only_rows(points, kept), SETTINGS)
    assert codes(found) == ["not-measured", "no-scatter-known"]
    assert found.sizes == ()
    other = part_of(tmp_path, "features: {q: {x_mm: 0, y_mm: 0}, w: {x_mm: 9, y_mm: 0}}\n"
                    "lengths: [{from: q, to: w}]\n")  # fmt: skip
    assert codes(correct(model, other, points, SETTINGS)) == ["not-measured", "no-scatter-known"]


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({"T_a_degC": 20.9, "T_b_degC": 19.1, "load": 90.0}, None),
        ({"T_a_degC": 20.9, "T_b_degC": 26.0}, "(T_b_degC reads 26 degC)"),
        ({"T_a_degC": 17.5, "T_b_degC": 22.0, "T_c_degC": np.nan}, "reads 17.5 degC; 1 more se"),
    ],
)
def test_temperatures_that_nothing_in_the_model_goes_by_are_told(
    tmp_path: Path, columns: dict[str, float], told: str | None
) -> None:
    cold = stated(tmp_path, "components: {px: {unit: um, coefficients: [2], u_future: 1}}\n"
                            "equations: {Ex: px}\n")  # fmt: skip
    measured = rings(1)[1]
    own = {name: np.append(np.full(10, 20.0), value) for name, value in columns.items()}
    points = ring_points(measured, ["a"], None, dict(own))
    found = unused_warmth(cold, points, 20.0)
    assert [item.code for item in found] == ([] if told is None else ["no-thermal-component"])
    assert told is None or told in found[0].message
    assert unused_warmth(machine(tmp_path), points, 20.0) == []


# Corrected points summed up by feature.


def test_means_by_feature_and_the_largest_correction(tmp_path: Path) -> None:
    _, measured, temperature = rings(3)
    measured = measured.copy()
    measured[4, 1] = np.nan
    points = ring_points(measured, ["a", "a", "b"], [1, 2, 1], {"T_scale_degC": temperature})
    # One feature more often than the others, and one not at all.
    points = replace(points, feature=np.where(points.feature == 7, 6, points.feature))
    result = correct(machine(tmp_path), None, points, Settings())
    found = result.by_feature()
    assert found.features == tuple(name for name in points.features if name != "r7")
    for m, name in enumerate(found.features):
        own = [i for i in range(len(points)) if points.features[points.feature[i]] == name]
        for values, summed in (
            (points.measured - points.nominal, found.before),
            (result.corrected - points.nominal, found.after),
        ):
            for k in range(2):
                wanted = sum(values[i, k] for i in own) / len(own)
                assert summed[m, k] == pytest.approx(wanted, abs=ROUNDING_MM, nan_ok=True)
    largest, axis = result.largest
    assert axis == "xy"[int(np.nanargmax(np.nanmax(np.abs(result.error[:, :2]), axis=0)))]
    assert largest == np.nanmax(np.abs(result.error))


# Points corrected for drifts that lag behind temperatures, whose readings have a noise.


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
