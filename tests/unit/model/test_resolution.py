"""The step that measured coordinates were rounded to."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.model.resolution import resolution

EXACT = np.random.default_rng(1).uniform(-500, 500, 200)


@pytest.mark.parametrize("step", [1e-3, 5e-4, 1e-4, 1e-5])
def test_the_step_is_found(step: float) -> None:
    assert resolution(np.round(EXACT / step) * step) == step


def test_what_is_not_rounded_has_none_and_coarser_steps_count_as_1_um() -> None:
    assert resolution(EXACT) == 0.0
    assert resolution(np.round(EXACT, 2)) == 1e-3
