"""What is warned of after a search: scatter of single features and parts, columns of errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from loop_examples import effect, on_table, parameter, result

from mtu_cli.analyses.close_loop.warnings import loop_warnings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import larger_scatter

COLUMN = effect("covariate-x", parameter("slope", "um", 1.0, 0.01), covariate="deviation")


def warned(code: str, errors: FloatArray, **changed: Any) -> list[str]:
    """The warnings of one kind on points with these errors, mm."""
    item = on_table(verdict="none", **changed)
    item = replace(item, table=replace(item.table, errors=errors), explained=0 * errors)
    return [own.text for own in loop_warnings(result(item), 4) if own.code == code]


@pytest.mark.parametrize(("dimension", "name"), [(1, "feature H5"), (0, "part P5")])
def test_a_feature_or_part_that_scatters_more_is_named(dimension: int, name: str) -> None:
    errors = 1e-3 * np.random.default_rng(4).standard_normal((9, 12, 2))
    assert warned("feature-scatters", errors) == []
    errors[(slice(None),) * dimension + (4,)] *= 8
    (said,) = warned("feature-scatters", errors)
    assert said.startswith(f"{name} scatters far more than the others")


def test_one_outlier_or_turned_parts_are_no_scatter_of_features() -> None:
    rng = np.random.default_rng(5)
    errors = 1e-3 * rng.standard_normal((9, 12, 2))
    places = on_table().table.places[0, :, :2]
    turned = np.stack([-places[:, 1], places[:, 0]], axis=1)
    assert warned("feature-scatters", errors + 5e-5 * rng.standard_normal((9, 1, 1)) * turned) == []
    errors[3, 4, 0] += 0.1
    excluded = (("H5", "P4", "x", 0.1),)
    assert warned("feature-scatters", errors, set_aside=excluded) == []


def test_variances_are_compared_with_degrees_of_freedom() -> None:
    rng = np.random.default_rng(6)
    p = np.concatenate([larger_scatter(rng.standard_normal((9, 12)))[2] for _ in range(400)])
    assert np.mean(p < 0.01) < 0.01
    left = rng.standard_normal((9, 12)) * np.array([8.0] + [1.0] * 11)
    s, others, p = larger_scatter(left)
    assert s[0] > 4 > 2 > others[0]
    assert p[0] < 1e-4
    assert p[1:].min() > 1e-3


def test_a_column_that_is_the_error_is_told() -> None:
    item = on_table(replace(COLUMN, explained_share=0.9999))
    assert [own.code for own in loop_warnings(result(item), 4)] == ["covariate-is-the-error"]
    assert not list(loop_warnings(result(on_table(COLUMN)), 4))
