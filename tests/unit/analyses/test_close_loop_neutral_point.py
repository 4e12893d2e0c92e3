"""A drift and an offset found together: where the axis is right, by hand and by trials."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from close_loop_examples import effect, on_component, on_table, result
from scipy.stats import t as student

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import NeutralPoint
from mtu_cli.close_loop_sealed.analyses.loop.neutral_point import neutral_points
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.reports.close_loop import document
from mtu_cli.close_loop_sealed.reports.close_loop_table import table
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text

T = "T_spindle_degC"
DRIFT, SHIFT, U_DRIFT, U_SHIFT = 1.84, 3.68, 0.17, 0.5
DOF = 17.0
DRIFTS: dict[str, Any] = {
    "parameters": (("drift", "um/K", DRIFT, U_DRIFT),),
    "equations": {"Ex": f"drift*({T} - 24.5)"},
    "covariate": T,
}
OFFSET = effect(
    "offset-x", parameters=(("shift", "um", SHIFT, U_SHIFT),), equations={"Ex": "shift"}
)
SCALE = effect(
    "scale-x", parameters=(("scale", "um/m", -40.0, 3.0),), equations={"Ex": "scale*(x - 75)"}
)


def drifts(name: str = "thermal-drift-x", **changed: object) -> FoundEffect:
    return effect(name, **(DRIFTS | changed))


def found(*effects: FoundEffect, correlation: float = 0.0) -> tuple[TableResult, np.ndarray]:
    """Spindle from 20 to 28 degC; the first and the last parameter are correlated."""
    item = on_table("named", effects)
    n = len(item.table.parts)
    covariates = item.table.covariates | {
        T: np.linspace(20.0, 28.0, n)[:, np.newaxis],
        "T_part_degC": np.linspace(21.0, 22.0, n)[:, np.newaxis],
    }
    item = replace(item, table=replace(item.table, covariates=covariates))
    u = np.array([p[3] for e in effects for p in e.parameters])
    r = np.eye(len(u))
    if len(u) > 1:
        r[0, -1] = r[-1, 0] = correlation
    covariance = np.outer(u, u) * r
    points = neutral_points(item.table, effects, covariance)
    return replace(item, neutral_points=points), covariance


def told(*effects: FoundEffect, correlation: float = 0.0) -> tuple[NeutralPoint, ...]:
    return found(*effects, correlation=correlation)[0].neutral_points


@pytest.mark.parametrize("correlation", [0.0, 0.6, -0.6])
def test_a_drift_and_an_offset_cancel_at_the_neutral_point(correlation: float) -> None:
    """By hand: T = 24.5 - a/d, with u by the derivatives 1/d and a/d^2."""
    (point,) = told(drifts(), OFFSET, correlation=correlation)
    assert (point.axis, point.covariate, point.drift, point.offset) == ("x", T, (0,), (1,))
    assert point.at == pytest.approx(22.5)
    a, d = SHIFT, DRIFT
    square = (U_SHIFT / d) ** 2 + (a * U_DRIFT / d**2) ** 2
    square -= 2 * correlation * U_SHIFT * U_DRIFT * a / d**3
    assert point.u == pytest.approx(np.sqrt(square))
    assert point.seen == (20.0, 28.0)
    assert point.counted_from == pytest.approx(24.5)


def test_its_interval_is_fiellers_and_does_not_depend_on_the_order() -> None:
    (point,), (other,) = told(drifts(), OFFSET), told(OFFSET, drifts())
    k = student.ppf(0.975, DOF)
    for end in point.interval:
        lever = end - 24.5
        left = abs(SHIFT + DRIFT * lever)
        assert left == pytest.approx(k * np.hypot(U_SHIFT, lever * U_DRIFT))
    assert other.interval == pytest.approx(point.interval)
    assert (other.drift, other.offset) == ((1,), (0,))


def test_its_interval_covers() -> None:
    """Drawn about a truth of 22.5 degC with the normal law: 95 % of Fieller's intervals with the
    normal's factor hold it (DOF is that of the examples, so its factor is put back).
    """
    rng, n = np.random.default_rng(11), 2000
    k = student.ppf(0.975, DOF) / student.ppf(0.975, 1e9)
    held = 0
    for d, a in rng.normal([DRIFT, SHIFT], [k * U_DRIFT, k * U_SHIFT], size=(n, 2)):
        own = drifts(parameters=(("drift", "um/K", d, U_DRIFT),))
        offset = replace(OFFSET, parameters=(("shift", "um", a * 1e-3, U_SHIFT * 1e-3),))
        item, _ = found(own, offset)
        (point,) = item.neutral_points
        held += point.interval[0] <= 22.5 <= point.interval[1]
    assert abs(held / n - 0.95) < 3 * np.sqrt(0.95 * 0.05 / n)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (drifts(),),
        (OFFSET,),
        (drifts(), SCALE, OFFSET),
        (SCALE, replace(OFFSET, parameters=(("shift", "um", 1e-3, 1e-4),))),
        (
            drifts(),
            drifts("thermal-drift-x-2", equations={"Ex": "drift*(T_part_degC - 20)"}),
            OFFSET,
        ),
        (drifts(equations={"Ex": "drift*(T_elsewhere_degC - 20)"}), OFFSET),
        (drifts(equations={"Ex": f"drift*({T} - 24.5)**2"}), OFFSET),
        (
            drifts(class_names=("thermal-drift-x", "warm-up-x")),
            replace(OFFSET, class_names=("offset-x", "unnamed-field-x")),
        ),
        (drifts(parameters=(("drift", "um/K", 0.2, 0.17),)), OFFSET),
        (drifts(), effect("offset-y", equations={"Ey": "lost_motion"})),
        (drifts(), effect("odd-x", equations={}, chosen="H7")),
    ],
    ids=[
        *(
            "none",
            "no-offset",
            "no-drift",
            "place",
            "fixed-point",
            "two-sensors",
            "not-in-the-data",
            "bent",
        ),
        *("two-classes", "hardly-a-drift", "other-axis", "no-equation"),
    ],
)
def test_where_no_neutral_point_is_told(effects: tuple[FoundEffect, ...]) -> None:
    assert told(*effects) == ()


def test_none_of_a_component() -> None:
    item = on_component("pos_x", effects=(drifts(), OFFSET))
    assert neutral_points(item.table, item.effects, np.eye(2)) == ()


def test_what_turns_with_the_direction_leaves_it_where_it_is() -> None:
    backlash = effect("backlash-x", equations={"Ex": "lost_motion*dir_x"})
    (point,), (alone,) = told(drifts(), backlash, OFFSET), told(drifts(), OFFSET)
    assert (point.drift, point.offset) == ((0,), (2,))
    assert point.at == pytest.approx(alone.at)


def test_they_are_told_as_one_cause() -> None:
    item, covariance = found(OFFSET, drifts())
    whole = replace(result(item), covariance=covariance)
    said = "X drifts by 1.84 ± 0.17 um/K of T_spindle_degC, and is right at T_spindle_degC = "
    text = verdict_text(item, whole)
    assert text.startswith(f"{said}22.50 ± 0.33 (thermal-drift-x and offset-x). ")
    assert "is shifted" not in text
    note = "thermal-drift-x is counted from T_spindle_degC = 24.50, and offset-x is the error there"
    assert note in " ".join(plain_text(table(whole)).split())
    (point,) = document(whole)["neutral_points"]
    assert point["effects"] == ["thermal-drift-x", "offset-x"]
    assert point["at"]["value"] == pytest.approx(22.5)
    assert point["seen"] == [20.0, 28.0]


def test_beyond_the_data_says_so_and_far_from_it_nothing() -> None:
    """From 20 to 28 degC: 17 is told, -30 is not, where any line is zero somewhere."""
    steep = drifts(parameters=(("drift", "um/K", DRIFT, 0.03),))
    near = replace(OFFSET, parameters=(("shift", "um", 7.5 * DRIFT * 1e-3, 1e-4),))
    item, covariance = found(steep, near)
    text = verdict_text(item, replace(result(item), covariance=covariance))
    assert "is right at T_spindle_degC = 17.00 ± 0.13 (beyond the data: 20 to 28)" in text
    far = replace(OFFSET, parameters=(("shift", "um", 54 * DRIFT * 1e-3, 1e-4),))
    assert told(drifts(parameters=(("drift", "um/K", DRIFT, 1e-3),)), far) == ()


def test_a_wear_is_right_where_the_tool_was_new() -> None:
    """Parts of a tool are counted from its first, a wear from their middle: the offset there is no
    other cause.
    """
    wears = drifts(
        "trend-x",
        parameters=(("slope", "um", 0.8, 0.05),),
        equations={"Ex": "slope*(tool_parts - 5)"},
        covariate="tool_parts",
    )
    item, covariance = found(wears, OFFSET)
    order = np.arange(1.0, len(item.table.parts) + 1)[:, np.newaxis]
    own = replace(item.table, covariates=item.table.covariates | {"tool_parts": order})
    (point,) = neutral_points(own, item.effects, covariance)
    assert (point.axis, point.covariate) == ("x", "tool_parts")
    assert point.at == pytest.approx(5 - SHIFT / 0.8)
    text = verdict_text(replace(item, neutral_points=(point,)), result(item))
    right = "and is right at tool_parts = 0.40 ± 0.69 (beyond the data: 1 to 9)"
    assert f"per count of tool_parts, {right} (trend-x and offset-x)" in text


def test_a_squareness_is_right_where_the_other_axis_stood_at_its_setting() -> None:
    """Of the error along x by the place along y, in mm; of one shared by both axes there is no
    sentence for both.
    """
    angle = ("angle", "arcsec", -20.0, 0.5)
    square = effect("squareness-xy", parameters=(angle,), equations={"Ex": "angle*(75 - y)"})
    item, covariance = found(square, OFFSET)
    (point,) = item.neutral_points
    assert (point.axis, point.covariate) == ("x", "y")
    per_mm = 20 * np.pi / 648000
    assert point.at == pytest.approx(75 - 1e-3 * SHIFT / per_mm)
    assert point.counted_from == pytest.approx(75.0)
    whole = replace(result(item), covariance=covariance)
    text = verdict_text(item, whole)
    said = "X and Y are out of square by 20.00 ± 0.50 arcsec, less than 90 degrees"
    assert f"{said}, and X is right at y = 37.0 ± 5.2 mm (squareness-xy and offset-x)" in text
    note = "squareness-xy is counted from y = 75.00 mm, and offset-x is the error there: one cause"
    assert note in " ".join(plain_text(table(whole)).split())
    halves = {"Ex": "0.5*angle*(75 - y)", "Ey": "0.5*angle*(75 - x)"}
    item, covariance = found(replace(square, equations=halves), OFFSET)
    text = verdict_text(item, replace(result(item), covariance=covariance))
    assert "; X is right at y = " in text
    assert "everything is shifted along X" in text


TURNS = effect(
    "thermal-squareness-xy",
    parameters=(("angle", "arcsec/K", 2.0, 0.1),),
    equations={"Ex": f"angle*(y - 75)*({T} - 24.5)"},
    covariate=T,
)


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_an_angle_that_changes_and_a_drift_are_a_turn_about_a_place(correlation: float) -> None:
    """By hand: y = 75 - d/q, with u by the derivatives 1/q and d/q^2; what is the same at all
    temperatures beside it has no part in that.
    """
    square = effect(
        "squareness-xy",
        parameters=(("angle", "arcsec", 9.0, 0.5),),
        equations={"Ex": "angle*(75 - y)"},
    )
    q, u_q = 2e3 * np.pi / 648000, 0.1e3 * np.pi / 648000
    d, u_d = 0.45, 0.05
    own = drifts(parameters=(("drift", "um/K", d, u_d),))
    item, covariance = found(TURNS, square, own, correlation=correlation)
    (point,) = item.neutral_points
    assert (point.axis, point.covariate, point.beside) == ("x", "y", T)
    assert (point.drift, point.offset) == ((0,), (2,))
    assert point.at == pytest.approx(75 - d / q)
    variance = (u_d / q) ** 2 + (d * u_q / q**2) ** 2 - 2 * correlation * u_d * u_q * d / q**3
    assert point.u == pytest.approx(np.sqrt(variance))
    assert point.counted_from == pytest.approx(75.0)
    whole = replace(result(item), covariance=covariance)
    text = verdict_text(item, whole)
    said = "the angle of X and Y changes by 2.00 ± 0.10 arcsec/K of T_spindle_degC, and X does not"
    assert f"{said} move with T_spindle_degC at y = 28.6 ± " in text.replace("The", "the")
    assert "X drifts" not in text
    (told_,) = document(whole)["neutral_points"]
    assert (told_["covariate"], told_["beside"]) == ("y", T)
    note = "thermal-squareness-xy is counted from y = 75.00 mm, and thermal-drift-x is how far"
    assert note in " ".join(plain_text(table(whole)).split())


@pytest.mark.parametrize(
    "other",
    [
        drifts(equations={"Ex": "drift*(T_part_degC - 20)"}),
        drifts(equations={"Ex": f"drift*({T} - 24.5)**2"}),
        drifts(equations={"Ex": f"drift*(x - 75)*({T} - 24.5)"}),
        drifts(equations={"Ey": f"drift*({T} - 24.5)"}),
        drifts(equations={"Ex": f"drift*(y - 75)*({T} - 24.5)"}),
        drifts(equations={"Ex": f"drift*dir_x*({T} - 24.5)"}),
    ],
    ids=["another-sensor", "bent", "growth", "other-axis", "no-drift", "direction"],
)
def test_beside_what_an_angle_has_no_place_that_stays(other: FoundEffect) -> None:
    assert told(TURNS, other) == ()


def test_a_drift_of_several_axes_keeps_its_sentence() -> None:
    both = {"Ex": f"drift*({T} - 24.5)", "Ey": f"drift*({T} - 24.5)"}
    item, covariance = found(drifts("thermal-drift", axis=None, equations=both), OFFSET)
    text = verdict_text(item, replace(result(item), covariance=covariance))
    assert "; X is right at T_spindle_degC = 22.50 ± 0.33" in text
    assert "everything is shifted along X" in text


def test_an_interval_longer_than_the_data_is_not_told() -> None:
    wide = replace(OFFSET, parameters=(("shift", "um", 1e-3 * SHIFT, 4e-3),))
    assert told(drifts(parameters=(("drift", "um/K", DRIFT, 0.5),)), wide) == ()


def test_the_least_degrees_of_freedom_count() -> None:
    few = replace(OFFSET, intervals=((0.0, 0.0, 4.0),))
    (own,), (more,) = told(drifts(), few), told(drifts(), OFFSET)
    assert own.interval[0] < more.interval[0]
    assert own.interval[1] > more.interval[1]


def test_a_gap_in_the_temperatures_is_none_of_their_range() -> None:
    item, covariance = found(drifts(), OFFSET)
    values = item.table.covariates[T].copy()
    values[3] = np.nan
    own = replace(item.table, covariates=item.table.covariates | {T: values})
    (point,) = neutral_points(own, item.effects, covariance)
    assert point.seen == (20.0, 28.0)


def test_a_component_with_the_temperature_has_none() -> None:
    item, covariance = found(drifts(), OFFSET)
    own = replace(item.table, component="pos_x")
    assert neutral_points(own, item.effects, covariance) == ()


@pytest.mark.parametrize("unnamed", [(0.0, 0.3), (0.3, 0.0)])
def test_where_one_of_them_is_a_hint_each_is_told_by_itself(unnamed: tuple[float, float]) -> None:
    """What follows from both is a hint, too."""
    item, covariance = found(drifts(unnamed=unnamed[0]), replace(OFFSET, unnamed=unnamed[1]))
    own = replace(item, verdict="unexplained", nameless=("unnamed-drift-y",))
    whole = replace(result(own), covariance=covariance)
    verdicts = [effect["verdict"] for effect in document(whole)["effects"]]
    assert sorted(verdicts) == ["named", "unexplained"]
    stands, _ = verdict_text(own, whole).split("As a hint only: ")
    assert ("um/K" in stands) == (verdicts[0] == "named")
    assert ("is shifted" in stands) == (verdicts[1] == "named")
    both = replace(own, effects=(drifts(), OFFSET))
    text = verdict_text(both, replace(result(both), covariance=covariance))
    assert text.startswith("X drifts by 1.84 ± 0.17 um/K of T_spindle_degC, and is right at ")
    assert "hint" not in text


CLASS = ("thermal-drift-x", "warm-up-x")
HEATS = drifts(
    "screw-heat-x", parameters=(("drift", "um/K", 1.6, U_DRIFT),), class_names=CLASS[::-1]
)


def of_a_class(*rivals: FoundEffect, names: tuple[str, ...], **changed: object) -> str:
    """What is said of a drift that may be each of the rivals, beside an offset."""
    item, covariance = found(drifts(class_names=names, rivals=rivals), OFFSET)
    points = neutral_points(item.table, item.effects, covariance)
    for rival in rivals:
        points += neutral_points(item.table, (rival, OFFSET), covariance, instead=0)
    own = replace(item, verdict="class", neutral_points=points, **changed)  # type: ignore[arg-type]
    whole = replace(result(own), covariance=covariance)
    given = [point["given"] for point in document(whole)["neutral_points"]]
    assert given == [point.given[1] for point in points if point.given is not None]
    assert "one cause" not in " ".join(plain_text(table(whole)).split()).split("Effects")[-1]
    return verdict_text(own, whole)


def test_a_drift_that_may_be_another_has_one_if_it_is_that() -> None:
    """The offset keeps its sentence for the other: of a rise in time it is none."""
    rise = {"Ex": "lost_motion*(1 - exp(-time_min/20))"}
    warms = effect("warm-up-x", equations=rise, class_names=CLASS[::-1])
    text = of_a_class(warms, names=CLASS)
    one = "with offset-x that is one cause: X is right at T_spindle_degC = 22.50 ± 0.33. "
    assert f"of T_spindle_degC; {one}If warm-up-x: " in text
    assert text.count("one cause") == 1
    assert ". If it is warm-up-x, everything is shifted along X by 3.68" in text


def test_where_each_of_a_class_has_one_the_offset_is_told_with_them() -> None:
    names = ("thermal-drift-x", "screw-heat-x")
    text = of_a_class(replace(HEATS, class_names=names[::-1]), names=names)
    assert text.count("with offset-x that is one cause: X is right at T_spindle_degC = ") == 2
    assert "22.50 ± 0.33" in text
    assert "22.20 ± 0.40" in text
    assert "verything is shifted" not in text


def test_a_cause_that_is_the_same_with_each_of_a_class_is_told_once() -> None:
    names = ("thermal-drift-x", "screw-heat-x")
    text = of_a_class(drifts("screw-heat-x", class_names=names[::-1]), names=names)
    whichever = "Whichever it is, with offset-x that is one cause: X is right at T_spindle_degC = "
    assert text.count("one cause") == 1
    assert text.index(whichever) > text.index("If screw-heat-x: ")


def test_beside_a_hint_an_offset_that_stands_is_told() -> None:
    names = ("thermal-drift-x", "screw-heat-x")
    heats = replace(HEATS, class_names=names[::-1])
    item, covariance = found(drifts(class_names=names, rivals=(heats,)), OFFSET)
    points = neutral_points(item.table, item.effects, covariance)
    points += neutral_points(item.table, (heats, OFFSET), covariance, instead=0)
    own = replace(item, verdict="unexplained", nameless=("unnamed-drift-y",), neutral_points=points)
    stands, hint = verdict_text(own, replace(result(own), covariance=covariance)).split("hint only")
    assert "verything is shifted along X" in stands
    assert hint.count("one cause") == 2


def test_most_likely_a_drift_is_right_at_a_temperature() -> None:
    names = ("thermal-drift-x", "unnamed-drift-x")
    text = of_a_class(names=names)
    assert "(thermal-drift-x); with offset-x that is one cause: X is right at " in text
    assert "; a smooth drift in x without a name is not excluded. " in text
    said = "If it is a smooth drift in x without a name, everything is shifted along X by 3.68"
    assert said in text
