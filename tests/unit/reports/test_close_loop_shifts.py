"""What close-loop says of shifts, and of the temperature at which an angle is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import effect, on_component, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


def test_an_offset_in_a_level_is_told_with_its_effect() -> None:
    def said(family: str, level: float) -> str:
        own = effect(
            f"{family}-x",
            parameters=(("cubic", "um/m^3", 480.0, 120.0), ("level", "um", level, 0.3)),
            equations={"Ex": "cubic*(x - 75)**3 + level"},
        )
        return words(result(on_table("named", (own,))))

    shifted = ", and everything is shifted along X by 3.78 ± 0.30 um (curvature-x)."
    assert shifted in said("curvature", 3.78)
    assert "everything is shifted" not in said("curvature", 0.78)
    # That of a drift holds its own constant part.
    assert "everything is shifted" not in said("thermal-drift", 3.78)


def test_a_level_of_a_component_is_no_shift() -> None:
    """Its readings are 0 where the instrument was set to 0."""
    own = effect(
        "curvature-x",
        parameters=(("cubic", "um/m^3", 480.0, 120.0), ("level", "um", 3.78, 0.3)),
        equations={"Ex": "cubic*(x - 75)**3 + level"},
    )
    assert "shifted along X by 3.78" in words(result(on_table("named", (own,))))
    text = words(result(on_component("dx_x", "um", "named", (own,))))
    assert "bends along the travel" in text
    assert "shifted" not in text


@pytest.mark.parametrize(
    ("now", "told"),
    [
        (-5.0, "T_a = 19.00 ± 0.20 (beyond the data: 20 to 26), where squareness-xy and thermal-"),
        (-3.0, "T_a = 20.60 ± 0.15, where squareness-xy and thermal-squareness-xy cancel."),
        (-40.0, None),
        (0.0, None),
    ],
)
def test_an_angle_that_changes_is_right_at_a_temperature(now: float, told: str | None) -> None:
    """T = 23 - c/g; u by (u_c^2 + (c/g)^2 u_g^2)/g^2, of c and g known by themselves."""
    ways = {"Ex": "angle*(T_a - 23.0)*(y - 70)"}
    change = effect(
        "thermal-squareness-xy",
        parameters=(("angle", "arcsec/K", -1.25, 0.05 if now else 2.5),),
        equations=ways,
        covariate="T_a",
    )
    same = effect(
        "squareness-xy", parameters=(("angle", "arcsec", now or -3.0, 0.15),),
        equations={"Ex": "angle*(y - 70)"},
    )  # fmt: skip
    item = on_table("named", (change, same))
    temperatures = {"T_a": np.linspace(20.0, 26.0, 9)[:, None]}
    item = replace(item, table=replace(item.table, covariates=temperatures))
    u = [own.parameters[0][3] for own in (change, same)]
    text = words(replace(result(item), covariance=np.diag(np.square(u))))
    if told is None:
        assert "is right at" not in text
    else:
        assert f"The angle of X and Y is right at {told}" in text
    doubtful = replace(same, class_names=("squareness-xy", "rotation-x"))
    item = replace(item, effects=(change, doubtful), verdict="class")
    assert "The angle of X and Y is right" not in words(
        replace(result(item), covariance=np.diag(np.square(u)))
    )


def test_of_one_part_what_it_lies_shifted_by_is_told() -> None:
    """The machine may do that to every part: nothing tells."""
    item = on_table("named", (effect(),))
    table = item.table
    errors = np.full((1, *table.errors.shape[1:]), 1e-3) * (12.0, 2.0)
    one = replace(table, parts=("P1",), errors=errors, repeats=table.repeats[:1], covariates={})
    own = replace(item, table=one, explained=np.zeros_like(errors), floor=1.5e-3)
    text = words(result(own))
    assert "Of one part it is not known whether it lay shifted or the machine" in text
    assert "a mean error of X 12 um is left." in text
    many = replace(item, floor=1e-9)
    assert "Of one part" not in words(result(many))
