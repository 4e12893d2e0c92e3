"""Estimates from few trials of a model that is linear but for a little."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.block_plan import LEAST_BLOCKS, BlockPlan
from mtu_cli.stats.blocks import BlockSummariser, Draws, joined
from mtu_cli.stats.pooling import Estimates, Gain, Pool, rescaled
from mtu_cli.stats.single_block import single_block_estimates

FloatArray = NDArray[np.float64]

SURE_GAIN = 4.0
"""Gain from which on a control is taken. The scatter of ten blocks tells a variance to a half
only: with less the control may be of no use at all."""

EARLY_GAIN = 100.0
"""Gain from which on a few trials are enough for a count that adapts: to stop where the scatter
of the blocks happens to be small would be to state it too small. Here it plainly is."""

PLAIN_GAIN = 1000.0
"""Gain that no scatter of ten blocks makes of one that is no use, nor of a tenth of it."""

STUDENT = (2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093)
"""t(0.975) of 9 to 19 degrees of freedom, those of `LEAST_BLOCKS` to `FIRST_LOOK` blocks, as tables
print it: to import scipy.special for them would take longer than all that a short command does.
"""
NORMAL = 1.960
"""The same of infinitely many."""


def error_factors(blocks: int) -> dict[str, float]:
    """By which the scatter of `blocks` blocks is stated larger, for mean, u, low and high.

    t(blocks - 1)/z, so that twice the standard error holds the error in 95 % of cases: few blocks
    tell their own scatter to a fifth or so (JCGM 100:2008, G.3). An end's error runs as the square
    of its control. The slopes then share blocks with such errors, which adds 2/blocks to the
    variance that the scatter does not show, and the scatter of skewed values comes out small where
    their mean does: a fifth of the standard error of ten blocks and a seventh of 20, by simulation
    of ends that are bent up to where the output turns back.
    """
    student = STUDENT[blocks - LEAST_BLOCKS] / NORMAL
    end = student * math.sqrt(1.0 + 2.0 / blocks) * (1.1 + 1.0 / blocks)
    return {"mean": student, "u": student, "low": end, "high": end}


def crossed_gain(
    own: Gain, draws: Sequence[Draws], summariser: BlockSummariser, u_exists: NDArray[np.bool_]
) -> Gain:
    """Gain of the controls by the scatter of other blocks of the same trials: every h-th in one.

    Each of them takes as many trials from every block of `draws`, but for one at most, as the
    columns of a two-way table do from its rows. The averages of both scatter on their own, so a
    control that is taken for what these say is not one whose error happens to look small. The
    `own` gain of the blocks where it leaves no doubt.
    """
    seen = np.array(own)
    if np.all((seen == 1.0) | (seen >= PLAIN_GAIN)):
        return own
    whole = joined(draws, lambda arrays: np.concatenate(arrays, axis=1))
    u = draws[0].linear_u
    if u is not None and u.shape[1] == 1:
        whole = replace(whole, linear_u=u)
    pool = Pool(summariser.plan, u_exists)
    h = len(draws)
    crossed = [joined([whole], partial(_every, h, i)) for i in range(h)]
    for block in summariser.summarise_short(crossed):
        pool.add_statistics(block)
    return pool.gain()


def _every(h: int, first: int, arrays: Sequence[FloatArray]) -> FloatArray:
    """Every h-th column of an array from `first` on; the one that all trials share, if it is so."""
    (whole,) = arrays
    return whole if whole.shape[1] == 1 else whole[:, first::h]


def short_block_estimates(
    pooled: Estimates,
    crossed: Gain,
    values: FloatArray,
    probability: float,
    u_exists: NDArray[np.bool_],
) -> Estimates:
    """Each statistic from the blocks where its control gains, else from all `values` together.

    `pooled`: from the blocks of `BlockPlan.short`; their standard errors are stated larger
    (`error_factors`). `crossed`: what decides (`crossed_gain`), and is the gain stated. To decide
    by the scatter that is stated too would take the lesser of two by chance: two standard errors
    then held 8 in 9 errors of a control that gains about `SURE_GAIN`. `values` (outputs, M): the
    whole sample; of it as `single_block_estimates`.
    """
    gain = np.array(crossed)
    taken = (gain >= SURE_GAIN) & (np.array(pooled.gain) > 1.0)
    blocks = BlockPlan.short(values.shape[1], probability).blocks or LEAST_BLOCKS
    factors = error_factors(blocks)
    wide = {f"se_{name}": k * getattr(pooled, f"se_{name}") for name, k in factors.items()}
    if np.all(taken):
        return replace(pooled, **wide, gain=crossed)
    whole = single_block_estimates(values, probability, u_exists)
    found = {
        name: np.where(use, getattr(pooled, name), getattr(whole, name))
        for name, use in zip(factors, taken, strict=True)
    }
    errors = {
        name: np.where(use, wide[name], getattr(whole, name))
        for name, use in zip(wide, taken, strict=True)
    }
    ends = taken[2] & taken[3]
    return Estimates(
        **found,
        **errors,
        shortest_low=np.where(ends, pooled.shortest_low, whole.shortest_low),
        shortest_high=np.where(ends, pooled.shortest_high, whole.shortest_high),
        covariance=rescaled(whole.covariance, found["u"]),
        gain=Gain(*np.where(taken, gain, 1.0)),
    )


def all_controlled(estimates: Estimates, u_exists: NDArray[np.bool_]) -> bool:
    """Whether the control gains much for every statistic that there is, of every output."""
    all_exist = np.ones_like(u_exists)
    needed = np.array([u_exists, u_exists, all_exist, all_exist])
    return bool(np.all((np.array(estimates.gain) >= EARLY_GAIN) | ~needed))
