"""One declaration of a figure gives its JSON, CSV and cell."""

from __future__ import annotations

import csv
from collections import Counter
from dataclasses import dataclass
from math import inf, nan, pi
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mtu_cli.reports.document import (
    REPORTS,
    Document,
    Table,
    declared,
    described,
    described_columns,
)
from mtu_cli.reports.fields import (
    Field,
    Fields,
    Group,
    csv_rows,
    csv_text,
    record,
    rows_of,
)
from mtu_cli.reports.tables import plain_text

INNER: Fields = (Field("value_um", "value", "so", head="inner"), Field("n", "n", csv=""))
FIELDS: Fields = (
    Field("id", "id", head="name", show="text", mark=lambda item: "*" if item.flag else ""),
    Field("error_um", "error", head="error", u="u"),
    Field("variance_um2", lambda item: item.u**2),
    Field("ends.interval_arcsec", "ends", csv="ends_arcsec", show="interval", head="95 %", u="u"),
    Group("part", INNER),
    Group("members", INNER, many=True),
    Field("p", "p", show="p", head="p", detail=True),
)


def item(**changed: Any) -> Any:
    given = {
        "id": "a", "flag": True, "error": 0.00123, "u": 0.0005, "ends": (-pi / 648000, pi / 648000),
        "part": SimpleNamespace(value=0.002, n=3),
        "members": {"m": SimpleNamespace(value=nan, n=1)},
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
        "members": {"m": {"value_um": None, "n": 1}},
        "p": 0.04,
    }
    nothing = record(FIELDS, item(part=None, error=inf, ends=None, members=[]))
    assert (nothing["part"], nothing["error_um"], nothing["members"]) == (None, None, [])
    assert nothing["ends"] == {"interval_arcsec": None}


def test_an_open_interval_is_null_and_its_columns_may_be_named() -> None:
    field = Field("limits_um", "ends", csv="limit_{}95_um", show="interval")
    header, rows = csv_rows([field], [item(ends=(0.0, inf)), item(ends=(0.0, 0.001))])
    assert header == ["limit_low95_um", "limit_high95_um"]
    assert list(rows) == [[None, None], [0.0, 1.0]]
    assert field.json(item(ends=(0.0, inf))) is None


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


def test_a_table_rounds_to_u_and_leaves_out_what_is_empty() -> None:
    items = [item(part=None), item(id="b", flag=False, part=None, error=None)]
    table = Table(title="t", fields=FIELDS, items=items, footer="one line", notes=["more"])
    sheet = table.sheet(2, detail=False)
    assert [column.title for column in sheet.columns] == ["name\n", "error\num", "95 %\narcsec"]
    assert sheet.rows[0][:2] == ("a*", "1.23")
    assert sheet.rows[1][:2] == ("b", "-")
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
    given: dict[str, Any] = {
        "title": "t", "results": (FIELDS, item()), "tables": tables, "verdict": "It is so.",
        "figure": lambda: None,
    }  # fmt: skip
    short, long = (plain_text(Document(**given).shown(detail=detail)) for detail in (False, True))
    assert short.startswith("It is so.\nA\n")
    assert "B\n" not in short
    assert "B\n" in long


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
    results, row = declared(name)
    for known in (list(described(results)), list(described_columns(row))):
        assert [path for path, meaning in known if not meaning] == []
        assert [path for path, n in Counter(path for path, _ in known).items() if n > 1] == []
