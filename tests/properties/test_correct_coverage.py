"""The 95 % interval of a corrected diameter and length holds the true one in 95 % of machines."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from correct_examples import ring_part
from correct_trials import FittedMachines, diameter_coverage, fitted_machines, with_form
from machine_trials import Drift, machine
from scipy.stats import binom

MACHINES, RINGS = 60, 4
"""Rings of one machine have passes and noise of their own, and only its coefficients in common."""
NONE, SOME = Drift(0.0), Drift(1.0)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Drift], FittedMachines]:
    """The machines of a drift; all cases of it start from the same readings."""
    known = machine(tmp_path_factory.mktemp("machine"))
    return cache(lambda drift: fitted_machines(known, drift, MACHINES, seed=5))


@pytest.mark.parametrize(
    ("drift", "probing", "repeats"),
    [
        (NONE, 0.0, 1),
        (SOME, 0.3e-3, 1),
        (SOME, 1e-3, 2),
    ],
)
def test_intervals_of_a_ring_cover(
    fitted: Callable[[Drift], FittedMachines],
    drift: Drift,
    probing: float,
    repeats: int,
    tmp_path: Path,
) -> None:
    """A length between two points of the one ring that tells the scatter is held too often: a
    large error of it shows in the residuals, too. Less than one of a ring it is never."""
    part = ring_part(tmp_path, "lengths: [{from: r0, to: r5}]\n")
    shares = diameter_coverage(fitted(drift), part, RINGS, probing=probing, repeats=repeats)
    standard_error = np.sqrt(0.95 * 0.05 / (MACHINES * RINGS))
    # As if each ring had a machine of its own: what machines differ by is next to nothing.
    assert (shares.std(axis=0) / np.sqrt(MACHINES) < 1.3 * standard_error).all()
    assert (np.abs(shares.mean(axis=0) - 0.95) < 3.5 * standard_error).all()


@pytest.mark.parametrize("probing", [0.3e-3])
def test_a_round_ring_is_rarely_left_with_a_form(
    fitted: Callable[[Drift], FittedMachines], probing: float, tmp_path: Path
) -> None:
    called = with_form(fitted(SOME), ring_part(tmp_path), probing=probing, repeats=3)
    assert called <= binom.ppf(1 - 1e-3, MACHINES, 0.05)
