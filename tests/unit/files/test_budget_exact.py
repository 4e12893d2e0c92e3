"""Inputs of a budget that are exact, as a constant or because their uncertainty was forgotten."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files.budget import load_budget

CODE = "taken-as-exact"


def told(folder: Path, *inputs: str) -> list[str]:
    names = [line.partition(":")[0] for line in inputs]
    path = folder / "b.yaml"
    lines = "".join(
        f"  {line}\n" for line in ("L: {value: 50, u: 0.001}", *inputs, "unused: {value: 1}")
    )
    head = f"schema: mtu/budget/1\nname: t\nequation: {' + '.join(['L', *names])}\ninputs:\n"
    path.write_text(head + lines, "utf-8")
    return [own.message for own in load_budget(path).warnings if own.code == CODE]


@pytest.mark.parametrize(
    "given",
    [
        "-0.1", "{value: -0.1, u: 0}", "{value: -0.1, half_width: 0.2, distribution: rectangular}",
        "{low: -0.2, high: 0.2, distribution: rectangular}", "{value: 1, U: 0.2, k: 2}",
        "{readings: [1.1, 1.2, 1.3]}", "{value: 1, contributions: [{u: 0.1}]}",
    ],
)  # fmt: skip
def test_a_constant_or_what_has_an_uncertainty_passes(tmp_path: Path, given: str) -> None:
    assert told(tmp_path, f"theta: {given}") == []


@pytest.mark.parametrize("given", ["{value: -0.1}", "{value: -0.1, u: ~}"])
def test_a_value_alone_may_lack_its_uncertainty(tmp_path: Path, given: str) -> None:
    (message,) = told(tmp_path, f"theta: {given}")
    constant = "`theta: -0.1`" if given.count(":") == 1 else "with `u: 0`"
    assert message == (
        "b.yaml:6: input theta: no uncertainty is given, so that it is taken as exact; a constant "
        f"is written {constant}"
    )


def test_all_such_inputs_are_told_once(tmp_path: Path) -> None:
    several = [f"a{i}: {{value: {i}}}" for i in range(8)]
    (message,) = told(tmp_path, "k: 3", *several)
    assert "inputs a0, a1, a2, a3, a4, a5 and 2 more: no uncertainty is given" in message
    assert message.endswith("so that they are taken as exact; a constant is written `a0: 0`")


def test_beside_words_a_constant_has_a_u_of_0(tmp_path: Path) -> None:
    (message,) = told(tmp_path, "T: {value: 20, says: where lengths hold}", "a: {value: 1}")
    assert "inputs T, a: no uncertainty is given" in message
    assert message.endswith("a constant is written with `u: 0`")


def test_beside_units_a_constant_has_one_and_a_u_of_0(tmp_path: Path) -> None:
    """What one notice advises is no reason for another."""
    path = tmp_path / "b.yaml"
    head = (
        "schema: mtu/budget/1\nname: t\nequation: L/n\ninputs:\n  L: {value: 5, u: 1, unit: mm}\n"
    )

    def notices(n: str) -> list[str]:
        path.write_text(f"{head}  n: {n}\n", "utf-8")
        return [own.message for own in load_budget(path).warnings]

    (unit,) = notices("2")
    assert unit.endswith(
        "`unit: '1'` is that of a plain number, with `u: 0` where it is a constant"
    )
    assert any(own.endswith("a constant is written with `u: 0`") for own in notices("{value: 2}"))
    assert notices("{value: 2, unit: '1', u: 0}") == []
