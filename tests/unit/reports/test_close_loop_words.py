"""What close-loop says of several effects: long classes, one cause of two, what is not told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import ambiguous, effect, named, on_table, result

from mtu_cli.analyses.close_loop.fixed_point import fixed_points
from mtu_cli.analyses.close_loop.result import (
    CloseLoopResult,
    Experiment,
    FoundEffect,
    Verdict,
)
from mtu_cli.reports.close_loop import document, table
from mtu_cli.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


def long_class(now_d: float = 0.5, *names: str) -> CloseLoopResult:
    known = names or ("abbe-x", "trend-x", "scale-x", "cyclic-x", "radial")
    total = float(np.hypot(now_d, 3.2))
    told = Experiment(do="vary it on purpose", predicted_d=total, now_d=now_d, further_d=3.2)
    own = effect(class_names=("backlash-x", *known), experiment=told)
    return result(on_table("class", (own,)))


def test_of_a_long_class_the_sentence_names_three_and_the_table_all() -> None:
    text = words(long_class())
    assert text.startswith(
        "backlash-x, abbe-x, trend-x or one of 3 others (see the table): this data cannot tell. "
    )
    one = words(long_class(0.5, "abbe-x", "trend-x", "scale-x"))
    assert one.startswith("backlash-x, abbe-x, trend-x or one other (see the table): this")
    shown = plain_text(table(long_class()))
    assert "backlash-x may be: backlash-x, abbe-x, trend-x, scale-x, cyclic-x, radial\n" in shown
    assert "may be" not in plain_text(table(ambiguous()))


def test_rivals_that_the_data_should_have_told_apart_may_both_act() -> None:
    text = words(long_class(5.4))
    assert "One of them alone would show in this data (5.4 standard deviations)" in text
    assert "more than one may act, or none. To tell: vary it on purpose." in text
    # Below, and where something without a name is among them, an experiment tells.
    for found in (long_class(4.9), long_class(5.4, "abbe-x", "unnamed-drift-x")):
        assert "set them a further 3.2 standard deviations apart (so far " in words(found)
    # Of aliases nothing but rounding is left.
    assert "apart (so far none)." in words(long_class(2.5e-15))


GROWS = effect(
    "thermal-growth-x",
    parameters=(("growth", "um/m/K", 8.66, 0.4), ("level", "um", 5.8, 0.5)),
    equations={"Ex": "growth*(x - 75)*(T_spindle_degC - 20) + level"},
    covariate="T_spindle_degC",
)
DRIFTS = effect(
    "thermal-drift-x",
    parameters=(("drift", "um/K", 1.84, 0.17),),
    equations={"Ex": "drift*(T_spindle_degC - 24.54)"},
    covariate="T_spindle_degC",
)


def grown(
    *effects: FoundEffect, travel: tuple[float, float] = (0.0, 400.0), verdict: Verdict = "named"
) -> CloseLoopResult:
    """With independent parameters: 75 - 1.84/0.00866 = -137.5, u 21.9 mm."""
    item = on_table(verdict, effects, fired=("spatial-correlation",) * (verdict == "unexplained"))
    item = replace(item, table=replace(item.table, travel={"x": travel, "y": travel}))
    covariance = np.diag(np.square([p[3] for e in effects for p in e.parameters]))
    points = fixed_points(item.table, effects, covariance)
    return replace(result(replace(item, fixed_points=points)), covariance=covariance)


def test_growth_and_drift_are_one_cause_with_a_fixed_point() -> None:
    both = "X grows by 8.66 ± 0.40 um/m/K of T_spindle_degC from a fixed point at x = -137 ± 22 mm"
    names = " (thermal-growth-x and thermal-drift-x)"
    assert words(grown(GROWS, DRIFTS)).startswith(f"{both}{names}. Held-out parts: ")
    assert f"As a hint only: {both}{names}." in words(grown(GROWS, DRIFTS, verdict="unexplained"))
    # A third effect of which there are several: the two stay what they are.
    third = effect("backlash-x", class_names=("backlash-x", "abbe-x"))
    classed = words(grown(DRIFTS, GROWS, third, verdict="class"))
    assert classed.startswith(f"{both}{names[:2]}thermal-growth-x and thermal-drift-x). backlash-x")
    # The table keeps a row for each.
    rows = plain_text(table(grown(GROWS, DRIFTS))).splitlines()
    assert [row.split()[0] for row in rows if "± 0.40" in row or "± 0.17" in row][1:] == [
        "thermal-growth-x",
        "thermal-drift-x",
    ]


def test_a_fixed_point_that_is_not_told_is_said_to_be_so() -> None:
    text = words(grown(GROWS, DRIFTS, travel=(0.0, 50.0)))
    assert text.startswith(
        "X grows by 8.66 ± 0.40 um/m/K of T_spindle_degC (thermal-growth-x); X drifts by "
        "1.84 ± 0.17 um/K of T_spindle_degC (thermal-drift-x); the fixed point of X is not told. "
    )


def test_a_growth_of_all_axes_keeps_its_own_sentence() -> None:
    whole = effect(
        "thermal-growth", family="thermal-growth", axis=None, covariate="T_spindle_degC",
        parameters=(("growth", "um/m/K", 8.66, 0.4),),
        equations={
            "Ex": "growth*(x - 75)*(T_spindle_degC - 20)",
            "Ey": "growth*(y - 60)*(T_spindle_degC - 20)",
        },
    )  # fmt: skip
    text = words(grown(whole, DRIFTS))
    assert text.startswith("X and Y grow by 8.66 ± 0.40 um/m/K of T_spindle_degC (thermal-growth)")
    assert "; in all, the fixed point of X is x = -137 ± 22 mm. " in text


CREEPS = effect(
    "creep", family="creep", axis=None, says="the spindle creeps", covariate="T_spindle_degC",
    parameters=(("drift", "um/K", 1.84, 0.17),),
    equations={"Ex": "drift*(T_spindle_degC - 24)", "Ey": "drift*(T_spindle_degC - 24)"},
)  # fmt: skip
"""A drift of two axes by one parameter, from a user's library."""


def test_a_drift_of_two_axes_is_still_told_of_the_other() -> None:
    text = words(grown(GROWS, CREEPS))
    assert "from a fixed point at x = -137 ± 22 mm (thermal-growth-x and creep); " in text
    assert "; the spindle creeps: drift 1.84 ± 0.17 um/K (creep). Held-out" in text
    # Where the other axis grows too, both sentences together say all of it.
    other = effect(
        "thermal-growth-y", covariate="T_spindle_degC",
        parameters=(("growth", "um/m/K", 8.66, 0.4),),
        equations={"Ey": "growth*(y - 60)*(T_spindle_degC - 20)"},
    )  # fmt: skip
    both = words(grown(GROWS, CREEPS, other))
    for of_axis in ("x = -137 ± 22 mm (thermal-growth-x", "y = -152 ± 22 mm (thermal-growth-y"):
        assert f"from a fixed point at {of_axis} and creep)" in both
    assert "the spindle creeps" not in both


def test_an_effect_without_an_equation_keeps_its_sentence() -> None:
    chosen = effect("feature-outlier", axis=None, equations={}, chosen="H7", parameters=())
    assert "(feature-outlier)" in words(grown(GROWS, DRIFTS, chosen))


def test_a_level_is_explained_where_there_is_one() -> None:
    said = "level: a constant of the equation, the error where the effect itself is 0"
    assert said in plain_text(table(grown(GROWS)))
    assert "level" not in plain_text(table(named()))


def test_the_document_keeps_both_effects_and_adds_where_they_cancel() -> None:
    found = document(grown(GROWS, DRIFTS))
    assert [item["name"] for item in found["effects"]] == ["thermal-growth-x", "thermal-drift-x"]
    (point,) = found["fixed_points"]
    assert (point["axis"], point["covariate"]) == ("x", "T_spindle_degC")
    assert point["effects"] == ["thermal-growth-x", "thermal-drift-x"]
    assert point["told"] is True
    assert point["at_mm"]["value"] == pytest.approx(75 - 1.84 / 0.00866)
    low, high = point["at_mm"]["interval95"]
    assert low < point["at_mm"]["value"] < high
    assert document(named())["fixed_points"] == []
    weak = effect(
        "thermal-growth-x",
        parameters=(("growth", "um/m/K", 0.1, 10.0),),
        equations={"Ex": "growth*(x - 75)*(T_spindle_degC - 20)"},
    )
    (point,) = document(grown(weak, DRIFTS))["fixed_points"]
    assert (point["at_mm"]["interval95"], point["told"]) == (None, False)
