"""Measured errors of a shop day: part, hole, process and CMM scatter, in six kinds.

e[p, h, a, r] = effects + part[p, a] + hole[h, a] + process[p, h, a] + cmm[p, h, a, r],
the standard deviations 2.5, 0.5, 3.5 and 1.5 um; R = 3 repeats on the CMM.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

if TYPE_CHECKING:
    from shop_day.day import Floats, ShopDay
    from shop_day.truth import Truth

Noise = Literal["normal", "t4", "outliers", "noisy-axis", "noisy-operation", "hole-errors"]
NOISES: tuple[Noise, ...] = get_args(Noise)

SIG_PROCESS, SIG_CMM, SIG_PART, SIG_HOLE = 3.5, 1.5, 2.5, 0.5
"""Standard deviations, um."""
REPEATS = 3
SIGMA = float(np.sqrt(SIG_PROCESS**2 + SIG_CMM**2 / REPEATS))
"""Of one averaged coordinate, within part and hole: 3.6 um."""
FIXED_HOLE = 1.5
"""Of the holes' own errors where they are large, um."""
OUTLIER_SHARE, OUTLIER_UM = 0.01, (20.0, 60.0)
NOISY_AXIS = 2.0
"""Times the standard deviation of the cells."""
NOISY_OPERATION = (2.0, 3.0)
"""Times the variance of the cells, drawn between the two."""


def measure(
    day: ShopDay, rng: np.random.Generator, truths: Sequence[Truth] = (), noise: Noise = "normal"
) -> Floats:
    """Measured minus nominal (P, H, 2), um: the mean of the repeats."""
    mean: Floats = measure_repeats(day, rng, truths, noise).mean(axis=-1)
    return mean


def measure_repeats(
    day: ShopDay, rng: np.random.Generator, truths: Sequence[Truth] = (), noise: Noise = "normal"
) -> Floats:
    """Measured minus nominal (P, H, 2, R), um.

    An outlier is of the hole, so that it stands in all repeats of its cell. Heavy tails are
    those of process and CMM; parts and holes scatter normally.
    """
    table = (day.P, day.H, 2)
    spread = np.ones(table[1:])
    for truth in truths:
        if truth.noise_factor is not None:
            spread *= truth.noise_factor[:, None]
    hole = SIG_HOLE
    if noise == "noisy-axis":
        spread[:, rng.integers(2)] *= NOISY_AXIS
    elif noise == "noisy-operation":
        noisy = day.operation == rng.integers(len(day.operations))
        spread[noisy] *= np.sqrt(rng.uniform(*NOISY_OPERATION))
    elif noise == "hole-errors":
        hole = FIXED_HOLE

    def draw(*shape: int) -> Floats:
        heavy = noise == "t4"
        return rng.standard_t(4, size=shape) / np.sqrt(2.0) if heavy else rng.normal(size=shape)

    cells = SIG_PROCESS * spread * draw(*table)
    cells += SIG_PART * rng.normal(size=(day.P, 1, 2)) + hole * rng.normal(size=(1, day.H, 2))
    for truth in truths:
        cells += truth.errors
    if noise == "outliers":
        hit = rng.random(table) < OUTLIER_SHARE
        cells += hit * rng.choice([-1.0, 1.0], table) * rng.uniform(*OUTLIER_UM, table)
    return cells[..., None] + SIG_CMM * spread[..., None] * draw(*table, REPEATS)
