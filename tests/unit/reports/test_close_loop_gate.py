"""The line of a gate of close-loop names what is behind the verdict."""

from __future__ import annotations

import pytest
from close_loop_examples import effect, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect, Verdict
from mtu_cli.close_loop_sealed.reports.close_loop import gate_text

CLEAR = effect("backlash-y")
LONG = ("backlash-x", "abbe-x", "trend-x", "scale-x", "radial", "step-x")


@pytest.mark.parametrize(
    ("verdict", "effects", "text"),
    [
        ("none", (), "verdict none"),
        ("named", (CLEAR,), "verdict named: backlash-y"),
        ("named", (CLEAR, effect()), "verdict named: backlash-y, backlash-x"),
        (
            "class",
            (effect(class_names=("backlash-x", "abbe-x")), CLEAR),
            "verdict class: backlash-x or abbe-x, backlash-y",
        ),
        (
            "class",
            (effect(class_names=LONG[:-1]),),
            "verdict class: backlash-x or abbe-x or trend-x or scale-x or radial",
        ),
        (
            "class",
            (effect(class_names=LONG),),
            "verdict class: backlash-x or abbe-x or trend-x or scale-x or 2 more",
        ),
        ("unexplained", (), "verdict unexplained"),
        ("named", (effect("step-dx_x", component="dx_x"),), "verdict named: step-dx_x"),
    ],
)
def test_a_gate_names_what_it_has_found(
    verdict: Verdict, effects: tuple[FoundEffect, ...], text: str
) -> None:
    assert gate_text(result(on_table(verdict, effects))) == text


def test_beside_what_has_no_name_a_hint_is_no_finding() -> None:
    def unexplained(*effects: FoundEffect, **changed: object) -> CloseLoopResult:
        return result(on_table("unexplained", effects, **changed))

    hint = unexplained(CLEAR, fired=("serial-correlation",))
    assert gate_text(hint) == "verdict unexplained, with a hint at backlash-y"
    vague = effect(class_names=("backlash-x", "unnamed-drift-x"))
    both = unexplained(CLEAR, vague, nameless=("unnamed-drift-y",))
    assert gate_text(both) == (
        "verdict unexplained, beside backlash-y, with a hint at backlash-x or unnamed-drift-x"
    )
