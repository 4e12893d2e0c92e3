"""Levers that are straight lines, and those that look so at the ends and in the middle alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import on_table

from mtu_cli.close_loop_sealed.analyses.loop.straight_lines import (
    NODES,
    extent,
    in_covariate,
    in_place,
    middle_and_rise,
)
from mtu_cli.language import parse

MIDDLE, HALF = 75.0, 65.0


def along(text: str) -> tuple[float, float]:
    return middle_and_rise(in_place(parse(text), "x", MIDDLE, HALF))


@pytest.mark.parametrize(
    ("text", "middle", "rise"),
    [("3", 3.0, 0.0), ("x", 75.0, 65.0), ("2*(x - 75) - 4", -4.0, 130.0), ("sqrt(2)", 2**0.5, 0.0)],
)
def test_a_line_is_known_by_its_middle_and_rise(text: str, middle: float, rise: float) -> None:
    assert along(text) == pytest.approx((middle, rise))


@pytest.mark.parametrize(
    "text",
    [
        *("(x - 75)**2", "abs(x - 76)", "log(x - 20)", "1/(x - 75)"),
        # As a line through both ends and the middle has it.
        *("cos(pi*(x - 10)/130)", "x + sin(pi*(x - 75)/65)", "(x - 75)**3"),
    ],
)
def test_what_bends_between_is_no_line(text: str) -> None:
    assert np.isnan(along(text)).all()


@pytest.mark.parametrize("pitch", [*np.geomspace(0.5, 130.0, 12), 1.0, 2.5, 10.0, 65.0])
def test_no_wave_has_the_same_phase_at_all_places(pitch: float) -> None:
    wave = np.cos(2 * np.pi * HALF * NODES / pitch)
    assert np.isnan(middle_and_rise(wave)).all()


def test_a_lever_in_both_is_a_line_at_every_place() -> None:
    zero, slope = in_covariate(parse("(x - 75)*(T_degC - 20) + 3"), "T_degC", "x", MIDDLE, HALF)
    np.testing.assert_allclose(zero, 3.0 - 20.0 * HALF * NODES, rtol=1e-12)
    np.testing.assert_allclose(slope, HALF * NODES, atol=1e-11)
    assert middle_and_rise(slope) == pytest.approx((0.0, HALF), abs=1e-11)
    _, slope = in_covariate(parse("x*sin(2*pi*T_degC)"), "T_degC", "x", MIDDLE, HALF)
    assert np.isnan(slope).all()


def test_the_extent_is_that_of_the_places_there_are() -> None:
    table = on_table("none").table
    assert extent(table, "x") == (75.0, 65.0)
    # One place has no extent: 1 mm stands for it.
    assert extent(table, "z") == (127.0, 1.0)
    places = table.places.copy()
    places[..., 2] = np.nan
    places[0, 0, 0] = np.nan
    table = replace(table, places=places)
    assert np.isnan(extent(table, "z")).all()
    assert extent(table, "x") == (75.0, 65.0)
