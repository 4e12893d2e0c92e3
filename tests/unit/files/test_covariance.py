"""Whether a matrix is a covariance."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.files.machine import covariance_fault


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([], None),
        ([[0.0, 0.0], [0.0, 1.0]], None),
        ([[1.0, 0.5], [0.5000001, 1.0]], None),
        ([[1.0, 0.5], [0.50001, 1.0]], "not symmetric"),
        ([[1.0, 1.00000001], [1.00000001, 1.0]], None),
        ([[1.0, 1.0000005], [1.0000005, 1.0]], "a combination has a negative variance"),
        ([[1.0, 1.00001], [1.00001, 1.0]], "a combination has a negative variance"),
        ([[-1.0, 0.0], [0.0, 1.0]], "a variance is negative"),
        ([[0.0, 1e-9], [1e-9, 1.0]], "a combination has a negative variance"),
        ([[1e-320, 1.0], [1.0, 1e-320]], "a combination has a negative variance"),
        ([[1e-320, 1e-320], [1e-320, 1e-320]], None),
        ([[1e300, 1e300], [-1e300, 1e300]], "not symmetric"),
        ([[1.0, 0.0]], "not 1 x 1"),
        ([[1.0, 0.0], [0.0]], "not 2 x 2"),
    ],
)
def test_what_a_covariance_is(rows: list[list[float]], words: str | None) -> None:
    found = covariance_fault(rows, len(rows))
    assert (found is None) == (words is None)
    assert words is None or (found or "").endswith(words)


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e12])
def test_the_answer_does_not_depend_on_units(unit: float) -> None:
    """Slopes are some powers of ten smaller than offsets."""
    scale = np.diag([1.0, unit])
    for r, sound in ((0.999, True), (1.001, False)):
        rows = (scale @ np.array([[1.0, r], [r, 1.0]]) @ scale).tolist()
        assert (covariance_fault(rows, 2) is None) == sound
