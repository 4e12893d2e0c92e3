"""Units of readings against their definitions, and 1 arcsec over 1 m, which is 4.848 um."""

from __future__ import annotations

import math

import pytest

from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM, UNITS, dimension_name

SIZES = {
    "um": (LENGTH, 1e-3), "mm": (LENGTH, 1.0), "nm": (LENGTH, 1e-6), "rad": (ANGLE, 1.0),
    "deg": (ANGLE, math.radians(1)), "arcsec": (ANGLE, math.radians(1) / 3600),
    "mrad": (ANGLE, 1e-3), "urad": (ANGLE, 1e-6), "um/m": (ANGLE, 1e-6),
}  # fmt: skip


def test_lengths_in_mm_and_angles_in_rad() -> None:
    found = {name: (unit.dimension, unit.to_internal) for name, unit in UNITS.items()}
    assert found.keys() == SIZES.keys()
    for name, (dimension, size) in SIZES.items():
        assert found[name][0] == dimension
        assert found[name][1] == pytest.approx(size, rel=1e-15)
    assert pytest.approx(4.848, abs=5e-4) == ARCSEC * 1000 / UM
    words = [dimension_name(dimension) for dimension in (LENGTH, ANGLE, 2, -1)]
    assert words == ["a length (mm)", "an angle or ratio (rad)", "mm^2", "mm^-1"]
