"""What is logged of further parts that were never made, and the columns of effects on them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_tables import grid_places, shop_covariates, table
from model_examples import readings
from reading_examples import machine, only, run
from separation_examples import LIBRARY, found_as, members_of, prepared_day, prepared_of

from mtu_cli.close_loop_sealed.analyses.loop.classes import experiments
from mtu_cli.close_loop_sealed.analyses.loop.follow_up import (
    GOLDEN,
    OTHER_DAY_K,
    Wanted,
    as_it_is,
    follow_ups,
)
from mtu_cli.close_loop_sealed.analyses.loop.further_parts import FollowUp
from mtu_cli.close_loop_sealed.analyses.loop.separation import member_columns
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.model.reading_tables import reading_tables
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

ALL = ("x", "y", "z", "dir_x", "dir_y", "time_min", "sequence", "tool_parts", "load",
       "T_spindle_degC", "T_part_degC")  # fmt: skip
P, H, K = 9, 12, 6


def shop() -> ResidualTable:
    return table(P, H, places=grid_places(H, z=None), covariates=shop_covariates(P, H))


def plans(**wanted: object) -> dict[str, FollowUp]:
    own = Wanted(used=ALL, pitches={}, **wanted)  # type: ignore[arg-type]  # as in Wanted
    return {plan.name: plan for plan in follow_ups(shop(), own)}


def test_a_program_that_runs_both_ways_is_not_to_be_reversed_on_half_of_the_parts() -> None:
    base = shop()
    one_way = {"dir_x": np.ones((1, H)), "dir_y": np.ones((1, H))}
    turns = {"dir_x": np.where(np.arange(P) % 2, 1.0, -1.0)[:, None] * np.ones((P, H))}
    own = Wanted(used=("dir_x", "dir_y"), pitches={})
    for directions, phrase in ((one_way, "reverse the program's direction"), (turns, "")):
        made = replace(base, covariates={**base.covariates, **one_way, **directions})
        (plan,) = (plan for plan in follow_ups(made, own) if plan.name == "reverse")
        assert plan.fits == phrase
        assert plan.words == "run the program in the reverse direction"


def new(plan: FollowUp, name: str) -> np.ndarray:
    return np.broadcast_to(plan.values[name], (P + K, H))[P:]


def test_what_is_done_otherwise_changes_and_nothing_else() -> None:
    found = plans(outlying=[3])
    changed = {
        name: {
            column
            for column in plan.values
            if not np.array_equal(new(plan, column), new(found["more"], column))
        }
        for name, plan in found.items()
    }
    warmth = {"time_min", "T_spindle_degC", "T_part_degC"}
    assert changed == {
        "more": set(),
        "reverse": {"dir_x", "dir_y"},
        "new-tool": {"tool_parts"},
        "shift-x": {"x"},
        "stagger-x": {"x"},
        "shift-y": {"y"},
        "stagger-y": {"y"},
        "height": {"z"},
        "vary-load": {"load"},
        "again": {*warmth, "dir_x", "sequence", "tool_parts", "load"},
        "cold": warmth,
        "day-warmer": warmth,
        "day-colder": warmth,
    }


def test_what_was_made_stays_as_it_was() -> None:
    whole = shop()
    for plan in plans(outlying=[3]).values():
        np.testing.assert_array_equal(plan.places[:P], whole.places)
        for name, value in plan.values.items():
            if name in whole.covariates:
                was = np.broadcast_to(whole.covariates[name], (P, H))
                np.testing.assert_array_equal(np.broadcast_to(value, (P + K, H))[:P], was)


def test_counts_and_time_go_on_or_begin_again() -> None:
    found, log = plans(), shop_covariates(P, H)
    np.testing.assert_array_equal(new(found["more"], "sequence")[:, 0], np.arange(P + 1, P + K + 1))
    # Parts 1 to 8 of one tool, 1 of the next.
    np.testing.assert_array_equal(new(found["more"], "tool_parts")[:, 0], np.arange(2, 2 + K))
    np.testing.assert_array_equal(new(found["new-tool"], "tool_parts")[:, 0], np.arange(1, 1 + K))
    steps = np.diff(log["time_min"][:, 0])
    after = new(found["more"], "time_min")[:, 0] - log["time_min"][-1]
    np.testing.assert_allclose(after, np.median(steps) * np.arange(1, K + 1))
    np.testing.assert_array_equal(new(found["cold"], "time_min")[:, :1], log["time_min"][:K])
    warmer = new(found["day-warmer"], "T_spindle_degC")[:, :1]
    np.testing.assert_allclose(warmer, log["T_spindle_degC"][:K] + OTHER_DAY_K)
    np.testing.assert_array_equal(new(found["height"], "z") + shop().places[-K:, :, 2], 40.0)
    np.testing.assert_array_equal(
        new(found["again"], "sequence"), 4.0
    ) if "again" in found else None


@pytest.mark.parametrize(
    ("travel", "pitches", "by"),
    [
        (None, {}, [13.0]),
        (None, {"x": 20.0}, [5.0]),
        ((0.0, 200.0), {}, [13.0, 60.0]),
        ((5.0, 250.0), {}, [13.0, 110.0]),
        ((-100.0, 145.0), {}, [-13.0, -110.0]),
        ((-1000.0, 145.0), {}, [-13.0, -572.5]),
        ((9.0, 141.0), {}, []),
    ],
)
def test_the_fixture_is_shifted_within_the_travel(
    travel: tuple[float, float] | None, pitches: dict[str, float], by: list[float]
) -> None:
    """The holes stand from 10 to 140 mm."""
    ends = {} if travel is None else {"x": travel}
    wanted = Wanted(used=("x",), pitches=pitches, travel=ends)
    found = [plan for plan in follow_ups(shop(), wanted) if plan.name == "shift-x"]
    shifts = [plan.places[P:, :, 0] - shop().places[-K:, :, 0] for plan in found]
    assert len(shifts) == len(by)
    for shift, wanted_by in zip(shifts, by, strict=True):
        np.testing.assert_allclose(shift, wanted_by)
    # Only half of the travel itself is called so.
    halves = ["half of the travel" in plan.fits for plan in found]
    assert halves == [abs(b) == 572.5 for b in by]


def test_the_sequence_stands_for_the_tool_where_nothing_else_counts() -> None:
    log = shop_covariates(P, H)
    whole = shop()
    without = replace(whole, covariates={n: v for n, v in log.items() if n != "tool_parts"})
    _, plan = follow_ups(without, Wanted(used=("sequence",), pitches={}))
    assert plan.name == "new-tool"
    assert "count its parts" in plan.words
    np.testing.assert_array_equal(plan.values["sequence"][P:, 0], np.arange(P + 1, P + K + 1))
    np.testing.assert_array_equal(plan.new_tool["sequence"][P:, 0], np.arange(1, K + 1))
    # With a tool's own count, an effect of the sequence goes on.
    assert [p.name for p in follow_ups(whole, Wanted(used=("sequence",), pitches={}))] == ["more"]


def test_passes_are_measured_again_not_made(tmp_path: Path) -> None:

    found = only(reading_tables(machine(tmp_path), None, readings([run(8)])))
    wanted = Wanted(used=("x", "dir_x", "sequence", "time_min"), pitches={})
    names = [plan.name for plan in follow_ups(found, wanted)]
    assert names == ["more", "shift-x", "stagger-x", "cold"]
    assert follow_ups(found, wanted)[0].words == "measure 6 more passes as before"
    (chosen,) = experiments(*found_as(prepared_of(found), ["warm-up-x", "trend-x"]))
    assert chosen.experiment is not None
    assert chosen.experiment.do == "repeat the run after a cold start (predicted for 6 more passes)"


def test_without_further_parts_the_columns_are_those_of_the_library() -> None:
    for whole in (shop(), prepared_day("A", 4).table, prepared_day("B", 4).table):
        plan = as_it_is(whole)
        shape = whole.there.shape
        for candidate in candidates(whole, LIBRARY):
            for member in candidate.members[:5]:
                again = member_columns(member, whole, plan)
                assert len(again) == len(member.columns)
                for column, own in zip(again, member.columns, strict=True):
                    assert column.keys() == own.keys()
                    for axis, lever in own.items():
                        size = float(np.abs(lever).max())
                        np.testing.assert_allclose(
                            np.broadcast_to(column[axis], shape),
                            np.broadcast_to(lever, shape),
                            rtol=0,
                            atol=1e-12 * size,
                        )


def test_what_stands_out_does_so_where_it_is_made_or_measured_again() -> None:
    prepared = prepared_day("A", 4)
    whole = prepared.table
    wanted = Wanted(used=(), pitches={}, outlying=[2])
    more, again = follow_ups(whole, wanted)
    feature = prepared.members[members_of(prepared, "feature-outlier")[5]]
    part = prepared.members[members_of(prepared, "part-outlier")[2]]
    for plan in (more, again):
        column = np.broadcast_to(member_columns(feature, whole, plan)[0][0], (27, 24))
        np.testing.assert_array_equal(column, np.broadcast_to(np.eye(24)[5], (27, 24)))
    np.testing.assert_array_equal(member_columns(part, whole, more)[0][0][21:], 0.0)
    np.testing.assert_array_equal(member_columns(part, whole, again)[0][0][21:], 1.0)


@pytest.mark.parametrize(
    ("read", "most"),
    [(None, 65.0), ((0.0, 145.0), 13.0), ((0.0, 180.0), 40.0), ((0.0, 900.0), 130.0)],
)
def test_of_an_axis_without_travel_the_fixture_goes_no_farther_than_is_known(
    read: tuple[float, float] | None, most: float
) -> None:
    """Holes in two rows, at 10 and 140 mm: their distance is the spacing, and all that is known of
    the axis.
    """
    table = shop()
    places = table.places.copy()
    places[..., 0] = np.where(np.arange(H) % 2 == 0, 10.0, 140.0)
    rows = replace(table, places=places)
    ends = {} if read is None else {"x": read}
    wanted = Wanted(used=("x",), pitches={}, read=ends)
    (plan,) = (plan for plan in follow_ups(rows, wanted) if plan.name == "stagger-x")
    by = (plan.places[P:, :, 0] - places[-K:, :, 0])[:, 0]
    np.testing.assert_allclose(by, most * (GOLDEN * np.arange(1, K + 1) % 1.0))
