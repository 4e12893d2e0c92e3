"""One declaration of a figure gives its JSON, CSV and cell; the envelope and the CSV's text."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass
from math import inf, nan, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from mtu_cli.files.source import Source, report_bytes
from mtu_cli.findings import finding
from mtu_cli.model.settings import Settings
from mtu_cli.reports.document import (
    REPORTS,
    Document,
    Table,
    column_meanings,
    declaration,
    envelope,
    meanings,
)
from mtu_cli.reports.fields import Field, Fields, csv_rows, csv_text, declare, record, rows_of
from mtu_cli.reports.tables import Sheet, plain_text

FIELDS: Fields = declare(
    """
    id | | its name | name, text, mark=star()
    error_um | error | its error | error, u=u
    variance_um2 | squared(u) | u squared
    ends.interval_arcsec | ends | where it lies | 95 %, interval, csv=ends_arcsec, u=u
    part. | | |
        value_um | value | so | inner
        n | | | -, json
    members.{} | | |
        value_um | value | so
    p | | of the test | p, p, detail
    """,
    star=lambda item: "*" if item.flag else "",
    squared=lambda u: u**2,
)


def item(**changed: Any) -> Any:
    given = {
        "id": "a", "flag": True, "error": 0.00123, "u": 0.0005, "ends": (-pi / 648000, pi / 648000),
        "part": SimpleNamespace(value=0.002, n=3), "members": {"m": SimpleNamespace(value=nan)},
        "p": 0.04,
    }  # fmt: skip
    return SimpleNamespace(**(given | changed))


def test_the_name_states_the_unit_and_dots_nest() -> None:
    assert record(FIELDS, item()) == {
        "id": "a",
        "error_um": 0.00123 / 1e-3,
        "variance_um2": pytest.approx(0.25),
        "ends": {"interval_arcsec": [pytest.approx(-1), pytest.approx(1)]},
        "part": {"value_um": pytest.approx(2), "n": 3},
        "members": {"m": {"value_um": None}},
        "p": 0.04,
    }
    nothing = record(FIELDS, item(part=None, error=inf, ends=(0.0, inf), members={}))
    assert (nothing["part"], nothing["error_um"], nothing["members"]) == (None, None, {})
    assert nothing["ends"] == {"interval_arcsec": None}


def test_csv_has_the_same_figures_side_by_side() -> None:
    items = [item(), item(part=None, ends=None, id="b, c")]
    header, rows = csv_rows(FIELDS, items)
    first, second = csv.DictReader(csv_text(header, rows).splitlines())
    assert header == [
        "id", "error_um", "variance_um2", "ends_low_arcsec", "ends_high_arcsec", "part_value_um",
        "p",
    ]  # fmt: skip
    assert float(first["ends_high_arcsec"]) == pytest.approx(1)
    assert (second["id"], second["part_value_um"], second["ends_low_arcsec"]) == ("b, c", "", "")
    named = Field("limits_um", "ends", csv="limit_{}95_um", show="interval")
    assert named.columns == ("limit_low95_um", "limit_high95_um")


def test_csv_text_keeps_every_digit() -> None:
    value = 0.1 + 0.2
    text = csv_text(["a", "b,c", "d"], [[np.float64(value), 'say "x"', None], [nan, True, 3]])
    assert text.endswith("\n")
    assert "\r" not in text
    rows = list(csv.reader(io.StringIO(text)))
    assert rows == [["a", "b,c", "d"], [repr(value), 'say "x"', ""], ["", "true", "3"]]


def test_a_table_rounds_to_u_and_leaves_out_what_is_empty() -> None:
    items = [item(part=None), item(id="b", flag=False, part=None, error=None)]
    table = Table(title="t", fields=FIELDS, items=items, footer="one line", notes=["more"])
    sheet = table.sheet(2, detail=False)
    assert [column.title for column in sheet.columns] == ["name\n", "error\num", "95 %\narcsec"]
    assert [row[:2] for row in sheet.rows] == [("a*", "1.23"), ("b", "-")]
    assert sheet.notes == ["one line"]
    full = table.sheet(2, detail=True)
    assert full.columns[-1].title == "p\n"
    assert full.notes == ["one line", "more"]


def test_millimetres_have_decimals_where_any_has() -> None:
    fields = (Field("x_mm", "", head="x", show="mm"),)
    for items, cells in (([1.0, 20.0], ["1", "20"]), ([1.0, 20.5], ["1.000", "20.500"])):
        sheet = Table(title="t", fields=fields, items=items).sheet(2, detail=False)
        assert [row[0] for row in sheet.rows] == cells


def test_what_needs_detail_is_not_shown_without_it() -> None:
    tables = [Table(title=t, fields=FIELDS, items=[item()], detail=t == "B") for t in "AB"]
    document = Document("t", (FIELDS, item()), tables, None, verdict="It is so.")
    short, long = (plain_text(document.blocks(detail=detail)) for detail in (False, True))
    assert short.startswith("It is so.\nA\n")
    assert ("B\n" in short, "B\n" in long) == (False, True)


@dataclass
class Arrays:
    mean: Any
    inner: Any


def test_rows_of_arrays_are_items() -> None:
    table = Arrays(np.array([1.0, 2.0]), Arrays(np.array([[3.0, 4.0], [5.0, 6.0]]), None))
    fields = (Field("mean_mm", "mean"), Field("last_mm", "inner.mean.1"))
    assert [record(fields, row) for row in rows_of(table, 2)] == [
        {"mean_mm": 1.0, "last_mm": 4.0},
        {"mean_mm": 2.0, "last_mm": 6.0},
    ]


@pytest.mark.parametrize("name", REPORTS)
def test_every_figure_is_declared_once_and_explained(name: str) -> None:
    results, row = declaration(name)
    for known in (list(meanings(results)), list(column_meanings(row))):
        assert [path for path, meaning in known if not meaning] == []
        assert [path for path, n in Counter(path for path, _ in known).items() if n > 1] == []


def test_envelope_has_the_contract_fields_and_each_warning_once() -> None:
    path = Path("/secret/machine.yaml")
    source = Source(role="machine", path=path, shown="machine.yaml", sha256="ab")
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
    (given,), (listed,) = document["inputs"], document["warnings"]
    assert given == {"role": "machine", "path": "machine.yaml", "sha256": "ab", "rows": None}
    assert document["settings"] == {
        "coverage_factor": 2.0, "seed": 3, "correlation": "shared", "digits": 2, "trials": None,
        "at": {"dir_x": 1.0},
    }  # fmt: skip
    assert listed == {
        "code": "unrelated", "severity": "warning", "file": "a.csv", "row": 3,
        "message": "a.csv, row 3: C.x does not depend on a",
        "facts": {"output": "C.x", "names": ["a"]},
    }  # fmt: skip
    assert b"secret" not in report_bytes(document)


def shown_at(sheet: Sheet, width: int) -> str:
    """What a terminal of this width receives, without its colours."""
    out = io.StringIO()
    Console(file=out, force_terminal=True, width=width).print(sheet, crop=False)
    return re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())


SHEET = Sheet(
    title="Errors",
    columns=[
        Field("", "", head="feature\n", show="text"),
        Field("", "", head="of\n", show="text"),
        *(Field("", "", head=f"value {i}\num") for i in range(9)),
    ],
    rows=[
        ["bore_of_the_flange_04", "x", *(f"-12{i}.4 ± 5.6" for i in range(9))],
        ["b", "y", *["1"] * 9],
    ],
    notes=["a note"],
)


@pytest.mark.parametrize("width", [10, 20, 34, 60, 80, 90, 100, 200])
def test_no_digit_and_no_name_is_lost_on_any_terminal(width: int) -> None:
    shown = shown_at(SHEET, width)
    for i in range(9):
        assert f"-12{i}.4 ± 5.6" in shown
        assert f"value {i}" in shown
    heads = [line for line in shown.splitlines() if line.startswith("feature")]
    assert len(heads) == shown.count("bore_of_the_") >= 1
    if width >= 34:
        assert max(map(len, shown.splitlines())) <= min(width, 100)
