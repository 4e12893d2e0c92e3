"""Degrees Fahrenheit beside degC: refused unless an equation converts them, whichever way."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.budget import load_budget

GOOD = [
    ("L*(1 + a*((T - 32)/1.8 - R))", "1/degC", "degF"),
    ("L*(1 + a*(5*(T - 32)/9 - R))", "1/degC", "degF"),
    ("L*(1 + a*((T + 459.67)/1.8 - 273.15 - R))", "1/degC", "degF"),
    ("L*(1 + 1.8*a*(T - R))", "1/degF", "degC"),
    ("L*(1 + a*9/5*(T - R))", "um/m/°F", "degC"),
    ("L*(1 + a/0.5556*(T - R))", "degF^-1", "degC"),
    ("L*(1 + a*(T - (R*1.8 + 32)))", "1/degF", "degF"),
    ("L*(1 + a*(T - R*9/5 - 32))", "1/degF", "degF"),
    ("R + L/a/1.8 + 0*T", "mV/degF", "degC"),
    ("R + L*5/(9*a) + 0*T", "mV/degF", "degC"),
    ("R + 5*L/9/a + 0*T", "W/(m*degF)", "degC"),
]
BAD = [
    ("R + L/a*1.8 + 0*T", "mV/degF", "degC", "inputs.a.unit", "times 1.8"),
    ("L*(1 + a*(T - R))", "1/degF", "degC", "inputs.a.unit", "times 1.8"),
    ("L*(1 + a/1.8*(T - R))", "1/degF", "degC", "inputs.a.unit", "times 1.8"),
    ("L*(1 + a*(T - R))/1.8", "1/degF", "degF", "inputs.a.unit", "times 1.8"),
    ("L*(1 + 1.8*a*(T - R))", "1/degC", "degF", "inputs.T.unit", "divided by 1.8"),
    ("L*(1 + a*(1.8*T - R))", "1/degC", "degF", "inputs.T.unit", "divided by 1.8"),
    ("L*(1 + a*(T - R/1.8))", "1/degC", "degF", "inputs.T.unit", "divided by 1.8"),
]


def written(path: Path, equation: str, a: str, T: str) -> Path:
    path.write_text(
        f"schema: mtu/budget/1\nname: bar\nequation: {equation}\ninputs:\n"
        "  L: {value: 100, u: 0.001, unit: mm}\n"
        f"  a: {{value: 1.15e-5, u: 1e-6, unit: {a}}}\n"
        f"  T: {{value: 72, u: 0.5, unit: {T}}}\n"
        "  R: {value: 20, u: 0.5, unit: degC}\n",
        "utf-8",
    )
    return path


@pytest.mark.parametrize(("equation", "a", "T"), GOOD)
def test_what_is_converted_is_taken(equation: str, a: str, T: str, tmp_path: Path) -> None:
    assert load_budget(written(tmp_path / "b.yaml", equation, a, T)).trees


@pytest.mark.parametrize(("equation", "a", "T", "place", "advice"), BAD)
def test_what_is_not_is_told_with_its_own_factor(
    equation: str, a: str, T: str, place: str, advice: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        load_budget(written(tmp_path / "b.yaml", equation, a, T))
    (first, *_) = str(caught.value).splitlines()
    assert f"{place}: degF beside degC or K" in first
    assert advice in first
