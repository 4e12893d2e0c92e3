"""Corrected points summed up by feature."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from correct_examples import (
    ROUNDING_MM,
    machine,
    ring_points,
    rings,
)

from mtu_cli.analyses.correct import (
    correct,
)
from mtu_cli.model.settings import Settings


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
