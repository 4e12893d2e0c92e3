"""Where features of a calibrated ring stand at the temperature of the part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import part_of
from numpy.typing import NDArray

from mtu_cli.findings import InputError
from mtu_cli.model.simulate import SimulatedPoints, growth

IDS = ("e", "n", "w", "s", "far")
POINTS = np.array([[60.0, 20, 0], [10, 70, 0], [-40, 20, 0], [10, -30, 0], [200, 20, 0]])
"""Four on a circle of diameter 100 mm about (10, 20), and one that is not of it."""
RING = """\
features:
  e: {x_mm: 60, y_mm: 20}
  n: {x_mm: 10, y_mm: 70}
  w: {x_mm: -40, y_mm: 20}
  s: {x_mm: 10, y_mm: -30}
  far: {x_mm: 200, y_mm: 20}
circles:
  - {id: ring, features: [e, n, w, s],
     temperature: T_ring_degC, calibrated_mm: {20: 100.0, 30: 100.1}}
"""


def measured(temperatures: list[float] | None) -> SimulatedPoints:
    """All features, once at each temperature."""
    times = len(temperatures or [0.0])
    known = {} if temperatures is None else {"T_ring_degC": np.repeat(temperatures, len(IDS))}
    return SimulatedPoints(
        axes=("x", "y"),
        operation=None,
        part=("1",) * times * len(IDS),
        feature=IDS * times,
        repeat=np.ones(times * len(IDS), np.int64),
        measured=np.tile(POINTS[:, :2], (times, 1)),
        covariates=known,
    )


def moved(folder: Path, points: SimulatedPoints, text: str = RING) -> NDArray[np.float64]:
    found = growth(points, IDS, POINTS, part_of(folder, text).part.circles)
    return found.reshape(-1, len(IDS), 2)


def test_points_move_away_from_the_centre_as_the_diameter_grows(tmp_path: Path) -> None:
    """D is linear between calibrated temperatures and constant beyond: 0, 50 and 100 um more."""
    found = moved(tmp_path, measured([20.0, 25.0, 30.0, 40.0, 10.0]))
    outward = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1], [0, 0]])
    for um, shift in zip([0, 25, 50, 50, 0], found, strict=True):
        np.testing.assert_allclose(shift, 1e-3 * um * outward, rtol=0, atol=1e-12)


def test_a_circle_whose_temperature_is_not_known_stays_nominal(tmp_path: Path) -> None:
    assert not moved(tmp_path, measured(None)).any()
    plain = RING.replace("temperature: T_ring_degC, calibrated_mm: {20: 100.0, 30: 100.1}", "")
    assert not moved(tmp_path, measured([30.0]), plain).any()


def test_a_circle_that_its_points_do_not_determine(tmp_path: Path) -> None:
    circles = part_of(tmp_path, RING).part.circles
    line = measured([30.0])
    flat = POINTS * [1.0, 0.0, 1.0]
    with pytest.raises(InputError, match="goes through the nominal points"):
        growth(line, IDS, flat, circles)
