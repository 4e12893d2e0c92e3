"""What close-loop says of several effects: long classes, one cause of two, what is not told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import ambiguous, effect, named, on_component, on_table, result, scores

from mtu_cli.close_loop_sealed.analyses.loop.fixed_point import fixed_points
from mtu_cli.close_loop_sealed.analyses.loop.result import (
    CloseLoopResult,
    Experiment,
    FoundEffect,
    Otherwise,
    Verdict,
)
from mtu_cli.close_loop_sealed.reports.close_loop import document, table
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.model.visits import Datum
from mtu_cli.reports.tables import plain_text


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


def long_class(now_d: float = 0.5, *names: str) -> CloseLoopResult:
    known = names or ("abbe-x", "trend-x", "scale-x", "cyclic-x", "radial")
    total = float(np.hypot(now_d, 3.2))
    told = Experiment(do="vary it on purpose", predicted_d=total, now_d=now_d, further_d=3.2)
    own = effect(class_names=("backlash-x", *known), experiment=told)
    return result(on_table("class", (own,)))


def test_of_a_long_class_the_sentence_names_the_likeliest_and_the_table_all() -> None:
    text = words(long_class())
    assert text.startswith(
        "backlash-x, abbe-x, trend-x, scale-x or one of 2 others (more in the table): this data "
        "cannot tell which. "
    )
    # A single other one is as short by its name.
    one = words(long_class(0.5, "abbe-x", "trend-x", "scale-x", "radial"))
    assert one.startswith("backlash-x, abbe-x, trend-x, scale-x or radial: this data")
    shown = plain_text(table(long_class()))
    assert "backlash-x may be: backlash-x, abbe-x, trend-x, scale-x, cyclic-x, radial\n" in shown
    assert "may be" not in plain_text(table(ambiguous()))


def test_rivals_that_the_data_should_have_told_apart_may_both_act() -> None:
    text = words(long_class(5.4))
    assert "One of them alone would show in this data (5.4 standard deviations)" in text
    assert "more than one may act at once, or something else. To tell: vary it on purpose." in text
    text = words(long_class(5.4, "abbe-x", "unnamed-drift-x"))
    assert "One of those with a name alone would show in this data (5.4 standard" in text
    assert (
        "more than one may act at once, or what has no name. To tell: vary it on purpose." in text
    )
    assert "set them a further 3.2 standard deviations apart (so far 4.9)" in words(long_class(4.9))
    # Of aliases nothing but rounding is left.
    assert "apart (so far none)." in words(long_class(2.5e-15))


def test_small_figures_keep_two_digits_beside_large_ones() -> None:
    far = replace(on_table("named", (effect(),)), floor=1.2e-3)
    near = words(result(far))
    assert "rms 5.9 -> 3.8 um; repeatability 1.2 um." in near
    text = words(result(replace(far, before=scores(83_456.0), after=scores(4_321.0))))
    assert "rms 83460 -> 4320 um; repeatability 1.2 um." in text


def test_what_stands_beside_an_effect_without_passing_is_told() -> None:
    said = (
        "scale-x does not pass by itself (p = 0.24): without it what varies from part to part and "
    )
    said += "what is the same in all would ask for two sizes of one effect."
    beside = effect("scale-x", p_familywise=0.24)
    assert said in words(result(on_table("named", (GROWS, beside))))
    proven = words(result(on_table("named", (GROWS, replace(beside, p_familywise=0.049)))))
    assert "by itself" not in proven


def test_errors_that_are_rounding_are_none() -> None:
    item = replace(on_table("none", ()), before=scores(1e-11), after=scores(1e-11))
    assert words(result(item)) == (
        "Nothing undeclared was found: what was measured is what the model predicts."
    )
    assert "the rms of 0.00010 um" in words(result(replace(item, before=scores(1e-4))))


GROWS = effect(
    "thermal-growth-x",
    parameters=(("growth", "um/m/K", 8.66, 0.4), ("level", "um", 5.8, 0.5)),
    equations={"Ex": "growth*(x - 75)*(T_spindle_degC - 20) + level"},
    covariate="T_spindle_degC",
)
DRIFTS = effect(
    "thermal-drift-x",
    parameters=(("drift", "um/K", 1.84, 0.17),),
    equations={"Ex": "drift*(T_spindle_degC - 24.54)"},
    covariate="T_spindle_degC",
)


def grown(
    *effects: FoundEffect, travel: tuple[float, float] = (0.0, 400.0), verdict: Verdict = "named"
) -> CloseLoopResult:
    """With independent parameters: 75 - 1.84/0.00866 = -137.5, u 21.9 mm."""
    item = on_table(verdict, effects, fired=("spatial-correlation",) * (verdict == "unexplained"))
    item = replace(item, table=replace(item.table, travel={"x": travel, "y": travel}))
    covariance = np.diag(np.square([p[3] for e in effects for p in e.parameters]))
    points = fixed_points(item.table, effects, covariance)
    return replace(result(replace(item, fixed_points=points)), covariance=covariance)


def test_a_scale_beside_a_growth_is_told_at_20_degc() -> None:
    other = Otherwise(
        name="thermal-growth-x",
        parameter=("scale", "um/m", -2.3e-6, 32e-6),
        constant=("growth", "um/m/K", 6.3e-6, 5.3e-6),
        p=0.27,
        covariate="T_room_degC",
        at_reference=True,
    )
    scale = replace(
        GROWS, name="scale-x", family="scale", covariate=None, equations={"Ex": "scale*x + level"},
        otherwise=(other,),
    )  # fmt: skip
    shown = " ".join(plain_text(table(grown(scale))).split())
    assert (
        "scale-x: that scale and its u hold if there is no thermal-growth-x; with one it is "
        "-2 ± 32 um/m at T_room_degC = 20, beside a growth of 6.3 ± 5.3 um/m/K (p 0.27)"
    ) in shown
    turned = replace(other, constant=("angle", "arcsec/K", 1e-6, 1e-6))
    shown = " ".join(plain_text(table(grown(replace(scale, otherwise=(turned,))))).split())
    assert "beside an angle of" in shown
    assert replace(scale, otherwise=(turned, other)).holds_within == ("T_room_degC",)
    assert replace(scale, otherwise=(replace(other, at_reference=False),)).holds_within == ()


def test_a_growth_from_the_mean_of_the_day_says_so() -> None:
    note = "thermal-growth-x is counted from T_spindle_degC = 21.88, the mean of the data"
    mean = replace(GROWS, equations={"Ex": "growth*(x - 75)*(T_spindle_degC - 21.88) + level"})
    shown = [" ".join(plain_text(table(grown(own))).split()) for own in (GROWS, mean)]
    assert [note in text for text in shown] == [False, True]
    assert "fits better than 20 degC" not in shown[0]


def test_what_an_effect_would_be_beside_one_that_was_not_told_is_noted() -> None:
    other = Otherwise(
        name="scale-x",
        parameter=("growth", "um/m/K", 7.1e-6, 0.9e-6),
        constant=("scale", "um/m", 12.3e-6, 5.1e-6),
        p=0.034,
    )
    shown = " ".join(plain_text(table(grown(replace(GROWS, otherwise=(other,))))).split())
    assert (
        "thermal-growth-x: that growth and its u hold if there is no scale-x; with one it is "
        "7.10 ± 0.90 um/m/K, beside a scale of 12.3 ± 5.1 um/m (p 0.034)"
    ) in shown
    told = document(grown(replace(GROWS, otherwise=(other,))))["effects"][0]["otherwise"]
    assert told == [
        {
            "beside": "scale-x",
            "covariate": None,
            "p": 0.034,
            "parameters": {
                "growth": {"value": pytest.approx(7.1), "u": pytest.approx(0.9), "unit": "um/m/K"},
                "scale-x.scale": {
                    "value": pytest.approx(12.3), "u": pytest.approx(5.1), "unit": "um/m",
                },
            },
        }
    ]  # fmt: skip


def test_more_that_is_left_in_all_data_than_in_those_held_out_is_told() -> None:
    item = on_table("named", (effect(),))
    assert item.held_out_by is not None
    said = "With all data less was found: what is told here leaves"
    for factor, told in ((1.29, False), (1.31, True)):
        left = replace(item.after, rms=factor * item.after.rms)
        assert (said in words(result(replace(item, in_sample_after=left)))) == told
        none = replace(item, in_sample_after=left, held_out_by=None)
        assert said not in words(result(none))


def test_growth_and_drift_are_one_cause_with_a_fixed_point() -> None:
    both = "X grows by 8.66 ± 0.40 um/m/K of T_spindle_degC from a fixed point at x = -137 ± 22 mm"
    names = " (thermal-growth-x and thermal-drift-x)"
    assert words(grown(GROWS, DRIFTS)).startswith(f"{both}{names}. Held-out parts: ")
    assert f"the likeliest of the library: {both}{names}." in words(
        grown(GROWS, DRIFTS, verdict="unexplained")
    )
    # A third effect of which there are several: the two stay what they are.
    third = effect("backlash-x", class_names=("backlash-x", "abbe-x"))
    classed = words(grown(DRIFTS, GROWS, third, verdict="class"))
    assert classed.startswith(f"{both}{names}. Beside that backlash-x or abbe-x: this data cannot")
    # The table keeps a row for each.
    rows = plain_text(table(grown(GROWS, DRIFTS))).splitlines()
    assert [row.split()[0] for row in rows if "± 0.40" in row or "± 0.17" in row][1:] == [
        "thermal-growth-x",
        "thermal-drift-x",
    ]


@pytest.mark.parametrize(
    ("place", "shown"),
    [("x - 75", "75.00"), ("x - -190.3333333", "-190.3"), ("x", "0"), ("0.5*(150 - 2*x)", "75.00")],
)
def test_the_table_says_that_growth_and_drift_are_one_cause(place: str, shown: str) -> None:
    grows = replace(GROWS, equations={"Ex": f"growth*({place})*(T_spindle_degC - 20) + level"})
    said = (
        f"thermal-growth-x is counted from x = {shown} mm, and "
        "thermal-drift-x is how far that place goes: one cause"
    )
    assert said in " ".join(plain_text(table(grown(grows, DRIFTS))).split())
    # Not where no fixed point is told, or where two effects grow.
    for other in (grown(GROWS), grown(GROWS, DRIFTS, travel=(0.0, 50.0))):
        assert "one cause" not in plain_text(table(other))
    again = "thermal-growth-x-2"
    twice = replace(GROWS, name=again, class_names=(again,))
    assert "one cause" not in plain_text(table(grown(GROWS, twice, DRIFTS)))


def test_a_fixed_point_that_is_not_told_is_said_to_be_so() -> None:
    text = words(grown(GROWS, DRIFTS, travel=(0.0, 50.0)))
    assert text.startswith(
        "X grows by 8.66 ± 0.40 um/m/K of T_spindle_degC (thermal-growth-x); X drifts by "
        "1.84 ± 0.17 um/K of T_spindle_degC (thermal-drift-x); the fixed point of X is not told. "
    )


def test_a_growth_of_all_axes_keeps_its_own_sentence() -> None:
    whole = effect(
        "thermal-growth", family="thermal-growth", axis=None, covariate="T_spindle_degC",
        parameters=(("growth", "um/m/K", 8.66, 0.4),),
        equations={
            "Ex": "growth*(x - 75)*(T_spindle_degC - 20)",
            "Ey": "growth*(y - 60)*(T_spindle_degC - 20)",
        },
    )  # fmt: skip
    text = words(grown(whole, DRIFTS))
    assert text.startswith("X and Y grow by 8.66 ± 0.40 um/m/K of T_spindle_degC (thermal-growth)")
    assert "; in all, the fixed point of X is x = -137 ± 22 mm. " in text


CREEPS = effect(
    "creep", family="creep", axis=None, says="the spindle creeps", covariate="T_spindle_degC",
    parameters=(("drift", "um/K", 1.84, 0.17),),
    equations={"Ex": "drift*(T_spindle_degC - 24)", "Ey": "drift*(T_spindle_degC - 24)"},
)  # fmt: skip
"""A drift of two axes by one parameter, from a user's library."""


def test_a_drift_of_two_axes_is_still_told_of_the_other() -> None:
    text = words(grown(GROWS, CREEPS))
    assert "from a fixed point at x = -137 ± 22 mm (thermal-growth-x and creep); " in text
    assert "; the spindle creeps: drift 1.84 ± 0.17 um/K (creep). Held-out" in text
    # Where the other axis grows too, both sentences together say all of it.
    other = effect(
        "thermal-growth-y", covariate="T_spindle_degC",
        parameters=(("growth", "um/m/K", 8.66, 0.4),),
        equations={"Ey": "growth*(y - 60)*(T_spindle_degC - 20)"},
    )  # fmt: skip
    both = words(grown(GROWS, CREEPS, other))
    for of_axis in ("x = -137 ± 22 mm (thermal-growth-x", "y = -152 ± 22 mm (thermal-growth-y"):
        assert f"from a fixed point at {of_axis} and creep)" in both
    assert "the spindle creeps" not in both


WARMS = effect(
    "warm-up-x",
    parameters=(("rise", "um", 7.5, 0.4),),
    equations={"Ex": "rise*(1 - exp(-time_min/60))"},
    covariate="time_min",
    searched={"tau_min": (60.0, 41.0, 90.0)},
)


def open_drift(first: FoundEffect, other: FoundEffect, verdict: Verdict) -> CloseLoopResult:
    """A growth, and a drift or a warm-up, whichever was found `first`."""
    names = (first.name, other.name)
    own = replace(first, class_names=names, rivals=(replace(other, class_names=names),))
    whole = grown(GROWS, own, verdict=verdict)
    drift = grown(GROWS, replace(DRIFTS, class_names=names)).tables[0]
    return result(replace(whole.tables[0], fixed_points=drift.fixed_points))


@pytest.mark.parametrize("drift_first", [True, False])
def test_a_drift_that_is_one_of_a_class_may_be_one_cause_with_the_growth(
    drift_first: bool,
) -> None:
    pair = (DRIFTS, WARMS) if drift_first else (WARMS, DRIFTS)
    found = open_drift(*pair, verdict="class")
    drifts = (
        "thermal-drift-x: X drifts by 1.84 ± 0.17 um/K of T_spindle_degC; with thermal-growth-x "
        "that is one cause: X grows from a fixed point at x = -137 ± 22 mm."
    )
    warms = "warm-up-x: X shifts by 7.50 ± 0.40 um while warming up, time constant 60 [41, 90] min."
    both = [f"If {drifts}", f"If {warms}"]
    text = words(found)
    assert " ".join(both if drift_first else both[::-1]) in text
    assert f"{pair[0].name} or {pair[1].name}: this data cannot tell which. " in text
    assert "the fixed point of X is not told" not in text
    (point,) = document(found)["fixed_points"]
    assert (point["given"], point["told"]) == ("thermal-drift-x", True)
    assert point["effects"] == ["thermal-growth-x", "thermal-drift-x"]
    (rival,) = document(found)["effects"][1]["rivals"]
    assert rival["name"] == pair[1].name
    assert set(rival["parameters"]) == ({"rise"} if drift_first else {"drift"})
    # As a hint the same is said of each.
    hint = words(open_drift(*pair, verdict="unexplained"))
    assert "from a fixed point at x = -137 ± 22 mm)" in hint
    assert "warm-up-x (X shifts by 7.50 ± 0.40 um while warming up" in hint


def test_an_axis_that_shrinks_says_so() -> None:
    cold = effect(
        "thermal-growth-x",
        parameters=(("growth", "um/m/K", -8.66, 0.4),),
        equations={"Ex": "growth*(x - 75)*(T_spindle_degC - 20)"},
        covariate="T_spindle_degC",
    )
    names = ("thermal-drift-x", "warm-up-x")
    text = words(grown(cold, replace(DRIFTS, class_names=names), verdict="class"))
    assert "one cause: X shrinks from a fixed point at x = " in text


def wave(**changed: object) -> FoundEffect:
    return effect(
        "cyclic-x",
        parameters=(("sine", "um", 3.0, 0.3), ("cosine", "um", 4.0, 0.3)),
        equations={"Ex": "sine*sin(2*pi*x/43.3) + cosine*cos(2*pi*x/43.3)"},
        searched={"pitch_mm": (43.3, 2.0, 65.0)},
        **changed,
    )


def test_an_amplitude_that_is_not_told_from_0_is_called_unknown() -> None:
    for u, told in ((1.2, "of 5.0 ± 1.2 um"), (2.6, "of unknown (5.0 ± 2.6 um)")):
        own = wave()
        own = replace(own, covariance=(1e-3 * u) ** 2 * np.eye(2))
        text = words(result(on_table("named", (own,))))
        assert text.startswith(f"X has a periodic error {told} amplitude, pitch 43")


def growth_of_x() -> FoundEffect:
    """From the mean place and the mean temperature of the day on."""
    return replace(
        effect(
            "thermal-growth-x",
            parameters=(("growth", "um/m/K", 11.0, 0.5),),
            equations={"Ex": "growth*(x - 172.2)*(T_room_degC - 22.677)"},
        ),
        covariate="T_room_degC",
    )


def test_offset_and_squareness_beside_what_changes_are_those_of_one_temperature() -> None:
    growth = growth_of_x()
    offset = effect(
        "offset-x",
        kind="offset",
        parameters=(("shift", "um", 4.2, 0.5),),
        equations={"Ex": "shift"},
    )
    both = on_table("named", (growth, offset))
    T = np.full(both.table.there.shape, 23.5)
    both = replace(both, table=replace(both.table, covariates={"T_room_degC": T}))
    assert "shifted along X by 4.20 ± 0.50 um where T_room_degC is 23.5 (" in words(result(both))
    along_y = replace(growth, equations={"Ey": "growth*(y - 3)*(T_room_degC - 22)"})
    other = replace(both, effects=(along_y, offset))
    assert "by 4.20 ± 0.50 um (offset-x)" in words(result(other))
    square = effect(
        "squareness-xy",
        parameters=(("angle", "arcsec", 5.4, 0.4),),
        equations={"Ex": "angle*(y - 3)"},
    )
    leans = replace(
        effect(
            "thermal-squareness-xy",
            parameters=(("angle", "arcsec/K", 1.4, 0.4),),
            equations={"Ex": "angle*(y - 3)*(T_room_degC - 25.5)"},
        ),
        covariate="T_room_degC",
    )
    assert "than 90 degrees where T_room_degC is 25.5" in words(
        result(on_table("named", (square, leans)))
    )


def test_a_scale_beside_a_growth_is_that_of_one_temperature() -> None:
    scale = effect(
        "scale-x",
        parameters=(("scale", "um/m", 7.8, 0.5),),
        equations={"Ex": "scale*(x - 172.2)"},
    )
    growth = growth_of_x()
    text = words(result(on_table("named", (growth, scale))))
    assert "grows by 7.80 ± 0.50 um/m of travel where T_room_degC is 22.68" in text
    assert "of travel where" not in words(result(on_table("named", (scale,))))
    of_y = replace(growth, axis="y", name="thermal-growth-y")
    assert "of travel where" not in words(result(on_table("named", (of_y, scale))))
    # Not of a growth in the place of which it would stand.
    either = ("thermal-growth-x", "scale-x")
    one = replace(growth, class_names=either, rivals=(replace(scale, class_names=either),))
    shared = words(result(on_table("class", (one,))))
    assert "If scale-x: positioning of X grows by 7.80 ± 0.50 um/m of travel." in shared


def test_a_pitch_that_is_one_of_several_makes_a_class() -> None:
    own = wave(alike=(65.0, 26.04, 18.57, 2.0))
    text = words(result(on_table("class", (own,))))
    assert text.startswith(
        "X has a periodic error of 5.00 ± 0.30 um amplitude, pitch 43.3 mm; pitch_mm 65.0, 26.0, "
        "18.6 or 2.00 fits as well, with a size of its own (cyclic-x). To tell: measure "
        "features at more, and uneven, distances along the axis. Held-out"
    )
    shown = plain_text(table(result(on_table("class", (own,)))))
    (row,) = [line.split() for line in shown.splitlines() if line.strip().startswith("pitch_mm")]
    assert row == ["pitch_mm", "43.3", "mm", "[2.00,", "65.0]"]
    assert "cyclic-x: 5 values of pitch_mm fit alike at these places" in shown
    many = wave(alike=(65.0, 26.04, 18.57, 2.0, 2.1))
    said = "pitch 43.3 mm; pitch_mm is one of 6 that fit alike, each with a size of its own (cyc"
    assert said in words(result(on_table("class", (many,))))
    # In a class of names too.
    several = words(result(on_table("class", (replace(own, class_names=("cyclic-x", "abbe-x")),))))
    assert several.startswith(
        "cyclic-x or abbe-x: this data cannot tell which. If cyclic-x: X has a"
    )
    assert "distances along the axis. Held-out" in several
    assert "pitch 43 [2, 65] mm (cyclic-x)" in words(result(on_table("named", (wave(),))))


def test_a_wave_of_one_column_has_its_size() -> None:
    own = effect(
        "cyclic-x",
        parameters=(("cosine", "um", -4.0, 0.3),),
        equations={"Ex": "cosine*cos(2*pi*x/60)"},
        searched={"pitch_mm": (60.0, 58.0, 62.0)},
    )
    text = words(result(on_table("named", (own,))))
    assert text.startswith(
        "X has a periodic error of 4.00 ± 0.30 um amplitude, pitch 60.0 [58.0, 62.0]"
    )
    # Where the places show one phase of it, it is known at these places alone.
    item = on_table("named", (own,))
    places = item.table.places.copy()
    places[..., 0] = 10.0 + 30.0 * (np.arange(places.shape[1]) % 4)
    seen = replace(item, table=replace(item.table, places=places))
    assert words(result(seen)).startswith(
        "X has a periodic error of at least 2.00 ± 0.15 um amplitude, pitch 60.0 [58.0, 62.0]"
    )


def left_of_parts(*effects: FoundEffect, datum: Datum = "none", fired: bool = True) -> str:
    item = on_table(
        "unexplained" if fired else "named",
        effects,
        checks=(("part-variance", 1e-5),),
        fired=("part-variance",) if fired else (),
    )
    return words(result(replace(item, table=replace(item.table, datum=datum))))


TURNED = effect(
    "rotation-scatter", family="rotation-scatter", axis=None,
    equations={}, parameters=(), kind="scatter",
)  # fmt: skip


@pytest.mark.parametrize(
    ("effects", "datum", "fired", "advised"),
    [
        ((), "none", True, "an offset of its own: --datum offset takes that out; unseen are then "
         "offsets of whole parts: trend, step, and drift and warm-up but for what changes within a "
         "part. What is left"),
        ((TURNED,), "none", True, "an offset and a turn of its own: --datum offset,rotation takes"),
        ((TURNED,), "offset", False, "an offset and a turn of its own: --datum offset,rotation"),
        ((), "offset", True, None),
        ((TURNED,), "offset,rotation", False, None),
        ((effect(),), "none", False, None),
    ],
)  # fmt: skip
def test_parts_that_differ_as_a_whole_may_have_been_set_up_by_hand(
    effects: tuple[FoundEffect, ...], datum: Datum, fired: bool, advised: str | None
) -> None:
    text = left_of_parts(*effects, datum=datum, fired=fired)
    assert ("set up by hand" in text) == (advised is not None)
    assert advised is None or advised in text


FIRED = (("part-variance", 1e-5),)


def test_a_candidate_that_says_nothing_is_no_hint() -> None:
    item = on_table("unexplained", fired=("part-variance",), checks=FIRED)
    assert "backlash-x comes nearest" in words(result(item))
    # The best of many by chance, of which p is 0.6; one of two that fit alike; one that is none.
    for changed in ({"log_bayes_factor": 2.9}, {"posterior": 0.5}, {"log_bayes_factor": -1.0}):
        weak = tuple(
            c if c.log_bayes_factor is None else replace(c, **changed)  # type: ignore[arg-type]
            for c in item.candidates
        )
        text = words(result(replace(item, candidates=weak)))
        assert "No one effect of the library stands out." in text
        assert "hint" not in text


def test_what_is_left_is_told_with_its_direction_and_the_feature_where_it_is_largest() -> None:
    """1 um in x and 2 um in y everywhere, beside what was found; 5 um in y at the fourth feature,
    where one part was not measured and one reading (of 80 um) was set aside.
    """
    item = on_table("unexplained", (effect(),), fired=("part-variance",), checks=FIRED)
    errors = np.zeros(item.table.errors.shape)
    errors[:, :, 0], errors[:, :, 1] = 1e-3, -2e-3
    errors[:, 3, 1] = 5e-3
    there = np.ones(errors.shape[:2], bool)
    there[2, 3] = there[4, 3] = False
    errors[2, 3], errors[4, 3] = np.nan, 80e-3
    left = replace(item.table, errors=errors + item.explained, repeats=there.astype(np.int64))
    text = words(result(replace(item, table=left)))
    n = there.sum()
    rms = np.sqrt((25 * (len(errors) - 2) + 4 * (n - len(errors) + 2)) / n)
    at = item.table.features[3]
    assert f": most along Y ({rms:.1f} um), and there at feature {at} (5.0 um); repeat" in text


def test_of_a_component_the_position_is_told_where_most_is_left() -> None:
    item = replace(
        on_component("pos_x", verdict="unexplained"), fired=("part-variance",), checks=FIRED
    )
    assert ": most at position " in words(result(item))


@pytest.mark.parametrize(("rms", "told"), [(3.2, True), (3.5, False), (None, False)])
def test_what_stays_at_its_place_is_told_where_a_correction_there_is_worth_it(
    rms: float | None, told: bool
) -> None:
    """Of held-out parts with 3.8 um: 3.5 um are not a tenth less."""
    item = on_table("unexplained", (effect(),), fired=("part-variance",), checks=FIRED)
    by_column = None if rms is None else scores(rms)
    text = words(result(replace(item, by_column=by_column)))
    said = "Much of it stays: a correction of its own for every feature would take the rms of "
    assert (f"{said}held-out parts from 3.8 to 3.2 um." in text) == told
    assert told or "Much of it stays" not in text
    # What is left beside a name may be scatter of features, if it is not by far the most.
    assert said not in words(result(replace(on_table("named", (effect(),)), by_column=by_column)))


@pytest.mark.parametrize("verdict", ["named", "none", "class"])
@pytest.mark.parametrize(("rms", "in_sample", "told"), [(1.6, 3.5, True), (2.0, 3.5, False),
                                                        (1.6, 3.1, False)])  # fmt: skip
def test_what_stays_beside_a_verdict_is_told_where_it_is_the_most_of_what_is_left(
    verdict: Verdict, rms: float, in_sample: float, told: bool
) -> None:
    """Of held-out parts with 3.8 um; what the whole table's fit takes out does not stay."""
    base = {"named": named(), "class": ambiguous()}.get(verdict) or result(on_table("none", ()))
    item = replace(
        base.tables[0], by_column=scores(rms), after=scores(3.8), in_sample_after=scores(in_sample)
    )
    text, shown = words(result(item)), plain_text(table(result(item)))
    assert (
        "every feature would take the rms of held-out parts from 3.8 to 1.6 um." in text
    ) == told
    many, two = "abbe-x or trend-x, or several of them: this", "backlash-x or abbe-x, or both: this"
    assert (many in text, "or both" in text) == (told and verdict == "class", False)
    if verdict == "class":
        own = replace(item.effects[0], aliases=())
        assert (two in words(result(replace(item, effects=(own,))))) == told
    assert ("checks take what stays for errors of single features" in shown) == told
    assert ("nothing is left that" in shown) != told


def test_an_effect_without_an_equation_keeps_its_sentence() -> None:
    chosen = effect("feature-outlier", axis=None, equations={}, chosen="H7", parameters=())
    assert "(feature-outlier)" in words(grown(GROWS, DRIFTS, chosen))


def test_a_level_is_explained_where_there_is_one() -> None:
    said = "level: the constant of an equation and no effect of its own: the error where the "
    text = " ".join(plain_text(table(grown(GROWS))).split())
    assert f"{said}effects of its axis are 0. Beside a growth or a drift it holds" in text
    assert "level" not in plain_text(table(named()))


def test_the_document_keeps_both_effects_and_adds_where_they_cancel() -> None:
    found = document(grown(GROWS, DRIFTS))
    assert [item["name"] for item in found["effects"]] == ["thermal-growth-x", "thermal-drift-x"]
    (point,) = found["fixed_points"]
    assert (point["axis"], point["covariate"]) == ("x", "T_spindle_degC")
    assert point["effects"] == ["thermal-growth-x", "thermal-drift-x"]
    assert point["told"] is True
    assert point["at_mm"]["value"] == pytest.approx(75 - 1.84 / 0.00866)
    low, high = point["at_mm"]["interval95"]
    assert low < point["at_mm"]["value"] < high
    assert document(named())["fixed_points"] == []
    weak = effect(
        "thermal-growth-x",
        parameters=(("growth", "um/m/K", 0.1, 10.0),),
        equations={"Ex": "growth*(x - 75)*(T_spindle_degC - 20)"},
    )
    (point,) = document(grown(weak, DRIFTS))["fixed_points"]
    assert (point["at_mm"]["interval95"], point["told"]) == (None, False)


def test_what_is_likely_but_not_proven_is_told_and_not_called_scatter() -> None:
    base = on_component(verdict="none")
    likely = tuple(
        replace(c, log_bayes_factor=20.0, posterior=0.99, p_familywise=0.12)
        if c.name == "backlash-x"
        else replace(c, posterior=0.001)
        for c in base.candidates
    )
    for count in (2, 6, 20):
        own = replace(base.table, parts=tuple(map(str, range(count))))
        text = verdict_text(replace(base, table=own, candidates=likely), result(base))
        assert "may be scatter" in text
        assert f"backlash-x fits best by far, but {count} passes cannot prove it (p 0.12)" in text
        # What passes and is no finding has another reason.
        passed = tuple(replace(c, p_familywise=0.02) for c in likely)
        text = verdict_text(replace(base, table=own, candidates=passed), result(base))
        assert "backlash-x fits best by far (p 0.020), but its own size, by what passes " in text
        assert "cannot prove" not in text
        weak = tuple(replace(c, log_bayes_factor=1.0) for c in likely)
        text = verdict_text(replace(base, table=own, candidates=weak), result(base))
        assert "passes for scatter" in text
        assert "cannot prove" not in text
        assert ("of which 2 passes say little" in text) == (count == 2)
    one = replace(base.table, parts=("1",))
    text = verdict_text(replace(base, table=one, candidates=likely), result(base))
    assert "passes for scatter" in text


def test_what_stays_is_not_called_scatter() -> None:
    """Where a correction of every place would take half of it off held-out parts."""
    base = on_table("none", ())
    weak = tuple(replace(c, log_bayes_factor=1.0) for c in base.candidates)
    base = replace(base, candidates=weak, in_sample_after=base.after)
    for rms, stays in ((0.4, True), (0.6, False)):
        own = scores(1e3 * rms * base.after.rms)
        text = words(result(replace(base, by_column=own)))
        passes = "passes for errors of single features, the same in every part, repeatability"
        assert (passes in text) == stays == ("Much of it stays" in text)
        assert ("passes for scatter" in text) != stays


def test_sizes_that_no_error_has_are_not_told_as_what_would_have_been_found() -> None:
    base = on_component(verdict="none")
    absurd = tuple(
        replace(c, minimum_detectable=5.0) if c.name == "cyclic-x" else c for c in base.candidates
    )
    text = verdict_text(replace(base, candidates=absurd), result(base))
    assert "5000" not in text
    assert "would have been found; 1 more hardly." in text


def test_a_level_that_is_told_from_none_is_an_offset_of_its_axis() -> None:
    def shown(family: str, level: float) -> str:
        own = effect(
            f"{family}-y",
            parameters=(("size", "um", 2.05, 0.15), ("level", "um", level, 0.8)),
            equations={"Ey": "size*dir_y + level"},
        )
        return " ".join(plain_text(table(result(on_table("named", (own,))))).split())

    said = "its level is an offset of Y, -12.30 ± 0.80 um, which is written with it"
    assert f"backlash-y: {said}" in shown("backlash", -12.3)
    assert "its level is" not in shown("backlash", -2.3)
    # A drift has a constant part of its own, from the mean of the data on.
    assert "its level is" not in shown("thermal-drift", -12.3)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ((730.0, 320.0, 730.0), "time constant at least 320 min."),
        ((10.0, 10.0, 35.0), "time constant at most 35 min."),
        ((60.0, 41.0, 90.0), "time constant 60 [41, 90] min."),
    ],
)
def test_an_end_of_what_was_searched_is_no_estimate(
    found: tuple[float, float, float], said: str
) -> None:
    warm = effect(
        "warm-up-x",
        parameters=(("rise", "um", 7.5, 0.4),),
        equations={"Ex": "rise*(1 - exp(-time_min/60))"},
        searched={"tau_min": found},
    )
    shown = " ".join(plain_text(table(result(on_table("named", (warm,))))).split())
    text = " ".join(
        verdict_text(on_table("named", (warm,)), result(on_table("named", (warm,)))).split()
    )
    assert said in text.replace(" (warm-up-x)", "")
    assert str(found[0]) not in shown or found[0] == 60.0


def test_of_two_levels_of_one_name_as_a_size_the_effect_is_told() -> None:
    step = effect("step-x", parameters=(("jump", "um", 4.5, 0.5), ("level", "um", 1.5, 0.5)))
    ramp = effect(
        "ramp-y",
        parameters=(("level", "um", 12.0, 0.6), ("own_level", "um", 4.5, 0.5)),
        equations={"Ey": "level*sequence + own_level"},
        levels=("y",),
    )
    both = " ".join(plain_text(table(result(on_table("named", (step, ramp))))).split())
    assert "level of step-x, own_level: each the constant of an equation" in both


def test_levels_are_told_by_their_names() -> None:
    own = effect(
        "ramp-x",
        parameters=(("level", "um", 12.0, 0.6), ("own_level", "um", 4.5, 0.5)),
        equations={"Ex": "level*sequence + own_level"},
        levels=("x",),
    )
    shown = " ".join(plain_text(table(result(on_table("named", (own,))))).split())
    assert "own_level: the constant of an equation and no effect of its own" in shown
    assert " level: the constant" not in shown


def test_what_a_drift_is_counted_from_is_told() -> None:
    zero = "drift*(T_spindle_degC - 20.38)"
    shown = plain_text(table(grown(replace(DRIFTS, equations={"Ex": zero}))))
    said = "is counted from T_spindle_degC = 20.38, the mean of the data: what is constant is an"
    assert f"thermal-drift-x {said} offset" in " ".join(shown.split())


def test_a_size_that_is_not_told_from_0_is_no_more_than_a_hint() -> None:
    def shown(*effects: FoundEffect) -> str:
        return " ".join(plain_text(table(result(on_table("class", effects)))).split())

    weak = effect("backlash-x", parameters=(("lost_motion", "um", 0.2, 0.15),))
    also = replace(weak, name="backlash-y", class_names=("backlash-y",))
    said = "a test, but its size is not told from 0 (95 %): no more than a hint"
    assert f"backlash-x passes {said}" in shown(weak)
    # Whatever its sign.
    minus = effect("backlash-x", parameters=(("lost_motion", "um", -0.2, 0.15),))
    assert f"backlash-x passes {said}" in shown(minus)
    sure = effect("backlash-x", parameters=(("lost_motion", "um", -2.0, 0.15),))
    assert "no more than a hint" not in shown(sure)
    both = "backlash-x, backlash-y pass a test, but their sizes are not told from 0"
    assert both in shown(weak, also)
    assert said not in shown(effect())
    # Of a wave the amplitude is what counts, of which sine and cosine are no measure.
    wave = effect("cyclic-x", parameters=(("sine", "um", 0.1, 1.0), ("cosine", "um", 9.0, 1.0)))
    assert "not told from 0" not in shown(wave)
