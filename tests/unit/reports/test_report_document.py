"""Envelope, CSV text and figure bytes."""

from __future__ import annotations

import csv
import io
import re
from math import nan
from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.source import Source
from mtu_cli.files.write import report_bytes
from mtu_cli.findings import finding, listed
from mtu_cli.model.settings import Settings
from mtu_cli.reports.document import envelope
from mtu_cli.reports.fields import csv_text
from mtu_cli.reports.figures import blank, figure_bytes, styled


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


def draw(suffix: str) -> bytes:
    @styled
    def inner():  # type: ignore[no-untyped-def]  # a figure, whatever it holds
        page = blank(3.0, 2.0)
        page.subplots().plot([0, 1], [0, 1], "o-", label="a")
        return page

    return figure_bytes(inner(), suffix)


@pytest.mark.parametrize("suffix", ["png", ".svg", ".PDF"])
def test_the_same_figure_has_the_same_bytes_and_no_date(suffix: str) -> None:
    first = draw(suffix)
    assert first == draw(suffix)
    assert len(first) > 1000
    assert not re.search(rb"CreationDate|<dc:date>|20\d\d-\d\d-\d\dT", first)


def test_the_users_own_matplotlib_settings_change_nothing() -> None:
    import matplotlib

    plain = draw("png")
    with matplotlib.rc_context({"lines.linewidth": 9.0, "axes.facecolor": "red"}):
        assert draw("png") == plain
        assert matplotlib.rcParams["lines.linewidth"] == 9.0
