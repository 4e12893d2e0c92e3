"""Calls that are at fault: options, values, gates, reports of another machine."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from cli_runner import SMALL, done, mtu, prepared, refused
from support import (
    CONFIGS,
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
        (["lengths", "--outptu", "a"], "no such option: --outptu (Possible options: --out"),
        (["graph", "draw", "--to"], "option '--to' requires an argument"),
        (
            ["close-loop", "--fail-if", "found,drifts"],
            "unknown gate: 'drifts'; expected suspicious",
        ),
        (["schema", "machin"], "unknown schema: 'machin'; did you mean 'machine'?"),
        (["lengths", "--out", "-q"], "-q: -o does not write a file without an ending; expected"),
        (["lengths", "--fail-if", "nonconforming"], "unknown gate: 'nonconforming'; expected susp"),
        (["graph", "sweep", "g.yaml"], "missing option '--vary'"),
        (["lengths", "a", "b"], "got unexpected extra argument(s) (b)"),
        (["graph", "chek"], "no such command 'chek'. Did you mean 'check' (see mtu graph --help)"),
        (["lengths", "--at", "-o"], "--at: not NAME=VALUE: '-o'"),
        (["lengths", "--at", "a\x07=1"], "--at: not NAME=VALUE: 'a\\x07=1'"),
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


SHARE = "a probability from 0 to below 1, such as 0.01 for 1 %"


@pytest.mark.parametrize("share", ["1", "nan", ""])
def test_a_gate_with_no_share(share: str, work: Path) -> None:
    message = refused(work, "lengths", "--fail-if", f"nonconforming={share}", *OUTPUTS)
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
