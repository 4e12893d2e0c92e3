"""How many causes the effects found are."""

from __future__ import annotations

import pytest
from warm_day import T, empty, of_covariate, step

from mtu_cli.close_loop_sealed.analyses.loop.causes import causes, levels_of
from mtu_cli.close_loop_sealed.analyses.loop.state import Step


def steps_of(*names: str) -> list[Step]:
    """By name; of a growth the member of the spindle's temperature, from 20 degC; `a|b` is an
    effect a which may be b as well, `name!` that of another sensor.
    """
    prepared, found = empty()[1], []
    for text in names:
        name, *rivals = text.rstrip("!").split("|")
        sensor = "T_part_degC" if text.endswith("!") else T
        of = of_covariate(prepared, name, sensor)[0] if name.startswith("thermal") else 0
        found.append(step(prepared, name, of, rivals))
    return found


@pytest.mark.parametrize(
    ("names", "count"),
    [
        ((), 0),
        (("thermal-growth-x",), 1),
        (("thermal-growth-x", "thermal-drift-x"), 1),
        (("thermal-drift-x", "offset-x", "thermal-growth-x"), 1),
        (("thermal-growth-x", "trend-x|thermal-drift-x"), 1),
        (("thermal-growth-x", "trend-x"), 2),
        # A growth is not its own drift, nor is what acts along another axis.
        (("thermal-growth-x|thermal-drift-x",), 1),
        (("thermal-growth-x", "step-y|thermal-drift-x"), 2),
        (("thermal-growth-x", "thermal-drift-x", "trend-x|thermal-drift-x"), 2),
        (("thermal-growth-x", "thermal-drift-x!"), 2),
        (("thermal-drift-x", "step-x"), 2),
        # An angle that changes turns X about a place along Y: the drift of its middle is that.
        (("thermal-squareness-xy", "thermal-drift-x"), 1),
        (("thermal-squareness-xy", "thermal-growth-x", "thermal-drift-x"), 2),
        (("thermal-squareness-xy", "thermal-drift-x!"), 2),
        (("offset-x",), 1),
        (("offset-x", "squareness-xy"), 1),
        (("wear-approach-x", "thermal-growth-x", "thermal-drift-x", "offset-x"), 2),
    ],
)
def test_a_growth_has_its_drift_and_an_effect_its_level(names: tuple[str, ...], count: int) -> None:
    assert causes(empty()[1], steps_of(*names)) == count


def test_levels_are_those_along_the_axes_of_what_was_found() -> None:
    prepared = empty()[1]
    (offset,) = steps_of("offset-x")
    assert levels_of(prepared, [offset]) == frozenset()
    assert levels_of(prepared, steps_of("trend-x")) == {offset.index}
