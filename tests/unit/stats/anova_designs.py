"""One-way data with unequal repeats, for the tests of the analysis of variance."""

from __future__ import annotations

import numpy as np

from mtu_cli.stats.anova import Cells, cells_of
from mtu_cli.stats.least_squares import FloatArray, IntArray

PAPER = (5, 5, 5, 5, *[2] * 17)
"""Gilsinn & Ling 2004, section 4.1: repeats of the 21 parts, 54 in all."""


def simulated(
    repeats: tuple[int, ...], tables: int, s_part: float, s_repeat: float, seed: int
) -> tuple[FloatArray, IntArray]:
    """Values (tables, N) and the part (N,) of each."""
    rng = np.random.default_rng(seed)
    part: IntArray = np.repeat(np.arange(len(repeats)), repeats).astype(np.int64)
    parts = s_part * rng.standard_normal((tables, len(repeats)))
    return parts[:, part] + s_repeat * rng.standard_normal((tables, len(part))), part


def cells(values: FloatArray, part: IntArray, parts: int) -> Cells:
    """Cells of values (tables, N)."""
    tables = len(values)
    cell = np.arange(tables)[:, None] * parts + part
    return cells_of(values.ravel(), cell.ravel(), tables, parts)


def drawn(
    repeats: tuple[int, ...], tables: int, s_part: float, s_repeat: float, seed: int
) -> Cells:
    """Cells of simulated tables."""
    values, part = simulated(repeats, tables, s_part, s_repeat, seed)
    return cells(values, part, len(repeats))
