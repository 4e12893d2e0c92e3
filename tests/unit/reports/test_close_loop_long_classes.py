"""What close-loop says of classes with many names, of a scatter's, and of what was not tested."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from close_loop_examples import ambiguous, effect, judged, left_over, on_table, result

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult
from mtu_cli.close_loop_sealed.reports.close_loop import document, table
from mtu_cli.close_loop_sealed.reports.close_loop_notes import untested
from mtu_cli.close_loop_sealed.reports.close_loop_words import verdict_text
from mtu_cli.reports.tables import plain_text


def words(found: CloseLoopResult) -> str:
    return verdict_text(found.tables[0], found)


def test_of_a_very_long_class_the_table_names_six() -> None:
    known = tuple(f"cyclic-{i}" for i in range(20))
    own = effect(class_names=("backlash-x", *known))
    shown = plain_text(table(result(on_table("class", (own,)))))
    assert "cyclic-3, cyclic-4 and 15 more (-o FILE.json)" in shown.replace("\n", " ")
    assert "cyclic-5" not in shown


def test_what_is_no_reading_of_a_scatter_is_not_told_as_one() -> None:
    names = ("scale-scatter", "thermal-growth-x", "offset-z", "curvature-y")
    own = effect(
        "scale-scatter", family="scale-scatter", axis=None, equations={}, parameters=(),
        kind="scatter", class_names=names,
    )  # fmt: skip
    both = replace(own, apart=names[2:])
    text = words(result(on_table("class", (both,))))
    assert text.startswith("scale-scatter or thermal-growth-x: this data cannot tell which.")
    assert "offset-z" not in text
    shown = plain_text(table(result(on_table("class", (both,))))).replace("\n", " ")
    assert "scale-scatter: not much less likely, but no readings of it (they look different): " in (
        shown
    )
    alone = words(result(on_table("class", (replace(own, apart=names[1:]),))))
    said = "no readings of it: thermal-growth-x, offset-z or curvature-y."
    assert said in alone
    assert "this data cannot tell" not in alone
    # As a hint beside what is left, too.
    hinted = words(left_over((both,)))
    assert ") or thermal-growth-x" in hinted
    assert "offset-z" not in hinted


def test_reasons_of_what_was_not_tested_are_lines_of_their_own() -> None:
    none = on_table("none", ())
    plain = replace(none.candidates[0], unavailable=None)

    def lines(count: int) -> list[str]:
        shut = [replace(plain, name=f"c{i}", unavailable=f"reason {i}") for i in range(count)]
        return untested(replace(none, candidates=(plain, *shut)))

    assert lines(5) == [f"not tested: c{i}: reason {i}" for i in range(5)]
    assert lines(7)[3:] == [
        "not tested: c3: reason 3",
        "not tested for 3 further reasons (-o FILE.json): c4, c5, c6",
    ]


def test_each_of_a_class_has_a_line_of_its_own() -> None:
    found = ambiguous()
    lines = plain_text(table(found)).splitlines()
    assert lines[:2] == [
        "Undeclared effects: class",
        "backlash-x, abbe-x or trend-x: this data cannot tell which.",
    ]
    first, what = (next(i for i, own in enumerate(lines) if own.startswith(s)) for s in
                   ("  If backlash-x: ", "To tell: "))  # fmt: skip
    assert all(own.startswith("  ") for own in lines[first:what])
    assert "Held-out parts: rms" in " ".join(lines[what : lines.index("")])
    # The report has the same words without the lines.
    said = " ".join(own.strip() for own in lines[1 : lines.index("")])
    assert document(found)["verdict_text"] == [said]


def test_a_class_of_columns_that_are_copies_says_so() -> None:
    """Of two that take these columns; one alone is no reason why others look like it."""
    note = "T_spindle_degC is a copy of time_min here: the two cannot be told apart"
    own = effect(class_names=("backlash-x", "trend-x"))
    item = on_table("class", (own,))
    told = {"trend-x": (note,), "radial": ("T_a is a copy of T_b here",)}

    def said(notes: Mapping[str, tuple[str, ...]]) -> str:
        candidates = tuple(
            judged(old.name, log_bayes_factor=old.log_bayes_factor, notes=notes.get(old.name, ()))
            for old in item.candidates
        )
        return words(result(replace(item, candidates=candidates)))

    both = said(told | {"backlash-x": (note,)})
    assert "this data cannot tell which, for T_spindle_degC is a copy of time_min here. If " in both
    assert "T_a" not in both
    assert "this data cannot tell which. If " in said(told)
