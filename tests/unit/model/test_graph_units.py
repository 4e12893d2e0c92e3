"""Units of places, and lengths where lengths are meant."""

from __future__ import annotations

from pathlib import Path

import pytest
from graph_examples import graph_of

from mtu_cli.findings import InputError
from mtu_cli.language import parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.model.graph.units import formula_unit

UNITS = {"x": "mm", "y": "mm", "a": "rad", "q": "mm^4", "k": "1", "c": None}


@pytest.mark.parametrize(
    ("formula", "unit"),
    [
        ("x + y", "mm"),
        ("x*y**3/12", "mm^4"),
        ("1/x**4", "mm^-4"),
        ("x**6/y", "mm^5"),
        ("q/x", "mm^3"),
        ("x/y", "1"),
        ("2*a", "1"),
        ("atan2(x, y)", "rad"),
        ("x + c", "mm"),
        ("c", None),
        ("x*c", None),
        ("sqrt(x*y)", "mm"),
    ],
)
def test_unit_of_a_formula(formula: str, unit: str | None) -> None:
    assert formula_unit(parse(formula, BUDGET_FUNCTIONS), UNITS) == unit


def test_unit_of_angles_alone() -> None:
    assert formula_unit(parse("2*a", BUDGET_FUNCTIONS), {"a": "rad"}) == "rad"


@pytest.mark.parametrize("formula", ["x + a", "x + y**2", "q + x", "x*(y + a)"])
def test_terms_of_different_dimensions(formula: str) -> None:
    with pytest.raises(InputError, match="what is added"):
        formula_unit(parse(formula, BUDGET_FUNCTIONS), UNITS)


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        ("exp(x)", r"argument of exp is a length \(mm\)"),
        ("2*asin(x)", r"argument of asin is a length \(mm\)"),
        ("y*log(x + y)", r"argument of log is a length \(mm\)"),
        ("atan2(x, a)", r"what is compared is an angle or ratio \(rad\), not a length \(mm\)"),
        ("2**x", r"an exponent is a length \(mm\)"),
    ],
)
def test_functions_of_plain_numbers(formula: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        formula_unit(parse(formula, BUDGET_FUNCTIONS), UNITS)


@pytest.mark.parametrize("formula", ["exp(x/100)", "sin(a)", "cos(2*pi*x/25)", "log(c)"])
def test_arguments_that_may_be_plain_numbers(formula: str) -> None:
    assert formula_unit(parse(formula, BUDGET_FUNCTIONS), UNITS) == "1"


HEAD = """
uncertainty: {axis_um: 1}
places:
  xa: {kind: coordinate, axis: x, nominal_mm: 1}
  xb: {kind: coordinate, axis: x, nominal_mm: 5}
  ya: {kind: coordinate, axis: y, nominal_mm: 2}
  yb: {kind: coordinate, axis: y, nominal_mm: 4}
  za: {kind: coordinate, axis: z, nominal_mm: 10}
  O: {kind: point, nominal_mm: [0, 0, 0]}
  A: {kind: point, nominal_mm: [6, 0, 0]}
  B: {kind: point, nominal_mm: [0, 6, 0]}
  C: {kind: point, nominal_mm: [0, 0, 6]}
  OA: {kind: vector}
  e: {kind: vector}
  r: {kind: constant, value: 5, unit: UNIT}
  out: {kind: KIND}
transitions:
  - {do: meas, out: xa}
  - {do: meas, out: xb}
  - {do: meas, out: ya}
  - {do: meas, out: yb}
  - {do: meas, out: za}
  - {do: meas, out: O, along: x}
  - {do: meas, out: A, along: x}
  - {do: meas, out: B, along: x}
  - {do: meas, out: C, along: x}
  - {do: vector, in: [O, A], out: OA}
  - {do: unit_v, in: [OA], out: e}
  - {STEP, out: out}
report: [xa, xb, ya, yb, za, O, A, B, C, e, r, out]
"""
STEPS = [
    ("do: displace, in: [xa, r]", "coordinate, axis: x", 1, "r"),
    ("do: displace, in: [A, e]", "point", 1, "e"),
    ("do: ball, in: [xa, xb, ya, yb, za, r]", "point", 5, "r"),
    ("do: hole, in: [xa, xb, ya, yb, r]", "point", 4, "r"),
    ("do: sphere, in: [O, A, B, C, r]", "point", 4, "r"),
]


@pytest.mark.parametrize(("step", "kind", "at", "name"), STEPS, ids=lambda item: str(item)[:20])
@pytest.mark.parametrize("unit", ["rad", "1"])
def test_a_length_is_a_length(
    step: str, kind: str, at: int, name: str, unit: str, tmp_path: Path
) -> None:
    text = HEAD.replace("STEP", step).replace("KIND", kind)
    found = r"1" if name == "e" else unit
    with pytest.raises(InputError, match=rf"in\[{at}\]: not a length.*'{name}'.*not in {found}$"):
        graph_of(tmp_path, text.replace("UNIT", f"'{unit}'"))


@pytest.mark.parametrize("step", [item for item in STEPS if item[3] == "r"], ids=str)
@pytest.mark.parametrize("unit", ["unit: mm", "says: nothing of its unit"])
def test_lengths_pass(step: tuple[str, str, int, str], unit: str, tmp_path: Path) -> None:
    text = HEAD.replace("STEP", step[0]).replace("KIND", step[1]).replace("unit: UNIT", unit)
    assert graph_of(tmp_path, text).units["out"] == "mm"


def test_a_multiple_of_a_direction_is_what_its_factor_is(tmp_path: Path) -> None:
    """A unit vector times 5 mm displaces a point; times 5 rad it does not."""
    step = "do: displace, in: [A, f]"
    text = HEAD.replace("STEP", step).replace("KIND", "point")
    text = text.replace("  out:", "  f: {kind: vector}\n  out:")
    text = text.replace(f"  - {{{step}", f"  - {{do: ratio, in: [e, r], out: f}}\n  - {{{step}")
    assert graph_of(tmp_path, text.replace("UNIT", "mm")).nominal["out"][0, 0] == 11
    with pytest.raises(InputError, match=r"not a length.*'f'.*not in rad"):
        graph_of(tmp_path, text.replace("UNIT", "rad"))
