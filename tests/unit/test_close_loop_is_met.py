"""When the gates of close-loop are met."""

from __future__ import annotations

import pytest
from close_loop_examples import ambiguous, effect, left_over, named, nothing, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult
from mtu_cli.close_loop_sealed.cli.close_loop import gates_of


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
    gates = gates_of(found)
    assert set(gates) == {"found", "unexplained"}
    assert {name for name, gate in gates.items() if gate(0.0)} == met
