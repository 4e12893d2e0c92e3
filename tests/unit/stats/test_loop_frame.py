"""Columns in the coordinates of the strata: short cuts give what whole tables give."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats, Mask, frame_of, half_measured, holes, made, whole_frame

from mtu_cli.close_loop_sealed.stats.loop_frame import Frame

STRATA = made(6, 8, 2)
COLUMNS: dict[str, dict[int, Floats]] = {
    "part": {0: np.arange(6.0)[:, None] ** 2},
    "column": {1: np.arange(8.0)[None] ** 2},
    "two axes": {0: np.arange(6.0)[:, None], 1: np.sin(np.arange(8.0))[None]},
    "cells": {0: np.outer(np.arange(6.0), np.cos(np.arange(8.0)))},
}
MASKS: dict[str, Mask] = {
    "holes": holes(6, 8, 0.25, 1),
    "half": half_measured(6, 8),
    "blocks": np.kron(np.eye(2), np.ones((3, 4))) > 0,
}


def whole(parts: dict[int, Floats]) -> Floats:
    table = np.zeros(STRATA.shape)
    for axis, values in parts.items():
        table[:, :, axis] = values
    return table


def flat(column: dict[int, Floats]) -> Floats:
    y = np.zeros(STRATA.size)
    for index, values in column.items():
        y[STRATA.all[index].slice] = values
    return y


@pytest.mark.parametrize("name", COLUMNS)
def test_short_columns_are_those_of_the_whole_table(name: str) -> None:
    frame = whole_frame(STRATA)
    y, _ = STRATA.coordinates(whole(COLUMNS[name]))
    np.testing.assert_allclose(flat(frame.column(COLUMNS[name])), y, rtol=0, atol=1e-11)


@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("name", COLUMNS)
def test_columns_of_incomplete_tables_are_completed_as_the_errors_are(name: str, mask: str) -> None:
    frame = frame_of(STRATA, MASKS[mask])
    found = flat(frame.column(COLUMNS[name]))
    given = np.where(MASKS[mask][:, :, None], whole(COLUMNS[name]), np.pi)
    y, _ = frame.coordinates(given)
    # Strata that hold less than 2e-3 of a column, the smear of the filling, are left out.
    lost = float(np.sum((found - y) ** 2))
    assert lost <= 2e-3 * len(STRATA.all) * float(y @ y)
    assert set(np.flatnonzero(found)) <= set(np.flatnonzero(y))
    np.testing.assert_allclose(found[found != 0], y[found != 0], rtol=0, atol=1e-12)
    expected = frame.completion.fill(given).mean(axis=(0, 1))
    np.testing.assert_allclose(frame.means(COLUMNS[name]), expected, rtol=0, atol=1e-12)
    if name != "cells" and mask != "blocks":
        # A function of the part plus one of the column is completed exactly: nothing is lost.
        assert lost < 1e-20


@pytest.mark.parametrize("mask", ["none", *MASKS])
def test_many_columns_are_each_what_it_is_alone(mask: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where they are turned in several goes, with columns between them that need none."""
    monkeypatch.setattr(
        "mtu_cli.close_loop_sealed.stats.loop_frame.CACHED", 2 * int(np.prod(STRATA.shape))
    )
    frame = whole_frame(STRATA) if mask == "none" else frame_of(STRATA, MASKS[mask])
    rng = np.random.default_rng(4)
    several = [*COLUMNS.values(), *({1: rng.normal(size=(6, 8))} for _ in range(4))]
    for together, column in zip(frame.columns(several), several, strict=True):
        np.testing.assert_allclose(flat(together), flat(frame.column(column)), rtol=0, atol=1e-12)


def test_what_filling_smears_into_a_stratum_is_not_tested_there() -> None:
    """Of a column and hardly any of one that needs it; what is taken off is all of it."""
    frame = frame_of(STRATA, MASKS["holes"])
    column = {0: np.arange(6.0)[:, None] + 1e-3 * COLUMNS["cells"][0]}
    (tested,), (taken,) = frame.columns([column]), frame.whole_columns([column])
    assert {STRATA.all[i].kind for i in tested} == {"part"}
    assert {STRATA.all[i].kind for i in taken} == {"part", "line", "interaction", "column"}


def test_columns_lie_where_they_should() -> None:
    frame = whole_frame(STRATA)

    def kinds(name: str) -> list[tuple[str, int]]:
        return [(STRATA.all[i].kind, STRATA.all[i].axis) for i in frame.column(COLUMNS[name])]

    assert kinds("part") == [("part", 0)]
    assert kinds("column") == [("column", 1)]
    assert kinds("two axes") == [("part", 0), ("column", 1)]
    # P x H are products of a function of the part and one of the place.
    assert {kind for kind, _ in kinds("cells")} == {"part", "line", "interaction", "column"}


def test_a_constant_is_in_no_stratum() -> None:
    for mask in (np.ones((6, 8), bool), *MASKS.values()):
        frame = frame_of(STRATA, mask)
        assert frame.column({0: np.full((1, 1), 3.0)}) == {}
        assert frame.column({0: np.full((6, 8), 3.0)}) == {}


def test_a_freedom_is_taken_out_of_columns_and_errors_alike() -> None:
    def offsets(tables: Floats) -> Floats:
        return np.asarray(tables - tables.mean(axis=-2, keepdims=True))

    plain = whole_frame(STRATA)
    frame = Frame(strata=STRATA, completion=plain.completion, freeing=offsets)
    assert frame.column(COLUMNS["part"]) == {}
    found = frame.column(COLUMNS["cells"])
    assert {STRATA.all[i].kind for i in found} == {"line", "interaction", "column"}
    table = np.random.default_rng(2).normal(size=STRATA.shape)
    moved = table + np.random.default_rng(3).normal(size=(6, 1, 2))
    np.testing.assert_allclose(
        frame.coordinates(moved)[0], frame.coordinates(table)[0], rtol=0, atol=1e-12
    )


def test_where_entries_tell_no_noise_there_is_none() -> None:
    """Two entries a part, and every one of them needed for its part and its column."""
    there = np.zeros((6, 8), bool)
    there[np.arange(6), np.arange(6)] = there[np.arange(6), np.arange(6) + 2] = True
    frame = frame_of(STRATA, there)
    nominal = np.array([-3.0 if s.kind == "interaction" else s.size for s in STRATA.all])
    y = np.random.default_rng(4).normal(size=STRATA.size)
    found = frame.noise(y, np.maximum(nominal, 1.0), nominal, np.zeros((6, 6)))
    assert not found.variance.any()
    assert not found.dof.any()
