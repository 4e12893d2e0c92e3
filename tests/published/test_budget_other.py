"""Printed results of EA-4/02 and EURACHEM QUAM, as budgets.

Half a unit of the last printed digit, unless both figures are stated. QUAM A1 was compared with
the documentation of GTC (CITAC_A1), S2 with a package's test of EA-4/02 M:2022, S3 with Metrodata's
file for the GUM Workbench (metrodata.de/examples/S03.smu: 10 000.178 000 77 ohm, u = 8.328 004
mohm). The first edition's S2 (29.3 mg, with a drift of 8.95 mg) is given from memory of the
document and was compared with nothing: Metrodata's S02.smu has 8.66 mg, as the edition of 2022.
Its u is also computed by hand here.
"""

from __future__ import annotations

import math

import pytest
from budget_examples import evaluated, single

CADMIUM = """
    quantity: {name: c, unit: mg/L}
    equation: 1000*m*P/V
    inputs:
      m: {value: 100.28, u: 0.05, unit: mg}
      P: {value: 0.9999, half_width: 0.0001, distribution: rectangular}
      V: {value: 100.0, u: 0.07, unit: mL}
"""


def test_cadmium_standard() -> None:
    """EURACHEM/CITAC QUAM, A1: 1002.7 mg/L with u = 0.9 mg/L, from the rounded u(V) = 0.07 mL.

    From the three contributions to V, 0.041, 0.020 and 0.049 mL, unrounded u is 0.835 mg/L.
    """
    output = single(evaluated(CADMIUM))
    assert output.value == pytest.approx(1002.7, abs=0.05)
    assert output.u == pytest.approx(0.9, abs=0.05)
    volume = (
        "{value: 100.0, half_width: 0.1, distribution: triangular, contributions: [{u: 0.02}, "
        "{half_width: 0.084, distribution: rectangular}], unit: mL}"
    )
    unrounded = single(evaluated(CADMIUM.replace("{value: 100.0, u: 0.07, unit: mL}", volume)))
    assert unrounded.u == pytest.approx(0.835199, abs=5e-7)


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
    """EA-4/02, S2: 10 000.025 g with u = 29.3 mg, U = 59 mg (1999); 29.2 mg, 58 mg (M:2022).

    The first edition has the drift as 8.95 mg, for limits of 15 mg, which are 8.66 mg as a
    rectangle, as in that of 2022. Unrounded u is then 29.26 mg, U 58.52 mg.
    """
    printed = single(evaluated(WEIGHT.replace("UD", "u: 0.00895, distribution: rectangular")))
    by_hand = math.sqrt(0.0225**2 + 0.00895**2 + 0.0144**2 + 2 * 0.01**2 / 3)
    assert printed.u == pytest.approx(by_hand, rel=1e-12)
    assert printed.value == pytest.approx(10000.025, abs=5e-4)
    assert printed.u == pytest.approx(0.0293, abs=5e-5)
    assert printed.expanded == pytest.approx(0.059, abs=5e-4)
    own = single(evaluated(WEIGHT.replace("UD", "half_width: 0.015, distribution: rectangular")))
    assert own.u == pytest.approx(0.0292, abs=1e-4)
    assert own.u == pytest.approx(0.02926, abs=5e-5)
    assert own.expanded == pytest.approx(0.05852, abs=1e-4)


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
    assert output.value == pytest.approx(10000.178, abs=5e-4)
    assert output.u == pytest.approx(0.00833, abs=5e-6)
    assert output.expanded == pytest.approx(0.017, abs=5e-4)
    # 0.07e-6 is the rounded s/sqrt(5) of five ratios; they are from memory, but they alone give
    # the GUM Workbench's u to all its digits.
    readings = "{readings: [1.0000104, 1.0000107, 1.0000106, 1.0000103, 1.0000105]}"
    unrounded = single(evaluated(RESISTOR.replace("{value: 1.0000105, u: 0.07e-6}", readings)))
    assert unrounded.value == pytest.approx(10000.1780007665, abs=1e-9)
    assert unrounded.u == pytest.approx(0.00832800405, abs=5e-10)
