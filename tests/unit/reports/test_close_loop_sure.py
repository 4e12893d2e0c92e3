"""An effect that stands beside a drift or field without a name is told apart from the hints."""

from __future__ import annotations

from typing import Any

import pytest
from close_loop_examples import effect, left_over, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.shown import SURE
from mtu_cli.close_loop_sealed.reports.close_loop import document
from mtu_cli.close_loop_sealed.reports.close_loop_figure import figure
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text

SURELY = effect("backlash-x", unnamed=0.1 * SURE)
DOUBTFUL = effect(
    "thermal-drift-y", covariate="T_air_degC", unnamed=0.2,
    parameters=(("drift", "um/K", 1.84, 0.17),),
    equations={"Ey": "drift*0.1*(y - 60)"},
    class_names=("thermal-drift-y", "unnamed-drift-y"),
)  # fmt: skip


def nameless(*effects: FoundEffect, **changed: object) -> CloseLoopResult:
    return result(on_table("unexplained", effects, nameless=("unnamed-drift-y",), **changed))


def verdicts(found: CloseLoopResult) -> list[str]:
    return [own["verdict"] for own in document(found)["effects"]]


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


def test_a_lone_name_stands_where_what_has_no_name_lies_elsewhere() -> None:
    found = nameless(DOUBTFUL, SURELY)
    assert document(found)["verdict"] == "unexplained"
    assert verdicts(found) == ["unexplained", "named"]
    said = words(found)
    assert said.startswith("X gains 4.10 ± 0.30 um at reversal, too far from both sides (")
    assert (
        "(backlash-x). Beside that something is there, and this data cannot tell whether it has a "
        "name: a smooth drift in y without a name explains as much as the names do, or is likely "
        "in the place of one or beside them. As a hint only: thermal-drift-y (Y drifts by " in said
    )
    assert "/K of T_air_degC) or a smooth drift in y without a name." in said
    title = figure(found)._suptitle.get_text()  # type: ignore[attr-defined]  # by matplotlib
    assert "backlash-x; unexplained; as a hint: thermal-drift-y" in " ".join(title.split())


@pytest.mark.parametrize(
    "changed",
    [
        {"unnamed": SURE},
        {"kind": "scatter", "equations": {}, "parameters": ()},
        {"class_names": ("backlash-x", "abbe-x")},
        {"aliases": ("covariate-x",)},
    ],
)
def test_what_may_be_something_else_is_a_hint(changed: dict[str, Any]) -> None:
    found = nameless(effect("backlash-x", **changed), DOUBTFUL)
    assert verdicts(found) == ["unexplained", "unexplained"]
    assert words(found).startswith("Something is there, and this data cannot tell whether it has")
    # A check that fires, or an effect found twice over, leaves no doubt of that.
    for sure in ({"fired": ("serial-shape",), "checks": (("serial-shape", 0.001),)},
                 {"twofold": ("trend-x",)}):  # fmt: skip
        found = nameless(effect("backlash-x", **changed), DOUBTFUL, **sure)
        assert words(found).startswith("Something is there that no effect of the library describes")


def test_all_are_hints_where_a_check_fired_or_one_was_found_twice() -> None:
    assert verdicts(left_over((SURELY,))) == ["unexplained"]
    assert verdicts(nameless(SURELY, twofold=("trend-x",))) == ["unexplained"]


def test_an_effect_that_stands_leaves_no_hint_over() -> None:
    said = words(nameless(SURELY))
    assert "(backlash-x). Beside that something may be there" in said
    assert "hint" not in said


def test_elsewhere_an_effect_has_the_verdict_of_its_class() -> None:
    found = result(on_table("class", (SURELY, DOUBTFUL)))
    assert verdicts(found) == ["named", "class"]
