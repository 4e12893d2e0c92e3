"""Operations for which parts were clamped anew: a warning of close-loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import grid_places
from effect_tables import table as points_table
from scipy.stats import binom
from separation_examples import LIBRARY

from mtu_cli.close_loop_sealed.analyses.loop import CloseLoopResult, close_loop
from mtu_cli.close_loop_sealed.analyses.loop.clamped import CODE
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

SIGMA = 1.5e-3
FEW = replace(LIBRARY, families=tuple(
    own for own in LIBRARY.families if own.family.family in ("operation", "offset")
))  # fmt: skip
"""What takes a fixed shift away; of other families the warning asks nothing."""


def clamped(seed: int, s_mm: float, operations: tuple[str, ...] = ("A", "B")) -> ResidualTable:
    """Parts whose second operation lies elsewhere on each along x."""
    table = points_table(15, 24, places=grid_places(24, jitter=2.0), operations=operations)
    rng = np.random.default_rng(seed)
    errors = SIGMA * rng.normal(size=(15, 24, 2))
    errors[:, table.operation == 1, 0] += s_mm * rng.normal(size=(15, 1))
    return replace(table, errors=errors)


def closed(table: ResidualTable, library: EffectLibrary = LIBRARY) -> CloseLoopResult:
    return close_loop([table], library, alpha=0.05, max_effects=2, seed=1)


def told(result: CloseLoopResult) -> list[str]:
    return [own.message for own in result.warnings if own.code == CODE]


def test_two_operations_are_told_with_the_size() -> None:
    table = clamped(3, 6e-3)
    (text,) = told(closed(table))
    start = "operations A and B lie elsewhere against each other on every part, by s = x "
    assert text.startswith(start)
    s, u = (float(text.removeprefix(start).split()[i]) for i in (0, 2))
    assert ", y " not in text.split(" um")[0]
    assert s == pytest.approx(6.0, abs=3 * u)
    # A standard deviation of 15 values is known to 1/sqrt(28).
    assert u == pytest.approx(s / np.sqrt(28), rel=0.25)
    assert "(p <0.001)" in text


def test_of_several_operations_the_one_that_moves_is_told() -> None:
    (text,) = told(closed(clamped(4, 6e-3, ("A", "B", "C"))))
    assert text.startswith("operation B lies elsewhere against the others on every part, by s = x")


def test_clean_parts_and_a_fixed_shift_have_none() -> None:
    count, alarms = 12, 0
    for seed in range(count):
        table = clamped(10 + seed, 0.0)
        shifted = table.errors.copy()
        shifted[:, table.operation == 1] += 8e-3
        alarms += len(told(closed(replace(table, errors=shifted), FEW)))
    assert alarms <= binom.ppf(0.999, count, 1e-3)


def test_a_datum_of_every_operation_takes_it_away() -> None:
    assert told(closed(replace(clamped(3, 6e-3), datum="offset"))) == []


def test_of_few_features_turns_of_the_parts_are_not_told() -> None:
    table = points_table(15, 5, places=grid_places(5, jitter=2.0), operations=("A", "B"))
    rng = np.random.default_rng(1)
    errors = SIGMA * rng.normal(size=(15, 5, 2))
    errors[..., 0] -= 1e-4 * rng.normal(size=(15, 1)) * table.places[..., 1]
    assert told(closed(replace(table, errors=errors))) == []
