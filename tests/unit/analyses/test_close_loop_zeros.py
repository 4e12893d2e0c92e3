"""Where effects of a covariate are none: by their equations, whatever these look like."""

from __future__ import annotations

import pytest
from close_loop_examples import effect

from mtu_cli.close_loop_sealed.analyses.loop.zeros import zeros_of
from mtu_cli.close_loop_sealed.files.effect_templates import equation_text
from mtu_cli.language import parse


def zeros(*equations: str, covariate: str | None = "parts", levels: int = 0) -> tuple[float, ...]:
    parameters = [
        ("wear", "um", 0.46, 0.02),
        *[(f"level{i}", "um", 1.0, 0.1) for i in range(levels)],
    ]
    own = effect(
        "wear-approach-y",
        parameters=tuple(parameters),
        equations={f"E{axis}": text for axis, text in zip("yxz", equations, strict=False)},
        covariate=covariate,
    )
    return zeros_of(own)


@pytest.mark.parametrize(
    ("text", "zero"),
    [
        ("wear*(parts - 1)*dir_y", 1.0),
        ("wear*parts*dir_y", 0.0),
        ("wear*(parts + 3)*dir_y", -3.0),
        ("wear*(parts - 123456)*dir_y", 123456.0),
        ("wear*(parts - 1234567890123)*dir_y", 1234567890123.0),
        ("wear*(parts - 1e+16)*dir_y", 1e16),
        ("wear*(parts - 21.88)*(x - 75)", 21.88),
        ("-2*wear*(0.5 - parts/8)*dir_y", 4.0),
        ("dir_y*(wear*parts - wear*7)", 7.0),
        ("wear*(spare_parts - 2)*(parts - 1)", 1.0),
    ],
)
def test_it_is_that_of_the_covariate(text: str, zero: float) -> None:
    assert zeros(text) == (zero,)


@pytest.mark.parametrize(
    "text",
    [
        "wear*(spare_parts - 2)*dir_y",
        "wear*(parts - x)*dir_y",
        "wear*exp(parts)*dir_y",
        "wear*(parts - parts)*dir_y",
        "wear*(parts - 2)*(parts - 5)",
    ],
)
def test_there_may_be_none(text: str) -> None:
    assert zeros(text) == ()


def test_of_an_effect_without_a_covariate_there_is_none() -> None:
    assert zeros("wear*dir_y", covariate=None) == ()


def test_several_equations_have_each_zero_once() -> None:
    one = "wear*(parts - 4)*dir_y"
    assert zeros(one, one.replace("dir_y", "dir_x")) == (4.0,)
    assert zeros(one, "wear*(parts - 1)*dir_x") == (1.0, 4.0)


def test_levels_have_none() -> None:
    assert zeros("wear*(parts - 4)*(x - 1) + level0", levels=1) == (4.0,)
    assert zeros("level0", levels=1) == ()


@pytest.mark.parametrize("value", [0.0, -3.0, 1.0, 2e6 + 0.5, 1e-5, 1e16, 20.38, 21.88])
def test_what_is_written_is_read_again(value: float) -> None:
    text = equation_text(parse("wear*(parts - c)*dir_y"), {"c": value})
    assert zeros(text) == (value,)
