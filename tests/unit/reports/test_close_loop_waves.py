"""A periodic error over its pitch: all periods laid over one another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import effect, on_table
from effect_tables import table

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.reports.close_loop_curves import curves

X = np.cumsum(np.tile([13.0, 17.3, 8.9, 19.1, 11.7], 4))


def wave(pitch: float, **changed: object) -> FoundEffect:
    return effect(
        "cyclic-x",
        family="cyclic",
        parameters=(("sine", "um", 4.0, 0.3), ("cosine", "um", 3.0, 0.3)),
        equations={"Ex": f"sine*sin(2*pi*x/{pitch}) + cosine*cos(2*pi*x/{pitch})"},
        searched={"pitch_mm": (pitch, 0.99 * pitch, 1.01 * pitch)},
        **changed,
    )


def measured(own: FoundEffect, pitch: float) -> TableResult:
    """5 um of it, 1 um of level, and what the effect explains."""
    base = on_table("named", (own,))
    given = table(5, len(X), places=np.stack([X, 0 * X, 0 * X], 1))
    said = np.zeros(given.errors.shape)
    angle = 2 * np.pi * X / pitch
    said[:, :, 0] = 1e-3 * (4.0 * np.sin(angle) + 3.0 * np.cos(angle))
    level = np.array([1e-3, 0.0])
    return replace(base, table=replace(given, errors=said + level), explained=said)


@pytest.mark.parametrize("pitch", [20.0, 7.3])
def test_a_wave_of_many_periods_is_drawn_over_one(pitch: float) -> None:
    (curve,) = curves(measured(wave(pitch), pitch))
    (series,) = curve.series
    assert curve.xlabel == f"x within a pitch ({pitch:.6g} mm), mm"
    np.testing.assert_allclose(series.x, np.tile(X % pitch, 5), atol=1e-9)
    angle = 2 * np.pi * series.x / pitch
    np.testing.assert_allclose(series.y, 4.0 * np.sin(angle) + 3.0 * np.cos(angle) + 1.0, atol=1e-9)
    assert series.fine is not None
    at, line = series.fine
    assert (at[0], at[-1]) == (0.0, pitch)
    angle = 2 * np.pi * at / pitch
    np.testing.assert_allclose(line, 4.0 * np.sin(angle) + 3.0 * np.cos(angle) + 1.0, atol=1e-9)


@pytest.mark.parametrize(
    ("pitch", "changed"),
    [(150.0, {}), (20.0, {"alike": (12.0, 8.57)})],
    ids=["few-periods", "one-of-many"],
)
def test_few_periods_and_a_pitch_that_is_open_are_drawn_over_the_travel(
    pitch: float, changed: dict[str, object]
) -> None:
    (curve,) = curves(measured(wave(pitch, **changed), pitch))
    (series,) = curve.series
    assert series.x.max() == pytest.approx(X.max())
