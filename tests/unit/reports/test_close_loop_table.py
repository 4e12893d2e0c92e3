"""The tables of close-loop: the verdict in words first, rounded, on one screen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import (
    ambiguous,
    effect,
    judged,
    left_over,
    named,
    nothing,
    on_component,
    on_table,
    result,
    scores,
    several,
)

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect
from mtu_cli.close_loop_sealed.reports.close_loop import table
from mtu_cli.close_loop_sealed.reports.close_loop_effects import (
    SENTENCES,
    direction_text,
    effect_text,
)
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import WIDTH, plain_text

EVERY = {"named": named, "class": ambiguous, "unexplained": left_over, "none": nothing}


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


def said(own: FoundEffect) -> str:
    return effect_text(own, on_table("named", (own,)))


@pytest.mark.parametrize("verdict", [*EVERY, "several"])
def test_one_screen_of_a_hundred_columns_with_the_verdict_first(verdict: str) -> None:
    lines = plain_text(table((EVERY | {"several": several})[verdict]())).splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert len(lines) <= 40
    assert lines[0] == f"Undeclared effects: {'named' if verdict == 'several' else verdict}"


def test_a_name_comes_with_its_size_and_its_worth() -> None:
    # The reversal value is twice the lost motion of 2.05 +- 0.15 um.
    assert words(named()) == (
        "X gains 4.10 ± 0.30 um at reversal, too far from both sides (backlash-x). Held-out parts: "
        "rms 5.9 -> 3.8 um; repeatability 3.6 um."
    )


def test_a_reversal_says_which_way_it_goes() -> None:
    """E = lost_motion dir: at -2.05 um the hole is 4.10 um further to - after a move to +."""
    less = effect(parameters=(("lost_motion", "um", -2.05, 0.15),))
    assert said(effect()) == "X gains 4.10 ± 0.30 um at reversal, too far from both sides"
    assert said(less) == "X loses 4.10 ± 0.30 um at reversal, short from both sides"
    for own, way in ((effect(), "+ than after one to -: it goes too far"),
                     (less, "- than after one to -: it stops short")):  # fmt: skip
        text = " ".join(plain_text(table(result(on_table("named", (own,))))).split())
        assert f"after a move to + X stands 4.10 ± 0.30 um further to {way}, as play" in text
    component = replace(less, name="backlash-dx_x", component="dx_x")
    found = on_component("dx_x", "um", "named", (component,))
    assert effect_text(component, found).endswith("um at reversal, lower forward")
    way = direction_text(component, found) or ""
    assert way == "dx_x is 4.10 ± 0.30 um lower forward than in reverse"


def test_the_sign_of_a_squareness_is_told() -> None:
    """E_x = -angle y: + leans Y away from X."""
    own = effect(
        family="squareness", name="squareness-xy", parameters=(("angle", "arcsec", 10.0, 0.5),)
    )
    text = " ".join(plain_text(table(result(on_table("named", (own,))))).split())
    said = "squareness-xy: + where the right angle is too large, as in `mtu orthogonality`"
    assert said in text


def test_no_parts_are_advised_that_tell_nothing_apart() -> None:
    (own,) = ambiguous().tables[0].effects
    alone = replace(own, experiment=None, inseparable=True)
    text = words(result(on_table("class", (alone,))))
    assert "No further parts tell these apart: look for each of them on the machine" in text
    assert "To tell:" not in text
    # Other places tell a pitch.
    for wave in (
        replace(alone, class_names=(*alone.class_names, "cyclic-x")),
        replace(alone, aliases=("cyclic-x",)),
    ):
        text = words(result(on_table("class", (wave,))))
        said = "No further parts like these tell them apart. To tell: measure features at more"
        assert said in text


def test_a_follow_up_that_adds_next_to_nothing_is_not_advised() -> None:
    (own,) = ambiguous().tables[0].effects
    assert own.experiment is not None
    poor = replace(own, experiment=replace(own.experiment, further_d=0.2, now_d=5.0))
    text = words(result(on_table("class", (poor,))))
    assert (
        "Further parts tell little: the best of all follow-ups (shift the fixture by 17 mm) sets "
        "them a further 0.20 standard deviations apart."
    ) in text
    assert "To tell" not in text


def test_a_bend_is_told_from_a_lean_by_more_places() -> None:
    """A line of third order goes through any three heights; a fourth tells it from a tilt."""
    (own,) = ambiguous().tables[0].effects
    none = replace(own, experiment=None, inseparable=True, rivals=(), class_names=("abbe-x",))
    tilt = replace(
        none, name="abbe-x", aliases=("straightness-x",), equations={"Ex": "tilt*(z - 50)"}
    )
    text = words(result(on_table("class", (tilt,))))
    more = "Features at 4 or more different z in all tell straightness-x from"
    assert f"{more} abbe-x." in text
    assert "No further parts" not in text
    three = replace(tilt, class_names=("abbe-x", "squareness-xz"))
    text = words(result(on_table("class", (three,))))
    assert f"{more} the others. No further parts tell abbe-x or squareness-xz apart: look" in text
    # Along which axis it bends is not known where it was not estimated: y and z are one here.
    both = replace(tilt, equations={"Ex": "tilt*(z - y)"})
    text = words(result(on_table("class", (both,))))
    assert "No further parts tell these apart: look for each of them" in text


def test_what_was_not_estimated_of_a_class_is_told() -> None:
    """A rival that is the same on these points has no size of its own."""
    (own,) = ambiguous().tables[0].effects
    tilt = replace(
        own, name="abbe-x", class_names=("abbe-x", "squareness-xz"), aliases=("straightness-x",)
    )
    lean = replace(tilt, name="squareness-xz", family="squareness", axis="xz", rivals=())
    text = words(result(on_table("class", (replace(tilt, rivals=(lean,)),))))
    assert "If squareness-xz: X and Z are out of square" in text
    assert "What straightness-x would be is not estimated." in text
    every = replace(tilt, aliases=(), rivals=(lean,))
    assert "not estimated" not in words(result(on_table("class", (every,))))


def test_a_class_is_not_told_as_one_name() -> None:
    text = words(ambiguous())
    assert text.startswith(
        "backlash-x, abbe-x or trend-x: this data cannot tell which. If backlash-x: "
    )
    assert "To tell: shift the fixture by 17 mm" in text
    assert "set them a further 6.3 standard deviations apart (so far 0.81)" in text


def test_without_a_planned_experiment_the_library_says_what_to_do() -> None:
    own = effect(class_names=("backlash-x", "unnamed-drift-x"), posterior=0.9)
    text = words(result(on_table("class", (own,))))
    assert text.startswith("backlash-x or a smooth drift in x without a name: this data")
    assert "To tell: reverse the program." in text
    # At 97 : 3 the name is more than one of two.
    text = words(result(on_table("class", (replace(own, posterior=0.97),))))
    assert text.startswith(
        "Most likely X gains 4.10 ± 0.30 um at reversal, too far from both sides (backlash-x); a "
        "smooth drift in x without a name is not excluded. To tell: reverse the program."
    )
    named = replace(own, posterior=0.97, class_names=("backlash-x", "unnamed-drift-x", "abbe-x"))
    assert "this data cannot tell" in words(result(on_table("class", (named,))))


def test_what_is_unexplained_says_what_fired_and_gives_names_as_hints_only() -> None:
    text = words(left_over())
    assert "features near one another err alike (spatial-correlation, p <0.001)" in text
    assert "serial" not in text
    assert "As a hint only: of the named effects backlash-x comes nearest." in text
    assert "What is left has an rms of 6.0 um: most along X (" in text
    assert text.endswith("; repeatability is 3.6 um.")
    doubtful = effect(posterior=0.98)
    assert "As a hint only: backlash-x (X gains" in words(left_over((doubtful,)))
    hinted = words(left_over((effect(posterior=1.0),)))
    likeliest = "As a hint only, though by far the likeliest of the library: backlash-x ("
    assert f"{likeliest}X gains 4.10 ± 0.30 um at reversal, too far" in hinted
    assert "What is left has an rms of 3.7 um" in hinted


def test_what_was_found_twice_over_is_no_name() -> None:
    text = words(result(on_table("unexplained", (effect(),), twofold=("backlash-x",))))
    assert "backlash-x fits only twice over, in two forms that no one cause has at once" in text
    assert "As a hint only: backlash-x" in text


def test_nothing_found_says_what_would_have_been() -> None:
    text = words(nothing())
    assert text.startswith(
        "Nothing undeclared was found beside feature H7 of part P3, set aside as far off (at 5 % "
        "false alarms in all)"
    )
    alone = on_table("none", gross=())
    assert words(result(alone)).startswith("Nothing undeclared was found (at 5 % false alarms in")
    (one,) = nothing().tables[0].gross
    several = words(result(replace(alone, gross=(one, one))))
    assert (
        "found beside 2 entries set aside as far off (feature H7 of part P3 and so on)" in several
    )
    assert "0.51 um rms (abbe-x) to 2.8 um (cyclic-x) would have been found" in text
    shown = plain_text(table(nothing()))
    aside = "set aside as far off whatever the rest does: feature H7 of part P3 (x 17, y -0.40 um)"
    assert aside in " ".join(shown.split())


def test_figures_are_without_what_was_set_aside() -> None:
    (none,), (one,) = nothing().tables, named().tables
    assert "without 1 entry set aside\n" in plain_text(table(result(none)))
    with_gross = (scores(2837.7), scores(2837.9))
    both = replace(one, gross=none.gross * 2, held_out_with_gross=with_gross)
    shown = plain_text(table(result(both)))
    assert "without 2 entries set aside; held out with them: rms 2840 -> 2840 um" in shown
    found = replace(none, held_out_with_gross=with_gross)
    assert "held out with it: rms 2840 um" in plain_text(table(result(found)))


def test_parameters_are_rounded_to_their_uncertainty() -> None:
    lines = plain_text(table(named())).splitlines()
    (line,) = [line for line in lines if line.startswith("backlash-x  lost_motion")]
    assert " ".join(line.split()) == (
        "backlash-x lost_motion 2.05 ± 0.15 um [1.75, 2.35] <0.001 3.0 um 5 of 5"
    )


def test_the_best_five_candidates_are_listed_with_the_class_marked() -> None:
    lines = plain_text(table(ambiguous())).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("Likeliest"))
    names = [line.split()[0] for line in lines[start + 3 : start + 8]]
    assert names == ["backlash-x*", "abbe-x*", "trend-x*", "scale-x", "cyclic-x"]
    # Rounding leaves no minus before nothing.
    assert lines[start + 5].split()[1] == "0.0"
    assert "not tested: covariate-x: no other numeric column" in lines


def test_a_scatter_that_stood_higher_at_first_has_its_reason() -> None:
    """An effect that differs from part to part scatters, until it is taken out."""
    own = on_table("named", (effect(),))
    higher = (judged("scale-scatter", log_bayes_factor=61.2, posterior=0.99), *own.candidates)
    told = plain_text(table(result(replace(own, candidates=higher))))
    assert "scale-scatter: at the first look; not beside what was found" in told
    assert "not beside what was found" not in plain_text(table(result(own)))


def test_several_components_have_a_line_each_and_none_twice() -> None:
    text = plain_text(table(several()))
    assert "dx_x: it changes by 4.10 ± 0.30 um at reversal (backlash-x)." in text
    assert "ez_x: it changes by 4.10 ± 0.30 arcsec at reversal (backlash-x)." in text
    assert "Nothing undeclared in dy_x." in text
    assert "Held-out passes: rms 5.9 -> 3.8 arcsec" in text.replace("\n", " ")
    lines = text.splitlines()
    start = lines.index("Components")
    assert [line.split()[0] for line in lines[start + 3 : start + 6]] == ["dx_x", "ez_x", "dy_x"]


def test_scores_that_are_not_held_out_are_not_called_so() -> None:
    own = on_table("named", (effect(of_folds=0, folds=0),), held_out_by=None)
    text = plain_text(table(result(own)))
    assert "held-out" not in text.lower()
    assert "All data (none could be held out): rms 5.9 -> 3.8 um" in text.replace("\n", " ")


def test_an_effect_that_does_not_help_is_not_said_to() -> None:
    text = words(result(on_table("named", (effect(),), after=scores(6.4))))
    assert "Held-out parts: rms 5.9 -> 6.4 um" in text


def test_an_error_that_goes_to_nothing_does_not_make_the_other_long() -> None:
    text = words(result(on_table("named", (effect(),), after=scores(1.9e-8), floor=None)))
    assert "5.900 -> 0.000 um" in text


def test_a_component_without_an_axis_is_no_pair_of_axes() -> None:
    item = on_component("ring", name="ring", verdict="none")
    own = effect(
        "trend-ring", axis="ring", component="ring", covariate="sequence",
        parameters=(("slope", "um", 0.5, 0.1),), equations={"Ering": "slope*(sequence - 3)"},
    )  # fmt: skip
    assert effect_text(own, item) == "it shifts by 0.50 ± 0.10 um from pass to pass"


def test_without_a_repeatability_none_is_told() -> None:
    found = result(on_table("named", (effect(),), floor=None))
    assert words(found).endswith("rms 5.9 -> 3.8 um.")
    assert "repeatability" not in plain_text(table(found))


@pytest.mark.parametrize(
    ("own", "text"),
    [
        (
            effect("scale-y", parameters=(("scale", "um/m", -40.2, 3.1),)),
            "positioning of Y shrinks by 40.2 ± 3.1 um/m of travel",
        ),
        (
            effect("squareness-xy", parameters=(("angle", "arcsec", 3.3, 0.2),)),
            "X and Y are out of square by 3.30 ± 0.20 arcsec, more than 90 degrees",
        ),
        (
            effect("squareness-xy", parameters=(("angle", "arcsec", -3.3, 0.2),)),
            "X and Y are out of square by 3.30 ± 0.20 arcsec, less than 90 degrees",
        ),
        (
            effect(
                "cyclic-x",
                parameters=(
                    ("sine", "um", 3.0, 0.5), ("cosine", "um", 4.0, 0.5), ("level", "um", 9.0, 1.0)
                ),
                searched={"pitch_mm": (10.24, 9.8, 10.6)},
            ),
            # 3, 4, 5; equal and independent uncertainties stay the same along any direction.
            "X has a periodic error of 5.00 ± 0.50 um amplitude, pitch 10.24 [9.80, 10.60] mm",
        ),
        (
            effect(
                "thermal-drift-x",
                parameters=(("drift", "um/K", 2.31, 0.18),),
                covariate="T_spindle_degC",
            ),
            "X drifts by 2.31 ± 0.18 um/K of T_spindle_degC",
        ),
        (
            effect(
                "step-x",
                parameters=(("jump", "um", 8.0, 1.1),),
                searched={"at": (6.5, 5.5, 7.5)},
                covariate="sequence",
            ),
            "X jumps by 8.0 ± 1.1 um from part P7 on",
        ),
        (
            effect(
                "trend-x", parameters=(("slope", "um", 0.5, 0.1),), covariate="sequence"
            ),
            "X shifts by 0.50 ± 0.10 um from part to part",
        ),
        (
            effect(
                "feature-outlier",
                family="feature-outlier",
                axis=None,
                kind="outlier",
                chosen="H7",
                equations={},
                parameters=(("shift_x", "um", 21.0, 1.2), ("shift_y", "um", -0.4, 1.2)),
            ),
            "feature H7 stands out on every part: shift_x 21.0 ± 1.2 um, shift_y -0.4 ± 1.2 um",
        ),
        (
            effect(
                "straightness-x",
                parameters=(("bend", "um/m^2", 810.0, 95.0),),
                equations={"Ex": "bend*(y - 75)**2"},
            ),
            "X bends along Y: bend 810 ± 95 um/m^2",
        ),
        (
            effect(
                "thermal-growth",
                family="thermal-growth",
                axis=None,
                parameters=(("growth", "um/m/K", 11.0, 1.4),),
                covariate="T_part_degC",
            ),
            "X and Y grow by 11.0 ± 1.4 um/m/K of T_part_degC",
        ),
    ],
)  # fmt: skip
def test_effects_are_told_as_a_machinist_would(own: FoundEffect, text: str) -> None:
    assert said(own) == text


def test_a_users_own_family_is_told_in_its_own_words() -> None:
    own = effect("coolant-x", parameters=(("push", "um", 1.5, 0.2),))
    assert "coolant" not in SENTENCES
    assert said(own) == "what coolant says of x: push 1.50 ± 0.20 um"
    # A family of the library with other parameters than its sentence needs.
    bent = effect("cyclic-x", parameters=(("sine", "um", 1.0, 0.2),))
    assert said(bent) == "what cyclic says of x: sine 1.00 ± 0.20 um"


def test_scatter_is_not_said_to_be_taken_out() -> None:
    own = effect(
        "rotation-scatter", family="rotation-scatter", axis=None, kind="scatter",
        parameters=(), equations={}, explained_share=0.0,
    )  # fmt: skip
    own = replace(own, intervals=(), covariance=np.zeros((0, 0)))
    found = result(on_table("named", (own,), after=scores(5.9)))
    assert "->" not in words(found)
    assert "the rms stays at 5.9 um; repeatability is 3.6 um" in words(found)
    assert max(map(len, plain_text(table(found)).splitlines())) <= WIDTH


def test_long_names_do_not_widen_the_tables() -> None:
    long = "T_" + "very_long_name_of_a_sensor_" * 6 + "degC"
    own = effect(
        "thermal-drift-x", parameters=(("drift", "um/K", 2.31, 0.18),), covariate=long,
        class_names=("thermal-drift-x", *(f"covariate-{i}" for i in range(12))),
    )  # fmt: skip
    tables = (on_table("class", (own,)), on_component("c" * 40))
    for found in (result(tables[0]), result(*tables)):
        assert max(map(len, plain_text(table(found)).splitlines())) <= WIDTH
