"""Turns that are taken out, and with them the shifts of parts turned about another point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import grid_places
from effect_tables import table as points_table
from separation_examples import LIBRARY

from mtu_cli.close_loop_sealed.analyses.loop.evidence import WITH_TURNS, _without_direction
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.model.effect_library import candidates

TURNS = replace(LIBRARY, families=tuple(
    own for own in LIBRARY.families if own.family.family == "rotation-scatter"
))  # fmt: skip
"""Their candidates alone: those of a whole library took most of the time."""
PARTS, FEATURES, TABLES = 20, 16, 200
TURN, SHIFT, NOISE = 1e-4, 2e-3, 1e-4


def prepared_of(seed: int, about: tuple[float, float] | None) -> Prepared:
    """Parts that turn about a point (mm; None: about their middle) and shift by themselves."""
    rng = np.random.default_rng([5, seed])
    places = grid_places(FEATURES, jitter=2.0)
    table = points_table(PARTS, FEATURES, places=places)
    at = places[:, :2] - (places[:, :2].mean(axis=0) if about is None else np.array(about))
    turn = TURN * rng.normal(size=(PARTS, 1))
    errors = NOISE * rng.normal(size=(PARTS, FEATURES, 2))
    errors += SHIFT * rng.normal(size=(PARTS, 1, 2))
    errors += np.stack([-turn * at[:, 1], turn * at[:, 0]], axis=-1)
    own = replace(table, errors=errors)
    return prepare(own, candidates(own, TURNS))


def shifts(prepared: Prepared, y: Floats) -> list[Floats]:
    return [y[own.slice] for own in prepared.scan.frame.strata.all if own.kind == "part"]


def test_shifts_that_go_with_turns_go_with_them() -> None:
    """Turned about a far point the parts shift by 1000 mm times their turns: of 100 um is left
    what parts shift by themselves.
    """
    prepared = prepared_of(1, (-700.0, -700.0))
    before = shifts(prepared, prepared.y)
    after = shifts(prepared, _without_direction(prepared.scan, prepared.y, 0))
    # Coordinates of a part are those of its mean times the root of the features.
    own = SHIFT * np.sqrt(FEATURES)
    for was, left in zip(before, after, strict=True):
        assert np.sqrt(np.mean(was**2)) > 10 * own
        assert np.sqrt(np.mean(left**2)) == pytest.approx(own, rel=0.5)


def test_shifts_of_their_own_stay() -> None:
    """But for the share `WITH_TURNS` of them, of each axis, that goes with the turns by chance."""
    taken = []
    for seed in range(TABLES):
        prepared = prepared_of(seed, None)
        after = shifts(prepared, _without_direction(prepared.scan, prepared.y, 0))
        for was, left in zip(shifts(prepared, prepared.y), after, strict=True):
            taken.append(not np.array_equal(was, left))
    error = np.sqrt(WITH_TURNS * (1 - WITH_TURNS) / len(taken))
    assert np.mean(taken) < WITH_TURNS + 4 * error


def test_nothing_is_left_of_the_turns() -> None:
    prepared = prepared_of(2, None)
    once = _without_direction(prepared.scan, prepared.y, 0)
    assert np.abs(_without_direction(prepared.scan, once, 0) - once).max() < 1e-12
    lines = [own for own in prepared.scan.frame.strata.all if own.kind == "line"]
    was, left = (
        sum(float(y[own.slice] @ y[own.slice]) for own in lines) for y in (prepared.y, once)
    )
    assert left < 0.05 * was
