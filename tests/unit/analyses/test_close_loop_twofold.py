"""Effects that were found twice over: two forms of one effect that no one cause has at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats
from separation_examples import members_of
from warm_day import FEATURES, PARTS, described, empty, found, of_covariate, step, with_x

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.analyses.loop.twofold import twofold


def lost(prepared: Prepared) -> Floats:
    table, _ = empty()
    return 4e-3 * np.broadcast_to(table.covariates["dir_x"], prepared.table.there.shape)


def after(first: int, last: int) -> Floats:
    """5 um from one part to another."""
    own = np.zeros((PARTS, 1))
    own[first:last] = 5e-3
    return np.broadcast_to(own, (PARTS, FEATURES)).copy()


def two_steps(first: int, last: int) -> tuple[Prepared, tuple[Step, ...]]:
    """A jump and the way back, by the steps that are nearest to them."""
    prepared = with_x(after(first, last))
    at = [prepared.members[m].searched["at"] for m in members_of(prepared, "step-x")]
    near = [int(np.argmin(np.abs(np.array(at) - (part + 0.5)))) for part in (first, last)]
    return prepared, tuple(step(prepared, "step-x", of) for of in near)


def twice(prepared: Prepared, steps: Sequence[Step]) -> tuple[str, ...]:
    return twofold(described(prepared, found(prepared, *steps)))


def test_two_ways_to_write_one_cause_are_a_shape_without_a_name() -> None:
    """Lost motion by wear from the middle of the day and, less, from its beginning."""
    prepared = with_x(lost(empty()[1]))
    of_sequence = of_covariate(prepared, "wear-approach-x", "sequence")
    ways = [step(prepared, "wear-approach-x", of) for of in of_sequence]
    assert twice(prepared, ways) == ("wear-approach-x",)
    assert twice(prepared, ways[:1]) == ()
    # Of other tools they are causes of their own; and one of a class says so itself.
    of_tool = of_covariate(prepared, "wear-approach-x", "tool_parts")[0]
    assert twice(prepared, [ways[0], step(prepared, "wear-approach-x", of_tool)]) == ()
    unsure = step(prepared, "wear-approach-x", of_sequence[1], ("trend-x",))
    assert twice(prepared, [ways[0], unsure]) == ()
    # What has no name is none.
    nameless = replace(ways[1], credible=(*ways[1].credible, len(prepared.candidates)))
    assert twice(prepared, [ways[0], nameless]) == ("wear-approach-x",)


@pytest.mark.parametrize(("first", "last", "names"), [(4, 8, ()), (6, 7, ("step-x",))])
def test_two_steps_are_two_causes_but_where_they_all_but_cancel(
    first: int, last: int, names: tuple[str, ...]
) -> None:
    assert twice(*two_steps(first, last)) == names
