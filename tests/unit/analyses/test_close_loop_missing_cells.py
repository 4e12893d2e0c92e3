"""Cells that are missing make no second cause of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import grid_places
from effect_tables import table as points_table
from separation_examples import LIBRARY

from mtu_cli.close_loop_sealed.analyses.loop.one_table import loop_on
from mtu_cli.close_loop_sealed.model.effect_candidate import centred_axes
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

PARTS, FEATURES = 16, 12
ANGLE = 5e-5
KNOWN = ("squareness-xy", "offset-x", "scale-x", "step-x")


def out_of_square(gone: float) -> ResidualTable:
    """About y = 0, without a shift; `gone` of the cells were not measured."""
    rng = np.random.default_rng(3)
    table = points_table(PARTS, FEATURES, places=grid_places(FEATURES, jitter=2.0))
    errors = 1e-3 * rng.normal(size=table.errors.shape) + 5e-4 * rng.normal(size=(PARTS, 1, 2))
    errors[..., 0] -= ANGLE * table.places[..., 1]
    there = rng.random((PARTS, FEATURES)) >= gone
    if not gone:
        there[:] = True
    return replace(
        table,
        errors=np.where(there[..., None], errors, np.nan),
        repeats=table.repeats * there,
    )


@pytest.mark.parametrize("gone", [0.0, 0.01, 0.3])
def test_a_squareness_about_a_place_is_one_cause(gone: float) -> None:
    table = out_of_square(gone)
    known = [c for c in candidates(table, LIBRARY) if c.name in KNOWN]
    found = loop_on(table, known, LIBRARY, alpha=0.05, most=4, seed=1).result
    assert {effect.name for effect in found.effects} == {"squareness-xy", "offset-x"}
    assert not any(effect.levels for effect in found.effects)
    (point,) = found.neutral_points
    assert (point.axis, point.covariate) == ("x", "y")
    assert abs(point.at) < 3 * point.u


def mean_over(column: Floats, there: Floats) -> float:
    return float(np.broadcast_to(column, there.shape)[there.astype(bool)].mean())


def test_what_is_centred_has_no_mean_over_the_cells_that_are_there() -> None:
    table = out_of_square(0.3)
    there = table.there.astype(float)
    for candidate in candidates(table, LIBRARY):
        for member in candidate.members:
            for axis in {axis for column in member.columns for axis in column}:
                own = [column[axis] for column in member.columns if axis in column]
                sizes = [np.sqrt(mean_over(v**2, there)) for v in own]
                pairs = zip(own, sizes, strict=True)
                none = all(abs(mean_over(v, there)) <= 1e-6 * s for v, s in pairs)
                assert (axis in member.centred) == none


def test_one_column_with_a_mean_is_enough() -> None:
    there = np.array([[True, True], [True, False]])
    even, odd = np.array([[1.0, -2.0]]), np.array([[1.0, 1.0]])
    assert centred_axes([{0: even}], there) == {0}
    assert centred_axes([{0: even}, {0: odd}], there) == set()
    assert centred_axes([{0: odd}, {0: even, 1: even}], there) == {1}
    assert centred_axes([{0: even}], np.zeros((2, 2), bool)) == set()
