"""A call within the process of the tests does what a started process does."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import done, listing, mtu, prepared, started
from support import CONFIGS

BUDGET = CONFIGS / "budgets" / "gum-h2-impedance.yaml"
CALLS = {
    "lengths --plot out.svg -o out.json --csv out.csv": 0,
    f"budget {BUDGET} --trials 20000 --plot out.pdf": 0,
    "anova --cmm lbb.csv": 2,
    "lenghts": 2,
}
"""With how each ends, in a folder of its own; a picture of every kind of file."""


@pytest.mark.parametrize("call", CALLS)
def test_the_same_bytes_and_files(call: str, tmp_path: Path) -> None:
    found = []
    for name, way in (("within", mtu), ("process", started)):
        work = prepared(tmp_path / name / "work")
        result = done(way(*call.split(), cwd=work), CALLS[call])
        found.append((result.stdout, result.stderr, listing(work)))
    assert found[0] == found[1]
