"""Calls that are at fault: options, values, gates, reports of another machine."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from cli_runner import SMALL, done, mtu, prepared, refused
from support import (
    CONFIGS,
    PAPER,
)

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
    ("call", "shown"),
    [
        (["fit-components", SMALL], r"(?m)^\S+ .*?± (\S+)"),
        (["compare", CONFIGS / "undeclared"], r"± (\d\S*)"),
        (["anova", CONFIGS / "undeclared"], r"(?m)^\d+-\d+ +\d+ +\S+ +\S+ +\S+ +(\S+)"),
        (["predict-points", PAPER], r"(?m)^\d+ .*?(\S+) +\S+ +\["),
        (["budget", CONFIGS / "budgets" / "gum-h1-end-gauge.yaml", "--trials", 4000],
         r"order +\S+ +(\S+) +nm"),
        (["graph", "simulate", CONFIGS / "graphs" / "bore-to-bore.yaml", "--trials", 4000],
         r"(\S+) +\["),
    ],
    ids=lambda item: item[0] if isinstance(item, list) else "",
)  # fmt: skip
def test_tables_show_the_digits_of_u_that_are_asked_for(call: list[Any], shown: str) -> None:
    found = re.findall(shown, done(mtu(*call, "--digits", 3)).stdout)
    assert found
    for u in found:
        figures = u.partition("e")[0].replace(".", "").lstrip("0")
        # An integer may end in zeros, as in 1250 for 1.25e3.
        assert len(figures) == 3 or ("." not in u and len(figures) > 3), u


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["--k", "2,5"], "invalid value for '--k': Input should be a valid number"),
        (["--trials", "1e4"], "invalid value for '--trials': Input should be a valid integer"),
        (["-p", ""], "invalid value for '-p' / '--part': it names no file"),
        (["-o", "new/"], "invalid value for '-o' / '--out': it names no file"),
    ],
)
def test_numbers_and_names_that_are_none(call: list[str], words: str, work: Path) -> None:
    assert words in refused(work, "lengths", *call)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["lengths", "--outptu", "a"], "no such option: --outptu (Possible options: --out"),
        (["--at", "T=1"], "no such option: --at"),
        (["graph", "draw", "--to"], "option '--to' requires an argument"),
        (
            ["close-loop", "--fail-if", "found,drifts"],
            "unknown gate: 'drifts'; expected suspicious",
        ),
        (["schema", "machin"], "unknown schema: 'machin'; did you mean 'machine'?"),
        (["lengths", "--threads"], "option '--threads' requires an argument"),
        (["lengths", "--out", "-q"], "-q: -o does not write a file without an ending; expected"),
        (["graph", "sweep", "g.yaml"], "missing option '--vary'"),
        (["schema"], "missing argument 'KIND'"),
        (["lengths", "a", "b"], "got unexpected extra argument(s) (b)"),
        (["graph", "chek"], "no such command 'chek'. Did you mean 'check' (see mtu graph --help)"),
        (["predict"], "no such command 'predict'. Did you mean 'predict-points'"),
        (["lengths", "--at", "-o"], "--at: not NAME=VALUE: '-o'"),
        (["\u65e5\u672c" * 40], "no such command '\u65e5\u672c"),
        (["lengths", "--a\x1b[31m\n"], "no such option: --a\\x1b[31m"),
    ],
    ids=lambda value: ascii(" ".join(value)[:20]) if isinstance(value, list) else "",
)
def test_calls_that_are_none_are_told_in_one_line(call: list[str], words: str, work: Path) -> None:
    message = refused(work, *call, env={"COLUMNS": "30"})
    assert message.startswith(f"mtu: {words}")
    assert len(message.splitlines()) == 1


def test_all_bad_covariates_are_told_at_once(work: Path) -> None:
    bad = ["T", "=1", "T_a_degC=", "a\x07=1"]
    words = ["warm", "1_0", "\uff12", "23,5", "23.5 degC"]
    vast = ["nan", "-inf", "1e400"]
    values = [*words, *vast]
    given = [*bad, *(f"T_a_degC={value}" for value in values), "dir_x=1", "dir_x=-1"]
    call = [word for text in given for word in ("--at", text)]
    found = refused(work, "lengths", *call, *OUTPUTS).removeprefix("mtu: ").splitlines()
    assert len(found) == len(given) - 1
    for line, text in zip(found, bad, strict=False):
        assert line.startswith(f"--at: not NAME=VALUE: {text!r}; expected --at T_02_degC=23.5, say")
    assert found[len(bad) : -1] == [
        *(f"--at T_a_degC: not a number: {text!r}" for text in words),
        *(f"--at T_a_degC: not a finite number: {value!r}" for value in vast),
    ]
    assert found[-1] == "--at dir_x appears twice: 'dir_x=-1'"


SHARE = "a probability from 0 to below 1, such as 0.01 for 1 %"


@pytest.mark.parametrize(
    ("command", "gate", "expected"),
    [
        ("lengths", "nonconforming", "suspicious or nonconforming=0.01"),
        ("lengths", "drift", "suspicious or nonconforming=0.01"),
        ("anova", "nonconforming=0.1", "suspicious or unusual"),
        ("fit-components", "drifts", "suspicious or drift"),
        ("compare", "", "suspicious or biased or under-predicted"),
    ],
)
def test_unknown_gates(command: str, gate: str, expected: str, work: Path) -> None:
    message = refused(work, command, "--fail-if", gate, *OUTPUTS)
    assert message == f"mtu: unknown gate: '{gate}'; expected {expected}\n"


@pytest.mark.parametrize("share", ["1", "nan", "0,01", ""])
def test_a_gate_with_no_share(share: str, work: Path) -> None:
    message = refused(work, "lengths", "--fail-if", f"nonconforming={share}", *OUTPUTS)
    if share == "0,01":
        # Commas stand between gates.
        assert message.startswith("mtu: unknown gate: '01'; expected suspicious or noncon")
        return
    told = f"--fail-if nonconforming: out of range: 'nonconforming={share}'"
    assert message == f"mtu: {told}; expected {SHARE}\n"


def test_names_with_dollars_are_drawn_as_they_are(work: Path) -> None:
    part = work / "part.yaml"
    text = part.read_text("utf-8")
    renamed = re.sub(r"\bA\b", "'$A_{$'", text)
    assert renamed != text
    part.write_text(renamed, "utf-8")
    done(mtu("lengths", work, "--plot", work / "a.png"))


def test_two_features_at_one_place_are_asked_about(tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(
        "schema: mtu/part/1\nname: plate\nfeatures:\n"
        "  A: {x_mm: 10, y_mm: 20}\n  B: {x_mm: 50, y_mm: 20}\n  C: {x_mm: 10, y_mm: 20}\n"
    )
    machine = CONFIGS / "gilsinn-ling" / "machine.yaml"
    told = done(mtu("predict-points", "-m", machine, "-p", "part.yaml", "-q", cwd=tmp_path)).stderr
    assert "part.yaml:6: features.C: features at the same nominal place: A, C" in told
