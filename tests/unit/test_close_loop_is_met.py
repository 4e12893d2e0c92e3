"""When the gates of close-loop are met."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest
from close_loop_examples import ambiguous, effect, left_over, named, nothing, on_table, result

from mtu_cli.analyses.close_loop.result import CloseLoopResult
from mtu_cli.cli.close_loop import _is_met
from mtu_cli.cli.close_loop_choices import Choices


def hint() -> CloseLoopResult:
    weak = effect("backlash-x", parameters=(("lost_motion", "um", 0.2, 0.15),))
    return result(on_table("named", (weak,)))


@pytest.mark.parametrize(
    ("found", "met"),
    [
        (named(), {"found"}),
        (ambiguous(), {"found"}),
        (left_over(), {"found", "unexplained"}),
        (nothing(), set()),
        (hint(), set()),
    ],
)
def test_a_gate_is_met_by_what_is_more_than_a_hint(found: CloseLoopResult, met: set[str]) -> None:
    for gate in ("found", "unexplained"):
        choices = cast("Choices", SimpleNamespace(gates=(gate,)))
        assert _is_met(found, choices) == (gate in met)
