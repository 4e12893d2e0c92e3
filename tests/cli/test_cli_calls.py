"""Calls that are at fault: options, values, gates, reports of another machine."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import prepared, refused

OUTPUTS = ["-o", "out.json", "--csv", "out.csv", "--plot", "out.png"]


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A copy of the small study."""
    return prepared(tmp_path / "work")


def test_all_settings_out_of_range_are_told_at_once(work: Path) -> None:
    values = {"--k": "nan", "--digits": "5", "--seed": "-1", "--correlation": "some"}
    values |= {"--trials": "999", "--threads": "0"}
    call = [word for pair in values.items() for word in pair]
    found = refused(work, "lengths", *call, *OUTPUTS).removeprefix("mtu: ").splitlines()
    assert len(found) == len(values)
    begun = {line.partition("; expected ")[0] for line in found}
    assert begun == {f"{option}: out of range: '{value}'" for option, value in values.items()}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["lengths", "--outptu", "a"], "no such option: --outptu (Possible options: --out"),
        (["graph", "draw", "--to"], "option '--to' requires an argument"),
        (
            ["close-loop", "--fail-if", "found,drifts"],
            "unknown gate: 'drifts'; expected suspicious",
        ),
        (["lengths", "--out", "-q"], "-q: -o does not write a file without an ending; expected"),
        (
            ["lengths", "--fail-if", "nonconforming=1"],
            "--fail-if nonconforming: out of range: 'nonconforming=1'; expected a probability",
        ),
        (
            ["lengths", "--fail-if", "nonconforming=0.5,nonconforming=0.1"],
            "--fail-if nonconforming appears twice: 'nonconforming=0.1'",
        ),
        (["lengths", "--fail-if", "nonconforming"], "unknown gate: 'nonconforming'; expected susp"),
        (["graph", "sweep", "g.yaml"], "missing option '--vary'"),
        (["graph", "chek"], "no such command 'chek'. Did you mean 'check' (see mtu graph --help)"),
        (["lengths", "--at", "-o"], "--at: not NAME=VALUE: '-o'"),
        (
            ["simulate", "--cmm-room", "22:25"],
            "invalid value for '--cmm-room': not a number: '22:25'",
        ),
        (["simulate", "--passes", "0"], "invalid value for '--passes': '0' is not a whole number"),
        (["lengths", "-p", ""], "invalid value for '-p' / '--part': it names no file"),
        (["\u65e5\u672c" * 40], "no such command '\u65e5\u672c"),
        (["lengths", "--a\x1b[31m\n"], "no such option: --a\\x1b[31m"),
    ],
    ids=lambda value: ascii(" ".join(value)[:20]) if isinstance(value, list) else "",
)
def test_calls_that_are_none_are_told_in_one_line(call: list[str], words: str, work: Path) -> None:
    message = refused(work, *call, env={"COLUMNS": "30"})
    assert message.startswith(f"mtu: {words}")
    assert len(message.splitlines()) == 1
