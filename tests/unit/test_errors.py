from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import pytest

from mtu_cli.cli.execute import warning_lines
from mtu_cli.errors import (
    SHOWN_PROBLEMS,
    InputError,
    MtuError,
    Problem,
    closest,
    cut_names,
    did_you_mean,
    fault,
    is_near,
    shorten,
)
from mtu_cli.model.settings import Warned
from mtu_cli.slips import _slips, nearest


@pytest.mark.parametrize(
    ("problem", "text"),
    [
        (Problem(what="is empty"), "is empty"),
        (Problem(what="is empty", file="a.csv"), "a.csv: is empty"),
        (Problem(what="is odd", file="a.yaml", line=3), "a.yaml:3: is odd"),
        (Problem(what="is odd", line=3), "line 3: is odd"),
        (Problem(what="is odd", row=3), "row 3: is odd"),
        (
            Problem(
                what="not a number",
                file="a.csv",
                row=7,
                column="error",
                value="1,5",
                expected="a number such as 1.5",
            ),
            "a.csv, row 7, column 'error': not a number: '1,5'; expected a number such as 1.5",
        ),
        (Problem(what="is missing", column="pass"), "column 'pass': is missing"),
        (
            Problem(what="unknown name 'q'", file="m.yaml", line=9, path="equations.Ex", column=4),
            "m.yaml:9: equations.Ex: unknown name 'q' at column 4",
        ),
    ],
)
def test_a_problem_in_words(problem: Problem, text: str) -> None:
    assert str(problem) == text


def test_a_long_value_stays_on_one_line() -> None:
    text = str(Problem(what="too long", value="9" * 1000 + "\n"))
    assert "\n" not in text
    assert len(text) < 100


def test_every_problem_is_kept_and_twenty_are_shown() -> None:
    error = InputError(Problem(what=f"fault {i}") for i in range(23))
    lines = str(error).splitlines()
    assert len(error.problems) == 23
    assert lines[:SHOWN_PROBLEMS] == [f"fault {i}" for i in range(20)]
    assert lines[SHOWN_PROBLEMS:] == ["... and 3 more"]


def same(rows: Iterable[int], value: str = "furlong") -> list[Problem]:
    return [
        Problem(what="unknown unit", file="a.csv", column="unit", value=value, row=row)
        for row in rows
    ]


@pytest.mark.parametrize(
    ("rows", "others"),
    [
        (range(2, 92), " (and rows 3 to 91)"),
        ([2, 13, 39, 75], " (and rows 13, 39, 75)"),
        ([2, 3, 4, 9, 20, 21], " (and rows 3 to 4, 9, 20 to 21)"),
        (range(2, 40, 2), " (and 18 more rows, up to row 38)"),
    ],
)
def test_one_fault_of_many_rows_is_told_once(rows: Sequence[int], others: str) -> None:
    line = "a.csv, row 2, column 'unit': unknown unit: 'furlong'"
    assert str(InputError(same(rows))) == line + others


def test_what_differs_is_told_apart() -> None:
    """Three rows, cells with another value, and lines of a YAML file."""
    assert len(str(InputError(same((2, 3, 9)))).splitlines()) == 3
    two = [*same((2, 3, 4)), *same(range(5, 9), "ell"), *same((9,), "span")]
    assert [line.split(": ", 2)[-1] for line in str(InputError(two)).splitlines()] == [
        *["'furlong'"] * 3,
        "'ell' (and rows 6 to 8)",
        "'span'",
    ]
    mixed = [*same((2, 4, 6)), *same((3, 5), "ell")]
    rows = [line.split(",")[1] for line in str(InputError(mixed)).splitlines()]
    assert rows == [f" row {row}" for row in range(2, 7)]
    yaml = [Problem(what="is missing", file="m.yaml", line=line) for line in range(3, 9)]
    assert len(str(InputError(yaml)).splitlines()) == 6


def test_what_is_beyond_twenty_lines_is_counted_by_rows() -> None:
    many = [problem for i in range(23) for problem in same(range(2, 6), f"unit{i}")]
    lines = str(InputError(many)).splitlines()
    assert len(lines) == SHOWN_PROBLEMS + 1
    assert all(line.endswith(" (and rows 3 to 5)") for line in lines[:-1])
    assert lines[-1] == "... and 12 more"


def test_problems_stand_in_the_order_of_their_file() -> None:
    at = {"a 9": ("a", 9), "b 4": ("b", 4), "none": ("a", None), "a 2": ("a", 2), "b 3": ("b", 3)}
    problems = [Problem(what=what, file=file, line=line) for what, (file, line) in at.items()]
    found = [problem.what for problem in InputError(problems).problems]
    assert found == ["a 2", "b 3", "none", "a 9", "b 4"]
    rows = [Problem(what=str(row), file="c.csv", row=row) for row in (7, 3, 5)]
    assert [problem.row for problem in InputError(rows).problems] == [3, 5, 7]


def test_twenty_problems_leave_nothing_to_count() -> None:
    assert "more" not in str(InputError(Problem(what=f"fault {i}") for i in range(SHOWN_PROBLEMS)))


def test_fault_is_an_input_error_with_one_problem() -> None:
    error = fault("is missing", file="a.csv", column="pass")
    assert isinstance(error, MtuError)
    assert error.problems == (Problem(what="is missing", file="a.csv", column="pass"),)


def test_names_that_are_no_names_do_not_fill_the_screen() -> None:
    long = "a" * 100_000
    told = str(Problem(what=long, file="a", path=long, column=long, value=long, expected=long))
    assert len(told) < 1500
    assert told.count("...") == 5
    path = "results.components.dx_x.pass_covariance_moment"
    assert path in str(Problem(what="is missing", file="a.json", path=path))


@pytest.mark.parametrize(("width", "text"), [(6, "abcdef"), (5, "ab...")])
def test_shorten(width: int, text: str) -> None:
    assert shorten("abcdef", width) == text


@pytest.mark.parametrize(
    ("name", "meant"),
    [("dx_X", "dx_x"), ("dxx", "dx_x"), ("axis", None), ("ez_y", "ez_y"), ("", None)],
)
def test_closest(name: str, meant: str | None) -> None:
    assert closest(name, ["dx_x", "ez_y"]) == meant


def test_letters_in_another_order_are_nearest() -> None:
    assert closest("azx", ["axy", "ayz", "axz"]) == "axz"
    assert closest("AZX", ["ayz", "axz"]) == "axz"
    assert closest("T_12_degC", ["T_02_degC", "T_21_degC"]) == "T_21_degC"
    assert closest("trap", ["part"]) is None


def test_what_is_not_near_is_no_suggestion() -> None:
    """A third of the letters may differ, or the rest is missing; slips of the fingers count."""
    steps = ["meas", "line", "plane", "angle", "distance"]
    assert nearest("winkel", steps) == []
    assert nearest("dist", steps) == nearest("distence", steps) == ["distance"]
    assert nearest("lien", steps) == ["line"]
    assert nearest("LINE", steps) == ["line"]
    assert nearest("umm", ["um", "mm", "nm", "um/m"]) == ["um", "mm"]
    assert nearest("um/mm", ["um", "mm", "um/m"]) == ["um/m"]
    assert did_you_mean("umm", ["um", "mm", "um/m"]) == "did you mean 'um' or 'mm'?"
    assert did_you_mean("winkel", steps) == "one of: meas, line, plane, angle, distance"


def test_so_many_names_equally_near_are_listed() -> None:
    holes = [f"hole{i}" for i in range(1, 5)]
    assert did_you_mean("hole", holes[:3]) == "did you mean 'hole1', 'hole2' or 'hole3'?"
    assert did_you_mean("hole", holes) == "one of: hole1, hole2, hole3, hole4"


def test_slips_between_names() -> None:
    """Against the recursive definition."""

    def slow(a: str, b: str) -> int:
        if not a or not b:
            return len(a) + len(b)
        found = [slow(a[1:], b) + 1, slow(a, b[1:]) + 1, slow(a[1:], b[1:]) + (a[0] != b[0])]
        if a[:2] == b[1::-1] and len(a) > 1 < len(b):
            found.append(slow(a[2:], b[2:]) + 1)
        return min(found)

    words = ["".join(letters) for n in range(5) for letters in product("ab", repeat=n)]
    for a, b in product(words, ["", "ba", "abc", "bca", "caba"]):
        assert _slips(a, b) == slow(a, b)


@pytest.mark.parametrize(
    ("name", "other", "near"),
    [
        ("trails", "trials", True),
        ("Lazer", "laser", True),
        ("pass", "passes", True),
        ("pass", "laser", False),
        ("pass", "parts", False),
        ("machine.yaml", "tm.yaml", False),
        ("p.yaml", "t.yaml", False),
        ("p.yaml", "t.yml", False),
        ("d1.csv", "d2.csv.gz", False),
        ("P.yaml", "p.yml", True),
        ("lab.csv", "lbb.csv.gz", True),
        ("run.v1.yaml", "run.v2.yaml", True),
        (".yaml", ".csv", False),
        ("p", "t", False),
        ("", "", True),
    ],
)
def test_near_names_differ_in_a_third_of_their_letters_at_most(
    name: str, other: str, near: bool
) -> None:
    assert is_near(name, other) == is_near(other, name) == near


def test_did_you_mean() -> None:
    many = [f"T_{i}_degC" for i in range(13)]
    assert did_you_mean("dxx", ["dx_x"]) == "did you mean 'dx_x'?"
    assert did_you_mean("qqq", ["dx_x", "ez_y"]) == "one of: dx_x, ez_y"
    assert did_you_mean("qqq", many) == "one of: " + ", ".join(many[:12]) + ", ..."
    assert did_you_mean("qqq", []) == "no such name: none is known here"


def test_long_names_are_cut_and_what_stands_around_them_is_kept() -> None:
    text = f"part '{'z' * 100_000}' was not measured at P1; see {'a' * 250}.csv"
    assert cut_names(text) == f"part '{'z' * 57}...' was not measured at P1; see {'a' * 250}.csv"
    assert cut_names("many short words " * 100) == "many short words " * 100
    path = f"{'/'.join(['folder'] * 60)}/readings.csv"
    assert cut_names(f"{path}, row 3") == f"{path[:57]}.../readings.csv, row 3"
    endless = f"a/{'z' * 400}"
    assert cut_names(endless) == f"{endless[:57]}..."


def test_the_name_of_a_file_is_cut_too() -> None:
    problem = Problem(what="is missing", file=f"{'z' * 400}.json", row=2)
    assert str(problem) == f"{'z' * 57}..., row 2: is missing"


def test_a_warning_of_a_part_with_a_long_name_stays_short() -> None:
    (line,) = warning_lines(
        [Warned(code="empty-cells", message=f"part '{'z' * 100_000}' is short")]
    )
    assert line == f"warning: part '{'z' * 57}...' is short [empty-cells]"


def in_line(path: str, line: int, what: str = "wrong value") -> Problem:
    return Problem(what=what, file="s.yaml", line=line, path=path, value="abc", expected="a number")


def test_like_faults_of_many_entries_are_told_once() -> None:
    alike = [in_line(f"features.H{i}.{key}", i) for i in range(5) for key in ("x_mm", "y_mm")]
    first, second = str(InputError(alike)).splitlines()
    assert first == (
        "s.yaml:0: features.H0.x_mm: wrong value: 'abc'; expected a number (and lines 1 to 4)"
    )
    assert "features.H0.y_mm" in second
    entries = [in_line(f"features.H{i}", i, "no such width") for i in range(1, 6)]
    assert str(InputError(entries)).count("no such width") == 5
    lacking = [replace(entry, lacks="x_mm") for entry in entries]
    assert str(InputError(lacking)).count("no such width") == 1
    flow = [in_line(f"features.H{i}.x_mm", 3) for i in range(6)]
    assert str(InputError(flow)).endswith("(and 5 more)")
    two = [in_line(f"features.H{i}.x_mm", 3 + (i == 5)) for i in range(6)]
    assert str(InputError(two)).endswith("(and lines 3 to 4)")


def test_other_keys_are_told_by_themselves() -> None:
    keys = ("seed", "digits", "trials", "threads", "coverage_factor")
    text = str(InputError([in_line(f"settings.{key}", i) for i, key in enumerate(keys, 3)]))
    assert all(f"settings.{key}: " in text for key in keys)
    assert str(InputError([in_line(f"a{i}.b", i) for i in range(5)])).count("wrong value") == 5


def test_entries_of_two_steps_are_one_problem() -> None:
    """Of more places than a section of a contract has keys."""
    text = str(InputError([in_line(f"features.H{i}", i) for i in range(4, 34)]))
    assert "features.H0" not in text
    assert text.count("features.H") == 1
    assert "(and lines 5 to 33)" in text
