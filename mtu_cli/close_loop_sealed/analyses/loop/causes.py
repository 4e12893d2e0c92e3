"""How many causes the effects found are: what goes with another one is none of its own.

An axis that grows from a fixed point, or turns about one, shows, about the middle of places and
covariate, a growth (a change of angle), a drift with the same covariate, and an offset (see
`fixed_point` and `neutral_point`). To count each of them would end a search with half of one cause
taken out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.analyses.loop.straight_lines import depended_on
from mtu_cli.close_loop_sealed.model.effect_library import Member
from mtu_cli.model.machine_model import AXES

Lines = frozenset[tuple[str, int]]
"""A covariate and an axis each, along which errors are proportional to it."""
NONE: Lines = frozenset()


def causes(prepared: Prepared, steps: Sequence[Step]) -> int:
    """The number of causes that the steps of a search are.

    A drift goes with a growth or turn of its axes with the same covariate, once each, also where it
    is one of several names which the data cannot tell apart; an offset goes with any effect along
    its axis: it is a level of that.
    """
    members = [prepared.members[step.member] for step in steps if step.member >= 0]
    along = _axes(members)
    grown = {line for member in members for line in _grown(prepared, member)}
    drifted: set[tuple[str, int]] = set()
    count = 0
    for step in steps:
        if step.member < 0:
            count += _offset(prepared, step) not in along
            continue
        own = next((d for d in _drifts(prepared, step) if d and d <= grown - drifted), NONE)
        drifted |= own
        count += not own
    return count


def levels_of(prepared: Prepared, steps: Sequence[Step]) -> frozenset[int]:
    """The offsets, as candidates, along the axes of the effects found."""
    members = [prepared.members[step.member] for step in steps if step.member >= 0]
    along = _axes(members)
    scan = prepared.scan
    first = len(scan.columns)
    return frozenset(first + i for i, axis in enumerate(scan.offsets) if axis in along)


def _axes(members: Sequence[Member]) -> set[int]:
    """The axes along which members act."""
    return {axis for member in members for column in member.columns for axis in column}


def _offset(prepared: Prepared, step: Step) -> int | None:
    """The axis of an offset, None of an effect on the scatter."""
    scan = prepared.scan
    place = step.index - len(scan.columns)
    return scan.offsets[place] if 0 <= place < len(scan.offsets) else None


def _drifts(prepared: Prepared, step: Step) -> Iterator[Lines]:
    """What a step drifts along if it is a drift of a covariate alone: as found, or as another
    name along its axes that it may be as well; a growth is not its own drift.
    """
    own = prepared.members[step.member]
    yield _drifted(prepared, own)
    if _grown(prepared, own):
        return
    along = _axes([own])
    for index in step.credible:
        if step.index != index < len(prepared.candidates):
            for member in prepared.candidates[index].members:
                found = _drifted(prepared, member)
                if along <= {axis for _, axis in found}:
                    yield found


def _drifted(prepared: Prepared, member: Member) -> Lines:
    found = _depends(prepared, member)
    if member.covariate is None or any(over != {member.covariate} for over in found.values()):
        return NONE
    return frozenset((member.covariate, axis) for axis in found)


def _grown(prepared: Prepared, member: Member) -> Lines:
    """Where it changes with the place along one axis, its own or another, by its covariate."""
    if member.covariate is None:
        return NONE
    pairs = [{member.covariate, letter} for letter in AXES]
    found = _depends(prepared, member)
    return frozenset((member.covariate, axis) for axis, over in found.items() if over in pairs)


def _depends(prepared: Prepared, member: Member) -> dict[int, set[str]]:
    """By axis, what an effect depends on beside its parameters."""
    found = {}
    for axis, letter in enumerate(prepared.table.axes):
        text = member.equations.get(f"E{letter}")
        if text is not None:
            found[axis] = depended_on(text, member.parameters)
    return found
