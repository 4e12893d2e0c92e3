"""Temperatures in K beside ones in degC."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.budget import LoadedBudget, load_budget


def load(
    tmp_path: Path, equation: str, inputs: dict[str, str], unit: str | None = None
) -> LoadedBudget:
    path = tmp_path / "b.yaml"
    lines = "".join(f"  {name}: {{{text}}}\n" for name, text in inputs.items() if name in equation)
    stated = "" if unit is None else f"quantity: {{name: q, unit: {unit}}}\n"
    head = f"schema: mtu/budget/1\nname: t\n{stated}equation: {equation}\n"
    path.write_text(f"{head}inputs:\n{lines}", encoding="utf-8")
    return load_budget(path)


INPUTS = {
    "L": "value: 500, u: 0.1, unit: mm",
    "a": "value: 11.5e-6, u: 5.0e-7, unit: 1/K",
    "TK": "value: 295.15, u: 0.1, unit: K",
    "RK": "readings: [295.1, 295.2, 295.15], unit: Kelvin",
    "WK": "low: 295, high: 295.5, distribution: rectangular, unit: deg K",
    "TC": "value: 22, u: 0.1, unit: degC",
    "DK": "value: 2.1, u: 0.1, unit: K",
    "HC": "value: 295.15, u: 0.1, unit: degC",
    "c": "value: 0.04, u: 0.1, unit: degC",
    "T0": "value: 20, unit: \u00b0C",
    "Z": "value: 273.15, unit: K",
    "ZC": "value: 273.15, unit: degC",
    "HF": "value: 280, u: 3, unit: degC",
    "F": "value: 650, u: 3, unit: degC",
    "L5": "value: 6.5, u: 0.1, unit: degC",
    "ICE": "value: 273.16, u: 0.01, unit: K",
    "COLD": "value: 273.5, u: 0.1, unit: K",
}


@pytest.mark.parametrize(
    ("equation", "line", "told"),
    [
        ("L*a*(TK - T0)", 7, "inputs.TK.unit: a temperature in K and T0 (20 degC) are in one sum: "
         "'K'; expected one scale: 22 degC for 295.15 K"),
        ("L*a*(T0 - RK)", 7, "inputs.RK.unit: a temperature in K and T0 (20 degC) are in one sum"),
        ("L*a*(TK + c - T0)", 7, "inputs.TK.unit: a temperature in K and T0 (20 degC) are in one"),
        ("L*a*(WK - TC)", 7, "inputs.WK.unit: a temperature in K and TC (22 degC) are in one sum"),
    ],
)  # fmt: skip
def test_kelvin_less_celsius_is_refused(
    tmp_path: Path, equation: str, line: int, told: str
) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, equation, INPUTS)
    (problem,) = [str(own) for own in caught.value.findings]
    assert problem.startswith(f"b.yaml:{line}: ")
    assert told in problem


@pytest.mark.parametrize(
    "equation",
    [
        "L*a*(TC - T0)", "L*a*DK", "L*a*(TC - DK - T0)", "L*a*(TK - 273.15 - T0)",
        "L*a*(TK - 293.15)", "L*a*(TK + c - WK)", "L*a*(F - T0)", "TK*DK", "L*a*(TK - RK)",
        # Tetens and Antoine in K; 0 degC in K; two differences; hot forming; a difference in degC.
        "610.78*exp(17.2694*(TK - 273.16)/(TK - 35.86))", "10**(4.6543 - 1435.264/(TK - 64.848))",
        "Z + TC", "TK - Z - 20", "(TK - RK) - (TC - T0)", "TK - c", "HF - T0", "F - 20",
        "TK - ZC - T0",
    ],
)  # fmt: skip
def test_what_is_right_passes(tmp_path: Path, equation: str) -> None:
    codes = {notice.code for notice in load(tmp_path, equation, INPUTS).warnings}
    assert "like-kelvin" not in codes


@pytest.mark.parametrize(
    ("equation", "more", "taken"),
    [
        ("L*a*(T - 24)", {"T": "value: 295.15, u: 0.1, unit: K"}, "24"),
        ("L*a*(-20 + T)", {"T": "value: 250, u: 0.1, unit: K"}, "20"),
        ("L*a*(T - 20 + c)", {"T": "value: 295.15, u: 0.1, unit: K"}, "20"),
        ("L*a*(T - TC)", {"T": "value: 253.15, u: 0.1, unit: K"}, "TC (22 degC)"),
        ("L*a*(TK - O)", {"O": "value: 35, u: 1, unit: degC"}, "O (35 degC)"),
        ("L*a*(TK - O)", {"O": "value: 12, u: 1, unit: degC"}, "O (12 degC)"),
    ],
)
def test_what_may_be_a_difference_is_asked_for(
    tmp_path: Path, equation: str, more: dict[str, str], taken: str
) -> None:
    found = load(tmp_path, equation, INPUTS | more).warnings
    (notice,) = [own for own in found if own.code == "like-kelvin"]
    assert f"a temperature in K and {taken} are in one sum; expected one scale" in notice.message


def test_a_room_taken_off_kelvin_is_asked_for(tmp_path: Path) -> None:
    """The 20 may be K."""
    found = load(tmp_path, "L*a*(TK - 20)", INPUTS).warnings
    (notice,) = [own for own in found if own.code == "like-kelvin"]
    assert notice.message == (
        "b.yaml:7: inputs.TK: a temperature in K and 20 are in one sum; expected one scale: 22 "
        "degC for 295.15 K"
    )


def test_degrees_that_would_be_a_room_in_kelvin_are_asked_for(tmp_path: Path) -> None:
    found = load(tmp_path, "L*a*(HC - T0)", INPUTS).warnings
    (notice,) = [own for own in found if own.code == "like-kelvin"]
    assert notice.message == (
        "b.yaml:7: inputs.HC: 295.15 degC is in one sum with T0 (20 degC); expected 22 degC, if it "
        "is in K"
    )


@pytest.mark.parametrize(
    ("equation", "unit", "told"),
    [
        ("TC", "K", "inputs.TC: 22 degC make a result in K, and no unit is converted; expected "
         "degC for the result, or TC + 273.15"),
        ("TC + c", "K", "22 degC make a result in K"),
        ("TC - DK", "kelvin", "22 degC make a result in K"),
        ("TK", "degC", "inputs.TK: 295.15 K make a result in degC, and no unit is converted; "
         "expected K for the result, or TK - 273.15"),
        ("TK + DK", "\u00b0C", "295.15 K make a result in degC"),
        # What is taken off is too small for a temperature: it corrects the one that there is.
        ("TC - c", "K", "22 degC make a result in K"),
        ("TK - c", "degC", "295.15 K make a result in degC"),
        ("ICE", "degC", "273.16 K make a result in degC"),
        ("ICE + c", "degC", "273.16 K make a result in degC"),
        ("COLD - DK", "degC", "273.5 K make a result in degC"),
    ],
)  # fmt: skip
def test_a_result_in_another_scale_is_asked_for(
    tmp_path: Path, equation: str, unit: str, told: str
) -> None:
    found = load(tmp_path, equation, INPUTS, unit).warnings
    (notice,) = [own for own in found if own.code == "like-kelvin"]
    assert told in notice.message


@pytest.mark.parametrize(
    ("equation", "unit"),
    [
        ("TC", "degC"), ("TK", "K"), ("TC + 273.15", "K"), ("TK - 273.15", "degC"),
        ("TC - T0", "K"), ("TC - 20", "K"), ("-TC", "K"), ("TK - RK", "degC"), ("c", "K"),
        ("DK", "degC"), ("TC - F", "K"), ("TC - L5", "K"),
        ("ICE - 273.15", "degC"), ("ICE - COLD", "degC"), ("ICE - TK", "degC"),
        ("c + 273.15", "K"), ("c + Z", "K"), ("ZC", "K"), ("ICE", "K"),
        ("TK - ZC", "degC"), ("TC + Z", "K"), ("TK - Z", "degC"), ("L*a*DK", "mm"), ("F", "K"),
    ],
)  # fmt: skip
def test_a_result_in_its_own_scale_passes(tmp_path: Path, equation: str, unit: str) -> None:
    codes = {notice.code for notice in load(tmp_path, equation, INPUTS, unit).warnings}
    assert "like-kelvin" not in codes
