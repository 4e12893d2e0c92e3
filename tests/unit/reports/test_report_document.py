"""Envelope, CSV text and figure bytes."""

from __future__ import annotations

import csv
import io
import re
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.json_file import report_bytes
from mtu_cli.files.source import Source
from mtu_cli.findings import finding, listed
from mtu_cli.model.settings import Settings
from mtu_cli.reports.document import envelope, finite
from mtu_cli.reports.fields import csv_text
from mtu_cli.reports.figures import blank, figure_bytes, styled
from mtu_cli.reports.tables import Column, Sheet, broken, plain_text


def test_envelope_has_the_contract_fields_and_each_warning_once() -> None:
    source = Source(
        role="machine", path=Path("/secret/machine.yaml"), shown="machine.yaml", sha256="ab"
    )
    warning = finding("unrelated", output="C.x", names=["a"], file="a.csv", row=3)
    document = envelope(
        "lengths",
        inputs=[source],
        settings=Settings(trials=None, seed=3),
        results={"lengths": []},
        warnings=[warning, warning],
        at={"dir_x": 1},
    )
    assert list(document) == ["schema", "tool", "inputs", "settings", "results", "warnings"]
    assert document["schema"] == "mtu/lengths/1"
    assert document["inputs"] == [
        {"role": "machine", "path": "machine.yaml", "sha256": "ab", "rows": None}
    ]
    assert document["settings"] == {
        "coverage_factor": 2.0,
        "seed": 3,
        "correlation": "shared",
        "digits": 2,
        "trials": None,
        "at": {"dir_x": 1.0},
    }
    message = "a.csv, row 3: C.x does not depend on a"
    facts = {"output": "C.x", "names": ["a"]}
    (listed,) = document["warnings"]
    assert listed == {
        "code": "unrelated", "severity": "warning", "message": message, "facts": facts,
        "file": "a.csv", "row": 3,
    }  # fmt: skip
    assert b"secret" not in report_bytes(document)


def test_what_is_not_finite_is_none() -> None:
    assert [finite(value) for value in (None, nan, inf)] == [None] * 3
    assert isinstance(finite(np.float64(1)), float)


def test_names_are_listed_once_and_counted() -> None:
    assert listed("abcdefgha") == "a, b, c, d, e, f and 2 more"


def test_csv_text_keeps_every_digit() -> None:
    value = 0.1 + 0.2
    text = csv_text(["a", "b,c", "d"], [[np.float64(value), 'say "x"', None], [nan, True, 3]])
    assert text.endswith("\n")
    assert "\r" not in text
    rows = list(csv.reader(io.StringIO(text)))
    assert rows[0] == ["a", "b,c", "d"]
    assert float(rows[1][0]) == value
    assert rows[1][1:] == ['say "x"', ""]
    assert rows[2] == ["", "true", "3"]


@pytest.mark.parametrize("suffix", ["png", ".svg", ".PDF"])
def test_the_same_figure_has_the_same_bytes_and_no_date(suffix: str) -> None:
    def draw() -> bytes:
        @styled
        def inner():  # type: ignore[no-untyped-def]  # a figure, whatever it holds
            page = blank(3.0, 2.0)
            page.subplots().plot([0, 1], [0, 1], "o-", label="a")
            return page

        return figure_bytes(inner(), suffix)

    first = draw()
    assert first == draw()
    assert len(first) > 1000
    assert not re.search(rb"CreationDate|<dc:date>|20\d\d-\d\d-\d\dT", first)


def test_the_users_own_matplotlib_settings_change_nothing() -> None:
    import matplotlib

    def draw() -> bytes:
        @styled
        def inner():  # type: ignore[no-untyped-def]  # a figure, whatever it holds
            page = blank(3.0, 2.0)
            page.subplots().plot([0, 1], [0, 1])
            return page

        return figure_bytes(inner(), "png")

    plain = draw()
    with matplotlib.rc_context({"lines.linewidth": 9.0, "axes.facecolor": "red"}):
        assert draw() == plain
        assert matplotlib.rcParams["lines.linewidth"] == 9.0


def test_tables_fold_long_names_and_stay_within_100_columns() -> None:
    name = "a_feature_with_a_name_that_nobody_would_want_to_type_twice_" * 3
    sheet = Sheet(
        title="title",
        columns=[
            Column(title="name", text=True, folds=True),
            *[Column(title=f"n{i}") for i in range(8)],
        ],
        rows=[[name, *["-123.4 ± 5.6"] * 5, "1", "2", "3*"], ["b", *["1"] * 8]],
        notes=["note " * 40],
    )
    text = plain_text([sheet])
    assert max(map(len, text.splitlines())) <= 100
    assert text.isprintable() or (set(text) - {"\n"} and "\x1b" not in text)
    assert not re.search(r"[─│┌━╭]", text)
    assert "".join(re.findall(r"^[a-z_]+", text, re.M)).count("type_twice") == 3
    assert text.count("-123.4 ± 5.6") == 5


@pytest.mark.parametrize(
    ("name", "width", "lines"),
    [
        ("bore_of_the_flange_04", 12, ["bore_of_the_", "flange_04"]),
        ("bore_01-bore_04", 9, ["bore_01-", "bore_04"]),
        ("left of the rib", 8, ["left of", "the rib"]),
        ("a" * 7, 3, ["aaa", "aaa", "a"]),
        ("x " + "a" * 4, 3, ["x", "aaa", "a"]),
        ("whole", 5, ["whole"]),
        ("", 5, [""]),
    ],
)
def test_names_break_at_their_joints(name: str, width: int, lines: list[str]) -> None:
    assert broken(name, width) == lines


def test_a_long_name_in_a_table_keeps_its_number_together() -> None:
    columns = [Column(title="name", text=True, folds=True), Column(title="number")]
    rows = [["housing_upper_bore_left_0004", "1" * 80]]
    lines = plain_text([Sheet(title="t", columns=columns, rows=rows)]).splitlines()
    assert [line.split()[0] for line in lines[2:]] == ["housing_upper_bore_", "left_0004"]
