"""The document and the CSV of close-loop: keys, units, nulls, several components."""

from __future__ import annotations

import csv
import io
import json
import math
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
    on_table,
    result,
    scores,
    several,
)

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect
from mtu_cli.close_loop_sealed.reports.close_loop import csv_rows, document
from mtu_cli.reports.fields import csv_text

EVERY = {"named": named, "class": ambiguous, "unexplained": left_over, "none": nothing}


def rows(found: CloseLoopResult) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(csv_text(*csv_rows(found)))))


@pytest.mark.parametrize("verdict", EVERY)
def test_every_verdict_is_valid_json_with_the_fields_of_the_contract(verdict: str) -> None:
    found = document(EVERY[verdict]())
    json.dumps(found, allow_nan=False)
    assert found["verdict"] == verdict
    assert found["undeclared_effect_found"] is (verdict != "none")
    sizes = {"rms_um", "rms_x_um", "rms_y_um", "p95_um", "max_um", "chi2_per_dof"}
    for scored in (found, found["in_sample"]):
        assert set(scored["before"]) == set(scored["after"]) == sizes
    assert found["unexplained"]["found"] is (verdict == "unexplained")
    assert {check["name"] for check in found["unexplained"]["checks"]} == {
        "serial-correlation",
        "spatial-correlation",
    }
    assert len(found["candidates"]) == 7
    assert found["tables"] == []


def test_scores_are_in_um_and_the_held_out_ones_stand_first() -> None:
    found = document(named())
    assert found["before"]["rms_um"] == pytest.approx(5.9)
    assert found["after"]["max_um"] == pytest.approx(3.8 * 3.3)
    assert found["in_sample"]["before"]["rms_y_um"] == pytest.approx(6.0)
    assert found["floor_um"] == pytest.approx(3.6)
    assert found["improvement_percent"] == pytest.approx(100 * (5.9 - 3.8) / 5.9)
    held_out = {"by": "parts", "scored": "mean by posterior", "folds": 5, "with_outliers": None,
                "by_column": None}  # fmt: skip
    assert found["held_out"] == held_out
    (one,) = named().tables
    of_columns = document(result(replace(one, by_column=scores(2.5))))["held_out"]["by_column"]
    assert of_columns["rms_um"] == pytest.approx(2.5)
    both = document(result(replace(one, held_out_with_gross=(scores(70.0), scores(68.0)))))
    assert both["before"] == found["before"]
    assert both["held_out"]["with_outliers"]["before"]["rms_um"] == pytest.approx(70.0)
    assert both["held_out"]["with_outliers"]["after"]["max_um"] == pytest.approx(68.0 * 3.3)


def test_parameters_are_in_the_unit_that_stands_beside_them() -> None:
    own = effect(
        "scale-x",
        parameters=(("scale", "um/m", -12.5, 0.75),),
        equations={"Ex": "scale*(x - 75)"},
        searched={"pitch_mm": (10.2, 9.9, 10.5)},
    )
    (found,) = document(result(on_table("named", (own,))))["effects"]
    scale = found["parameters"]["scale"]
    assert scale["unit"] == "um/m"
    assert (scale["value"], scale["u"]) == (pytest.approx(-12.5), pytest.approx(0.75))
    assert scale["interval95"] == pytest.approx([-14.0, -11.0])
    assert found["searched"] == {"pitch_mm": {"value": 10.2, "interval95": [9.9, 10.5]}}
    assert found["equations"] == {"Ex": "scale*(x - 75)"}
    # A quarter of the squares of 6 um are those of 3 um.
    assert found["rms_um"] == pytest.approx(3.0)


def test_a_class_comes_with_its_names_and_the_experiment() -> None:
    (found,) = document(ambiguous())["effects"]
    assert found["class"] == ["backlash-x", "abbe-x"]
    assert found["apart"] == []
    assert found["aliases"] == ["trend-x"]
    assert found["experiment"] == {
        "do": "shift the fixture by 17 mm",
        "predicted_d": 6.34,
        "now_d": 0.81,
        "further_d": 6.29,
    }


def test_what_is_left_has_a_size_only_where_it_is_more_than_scatter() -> None:
    assert document(named())["unexplained"]["rms_um"] is None
    left = document(left_over((effect(),)))["unexplained"]
    assert left["rms_um"] == pytest.approx(3.7)
    assert [check["fired"] for check in left["checks"]] == [False, True]


def test_a_drift_without_a_name_is_unexplained_though_no_check_fired() -> None:
    twice = document(result(on_table("unexplained", twofold=("wear-approach-x",))))
    assert twice["unexplained"]["found"] is True
    assert twice["unexplained"]["twofold"] == ["wear-approach-x"]
    found = document(result(on_table("unexplained", nameless=("unnamed-drift-y",))))
    assert found["unexplained"]["found"] is True
    assert found["unexplained"]["rms_um"] == pytest.approx(6.0)
    assert found["unexplained"]["twofold"] == []


def test_entries_set_aside_are_told() -> None:
    (found,) = document(nothing())["outliers"]
    assert (found["part"], found["feature"], found["score"]) == ("P3", "H7", 9.1)
    assert found["deviation_um"] == pytest.approx({"x": 17.1, "y": -0.4})


def test_what_cannot_be_had_is_null() -> None:
    own = effect(intervals=((-math.inf, math.inf, math.inf),), of_folds=0, folds=0)
    odd = on_table(
        "named",
        (own,),
        floor=None,
        held_out_by=None,
        before=replace(scores(0.0), chi2_per_dof=None, p95=np.nan),
    )
    found = document(result(odd))
    json.dumps(found, allow_nan=False)
    assert found["floor_um"] is None
    assert found["improvement_percent"] is None
    assert found["held_out"]["by"] is None
    assert found["before"]["p95_um"] is None
    assert found["effects"][0]["parameters"]["lost_motion"]["interval95"] == [None, None]


def test_components_in_arcsec_have_keys_in_arcsec() -> None:
    found = document(several())
    json.dumps(found, allow_nan=False)
    assert found["component"] == "dx_x"
    assert [item["component"] for item in found["tables"]] == ["dx_x", "ez_x", "dy_x"]
    _, yaw, straight = found["tables"]
    assert yaw["before"]["rms_arcsec"] == pytest.approx(5.9)
    assert yaw["floor_arcsec"] == pytest.approx(3.6)
    assert not any(key.endswith("_um") for key in (*yaw, *yaw["before"]))
    assert (straight["verdict"], straight["effects"]) == ("none", [])
    assert [item["component"] for item in found["effects"]] == ["dx_x", "ez_x"]
    assert found["effects"][1]["parameters"]["lost_motion"]["unit"] == "arcsec"
    assert found["effects"][1]["parameters"]["lost_motion"]["value"] == pytest.approx(2.05)
    assert {item["component"] for item in found["candidates"]} == {"dx_x", "ez_x", "dy_x"}


def test_rows_are_the_candidates_with_those_that_could_not_be_tested() -> None:
    found = rows(ambiguous())
    assert [row["candidate"] for row in found][:2] == ["backlash-x", "abbe-x"]
    first, second, third = found[:3]
    assert (first["found"], first["in_class"]) == ("true", "true")
    assert (second["found"], second["in_class"]) == ("false", "true")
    assert (third["found"], third["in_class"]) == ("false", "false")
    assert float(first["minimum_detectable_um"]) == pytest.approx(1.234)
    last = found[-1]
    assert last["unavailable"] == "no other numeric column"
    assert last["p_familywise"] == last["minimum_detectable_um"] == ""
    assert found[5]["notes"] == "T_a is a copy of T_b"


def test_rows_have_a_column_for_each_unit_that_there_is() -> None:
    found = rows(several())
    lengths = [row for row in found if row["component"] == "dx_x"]
    angles = [row for row in found if row["component"] == "ez_x"]
    for own, other, row in (("um", "arcsec", lengths[0]), ("arcsec", "um", angles[0])):
        assert row[f"minimum_detectable_{own}"] != ""
        assert row[f"minimum_detectable_{other}"] == ""
    assert "minimum_detectable_arcsec" not in rows(named())[0]


def test_infinite_bayes_factors_are_empty_in_csv_and_null_in_json() -> None:
    odd = on_table("none", candidates=(judged("scale-x", log_bayes_factor=-math.inf),))
    assert document(result(odd))["candidates"][0]["log_bayes_factor"] is None
    assert rows(result(odd))[0]["log_bayes_factor"] == ""


def test_a_hint_alone_is_not_found() -> None:
    """For whoever counts findings; the verdict says what it may be."""

    def found(*effects: FoundEffect) -> tuple[object, bool]:
        own = result(on_table("class", effects))
        return document(own)["undeclared_effect_found"], own.is_found

    weak = effect("backlash-x", parameters=(("lost_motion", "um", 0.2, 0.15),))
    assert found(weak) == (False, False)
    assert found(weak, effect("backlash-y")) == (True, True)
    # The part from which on something jumped is none of its size.
    assert found(replace(weak, searched={"at": (9.5, 8.5, 10.5)})) == (False, False)
    assert found(effect(parameters=(("sine", "um", 0.1, 1.0), ("cosine", "um", 4.0, 1.0))))[1]
    assert result(on_table("unexplained", (weak,))).is_found
    assert not nothing().is_found
