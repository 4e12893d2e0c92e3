"""Single features that scatter more than the others: told by close-loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import grid_places
from effect_tables import table as points_table
from numpy.typing import NDArray
from scipy.stats import binom
from separation_examples import LIBRARY

from mtu_cli.close_loop_sealed.analyses.loop import close_loop
from mtu_cli.close_loop_sealed.model.loose_features import CODE, loose_features
from mtu_cli.findings import Finding

Floats = NDArray[np.float64]


def told(found: tuple[Finding, ...] | list[Finding]) -> list[str]:
    return [own.message for own in found if own.code == CODE]


def test_close_loop_tells_it_with_its_size() -> None:
    """As it was given: gross entries of it are set aside before anything is judged."""
    table = points_table(21, 24, places=grid_places(24, jitter=2.0))
    rng = np.random.default_rng(3)
    errors = 1.5e-3 * rng.normal(size=(21, 24, 2))
    errors[:, 7, 0] += 12e-3 * rng.normal(size=21)
    own = replace(table, errors=errors)
    found = close_loop([own], LIBRARY, alpha=0.05, max_effects=3, seed=1)
    (text,) = told(found.warnings)
    assert text.startswith(f"feature {own.features[7]} scatters from part to part far more")
    shown = float(text.split("others: x ")[1].split()[0])
    s = float(np.std(errors[:, 7, 0], ddof=1))
    assert shown == pytest.approx(1e3 * s, rel=0.15)


def test_of_many_features_none_is_looked_for() -> None:
    rng = np.random.default_rng(1)
    errors, places = rng.normal(size=(6, 301, 1)), rng.uniform(size=(301, 3))
    errors[:, 3] *= 100.0
    names = [f"H{i}" for i in range(301)]
    there = np.full((6, 301), True)
    assert loose_features(errors, there, places, names, ["x"]) == []
    assert len(loose_features(errors[:, :40], there[:, :40], places[:40], names[:40], ["x"])) == 1


def test_a_feature_far_from_all_others_is_not_told() -> None:
    """Parts that grow, or a machine whose slopes drift, move it more than the others."""
    rng = np.random.default_rng(2)
    places = np.array([[5.0, 5, 0], [15, 5, 0], [5, 15, 0], [15, 15, 0], [395, 295, 0]])
    growth = 3e-5 * rng.normal(size=(20, 1))
    errors = 1e-3 * rng.normal(size=(20, 5, 1)) + (growth * places[:, 0])[:, :, None]
    there, names = np.full((20, 5), True), list("ABCDE")
    assert loose_features(errors, there, places, names, ["x"]) == []
    inside = places.copy()
    inside[[3, 4]] = places[[4, 3]]
    loose = 1e-3 * rng.normal(size=(20, 5, 1))
    loose[:, 4] *= 8
    assert len(loose_features(loose, there, inside, names, ["x"])) == 1


def test_what_rounding_leaves_scatters_not() -> None:
    rng = np.random.default_rng(3)
    errors = 0.01 + 1e-18 * rng.normal(size=(20, 6, 1))
    errors[:, 2] += 1e-17 * rng.normal(size=(20, 1))
    places = np.random.default_rng(4).uniform(size=(6, 3))
    assert loose_features(errors, np.full((20, 6), True), places, list("ABCDEF"), ["x"]) == []


ROW = np.column_stack([20.0 * np.arange(8), np.zeros((8, 2))])
SQUARE = np.array([[x, y, 0.0] for x in (0, 50, 100) for y in (0, 50, 100)])
FAR = np.array([[x, y, 10.0] for x in (5, 12, 25) for y in (5, 14, 25)] + [[320.0, 20.0, 10.0]])


@pytest.mark.parametrize(
    ("places", "column", "z_mm"),
    [(ROW, 0, 0.0), (SQUARE, 4, -5.0), (SQUARE, 4, 1e-6), (FAR, 2, 0.0)],
)
def test_where_a_loose_feature_lies_hides_it_not(places: Floats, column: int, z_mm: float) -> None:
    """At the end of a row, deeper than the others, or beside one that is far off."""
    rng, at = np.random.default_rng(7), places.copy()
    at[column, 2] += z_mm
    names = [f"H{i}" for i in range(len(at))]
    for _ in range(20):
        errors = 1e-3 * rng.normal(size=(20, len(at), 2))
        errors[:, column, 0] *= 10.0
        (found,) = loose_features(errors, np.full((20, len(at)), True), at, names, ["x", "y"])
        assert found.message.startswith(f"feature H{column} ")


@pytest.mark.parametrize("places", [ROW, SQUARE, FAR, FAR[[0, 2, 4, 6, 8, 9]]])
def test_parts_that_turn_and_grow_make_no_feature_loose(places: Floats) -> None:
    rng, told = np.random.default_rng(8), 0
    names = [f"H{i}" for i in range(len(places))]
    for _ in range(60):
        errors = 1e-3 * rng.normal(size=(20, len(places), 2))
        turn, growth = 1e-4 * rng.normal(size=(2, 20, 1))
        errors[..., 0] += growth * places[:, 0] - turn * places[:, 1]
        errors[..., 1] += growth * places[:, 1] + turn * places[:, 0]
        there = np.full((20, len(places)), True)
        told += bool(loose_features(errors, there, places, names, ["x", "y"]))
    assert told <= binom.ppf(0.999, 60, 1e-3)


def test_one_slip_makes_no_feature_loose() -> None:
    rng = np.random.default_rng(9)
    errors = 1e-3 * rng.normal(size=(20, 9, 2))
    errors[3, 4, 0] += 0.5
    there = np.full((20, 9), True)
    assert loose_features(errors, there, SQUARE, list("ABCDEFGHI"), ["x", "y"]) == []
