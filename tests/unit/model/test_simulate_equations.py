"""Equations of `simulate`, whose numbers may have units that are not written."""

from __future__ import annotations

import pytest

from mtu_cli.findings import InputError
from mtu_cli.model.simulate import covariate_equations, errors_by_axis


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
