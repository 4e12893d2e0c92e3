"""The mean squares that components of variance give on average in an incomplete table, or in one
with freedoms taken out.

The coordinates are linear in the errors of entries, of columns and of parts, y = sum_u M_u u:
inputs u that are uncorrelated, each of J directions with covariance V (J, J), add to a sum of
squares sum_jk V_jk sum_u M_uj' M_uk (synthesis: Hartley, Biometrics 23 (1967) 105). What does
not depend on V belongs to the design and serves every table of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.stats.crossed import Completion, Freeing
from mtu_cli.close_loop_sealed.stats.design_inputs import (
    Inputs,
    Turned,
    coordinates,
    entry_and_column_inputs,
    part_inputs,
    signs,
    turning,
)
from mtu_cli.close_loop_sealed.stats.mean_squares import MeanSquares, beyond_parts, of_parts
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedSquares:
    """What errors of entries, of columns, of their reversals, of parts, and what all parts have
    in common give in the sums of squares of one design: `interaction`, `rest` and `turned`
    (T, A) and `part` (T, d, d), d = A (1 + k), for every variance and covariance of them, T in
    all: 3 A variances by axis and twice d d covariances.
    """

    strata: Strata
    interaction: FloatArray
    rest: FloatArray
    turned: FloatArray
    part: FloatArray

    def of(
        self,
        *,
        interaction: FloatArray,
        column: FloatArray,
        reversal: FloatArray,
        part: FloatArray,
        common: FloatArray,
        dof: FloatArray,
    ) -> MeanSquares:
        """Mean squares for variances `interaction`, `column`, `reversal` (A,), the covariances
        `part` and `common` (d, d) of a part's coordinates and of P times what all parts have in
        common, and degrees of freedom `dof` (S,) of the strata; nan as in `mean_squares`.
        """
        V = np.concatenate([interaction, column, reversal, part.ravel(), common.ravel()])
        P = self.strata.shape[0]
        return MeanSquares(
            interaction=_over(self._sizes("interaction", dof), V @ self.interaction),
            rest=_over(self._sizes("column", dof), V @ self.rest),
            turned=_over(self._sizes("reversal", dof), V @ self.turned),
            part=_over(np.array(P - 1.0), np.tensordot(V, self.part, axes=1)),
        )

    def _sizes(self, kind: str, dof: FloatArray) -> FloatArray:
        """What a sum (A,) is divided by; 0 where there is none."""
        found = np.zeros(self.strata.shape[2])
        for stratum, n in zip(self.strata.all, dof, strict=True):
            if stratum.kind == kind:
                own = n if kind == "interaction" else stratum.size - len(stratum.lead)
                found[stratum.axis] = own
        return found


def _over(sizes: FloatArray, sums: FloatArray) -> FloatArray:
    found: FloatArray = np.where(sizes > 0, sums / np.where(sizes > 0, sizes, 1.0), np.nan)
    return found


def expected_squares(
    strata: Strata, completion: Completion, freeing: Freeing | None
) -> ExpectedSquares:
    """Of a design whose tables are freed by `freeing` and filled in by `completion`."""
    P = strata.shape[0]
    turned = turning(strata, completion, freeing)
    sums = [
        _sums(strata, turned, inputs, signs(n), apart=True)
        for inputs, n in entry_and_column_inputs(strata, completion.observed)
    ]
    # What all parts have in common: the input whose signs are all 1, of length 1.
    sums += [
        _sums(strata, turned, part_inputs(strata), own, apart=False)
        for own in (signs(P), np.full((1, P), 1 / np.sqrt(P)))
    ]
    interaction, rest, reversals, part = (np.concatenate(own) for own in zip(*sums, strict=True))
    return ExpectedSquares(
        strata=strata, interaction=interaction, rest=rest, turned=reversals, part=part
    )


def _sums(
    strata: Strata, turned: Turned, inputs: Inputs, of: FloatArray, *, apart: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The sums of squares, in the order of `ExpectedSquares`, of inputs of J directions: (J, ...)
    of each where they are uncorrelated (`apart`), else (J J, ...) of every two.
    """
    A = strata.shape[2]
    d = A * (1 + strata.lines)
    J = inputs(of[:0]).shape[1] * A
    sums = {kind: np.zeros((J, J, A)) for kind in ("interaction", "column", "reversal")}
    part = np.zeros((J, J, d, d))
    for y in coordinates(strata, turned, inputs, of):
        for stratum in strata.all:
            if stratum.kind in sums:
                own = beyond_parts(stratum, y)
                products = np.tensordot(own, own, axes=([0, 2], [0, 2]))
                sums[stratum.kind][:, :, stratum.axis] += products
        own = of_parts(strata, y)
        part += np.tensordot(own, own, axes=([0, 2], [0, 2])).transpose(0, 2, 1, 3)
    kept = np.arange(J) * (J + 1) if apart else np.arange(J * J)
    interaction, rest, reversals = (own.reshape(J * J, A)[kept] for own in sums.values())
    return interaction, rest, reversals, part.reshape(J * J, d, d)[kept]
