"""The report of close-loop: its sentence, its fields, its tables and its picture."""

from __future__ import annotations

import json

import pytest
from loop_examples import (
    BACKLASH,
    CLASS,
    CYCLIC,
    SCATTER,
    SMOOTH,
    effect,
    on_table,
    parameter,
    result,
)

from mtu_cli.analyses.close_loop.result import Crossing, FoundEffect
from mtu_cli.files.source import report_bytes
from mtu_cli.reports.close_loop import document, effect_text, verdict_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.tables import plain_text

EXAMPLES = {
    "named": result(on_table(BACKLASH, CYCLIC)),
    "class": result(on_table(CLASS, verdict="class")),
    "smooth": result(on_table(SMOOTH)),
    "unexplained": result(on_table(SCATTER, verdict="unexplained")),
    "none": result(on_table(verdict="none")),
    "several": result(on_table(BACKLASH, component="dx_x"), on_table(SMOOTH, component="ez_x")),
}


HEADER = ["component", "candidate", "family", "p_familywise", "log_bayes_factor", "posterior",
          "minimum_detectable_um", "found", "in_class", "unavailable", "notes"]  # fmt: skip


def test_the_first_sentence_is_a_machinists() -> None:
    assert verdict_text(on_table(BACKLASH), 0.05) == (
        "X loses 8.20 ± 0.30 um at reversal (backlash-x); with the correction the rms error of "
        "held-out parts falls from 3.6 to 2.0 um; repeatability 1.8 um."
    )


@pytest.mark.parametrize(
    ("found", "component", "said"),
    [
        (CYCLIC, None, "Y has a periodic error of 5.00 ± 0.20 um amplitude, pitch 12.50 mm"),
        (BACKLASH, "dx_x", "dx_x is 8.20 ± 0.30 um lower forward than in reverse"),
        (SMOOTH, None, "a smooth error of x along x: rms 2.50 ± 0.30 um"),
        (SCATTER, None, "one operation scatters more (milled): 2.5 times the rest"),
        (
            effect("squareness-xy", parameter("angle", "arcsec", 11.4, 1.8)),
            None,
            "X and Y are out of square by 11.4 ± 1.8 arcsec, more than 90 degrees",
        ),
        (
            effect("mine-x", parameter("a", "um", 1, 0.1), parameter("b", "um/m", 2, 0.1)),
            None,
            "what mine does: a 1.00 ± 0.10 um, b 2.00 ± 0.10 um/m",
        ),
    ],
)
def test_an_effect_in_words(found: FoundEffect, component: str | None, said: str) -> None:
    item = on_table(found, component=component)
    assert effect_text(item.effects[0], item) == said


def test_what_is_left_what_separates_and_what_cancels_is_said() -> None:
    left = verdict_text(on_table(SCATTER, verdict="unexplained"), 0.05)
    assert "parts follow one another too smoothly to be scatter (walk, p 0.002)" in left
    assert "no equation corrects that" in left
    assert "turn the part (then 6.3 standard deviations apart)" in verdict_text(
        on_table(CLASS, verdict="class"), 0.05
    )
    zero = Crossing(axis="x", covariate="T_a_degC", value=22.2, u=0.8, interval95=(20.6, 23.8))
    assert "X is right at T_a_degC = 22.20 ± 0.80 degC." in verdict_text(
        on_table(BACKLASH, crossings=(zero,)), 0.05
    )


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_report_is_json_fits_100_columns_and_has_a_picture(name: str) -> None:
    found = document(EXAMPLES[name])
    record = found.record()
    assert json.loads(report_bytes(record)) == record
    text = plain_text(found.blocks(detail=True))
    assert max(map(len, text.splitlines())) <= 100
    assert found.figure is not None
    assert figure_bytes(found.figure(), ".png").startswith(b"\x89PNG")
    header, rows = found.rows()
    assert header[:6] == HEADER[:6]
    assert header[-4:] == HEADER[-4:]
    lines = [dict(zip(header, row, strict=True)) for row in rows]
    assert [line["candidate"] for line in lines[:3]] == ["scale-x", "backlash-x", "covariate-x"]
    assert lines[1]["found"] is any(x.name == "backlash-x" for x in EXAMPLES[name].effects)


def test_numbers_are_in_the_units_of_their_names() -> None:
    record = document(EXAMPLES["named"]).record()
    assert record["before"]["rms_um"] == pytest.approx(3.6)
    assert record["before"]["rms_x_um"] == pytest.approx(3.6)
    assert record["floor_um"] == pytest.approx(1.8)
    assert record["improvement_percent"] == pytest.approx(100 * (1 - 2 / 3.6))
    assert record["after_averaged"]["rms_um"] == pytest.approx(2.0)
    first, second = record["effects"]
    lost = first["parameters"]["lost_motion"]
    assert (lost["value"], lost["u"]) == (pytest.approx(-4.1), pytest.approx(0.15))
    assert second["searched"]["pitch_mm"] == {
        "value": 12.5, "interval95": [12.3, 12.7], "intervals": [[12.3, 12.7]],
    }  # fmt: skip
