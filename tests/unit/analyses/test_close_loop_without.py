"""Offsets that a rival of an effect does without."""

from __future__ import annotations

import numpy as np
from close_loop_examples import effect

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.rivals import Instead, with_rivals


def shift(axis: str, value: float) -> FoundEffect:
    return effect(
        f"offset-{axis}",
        parameters=(("shift", "um", value, 0.3),),
        equations={f"E{axis}": "shift"},
        kind="offset",
    )


def without(found: tuple[float, float], beside: tuple[float, float]) -> tuple[str, ...]:
    """Of a rival along x, offsets of x and y beside what was found and beside the rival, um."""
    trend, warms = effect("trend-x"), effect("warm-up-x")
    effects = (trend, shift("x", found[0]), shift("y", found[1]))
    other = Instead(
        place=0,
        effects=(warms, shift("x", beside[0]), shift("y", beside[1])),
        covariance=np.eye(3),
    )
    told = with_rivals(effects, [other])
    assert told[1:] == effects[1:]
    (rival,) = told[0].rivals
    assert rival.name == "warm-up-x"
    return rival.without


def test_an_offset_that_is_not_told_beside_a_rival_is_none_of_it() -> None:
    assert without((3.9, 2.0), (0.1, 2.0)) == ("offset-x",)
    assert without((3.9, 2.0), (-0.1, 2.0)) == ("offset-x",)


def test_what_is_told_or_was_not_told_before_stays() -> None:
    assert without((3.9, 2.0), (3.8, 2.0)) == ()
    assert without((0.2, 2.0), (0.1, 2.0)) == ()
    # Of another axis it is not the rival's.
    assert without((3.9, 2.0), (3.8, 0.1)) == ()
