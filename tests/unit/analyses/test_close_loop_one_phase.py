"""The size of a wave of which the places show one phase."""

from __future__ import annotations

import numpy as np
import pytest
from close_loop_examples import effect
from crossed_tables import Floats
from effect_tables import table as points_table
from numpy.typing import ArrayLike

from mtu_cli.close_loop_sealed.analyses.loop.one_phase import least_amplitude
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

PITCH, STEP = 60.0, 30.0


def at(given: ArrayLike) -> ResidualTable:
    x = np.asarray(given, np.float64)
    places = np.stack([np.repeat(x, 2), np.tile([0.0, 60.0], len(x)), np.full(2 * len(x), 9.0)], 1)
    return points_table(5, len(places), places=places)


def wave(value: float, *more: tuple[str, str, float, float], name: str = "sine") -> FoundEffect:
    shape = {"sine": "sin", "cosine": "cos"}
    parameters = ((name, "um", value, 0.3), *more)
    terms = [f"{n}*{shape[n]}(2*pi*x/60)" if n in shape else n for n, *_ in parameters]
    return effect("cyclic-x", parameters=parameters, equations={"Ex": " + ".join(terms)})


@pytest.mark.parametrize("first", [1.0, 3.0, 10.0, 17.0])
@pytest.mark.parametrize("name", ["sine", "cosine"])
def test_it_is_what_the_errors_differ_by_whatever_phase_was_written(
    first: float, name: str
) -> None:
    """Errors of +-5 um in turn: 5/|sin| or 5/|cos| of the first place's phase is written."""
    phase = 2 * np.pi * first / PITCH
    lever = abs(np.sin(phase) if name == "sine" else np.cos(phase))
    own = wave(-5.0 / lever, ("level", "um", 2.0, 0.1), name=name)
    found = least_amplitude(own, at(first + STEP * np.arange(6)))
    assert found == pytest.approx((5e-3, 0.3e-3 * lever), rel=1e-9)


def test_of_two_places_any_wave_is_one_column() -> None:
    """The errors there are 0 and 4 um: a wave between -2 and 2, beside a level, has them."""
    assert least_amplitude(wave(4.0), at(np.array([0.0, 15.0]))) == pytest.approx((2e-3, 0.15e-3))


@pytest.mark.parametrize(
    ("own", "x"),
    [
        (wave(3.0, ("cosine", "um", 4.0, 0.3)), 10.0 + STEP * np.arange(6)),
        (wave(3.0), np.array([0.0, 15.0, 37.0])),
        (effect("cyclic-x", parameters=(("size", "um", 1.0, 0.1),), equations={}), np.arange(3.0)),
    ],
    ids=["two-phases", "three-values", "no-equation"],
)
def test_what_is_more_than_one_column_has_its_own(own: FoundEffect, x: Floats) -> None:
    assert least_amplitude(own, at(x)) is None
