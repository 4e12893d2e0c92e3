"""What close-loop says of readings: which component, which position and way, which pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import effect, on_component, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.gross import Gross
from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult
from mtu_cli.close_loop_sealed.analyses.loop.warnings import loop_warnings
from mtu_cli.close_loop_sealed.reports.close_loop import table
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text

OFF = Gross(part="2", feature="150 -", deviation=(0.0082,), score=9.0)


def shown(found: CloseLoopResult) -> str:
    return " ".join(plain_text(table(found)).split())


def test_of_several_components_each_entry_set_aside_has_its_own() -> None:
    """Also where nothing was found in it; the axis of a component is no axis of its error."""
    silent = replace(on_component("dy_x", verdict="none"), gross=(OFF,))
    found = result(on_component("dx_x"), silent)
    text = shown(found)
    said = "dy_x: set aside as far off whatever the rest does: position 150 in reverse of pass 2"
    assert f"{said} (8.2 um)" in text
    assert "Nothing undeclared in dy_x, beside what was set aside (see below)." in text
    assert "in dy_x." in shown(result(on_component("dx_x"), replace(silent, gross=())))
    (warning,) = [w for w in loop_warnings([silent], 9) if w.code == "outliers-set-aside"]
    assert "set aside of dy_x: position 150" in warning.message


@pytest.mark.parametrize(
    ("chosen", "place"), [("150 +", "150 forward"), ("150 -", "150 in reverse"), ("150", "150")]
)
def test_a_position_that_stands_out_is_told_with_its_way(chosen: str, place: str) -> None:
    own = effect(
        "feature-outlier", family="feature-outlier", equations={}, kind="outlier", chosen=chosen,
        parameters=(("shift_x", "um", 4.0, 0.2),), component="dx_x",
    )  # fmt: skip
    item = on_component(effects=(own,))
    assert f"position {place} stands out on every pass" in verdict_text(item, result(item))


def test_where_most_is_left_is_told_with_its_way() -> None:
    item = on_component(verdict="unexplained", effects=())
    errors = np.zeros_like(item.table.errors)
    errors[:, 7, 0] = 9e-3
    names = tuple(f"{50 * (i // 2)} {'+-'[i % 2]}" for i in range(len(item.table.features)))
    left = replace(
        item, table=replace(item.table, errors=errors, features=names),
        fired=("column-variance",), checks=(("column-variance", 0.003),),
        explained=np.zeros_like(errors), effects=(),
    )  # fmt: skip
    assert "most at position 150 in reverse (9.0 um)" in verdict_text(left, result(left))


def test_what_stands_for_the_pass_is_told() -> None:
    own = effect(
        "trend-x", equations={"Ex": "slope*(sequence - 3.5)"}, covariate="sequence",
        parameters=(("slope", "um", 1.4, 0.1),),
    )  # fmt: skip
    note = "sequence counts the passes in the order of time: 1, 2, ... (there and back are one)"
    assert note in shown(result(on_component(effects=(replace(own),))))
    assert note not in shown(result(on_table("named", (own,))))
    assert note not in shown(result(on_component()))


def test_an_offset_of_readings_one_way_may_be_half_of_a_lost_motion() -> None:
    own = effect(
        "offset-x", equations={"Ex": "shift"}, kind="offset",
        parameters=(("shift", "um", -2.3, 0.2),), component="dx_x",
    )  # fmt: skip
    item = on_component(effects=(own,))
    said = "or has half of a lost motion: all was read one way"
    assert said not in verdict_text(item, result(item))
    way = {**item.table.covariates, "dir_x": np.ones((1, len(item.table.features)))}
    alone = replace(item, table=replace(item.table, covariates=way))
    assert said in verdict_text(alone, result(alone))
