"""Printed results of NIST TN 1900, EA-4/02 and EURACHEM QUAM, as budgets.

Half a unit of the last printed digit, unless both figures are stated.
"""

from __future__ import annotations

import math

import pytest
from budget_examples import evaluated, single

TEMPERATURE = """
    quantity: {name: t, unit: degC}
    equation: tau
    inputs:
      tau:
        readings: [18.75, 28.25, 25.75, 28.00, 28.50, 20.75, 21.00, 22.75, 18.50, 27.25, 20.75,
          26.50, 28.00, 23.25, 28.00, 21.75, 26.00, 26.50, 28.00, 33.25, 32.00, 29.50]
"""


def test_surface_temperature() -> None:
    """NIST TN 1900, E2: mean of 22 daily readings 25.59 degC, u 0.872, 95 % (23.8, 27.4)."""
    result = evaluated(TEMPERATURE, digits=3)
    output = single(result)
    assert output.first.value == pytest.approx(25.59, abs=0.005)
    assert output.first.u == pytest.approx(0.872, abs=0.0005)
    assert output.first.dof == 21.0
    assert output.k == pytest.approx(2.08, abs=0.005)
    assert output.first.value - output.expanded == pytest.approx(23.8, abs=0.05)
    assert output.first.value + output.expanded == pytest.approx(27.4, abs=0.05)
    # The t of JCGM 101 is that of the first order here: both intervals are the same.
    assert output.validation.passed is True


PITOT = """
    quantity: {name: v, unit: m/s}
    equation: sqrt(2*delta*Rs*T/p)
    inputs:
      delta: {value: 1993, u: 12.5, unit: Pa}
      p: {value: 101400, u: 2100, unit: Pa}
      T: {value: 292.8, u: 0.11, unit: K}
      Rs: {value: 287.058, unit: J/(kg K)}
"""


def test_pitot_tube() -> None:
    """NIST TN 1900, example of a Pitot tube: v = 57.48 m/s with u = 0.62 m/s."""
    output = single(evaluated(PITOT))
    assert output.first.value == pytest.approx(57.48, abs=0.005)
    assert output.first.u == pytest.approx(0.62, abs=0.005)
    # By hand: relative u is half of the root of the sum of squares.
    relative = 0.5 * math.sqrt((12.5 / 1993) ** 2 + (2100 / 101400) ** 2 + (0.11 / 292.8) ** 2)
    assert output.first.u == pytest.approx(output.first.value * relative, rel=1e-12)


CADMIUM = """
    quantity: {name: c, unit: mg/L}
    equation: 1000*m*P/V
    inputs:
      m: {value: 100.28, u: 0.05, unit: mg}
      P: {value: 0.9999, half_width: 0.0001, distribution: rectangular}
      V: {value: 100.0, u: 0.07, unit: mL}
"""


def test_cadmium_standard() -> None:
    """EURACHEM/CITAC QUAM, A1: 1002.7 mg/L with u = 0.9 mg/L."""
    output = single(evaluated(CADMIUM))
    assert output.first.value == pytest.approx(1002.7, abs=0.05)
    assert output.first.u == pytest.approx(0.9, abs=0.05)


WEIGHT = """
    quantity: {name: mx, unit: g}
    equation: ms + dmd + dm + dmc + db
    inputs:
      ms: {value: 10000.005, U: 0.045, k: 2}
      dmd: {value: 0, UD}
      dm: {value: 0.020, u: 0.0144}
      dmc: {value: 0, half_width: 0.010, distribution: rectangular}
      db: {value: 0, half_width: 0.010, distribution: rectangular}
    coverage: {k: 2}
"""


def test_weight_of_ten_kilograms() -> None:
    """EA-4/02, S2: 10 000.025 g with u = 29.3 mg, U = 59 mg.

    The drift is printed as 8.95 mg, for limits of 15 mg, which are 8.66 mg as a rectangle:
    with that u is 29.2 mg, U 58 mg.
    """
    printed = single(evaluated(WEIGHT.replace("UD", "u: 0.00895, distribution: rectangular")))
    assert printed.first.value == pytest.approx(10000.025, abs=5e-4)
    assert printed.first.u == pytest.approx(0.0293, abs=5e-5)
    assert printed.expanded == pytest.approx(0.059, abs=5e-4)
    own = single(evaluated(WEIGHT.replace("UD", "half_width: 0.015, distribution: rectangular")))
    assert own.first.u == pytest.approx(0.0292, abs=5e-5)


RESISTOR = """
    quantity: {name: Rx, unit: ohm}
    equation: (Rs + dRd + dRts)*rc*r - dRtx
    inputs:
      Rs: {value: 10000.053, U: 0.005, k: 2}
      dRd: {value: 0.020, half_width: 0.010, distribution: rectangular}
      dRts: {value: 0, half_width: 0.00275, distribution: rectangular}
      dRtx: {value: 0, half_width: 0.0055, distribution: rectangular}
      rc: {value: 1, half_width: 1.0e-6, distribution: triangular}
      r: {value: 1.0000105, u: 0.07e-6}
    coverage: {k: 2}
"""


def test_resistor() -> None:
    """EA-4/02, S3: 10 000.178 ohm with u = 8.33 mohm, U = 17 mohm."""
    output = single(evaluated(RESISTOR))
    assert output.first.value == pytest.approx(10000.178, abs=5e-4)
    assert output.first.u == pytest.approx(0.00833, abs=5e-6)
    assert output.expanded == pytest.approx(0.017, abs=5e-4)
