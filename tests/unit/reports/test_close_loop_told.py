"""What close-loop says of offsets that only one of a class has, of what has no name, of scatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import effect, on_table, result, scores

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import NeutralPoint
from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult
from mtu_cli.close_loop_sealed.reports.close_loop import document, table
from mtu_cli.close_loop_sealed.reports.close_loop_effects import direction_text
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text

DRIFTS = ("unnamed-drift-y",)


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


def test_an_offset_that_one_of_a_class_has_not_is_no_fact() -> None:
    """A trend is counted from its middle, a warm-up from its start: only one has an offset."""
    names = ("trend-x", "warm-up-x")
    trend = effect(
        "trend-x",
        parameters=(("slope", "um", 0.4, 0.014),),
        equations={"Ex": "slope*(sequence - 9.5)"},
        covariate="sequence",
        class_names=names,
    )
    warms = effect(
        "warm-up-x",
        parameters=(("rise", "um", 7.5, 0.4),),
        equations={"Ex": "rise*(1 - exp(-time_min/60))"},
        covariate="time_min",
        searched={"tau_min": (60.0, 41.0, 90.0)},
        class_names=names,
    )
    shift = effect(
        "offset-x",
        parameters=(("shift", "um", 3.9, 0.3),),
        equations={"Ex": "shift"},
        kind="offset",
    )
    point = NeutralPoint(
        axis="x", covariate="sequence", drift=(0,), offset=(1,), at=-0.2, u=0.9,
        interval=(-2.0, 1.6), seen=(1.0, 18.0), given=(0, "trend-x"),
    )  # fmt: skip

    def said(*without: str) -> str:
        own = replace(trend, rivals=(replace(warms, without=without),))
        return words(result(replace(on_table("class", (own, shift)), neutral_points=(point,))))

    # Beside what changes from part to part it is the mean of these, not a shift of all there are.
    fact = "verything is shifted along X by 3.90 ± 0.30 um on the mean of these parts (offset-x)."
    assert fact in said()
    assert fact not in said("offset-x")
    assert "[41, 90] min; offset-x is not told from 0 then." in said("offset-x")
    assert "with offset-x that is one cause: X is right at sequence = -0.2" in said("offset-x")
    of_y = replace(on_table("class", (replace(trend, axis="y"), shift)), neutral_points=())
    assert "along X by 3.90 ± 0.30 um (offset-x)." in words(result(of_y))


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (DRIFTS, "a smooth drift in y without a name explains as much as the names do, or is"),
        (
            (*DRIFTS, "unnamed-field-x"),
            "a smooth drift in y without a name and a smooth field in x without a name explain as",
        ),
    ],
)
def test_what_has_no_name_is_told_with_its_axis(names: tuple[str, ...], told: str) -> None:
    found = result(on_table("unexplained", (effect(),), nameless=names))
    assert told in words(found)
    assert document(found)["unexplained"]["without_name"] == list(names)


def test_scatter_that_is_left_is_nothing_to_look_for() -> None:
    def said(rms_um: float, fired: tuple[str, ...] = ()) -> str:
        item = on_table("unexplained", (effect(),), nameless=DRIFTS, fired=fired)
        left = replace(item.in_sample_after, rms=1e-3 * rms_um)
        return words(result(replace(item, in_sample_after=left, floor=3.6e-3)))

    assert "an rms of 3.8 um: about repeatability (3.6)." in said(3.8)
    assert "most along" not in said(3.8)
    assert "most along" in said(5.0)
    # A check that fires looks at more than the size of what is left.
    assert "most along" in said(3.8, ("spatial-correlation",))


X_ALONE = (("x", 26e-6), ("y", 0.0))
REAMED, REST = (("x", 5.6e-3), ("y", 2.0e-3)), (("x", 1.7e-3), ("y", 1.4e-3))


@pytest.mark.parametrize(
    ("size", "told", "s"),
    [
        (ScatterSize(parameter=("s", "arcsec", 2e-5, 3e-6)), "s = 4.13 ± 0.62 arcsec", 4.125),
        (
            ScatterSize(parameter=("s", "um/m", 18.7e-6, 3.1e-6), by_axis=X_ALONE),
            "s = 18.7 ± 3.1 um/m (X 26, Y 0)",
            18.7,
        ),
        (
            ScatterSize(parameter=("s", "um", 4.2e-3, 0.2e-3), of="reamed", others=1.58e-3),
            "reamed by 4.20 ± 0.20 um, the others by 1.6 um",
            4.2,
        ),
        (
            ScatterSize(parameter=("s", "um", 4.2e-3, 0.2e-3), of="reamed"),
            "reamed by 4.20 ± 0.20 um",
            4.2,
        ),
        (
            ScatterSize(
                parameter=("s", "um", 4.2e-3, 0.2e-3),
                of="reamed",
                others=1.58e-3,
                by_axis=REAMED,
                others_by_axis=REST,
            ),
            "reamed by 4.20 ± 0.20 um (X 5.6, Y 2.0), the others by 1.6 um (X 1.7, Y 1.4)",
            4.2,
        ),
    ],
)
def test_a_scatter_has_a_size(size: ScatterSize, told: str, s: float) -> None:
    own = effect("rotation-scatter", parameters=(), equations={}, kind="scatter", scatter=size)
    found = result(on_table("named", (own,)))
    assert told in words(found)
    assert told.split(" ± ")[0].split()[-1] + " ± " in plain_text(table(found))
    written = document(found)["effects"][0]["scatter"]
    assert written["s"] == pytest.approx(s, rel=1e-3)
    assert (written["of"], written["unit"]) == (size.of, size.parameter[1])
    for name, told_of in (("by_axis", size.by_axis), ("others_by_axis", size.others_by_axis)):
        per = 1e3 if size.of is not None else 1e6
        assert written[name] == pytest.approx({axis: per * value for axis, value in told_of})
    assert written["s_of_others"] == (None if size.others is None else pytest.approx(1.58))


@pytest.mark.parametrize(
    ("wear", "told"),
    [
        (
            0.6,
            "X goes 0.600 ± 0.020 um per count of tool_parts further in the direction of approach",
        ),
        (
            -0.6,
            "X stops 0.600 ± 0.020 um per count of tool_parts short in the direction of approach",
        ),
    ],
)
def test_which_way_wear_goes(wear: float, told: str) -> None:
    own = effect(
        "wear-approach-x",
        parameters=(("wear", "um", wear, 0.02),),
        equations={"Ex": "wear*(tool_parts - 1)*dir_x"},
        covariate="tool_parts",
    )
    assert f"{told}, by wear" in words(result(on_table("named", (own,))))


@pytest.mark.parametrize(
    ("lever", "zero"),
    [
        ("tool_parts", "0"),
        ("(tool_parts + 3)", "-3"),
        ("(tool_parts - 123456)", "123456"),
        ("(tool_parts - 1234567.5)", "1234567.5"),
    ],
)
def test_where_a_wear_is_none_is_told_once_with_all_digits(lever: str, zero: str) -> None:
    own = effect(
        "wear-approach-x",
        parameters=(("wear", "um", 0.46, 0.02),),
        equations={f"E{axis}": f"wear*{lever}*dir_{axis}" for axis in "xy"},
        covariate="tool_parts",
    )
    shown = " ".join(plain_text(table(result(on_table("named", (own,))))).split())
    assert shown.count(f"is counted from tool_parts = {zero}: there it is 0") == 1
    assert shown.count("there it is 0") == 1


def test_a_scale_is_meant_where_its_growth_is_none() -> None:
    """However cold that is."""
    scale = effect("scale-x", parameters=(("scale", "um/m", 30.0, 2.0),))
    grows = effect(
        "thermal-growth-x",
        parameters=(("growth", "um/m/K", 10.0, 1.0),),
        equations={"Ex": "growth*(x - 75)*(T_room_degC + 4.5)"},
        covariate="T_room_degC",
    )
    assert "of travel where T_room_degC is -4.5" in words(result(on_table("named", (scale, grows))))


def test_lost_motion_from_one_part_on_is_more_where_some_was_there_before() -> None:
    later = effect(
        "backlash-step-x",
        parameters=(("lost_motion", "um", -2.8, 0.15),),
        equations={"Ex": "lost_motion*step(sequence - 8.5)*dir_x"},
        searched={"at": (8.5, 7.5, 9.5)},
    )
    before = effect("backlash-x", parameters=(("lost_motion", "um", -1.2, 0.12),))
    alone = words(result(on_table("named", (later,))))
    assert "X loses 5.60 ± 0.30 um at reversal, short from both sides, from part " in alone
    both = words(result(on_table("named", (later, before))))
    assert "X loses 5.60 ± 0.30 um more at reversal, short from both sides, from part " in both
    less = replace(later, parameters=(("lost_motion", "um", 0.8e-3, 0.15e-3),))
    shrinks = words(result(on_table("named", (less, before))))
    assert "X loses 1.60 ± 0.30 um less at reversal, from part " in shrinks
    other = replace(before, name="backlash-y", axis="y")
    assert "um more at" not in words(result(on_table("named", (later, other))))


@pytest.mark.parametrize(
    ("later", "whole"),
    [
        (-2.8, "X loses 8.00 ± 0.36 um at reversal, short from both sides"),
        (0.8, "X loses 0.80 ± 0.36 um at reversal, short from both sides"),
        (3.2, "X gains 4.00 ± 0.36 um at reversal, too far from both sides"),
    ],
)
def test_what_an_axis_loses_from_one_part_on_is_told_in_all(later: float, whole: str) -> None:
    """u of the sum holds the covariance: 2 sqrt(0.15^2 + 0.12^2 - 2 0.00225) um."""
    step = effect(
        "backlash-step-x",
        parameters=(("lost_motion", "um", later, 0.15),),
        equations={"Ex": "lost_motion*step(sequence - 8.5)*dir_x"},
        searched={"at": (8.5, 7.5, 9.5)},
    )
    before = effect("backlash-x", parameters=(("lost_motion", "um", -1.2, 0.12),))
    covariance = 1e-6 * np.array([[0.0225, -0.00225], [-0.00225, 0.0144]])
    told = replace(result(on_table("named", (step, before))), covariance=covariance)
    text = words(told)
    assert f"In all, from part P9 on: {whole}." in text
    way = direction_text(step, told.tables[0]) or ""
    assert way.endswith(", compared with what it did before")
    assert "too far, as play" not in way
    # One of several names is no sum.
    one = replace(step, class_names=("backlash-step-x", "abbe-x"))
    doubtful = replace(result(on_table("class", (one, before))), covariance=covariance)
    assert "In all" not in words(doubtful)
    alone = replace(result(on_table("named", (step,))), covariance=covariance[:1, :1])
    assert "In all" not in words(alone)


def test_what_is_sure_stands_before_what_is_one_of_several() -> None:
    doubtful = effect("backlash-x", class_names=("backlash-x", "trend-x"))
    surely = effect("backlash-y", equations={"Ey": "lost_motion*dir_y"})
    said = words(result(on_table("class", (doubtful, surely))))
    assert said.startswith("Y gains")
    assert "Beside that backlash-x or trend-x: this data cannot tell which" in said


@pytest.mark.parametrize(("name", "told"), [("wear-approach-y", True), ("trend-y", False)])
def test_where_a_wear_is_none_is_told(name: str, told: bool) -> None:
    own = effect(
        name,
        parameters=(("wear", "um", 0.46, 0.02),),
        equations={"Ey": "wear*(tool_parts - 1)*dir_y"},
        covariate="tool_parts",
    )
    shown = " ".join(plain_text(table(result(on_table("named", (own,))))).split())
    assert (f"{name} is counted from tool_parts = 1: there it is 0" in shown) == told


@pytest.mark.parametrize(("after", "told"), [(3.7, False), (4.0, True)])
def test_why_held_out_parts_fit_better_than_all_data_is_told(after: float, told: bool) -> None:
    """3.8 um are left of them: of all data more only by what is not written."""
    item = replace(on_table("named", (effect(),)), in_sample_after=scores(after))
    shown = " ".join(plain_text(table(result(item))).split())
    said = "held out is foretold by all that the other parts leave possible, by its probability"
    assert (f"{said}; all data by what is written alone" in shown) == told
    alone = " ".join(plain_text(table(result(replace(item, held_out_by="features")))).split())
    assert said not in alone


def test_that_held_out_parts_are_foretold_no_better_is_told() -> None:
    item = on_table("named", (effect(),))
    said = "held-out parts are foretold no better with what was found than without"
    assert said not in " ".join(plain_text(table(result(item))).split())
    worse = replace(item, after=scores(6.0))
    assert said in " ".join(plain_text(table(result(worse))).split())
