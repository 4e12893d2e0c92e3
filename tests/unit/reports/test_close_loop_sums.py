"""What squarenesses come to that were found along both of their axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import effect, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.reports.close_loop_table import table
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text

ARCSEC = np.pi / 180 / 3600


def square(angle: float, u: float, along: str, name: str = "squareness-xy") -> FoundEffect:
    other = {"x": "y", "y": "x"}[along]
    return effect(
        name,
        family="squareness",
        axis="xy",
        parameters=(("angle", "arcsec", angle, u),),
        equations={f"E{along}": f"-angle*{other}"},
    )


@pytest.mark.parametrize(
    ("second", "correlation", "told"),
    [
        # sqrt(3^2 + 4^2), and with r = -1/4: sqrt(25 - 6).
        (30.0, 0.0, "10.0 ± 5.0 arcsec, less"),
        (30.0, -0.25, "10.0 ± 4.4 arcsec, less"),
        (60.0, 0.0, "20.0 ± 5.0 arcsec, more"),
    ],
)
def test_two_squarenesses_come_to_their_sum(second: float, correlation: float, told: str) -> None:
    """E_x = -a y and E_y = -b x: the angle of the axes is off by a + b."""
    before = effect(parameters=(("lost_motion", "um", 2.0, 0.3),))
    own = (before, square(-40.0, 3.0, "x"), square(second, 4.0, "y"))
    u = np.array([3e-4, 3 * ARCSEC, 4 * ARCSEC])
    r = np.eye(3)
    r[1, 2] = r[2, 1] = correlation
    found = replace(result(on_table("named", own)), covariance=np.outer(u, u) * r)
    said = f"squareness-xy was found along both axes: together X and Y are out of square by {told}"
    assert f"{said} than 90 degrees, and all is turned." in verdict_text(found.tables[0], found)
    shown = " ".join(plain_text(table(found)).split())
    assert shown.count("+ where the right angle is too large") == 1


def test_one_of_each_pair_of_axes_has_no_sum() -> None:
    own = (square(-40.0, 3.0, "x"), square(30.0, 4.0, "y", "squareness-xz"))
    found = replace(result(on_table("named", own)), covariance=np.eye(2))
    assert "together" not in verdict_text(found.tables[0], found)
