"""Tables wider than what there is: columns below each other, and nothing cut off."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from mtu_cli.reports.fields import Field
from mtu_cli.reports.tables import Sheet


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
