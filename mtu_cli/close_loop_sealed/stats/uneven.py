"""Members beside columns of the table that scatter differently: their own share of the variance.

An entry of column h has the variance v_h, on average that of its stratum. A member with the unit
column q in that stratum is then explained by chance with the variance

    f = tr(q K q'),  K = C' diag(v) C / mean,

C (H, J) the stratum's vectors of the columns: what it explains counts over f. Along the smooth
directions of whole parts most of the variance may be the parts' own, not that of the entries;
whitened (W) it is 1 as elsewhere, and only the entries' share W (K - I) W' differs. Parts and
lines hold one vector of the columns each; their own mean square knows its share.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.stats.column_groups import ManyStrata, OneStratum, Packed, whiten
from mtu_cli.stats.least_squares import FloatArray


def uneven(pack: Packed, entry: FloatArray, column: FloatArray) -> Packed:
    """The pack for entries of variances `entry` (H, A), and means of columns of variances
    `column` (H, A), both on any scale.
    """
    strata = pack.strata
    kernels = [_kernel(pack, index, entry, column) for index in range(len(strata.all))]
    return replace(
        pack,
        one=tuple(replace(one, spread=_of_one(one, kernels[one.index])) for one in pack.one),
        many=tuple(replace(many, spread=_of_many(many, kernels)) for many in pack.many),
    )


def _kernel(pack: Packed, index: int, entry: FloatArray, column: FloatArray) -> FloatArray | None:
    """K (J, J), whitened, of a stratum with several vectors of the columns."""
    strata, stratum = pack.strata, pack.strata.all[index]
    if stratum.kind in ("part", "line"):
        return None
    own = {"column": strata.even, "reversal": strata.odd}.get(
        stratum.kind, np.arange(1 + strata.lines, strata.shape[1])
    )
    C = strata.columns[:, own]
    v = (entry if stratum.kind == "interaction" else column)[:, stratum.axis]
    K: FloatArray = (C.T * v) @ C
    level = float(np.trace(K)) / len(K)
    if level <= 0:
        return np.eye(len(K))
    excess = K / level - np.eye(len(K))
    whiten(strata, pack.whitening, index, excess)
    whiten(strata, pack.whitening, index, excess.T)
    return np.eye(len(K)) + excess


def _share(X: FloatArray, K: FloatArray | None) -> FloatArray:
    """f (M,) of columns X (n, M, g), their mean over g; 1 where a column is 0."""
    if K is None:
        return np.ones(X.shape[1])
    rows = X.reshape(-1, len(K), *X.shape[1:])
    size = np.einsum("rjmg,rjmg->m", rows, rows)
    turned = np.tensordot(K, rows, axes=(1, 1))
    own = np.einsum("jrmg,rjmg->m", turned, rows)
    found: FloatArray = np.where(size > 0, own / np.where(size > 0, size, 1.0), 1.0)
    return found


def _of_one(one: OneStratum, K: FloatArray | None) -> FloatArray:
    return _share(one.Q.reshape(len(one.Q), len(one.members), one.g), K)


def _of_many(many: ManyStrata, kernels: list[FloatArray | None]) -> FloatArray:
    found = np.ones((len(many.members), len(kernels)))
    for index, block in many.X.items():
        found[:, index] = _share(block, kernels[index])
    return found
