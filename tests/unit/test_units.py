from __future__ import annotations

import math

import pytest

from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM, UNITS, dimension_name


def test_the_units_of_the_contract() -> None:
    assert set(UNITS) == {"um", "mm", "nm", "arcsec", "urad", "mrad", "rad", "deg", "um/m"}
    assert all(name == unit.name for name, unit in UNITS.items())


@pytest.mark.parametrize(
    ("name", "dimension", "internal"),
    [
        ("um", LENGTH, 1e-3), ("mm", LENGTH, 1.0), ("nm", LENGTH, 1e-6),
        ("deg", ANGLE, math.radians(1)), ("arcsec", ANGLE, math.radians(1) / 3600),
        ("mrad", ANGLE, 1e-3), ("urad", ANGLE, 1e-6), ("rad", ANGLE, 1.0), ("um/m", ANGLE, 1e-6),
    ],
)  # fmt: skip
def test_lengths_in_mm_and_angles_in_rad(name: str, dimension: int, internal: float) -> None:
    assert UNITS[name].dimension == dimension
    assert UNITS[name].to_internal == pytest.approx(internal, rel=1e-15)


def test_an_arcsec_over_a_metre_is_4_848_um() -> None:
    """The rule of thumb of every metrologist: 1 arcsec is 4.848 um/m."""
    assert UNITS["arcsec"].to_internal / UNITS["um/m"].to_internal == pytest.approx(4.848, abs=5e-4)
    at_a_metre = ARCSEC * 1000 / UM
    assert at_a_metre == pytest.approx(4.848, abs=5e-4)


@pytest.mark.parametrize(
    ("dimension", "words"),
    [(LENGTH, "a length (mm)"), (ANGLE, "an angle or ratio (rad)"), (2, "mm^2"), (-1, "mm^-1")],
)
def test_dimension_names(dimension: int, words: str) -> None:
    assert dimension_name(dimension) == words
