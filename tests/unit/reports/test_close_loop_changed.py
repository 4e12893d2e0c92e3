"""What close-loop says of an effect whose size depends on which of a class another one is."""

from __future__ import annotations

from dataclasses import replace

from close_loop_examples import effect, on_table, result

from mtu_cli.close_loop_sealed.reports.close_loop import document, table
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text

NAMES = ("radial", "scale-z")
SCALE = effect(
    "scale-y",
    parameters=(("scale", "um/m", 11.7, 1.7),),
    equations={"Ey": "scale*(y - 75)"},
)
THEN = replace(SCALE, parameters=(("scale", "um/m", 29.8e-6, 1.3e-6),))
SHIFTS = effect(
    "radial",
    axis=None,
    parameters=(("radius", "um", 2.75, 0.15),),
    equations={"Ex": "radius*(x - 75)", "Ey": "radius*(y - 75)"},
    class_names=NAMES,
)
RIVAL = effect(
    "scale-z",
    parameters=(("scale", "um/m", 32.0, 1.8),),
    equations={"Ez": "scale*z"},
    class_names=NAMES[::-1],
)


def test_another_size_is_told_with_the_rival_and_the_first_is_told_to_be_beside_what() -> None:
    found = replace(SHIFTS, rivals=(replace(RIVAL, changed=(THEN,)),))
    whole = result(on_table("class", (found, SCALE)))
    text = verdict_text(whole.tables[0], whole)
    assert "32.0 ± 1.8 um/m of travel; then positioning of Y grows by 29.8 ± 1.3 " in text
    assert text.lower().count("beside radial, positioning of y grows by 11.7 ± 1.7 um/m") == 1
    shown = " ".join(plain_text(table(whole)).split())
    assert "scale-y has these figures beside radial, and others beside what that may be" in shown
    (rival,) = document(whole)["effects"][0]["rivals"]
    assert rival["changed"]["scale-y"]["scale"]["value"] == 29.8
    assert rival["changed"]["scale-y"]["scale"]["unit"] == "um/m"


def test_what_stays_as_it_is_is_told_by_itself() -> None:
    whole = result(on_table("class", (replace(SHIFTS, rivals=(RIVAL,)), SCALE)))
    text = verdict_text(whole.tables[0], whole)
    assert "positioning of Y grows by 11.7 ± 1.7 um/m of travel (scale-y)" in text.replace("P", "p")
    assert "is then" not in text
    assert "beside radial" not in text.lower()
    assert "has these figures" not in plain_text(table(whole))
