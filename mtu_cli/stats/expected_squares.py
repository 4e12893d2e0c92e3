"""The mean squares that components of variance give on average in an incomplete table, or in one
with freedoms taken out.

The coordinates are linear in the errors of entries, of columns and of parts, y = sum_u M_u u:
inputs u that are uncorrelated, each of J directions with covariance V (J, J), add to a sum of
squares sum_jk V_jk sum_u M_uj' M_uk (synthesis: Hartley, Biometrics 23 (1967) 105). What does
not depend on V belongs to the design and serves every table of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.crossed import Completion, Freeing
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mean_squares import MeanSquares, beyond_parts, of_parts
from mtu_cli.stats.strata import Strata

MOST = 1200
"""Inputs up to which each is passed on its own."""
PROBES = 400
"""Sums of all inputs with random signs instead of more (Hutchinson, Commun. Stat. Simul. Comput.
19 (1990) 433): a sum of squares of n degrees of freedom is then known to sqrt(2 / (400 n)) of it.
"""
VALUES = 1 << 21
"""Numbers in the tables that are passed at once."""

Inputs = Callable[[FloatArray], FloatArray]
"""From signs (b, n) of inputs to what they do to each axis, (b, J / A, P, H)."""
Turned = Callable[[FloatArray], FloatArray]
"""From values (b, J / A, P, H) to the coordinates (b, J, N) of each along each axis."""


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
    turned = _apart(strata, completion)
    if freeing is not None:
        turned = _together(strata, completion, freeing)
    sums = [
        _sums(strata, turned, inputs, _signs(n), apart=True)
        for inputs, n in _of_entries_and_columns(strata, completion.observed)
    ]
    # What all parts have in common: the input whose signs are all 1, of length 1.
    sums += [
        _sums(strata, turned, _of_parts(strata), signs, apart=False)
        for signs in (_signs(P), np.full((1, P), 1 / np.sqrt(P)))
    ]
    interaction, rest, reversals, part = (np.concatenate(own) for own in zip(*sums, strict=True))
    return ExpectedSquares(
        strata=strata, interaction=interaction, rest=rest, turned=reversals, part=part
    )


def _of_entries_and_columns(strata: Strata, there: NDArray[np.bool_]) -> list[tuple[Inputs, int]]:
    """The entries that are `there` (P, H), the columns and their reversals, and their numbers."""
    P, H, _ = strata.shape
    cells = np.flatnonzero(there)
    even = strata.columns[:, [0, *strata.even.tolist()]]
    odd = strata.columns[:, strata.odd]

    def entries(signs: FloatArray) -> FloatArray:
        found = np.zeros((len(signs), P * H))
        found[:, cells] = signs
        return found.reshape(len(signs), 1, P, H)

    def columns(signs: FloatArray) -> FloatArray:
        return np.ones((P, 1)) * (signs @ even.T)[:, None, None]

    def reversals(signs: FloatArray) -> FloatArray:
        return np.ones((P, 1)) * (signs @ odd.T)[:, None, None]

    return [(entries, len(cells)), (columns, even.shape[1]), (reversals, odd.shape[1])]


def _of_parts(strata: Strata) -> Inputs:
    """The parts, by their offsets and smooth directions."""
    own = strata.columns[:, : 1 + strata.lines].T

    def parts(signs: FloatArray) -> FloatArray:
        found: FloatArray = signs[:, None, :, None] * own[:, None]
        return found

    return parts


def _signs(n: int) -> FloatArray:
    """(m, n) with a sum of products over m that is the identity, exactly or on average."""
    if n <= MOST:
        return np.eye(n)
    rng = np.random.default_rng(n)
    found: FloatArray = rng.choice([-1.0, 1.0], (PROBES, n)) / np.sqrt(PROBES)
    return found


def _sums(
    strata: Strata, turned: Turned, inputs: Inputs, signs: FloatArray, *, apart: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The sums of squares, in the order of `ExpectedSquares`, of inputs of J directions: (J, ...)
    of each where they are uncorrelated (`apart`), else (J J, ...) of every two.
    """
    P, H, A = strata.shape
    d = A * (1 + strata.lines)
    J = inputs(signs[:0]).shape[1] * A
    sums = {kind: np.zeros((J, J, A)) for kind in ("interaction", "column", "reversal")}
    part = np.zeros((J, J, d, d))
    step = max(VALUES // (J * P * H * A), 1)
    for first in range(0, len(signs), step):
        y = turned(inputs(signs[first : first + step]))
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


def _together(strata: Strata, completion: Completion, freeing: Freeing) -> Turned:
    """Coordinates of values along each axis in turn, where freeing mixes the axes."""
    P, H, A = strata.shape

    def turned(values: FloatArray) -> FloatArray:
        tables = np.zeros((len(values), A, values.shape[1], P, H, A))
        for axis in range(A):
            tables[:, axis, :, :, :, axis] = values
        freed = freeing(tables.reshape(len(values), -1, P, H, A))
        return strata.coordinates(completion.fill(freed))[0]

    return turned


def _apart(strata: Strata, completion: Completion) -> Turned:
    """As `_together`, where nothing is freed: each axis has the same of its own values."""
    P, H, A = strata.shape

    def turned(values: FloatArray) -> FloatArray:
        flat = strata.rotated(completion.fill(values[..., None])).reshape(*values.shape[:2], P * H)
        found = np.zeros((len(values), A, values.shape[1], strata.size))
        for stratum in strata.all:
            place = strata.order[stratum.slice] - stratum.axis * P * H
            found[:, stratum.axis, :, stratum.slice] = flat[..., place]
        return found.reshape(len(values), -1, strata.size)

    return turned
