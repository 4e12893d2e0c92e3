from __future__ import annotations

import math
from fractions import Fraction

import pytest

from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM, UNITS, dimension_name


def test_the_units_of_the_contract() -> None:
    assert set(UNITS) == {"um", "mm", "nm", "arcsec", "urad", "mrad", "rad", "deg", "um/m"}
    assert all(name == unit.name for name, unit in UNITS.items())


@pytest.mark.parametrize(
    ("name", "mm"),
    [("um", Fraction(1, 1000)), ("mm", Fraction(1)), ("nm", Fraction(1, 1000000))],
)
def test_lengths_in_mm(name: str, mm: Fraction) -> None:
    assert UNITS[name].dimension == LENGTH
    assert UNITS[name].to_internal == float(mm)


@pytest.mark.parametrize(
    ("name", "rad"),
    [
        ("deg", math.radians(1)),
        ("arcsec", math.radians(1) / 3600),
        ("mrad", 1e-3),
        ("urad", 1e-6),
        ("rad", 1.0),
        ("um/m", 1e-6),
    ],
)
def test_angles_in_rad(name: str, rad: float) -> None:
    assert UNITS[name].dimension == ANGLE
    assert UNITS[name].to_internal == pytest.approx(rad, rel=1e-15)


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
