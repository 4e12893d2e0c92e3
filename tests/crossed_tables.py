"""Tables of parts x columns x axes, complete or not, with dense covariances to judge them by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.crossed import Freeing, completion
from mtu_cli.close_loop_sealed.stats.expected_squares import ExpectedSquares
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.loop_null import KnownScatter, NullModel
from mtu_cli.close_loop_sealed.stats.mean_squares import MeanSquares
from mtu_cli.close_loop_sealed.stats.strata import Strata, strata_of

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def pairs(H: int) -> Floats:
    """(H, H / 2) differences of every two neighbours: forward and reverse at one place."""
    found = np.zeros((H, H // 2))
    for i in range(H // 2):
        found[2 * i, i], found[2 * i + 1, i] = 1.0, -1.0
    return np.asarray(found / np.sqrt(2))


def grid(H: int, seed: int = 1) -> Floats:
    """(H, 2) places about their mean, of order one."""
    places = np.random.default_rng(seed).uniform(-1.0, 1.0, (H, 2))
    return np.asarray(places - places.mean(axis=0))


def contrasts(P: int) -> Floats:
    """(P, P - 1) orthonormal contrasts of the parts: the cosines of the DCT-II, one by one."""
    found = np.zeros((P, P - 1))
    for m in range(P):
        for k in range(1, P):
            found[m, k - 1] = np.sqrt(2 / P) * np.cos((2 * m + 1) * k * np.pi / (2 * P))
    return found


def made(P: int, H: int, A: int, *, lines: bool = True, seed: int = 1) -> Strata:
    """Strata with the two straight directions, or with none."""
    return strata_of(P, grid(H, seed) if lines else np.zeros((H, 0)), A)


def holes(P: int, H: int, share: float, seed: int) -> Mask:
    """A mask with `share` of the entries missing, some in every row and column left."""
    rng = np.random.default_rng(seed)
    there = np.asarray(rng.random((P, H)) >= share)
    there[np.arange(H) % P, np.arange(H)] = True
    there[np.arange(P), np.arange(P) % H] = True
    return there


def half_measured(P: int, H: int) -> Mask:
    """Every second part has the first half of the columns only, and one part the second."""
    there = np.ones((P, H), bool)
    there[1::2, H // 2 :] = False
    there[0, : H // 2] = False
    return there


def turned_out(there: Mask) -> Freeing:
    """Takes out what turns the parts about the origin, of the entries that are there: it mixes
    the axes.
    """
    places = np.random.default_rng(5).normal(size=(there.shape[1], 2))
    arm = np.stack([-places[:, 1], places[:, 0]], axis=1) * there[:, :, None]
    size = np.einsum("pha,pha->p", arm, arm)

    def free(tables: Floats) -> Floats:
        amount = np.einsum("...pha,pha->...p", tables, arm) / size
        return np.asarray(tables - amount[..., None, None] * arm)

    return free


def frame_of(strata: Strata, observed: Mask) -> Frame:
    return Frame(strata=strata, completion=completion(observed, strata.smooth), freeing=None)


def whole_frame(strata: Strata) -> Frame:
    return frame_of(strata, np.ones(strata.shape[:2], bool))


def sizes(strata: Strata, missing: int = 0) -> Floats:
    """Degrees of freedom (S,): what is missing is missing in the interaction."""
    return np.array(
        [s.size - (missing if s.kind == "interaction" else 0) for s in strata.all], float
    )


def nothing_known(strata: Strata) -> KnownScatter:
    n = strata.shape[2] * (1 + strata.lines)
    return KnownScatter(np.zeros((n, n)), np.zeros((n, 0)), np.inf)


def null(
    strata: Strata,
    *,
    interaction: Floats,
    column: Floats,
    part: Floats,
    reversal: Floats | None = None,
    common: Floats | None = None,
    dof: float = np.inf,
    part_dof: float = np.inf,
) -> NullModel:
    """A null model; `part` is the covariance of a part's coordinates, known with `part_dof`."""
    n = len(part)
    return NullModel(
        interaction=interaction,
        column=column,
        reversal=np.zeros(len(interaction)) if reversal is None else reversal,
        part=part,
        with_noise=part + np.diag(np.repeat(interaction, 1 + strata.lines)),
        part_dof=part_dof,
        common=np.zeros((n, 0)) if common is None else common,
        predicted_part=np.zeros((n, n)),
        model_dof=dof,
    )


def levers(strata: Strata) -> Floats:
    """(P, H, A, A (1 + k)): what a unit of each of a part's coordinates does to its entries."""
    P, H, A = strata.shape
    k = strata.lines
    found = np.zeros((P, H, A, A * (1 + k)))
    for a in range(A):
        found[:, :, a, a * (1 + k) : (a + 1) * (1 + k)] = strata.columns[:, : 1 + k]
    return found


def dense_covariance(strata: Strata, model: NullModel) -> Floats:
    """(P H A) x2, entry by entry: part, column, reversal, coefficients and residual.

    Columns scatter along what is even (all but the reversals), reversals along what is odd.
    """
    P, H, A = strata.shape
    L = levers(strata)
    odd = strata.columns[:, strata.odd]
    even = np.eye(H) - odd @ odd.T
    V = np.zeros((P, H, A, P, H, A))
    common = model.common @ model.common.T / P
    for p in range(P):
        for q in range(P):
            V[p, :, :, q] += np.einsum("hai,ij,gbj->hagb", L[p], common, L[q])
            for a in range(A):
                V[p, :, a, q, :, a] += model.column[a] * even + model.reversal[a] * odd @ odd.T
        V[p, :, :, p] += np.einsum("hai,ij,gbj->hagb", L[p], model.part, L[p])
        for a in range(A):
            V[p, :, a, p, :, a] += model.interaction[a] * np.eye(H)
    return V.reshape(P * H * A, P * H * A)


def expected(
    frame: Frame, model: NullModel, dof: Floats, squares: ExpectedSquares | None = None
) -> MeanSquares:
    """The mean squares that tables of a null have on average, by those of the frame or others."""
    return (squares or frame.squares).of(
        interaction=model.interaction,
        column=model.column,
        reversal=model.reversal,
        part=model.part,
        common=model.common @ model.common.T,
        dof=dof,
    )


def coordinate_matrix(frame: Frame) -> Floats:
    """(N, P H A): the coordinates of every single entry."""
    shape = frame.strata.shape
    n = int(np.prod(shape))
    return frame.coordinates(np.eye(n).reshape(n, *shape))[0].T


def within(found: Floats, expected: Floats, error: Floats, deviations: float = 5.0) -> bool:
    """Whether all lie within so many Monte Carlo standard errors."""
    return bool((np.abs(found - expected) <= deviations * error + 1e-12).all())
