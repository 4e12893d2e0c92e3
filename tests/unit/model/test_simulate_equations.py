"""Equations of `simulate`, whose numbers may have units that are not written."""

from __future__ import annotations

import pytest

from mtu_cli.findings import InputError
from mtu_cli.model.simulate import covariate_equations, errors_by_axis, named_equation


@pytest.mark.parametrize(
    "text",
    [
        "Ex: 0.004*dir_x",
        "Ex: dir_x",
        "Ex: 1e-8*x*y",
        "Ex: 1e-5*x*(T_a_degC - 20)",
        "Ex: 2e-8*(x - 500)**2 + 0.001",
        "Ex: 0.003*sin(2*pi*x/40)",
        "Ex: 0.01*(1 - exp(-time_min/30))",
        "Ex: x*load",
        "Ex: 1e-3*sqrt(253.7 + 0.1677*x - 0.3933*y)",
        "Ex: x",
    ],
)
def test_errors_that_may_be_right(text: str) -> None:
    assert named_equation("--effect", text)[0] == "Ex"


def test_names_are_those_of_errors_and_of_columns_that_are_free() -> None:
    ((axis, _),) = errors_by_axis("--effect", ["Ex: 0.004*dir_x"], "xy")
    assert axis == "x"
    assert [name for name, _ in covariate_equations("--covariate", ["load: 1", "wear: 2"])] == [
        "load",
        "wear",
    ]
    with pytest.raises(InputError, match="unknown equation: 'Ez'"):
        errors_by_axis("--effect", ["Ez: 0.004"], "xy")
    for texts in (["part: 1"], ["load: 1", "load: 2"], ["load 1"]):
        with pytest.raises(InputError, match=r"another name|NAME: EQUATION"):
            covariate_equations("--covariate", texts)
