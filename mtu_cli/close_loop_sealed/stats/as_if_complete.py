"""Mean squares of an incomplete table, or of one with freedoms taken out, as a complete one has
them.
"""

from __future__ import annotations

import numpy as np

from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.mean_squares import LEAST, MeanSquares
from mtu_cli.stats.least_squares import FloatArray

CORRECTIONS = 100
CONVERGED = 1e-3
"""Share of its mean square that a last correction is at most."""
NOTHING = 1e-9
"""Share of the largest mean square of its kind below which one is rounding: what was freed."""


def as_if_complete(
    frame: Frame, wanted: MeanSquares, dof: FloatArray, part: FloatArray, common: FloatArray
) -> MeanSquares:
    """The mean squares that `wanted` stand for in a complete table: those whose components give
    `wanted` here, of a table with `dof` (S,). Components are neither shrunk nor cut off meanwhile,
    for that is no bias. `part` (d, d) is the covariance of one part's coordinates where there is
    one part alone, `common` (d, K) the factor of what all parts have in common, times P.
    """
    aim = wanted
    # Of one part the columns' is the noise, which is never less than nothing.
    least = LEAST * wanted.rest if len(frame.completion.rows) == 1 else -np.inf
    for _ in range(CORRECTIONS):
        got = _expected(frame, aim, dof, part, common)
        step = MeanSquares(
            interaction=wanted.interaction - got.interaction,
            rest=wanted.rest - got.rest,
            turned=wanted.turned - got.turned,
            part=wanted.part - got.part,
        )
        last, aim = (
            aim,
            MeanSquares(
                interaction=np.maximum(
                    aim.interaction + step.interaction, LEAST * wanted.interaction
                ),
                rest=np.maximum(aim.rest + step.rest, least),
                turned=aim.turned + step.turned,
                part=aim.part + step.part,
            ),
        )
        if _share(aim, last, wanted) <= CONVERGED:
            break
    return aim


def _share(aim: MeanSquares, last: MeanSquares, wanted: MeanSquares) -> float:
    """The largest step from `last`, each as a share of its own mean square where there is any."""
    scale = np.sqrt(np.abs(np.diag(wanted.part)))
    pairs = (
        (aim.interaction - last.interaction, wanted.interaction),
        (aim.rest - last.rest, wanted.rest),
        (aim.turned - last.turned, wanted.turned),
        (aim.part - last.part, np.outer(scale, scale)),
    )
    shares = [(np.abs(own) / _at_least(np.abs(whole))).ravel() for own, whole in pairs]
    return float(np.nanmax(np.concatenate(shares), initial=0.0))


def _at_least(sizes: FloatArray) -> FloatArray:
    return np.maximum(sizes, max(NOTHING * float(np.nanmax(sizes, initial=0.0)), 1e-300))


def _expected(
    frame: Frame, squares: MeanSquares, dof: FloatArray, part: FloatArray, common: FloatArray
) -> MeanSquares:
    """What tables give here on average whose components give `squares` in a complete table."""
    P, k = frame.strata.shape[0], frame.strata.lines
    interaction = _finite(squares.interaction if P > 1 else squares.rest)
    noise = np.diag(np.repeat(interaction, 1 + k))
    return frame.squares.of(
        interaction=interaction,
        column=_finite(squares.rest - interaction) / P,
        reversal=_finite(squares.turned - interaction) / P,
        part=squares.part - noise if P > 1 else part,
        common=common @ common.T,
        dof=dof,
    )


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, 0.0)
