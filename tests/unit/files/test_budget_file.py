"""Budget files: what they accept, and every fault with its line, all at once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from budget_examples import loaded
from support import CONFIGS

from mtu_cli.analyses.budget.inputs import InputQuantity, inputs_of
from mtu_cli.files.budget import load_budget
from mtu_cli.findings import Finding, InputError
from mtu_cli.stats.distributions import Distribution

SHIPPED = sorted((CONFIGS / "budgets").glob("*.yaml"))
SUM = "equation: a + b\ninputs:\n  b: {value: 1, u: 0.1}\n"


def findings(text: str) -> list[Finding]:
    with pytest.raises(InputError) as raised:
        loaded(text)
    return list(raised.value.findings)


def quantity(entry: str) -> InputQuantity:
    """The input `a` of a sum."""
    found = inputs_of(loaded(SUM + f"  a: {entry}\n")).quantities
    return next(item for item in found if item.name == "a")


def contribution(entry: str) -> Distribution:
    (part,) = quantity(entry).parts
    return part.distribution


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_budgets(path: Path) -> None:
    read = load_budget(path)
    assert read.budget.says
    assert not read.warnings
    assert all(item.unit for item in read.budget.inputs.values())


@pytest.mark.parametrize(
    ("entry", "u", "dof"),
    [
        ("{value: 0, u: 0.3}", 0.3, math.inf),
        ("{value: 0, u: 0.3, dof: 7, distribution: t}", 0.3, 7.0),
        ("{value: 0, U: 0.6, k: 2}", 0.3, math.inf),
        ("{low: -1, high: 1, distribution: triangular}", 1 / math.sqrt(6), math.inf),
        (
            "{value: 0, half_width: 2, top: 1, distribution: trapezoidal}",
            math.sqrt(5 / 6),
            math.inf,
        ),
        # JCGM 101, 6.4.3: u^2 = a^2/3 + d^2/9, and nu = (a/d)^2 / 2.
        (
            "{value: 0, half_width: 1, inexact: 0.5, distribution: curvilinear-trapezoidal}",
            math.sqrt(1 / 3 + 0.25 / 9),
            2.0,
        ),
        (
            "{value: 0, half_width: 1, dof: 2, distribution: curvilinear-trapezoidal}",
            math.sqrt(1 / 3 + 0.25 / 9),
            2.0,
        ),
    ],
)
def test_standard_uncertainties(entry: str, u: float, dof: float) -> None:
    found = contribution(entry)
    assert found.u == pytest.approx(u)
    assert found.dof == pytest.approx(dof)


# An entry, and code and place of each of its faults.
FAULTY = [
    ("{low: 2, high: 1, distribution: rectangular}", "wrong-value", ".low"),
    ("{value: 1, low: 2, distribution: rectangular}", "incomplete", ".low"),
    ("{value: 1, readings: [1, 2]}", "exclusive", ".value"),
    ("{value: 1.2, low: 0, high: 2, distribution: rectangular}", "wrong-value", ".value"),
    ("{value: 1, half_width: 1}", "no-limits", ""),
    ("{readings: [1, 2], dof: 9}", "incomplete", ".dof"),
    ("{value: 1, half_width: 1, distribution: arcsine, dof: 0.2}", "wrong-value", ".dof"),
    ("{value: 1, half_width: 1, distribution: trapezoidal, top: 2}", "wrong-value", ".top"),
    ("{value: 1, u: 1, dof: 5, distribution: curvilinear-trapezoidal, inexact: 0.1}",
     "exclusive", ".dof"),
    ("{value: 1, contributions: [{says: x}]}", "missing-key", ".contributions[0]"),
    ("{value: 1, distribution: arcsine}", "incomplete", ".distribution"),
    ("{value: 1.0e308, u: 1}", "wrong-value", ".value"),

]  # fmt: skip


@pytest.mark.parametrize(("entry", "code", "place"), FAULTY)
def test_faults_of_an_input(entry: str, code: str, place: str) -> None:
    found = findings(SUM + f"  a: {entry}\n")
    assert found[0].code == code
    assert (found[0].line, found[0].path) == (6, f"inputs.a{place}")
    assert {each.path for each in found} <= {f"inputs.a{place}", "inputs.a.readings"}


def test_all_faults_at_once() -> None:
    found = findings(
        """\
        equation: a + lenght*c
        inputs:
          a: {value: 1, u: -1}
          length: {value: 2, u: 1, half_width: 3}
          c: {value: 1, u: 1, distribution: normall}
          sin: 3
          2x: 4
        correlations: [[a, d, .5], [a, a, .1], [a, c, 1.5], [c, a, .2], [c, length], [sin, a, .2]]
        coverage: {probability: 0.95, k: 2}
        """
    )
    assert [each.line for each in found] == [3, 5, 6, 7, 8, 9, *[10] * 6, 11]
    codes = [each.code for each in found]
    for code in (
        "unknown-name", "exclusive", "name-taken", "wrong-correlation",
        "appears-twice", "wrong-value",
    ):  # fmt: skip
        assert code in codes


@pytest.mark.parametrize(
    ("more", "codes"),
    [
        ("simultaneous: [[V, I]]", ["wrong-count"]),
        ("simultaneous: [[V, T]]", ["incomplete"]),
        ("simultaneous: [[V, W], [W, V]]", ["appears-twice", "appears-twice"]),
        ("simultaneous: [[V, W]]\ncorrelations: [[V, W, 0.2]]", ["exclusive"]),
        ("simultaneous: [[V, X]]", ["unknown-name"]),
    ],
)
def test_faults_of_simultaneous_readings(more: str, codes: list[str]) -> None:
    readings = "V: {readings: [1, 2, 3]}, W: {readings: [2, 1, 3]}, I: {readings: [1, 2]}"
    text = f"equation: V/I + T + W\ninputs: {{{readings}, T: {{value: 1, u: 1}}}}\n{more}\n"
    assert [each.code for each in findings(text)] == codes


def warnings(entry: str) -> list[tuple[str, int | None]]:
    return [(each.code, each.line) for each in loaded(SUM + f"  a: {entry}\n").warnings]


def test_warnings() -> None:
    assert not warnings("{value: 1, u: 1}")
    assert not warnings("9.81")
    assert not warnings("{value: 1, u: 0}")
    assert warnings("{value: 1}") == [("no-uncertainty", 6)]
    assert warnings("{readings: [1, 1, 1]}") == [("equal-readings", 6)]
    assert not warnings("{readings: [1, 1, 1], half_width: 0.5, distribution: rectangular}")
    unused = loaded("equation: a\ninputs:\n  a: {value: 1, u: 1}\n  b: {value: 1, u: 1}\n")
    assert [each.message for each in unused.warnings] == [
        "b.yaml:6: inputs.b: the input 'b' is in no equation"
    ]
