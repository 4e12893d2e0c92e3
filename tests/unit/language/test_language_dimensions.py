from __future__ import annotations

import pytest

from mtu_cli.close_loop_sealed.files.effect_text import filled_tree
from mtu_cli.language import EquationError, check_dimension, parse
from mtu_cli.units import ANGLE, LENGTH

DIMENSIONS: dict[str, int | None] = {
    "x": LENGTH,
    "y": LENGTH,
    "z": LENGTH,
    "dx_x": LENGTH,
    "dy_y": LENGTH,
    "ey_x": ANGLE,
    "ez_y": ANGLE,
    "arm": None,
    "T_spindle_degC": None,
}


@pytest.mark.parametrize(
    "text",
    [
        "dx_x + z*ey_x - y*ez_y",
        "dx_x + arm*ey_x",
        "0.004*T_spindle_degC",
        "dx_x + 0.01",
        "(x + 100)*ez_y",
        "(x - arm)*ez_y",
        "dx_x*ey_x",
        "dx_x*x/y",
        "dx_x*sin(2*pi*x/25)",
        "dx_x*step(x - 300)",
        "dx_x*cos(ey_x)*exp(x/y)*log(2)",
        "dx_x*exp(-x/50)*(1 + x/500)*(1 - 0.002*y)",
        "abs(x)*ey_x",
        "sqrt(x*y)*ey_x",
        "sqrt(x**2 + y**2)*ey_x",
        "x**2/y*ey_x",
        "-(dx_x - z*ey_x)",
        "x**arm",
        "x**0.5",
        "sqrt(x)",
        "3",
        "unheard_of",
        "(ey_x + 1)*x",
        "-x*-ey_x",
    ],
)
def test_lengths(text: str) -> None:
    check_dimension(parse(text), LENGTH, DIMENSIONS)


LEVER = "its lever arm beside it as a factor (a position or a named constant)"
TERM = "a term that is a length (mm)"


@pytest.mark.parametrize(
    ("text", "column", "expected"),
    [
        ("dx_x + ey_x", 8, LEVER),
        ("ey_x + dx_x", 1, LEVER),
        ("dx_x - ey_x", 8, LEVER),
        ("dx_x + 127*ey_x", 8, LEVER),
        ("dx_x + ey_x*127", 8, LEVER),
        ("dx_x - (dy_y - ey_x/2)", 16, LEVER),
        ("-(dx_x + ey_x)", 10, LEVER),
        ("dx_x*z", 1, TERM),
        ("dx_x + x*y*ey_x/2", 8, TERM),
        ("step(x)", 1, LEVER),
        ("dx_x + sin(x)", 8, LEVER),
        ("dx_x + 2*abs(ey_x)", 8, LEVER),
        ("sqrt(x**2*y**2)", 1, TERM),
        ("dx_x + x**2", 8, TERM),
        ("x**0", 1, LEVER),
        ("dx_x/y", 1, LEVER),
        ("z*ey_x/y + dx_x", 1, LEVER),
        ("dx_x*(100 + x/2)", 1, TERM),
    ],
)
def test_what_is_not_a_length_is_refused_where_its_term_begins(
    text: str, column: int, expected: str
) -> None:
    with pytest.raises(EquationError, match=r"its equation is a length \(mm\)") as caught:
        check_dimension(parse(text), LENGTH, DIMENSIONS)
    assert caught.value.column == column
    assert caught.value.expected == expected


@pytest.mark.parametrize(
    ("text", "column"), [("2*(dx_x + ey_x)", 9), ("arm*(x - ez_y)", 8), ("(x*y + x)/y", 6)]
)
def test_sums_inside_a_term_are_of_one_dimension(text: str, column: int) -> None:
    with pytest.raises(EquationError, match="are added") as caught:
        check_dimension(parse(text), LENGTH, DIMENSIONS)
    assert caught.value.column == column


@pytest.mark.parametrize("text", ["dx_x*y**-n", "dx_x*y*-n", "dx_x*-n*y", "dx_x*y**(-(-n))"])
def test_a_negated_number_of_a_template_is_a_number(text: str) -> None:
    """A parser makes ``-1`` a number, a template that is filled in does not."""
    written = parse(text.replace("n", "1"))
    for tree in (written, filled_tree(parse(text), {"n": 1.0})):
        with pytest.raises(EquationError, match=r"its equation is a length \(mm\)"):
            check_dimension(tree, LENGTH, DIMENSIONS)


def test_what_is_added_to_minus_one_is_a_plain_number() -> None:
    for text in ("dx_x*(x/500 - 1)", "dx_x*(-1 + x/500)", "dx_x*(1 + x/-500)"):
        check_dimension(parse(text), LENGTH, DIMENSIONS)


def test_an_angle_may_be_wanted() -> None:
    check_dimension(parse("ey_x + dx_x/z"), ANGLE, DIMENSIONS)
    with pytest.raises(EquationError, match="a length") as caught:
        check_dimension(parse("ey_x + dx_x"), ANGLE, DIMENSIONS)
    assert caught.value.column == 8


@pytest.mark.parametrize(
    ("text", "words", "column"),
    [
        ("dx_x*sin(x)", r"sin of a length \(mm\)", 10),
        ("dx_x*exp(-x)", r"exp of a length \(mm\)", 10),
        ("dx_x*log(x + 20)", r"log of a length \(mm\)", 10),
        ("dx_x*cos(x*y)", r"cos of mm\^2", 10),
        ("dx_x*2**(x - 1)", r"an exponent that is a length \(mm\)", 10),
    ],
)
def test_arguments_of_functions_are_plain_numbers(text: str, words: str, column: int) -> None:
    with pytest.raises(EquationError, match=words) as caught:
        check_dimension(parse(text), LENGTH, DIMENSIONS)
    assert caught.value.column == column
