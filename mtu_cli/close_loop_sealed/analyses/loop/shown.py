"""Sizes of what was found that follow from its parameters and scores."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.gross import Gross
from mtu_cli.close_loop_sealed.analyses.loop.result import (
    DRIFT,
    FIELD,
    FoundEffect,
    TableResult,
    Verdict,
)

SURE = 1e-3
"""Posterior of what has no name below which a lone name stands beside drifts or fields without one:
of 528 sets with an effect outside the library it let 2 wrong names pass, at 1e-2 5.
"""
APART = 5.0
"""Standard deviations d between rivals at which the data should have told them apart: their log
likelihood ratio is normal about d^2/2 with a standard deviation d, and below 3, where both stay in
a 95 % class, in 3 % of cases.
"""


def amplitude(effect: FoundEffect) -> tuple[float, float]:
    """Length sqrt(sum p_i^2) of the parameters as a vector, levels left out, and its
    u = sqrt(g' C g) with g = p/length (JCGM 100:2008, 5.2.2); internal units.
    """
    p = np.zeros(len(effect.parameters))
    p[: len(effect.sizes)] = [value for _, _, value, _ in effect.sizes]
    length = float(np.linalg.norm(p))
    if length == 0:
        return 0.0, math.nan
    g = p / length
    return length, math.sqrt(max(float(g @ effect.covariance @ g), 0.0))


def pitch_is_open(effect: FoundEffect) -> bool:
    """Whether what was searched along an axis is one of several values that fit as well: they
    foretell different errors at other places.
    """
    return bool(effect.alike) and effect.covariate is None


def is_nameless(name: str) -> bool:
    """Whether a member of a class is a drift or a field without a name."""
    return name.startswith((f"{DRIFT}-", f"{FIELD}-"))


def is_lone(effect: FoundEffect) -> bool:
    """Whether an effect is the only cause that the data allow in its place."""
    return len(effect.candidates) == 1 and not pitch_is_open(effect)


def own_verdict(effect: FoundEffect, item: TableResult) -> Verdict:
    """The verdict on one effect of a table."""
    return verdict_on(effect, (*item.fired, *item.twofold), without_name=item.without_name)


def verdict_on(effect: FoundEffect, fired: Sequence[str], *, without_name: bool) -> Verdict:
    """The verdict on one effect: what has no name (`without_name`) need not touch all of them.

    Where a check of what is left `fired`, or an effect was found twice over, each is a hint only;
    so is a scatter of whole parts that one axis alone has, whatever it stands beside.
    """
    lone = is_lone(effect)
    if fired or effect.of_one_axis:
        return "unexplained"
    if without_name:
        # Of a scatter it is not known how much has no name: drifts are of the mean.
        sure = lone and effect.kind != "scatter" and effect.unnamed < SURE
        return "named" if sure else "unexplained"
    return "named" if lone else "class"


def should_be_told(effect: FoundEffect) -> bool:
    """Whether the data would have told the named effects of a class apart, if one of them were
    alone: a drift or field without a name is no part of an experiment.
    """
    return effect.experiment is not None and effect.experiment.now_d >= APART


def effect_rms(effect: FoundEffect, item: TableResult) -> float:
    """Root mean square of an effect over all coordinates of a table, mm (rad)."""
    return math.sqrt(effect.explained_share) * item.in_sample_before.rms


@dataclass(frozen=True, slots=True, kw_only=True)
class MostLeft:
    """Where errors beside the effects found are largest: the axis with the largest root mean square
    `along` it, and the column (feature) with the largest over the rows `there`; mm (rad).
    """

    axis: str
    along: float
    column: str
    there: float


def most_left(item: TableResult) -> MostLeft:
    """In sample, of what was not set aside."""
    table = item.table
    present = table.there[:, :, np.newaxis]
    squares = np.where(present, table.errors - item.explained, 0.0) ** 2
    along = np.sqrt(squares.sum(axis=(0, 1)) / max(int(table.there.sum()), 1))
    a = int(np.argmax(along))
    there = np.sqrt(squares[:, :, a].sum(axis=0) / np.maximum(table.there.sum(axis=0), 1))
    h = int(np.argmax(there))
    return MostLeft(
        axis=table.axes[a],
        along=float(along[a]),
        column=table.features[h],
        there=float(there[h]),
    )


def improvement_percent(item: TableResult) -> float | None:
    """By how much the root mean square of held-out errors fell; None where there was none."""
    if item.before.rms == 0:
        return None
    return 100 * (1 - item.after.rms / item.before.rms)


def things(item: TableResult) -> tuple[str, str]:
    """What the rows and the columns of a table are: parts and features, passes and positions."""
    return ("part", "feature") if item.table.component is None else ("pass", "position")


WAYS = {"+": "forward", "-": "in reverse"}


def entry_text(gross: Gross, item: TableResult) -> str:
    """Which entry of the table it is."""
    row, column = things(item)
    return f"{column} {column_text(gross.feature, item)} of {row} {gross.part}"


def column_text(name: str, item: TableResult) -> str:
    """A feature, or a position and its direction, which stands behind it as a sign."""
    place, _, sign = name.partition(" ")
    readings = item.table.component is not None
    return f"{place} {WAYS[sign]}" if readings and sign in WAYS else name
