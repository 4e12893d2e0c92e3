"""What close-loop says where one axis alone turns or grows from part to part."""

from __future__ import annotations

from dataclasses import replace

import pytest
from close_loop_examples import effect, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect
from mtu_cli.close_loop_sealed.reports.close_loop import document, gate_text, table
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text

GROWTH = ScatterSize(
    parameter=("s", "um/m", 17e-6, 2.8e-6),
    by_axis=(("x", 24.2e-6), ("y", 0.4e-6)),
    u_by_axis=(4.1e-6, 3.2e-6),
    p_alike=1e-9,
)
ARCSEC = 4.84813681109536e-6
TURN = ScatterSize(
    parameter=("s", "arcsec", 3 * ARCSEC, 0.5 * ARCSEC),
    by_axis=(("x", 0.2 * ARCSEC), ("y", 4.25 * ARCSEC)),
    u_by_axis=(0.4 * ARCSEC, 0.71 * ARCSEC),
    p_alike=1e-9,
)


def scatter(name: str, size: ScatterSize) -> FoundEffect:
    own = effect(name, parameters=(), equations={}, kind="scatter", scatter=size)
    return replace(own, family=name, axis=None)


def told(own: FoundEffect, *beside: FoundEffect) -> CloseLoopResult:
    return result(on_table("unexplained", (own, *beside)))


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (
            scatter("scale-scatter", GROWTH),
            "the scale of X differs from part to part: s = 24.2 ± 4.1 um/m (Y 0.4 ± 3.2)",
        ),
        (
            scatter("rotation-scatter", TURN),
            "X leans over along Y from part to part: s = 4.25 ± 0.71 arcsec (Y along X "
            "0.20 ± 0.40)",
        ),
    ],
)
def test_it_is_told_as_what_it_is(own: FoundEffect, said: str) -> None:
    text = words(told(own))
    assert text.startswith(f"Something is there that no effect of the library describes: {said}")
    assert f"to which {own.name} comes nearest" in text
    # That parts were turned by hand would be the name that it has not.
    assert "set up by hand" not in text
    assert "hint only" not in text


def test_its_sizes_are_those_of_axes() -> None:
    found = told(scatter("scale-scatter", GROWTH))
    rows = plain_text(table(found)).splitlines()
    first = next(i for i, row in enumerate(rows) if "s along x" in row)
    assert "24.2 ± 4.1" in rows[first]
    assert "s along y" in rows[first + 1]
    assert "0.4 ± 3.2" in rows[first + 1]
    assert "17.0" not in plain_text(table(found))
    written = document(found)["effects"][0]["scatter"]
    assert (written["s"], written["u"], written["axes_unlike"]) == (None, None, True)
    assert written["by_axis"] == pytest.approx({"x": 24.2, "y": 0.4})
    assert written["u_by_axis"] == pytest.approx({"x": 4.1, "y": 3.2})
    assert "nothing is left" not in plain_text(table(found))


def test_where_axes_are_alike_one_size_is_told() -> None:
    alike = scatter("scale-scatter", replace(GROWTH, p_alike=0.2))
    found = result(on_table("named", (alike,)))
    assert "s = 17.0 ± 2.8 um/m (X 24, Y 0.40) (scale-scatter)" in words(found)
    written = document(found)["effects"][0]
    assert written["verdict"] == "named"
    assert written["scatter"]["s"] == pytest.approx(17.0)
    assert written["scatter"]["axes_unlike"] is False


def test_it_has_no_name_and_leaves_others_theirs() -> None:
    found = told(scatter("scale-scatter", GROWTH), effect("backlash-x"))
    written = document(found)
    assert [own["verdict"] for own in written["effects"]] == ["unexplained", "named"]
    assert written["unexplained"]["found"] is True
    assert written["unexplained"]["of_one_axis"] == ["scale-scatter"]
    text = words(found)
    assert text.startswith("X gains 4.10 ± 0.30 um at reversal")
    assert "Beside that something is there" in text
    assert gate_text(found) == (
        "verdict unexplained, beside backlash-x, with a hint at scale-scatter"
    )
