"""Calls that are at fault: options, values, gates, reports of another machine."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import done, mtu, prepared, refused

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
        (["simulate", "--passes", "0"], "--passes: out of range: '0'; expected from 1 to 10000"),
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


def test_sizes_of_a_machine_in_another_unit_are_asked_about(work: Path) -> None:
    text = (work / "machine.yaml").read_text().replace("travel_mm: [0, 300]", "travel_mm: [0, 3]")
    text = text.replace("components:", "constants: {z0: 127000}\ncomponents:")
    (work / "machine.yaml").write_text(text.replace("of: y", "of: x"))
    told = done(mtu("fit-components", ".", "-q", cwd=work)).stderr
    for words in ("axes.y.travel_mm: a travel of 3 mm", "constants.z0: a constant of 127000 mm"):
        assert f"{words} is hardly meant; probably " in told
