"""Some of the parts, or of the columns, of a table and of its candidates' columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.shape_prior import shape_weights
from mtu_cli.close_loop_sealed.model.effect_candidate import CENTRED
from mtu_cli.close_loop_sealed.model.effect_library import Candidate, Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

SHOWN = 0.02
"""Share of a column's variance that a fold must keep: what it hardly shows it cannot foretell."""
Identity = tuple[object, ...]


def only_parts(table: ResidualTable, kept: NDArray[np.bool_]) -> ResidualTable:
    """The table of some of its parts, columns that none of them has left out by the caller."""

    def cut(values: FloatArray) -> FloatArray:
        return values[kept] if len(values) == len(kept) and len(kept) > 1 else values

    return replace(
        table,
        parts=tuple(name for name, keep in zip(table.parts, kept, strict=True) if keep),
        errors=table.errors[kept],
        repeats=table.repeats[kept],
        places=table.places[kept],
        covariates={name: cut(values) for name, values in table.covariates.items()},
        common=cut(table.common),
        of_part=cut(table.of_part),
    )


def only_columns(table: ResidualTable, kept: NDArray[np.bool_]) -> ResidualTable:
    """The table of some of its columns."""

    def cut(values: FloatArray) -> FloatArray:
        return values[:, kept] if values.shape[1] == len(kept) and len(kept) > 1 else values

    return replace(
        table,
        features=tuple(name for name, keep in zip(table.features, kept, strict=True) if keep),
        errors=table.errors[:, kept],
        repeats=table.repeats[:, kept],
        places=table.places[:, kept],
        operation=table.operation[kept],
        covariates={name: cut(values) for name, values in table.covariates.items()},
        common=cut(table.common),
        of_part=cut(table.of_part),
    )


@dataclass(frozen=True, kw_only=True)
class Split:
    """What is `kept` to search in, of parts (dimension 0) or columns (1); the gate of what is
    kept is drawn from its own random `stream`.
    """

    dimension: int
    kept: NDArray[np.bool_]
    stream: int

    def cut(self, table: ResidualTable) -> ResidualTable:
        """What is kept of a table."""
        cut = only_parts if self.dimension == 0 else only_columns
        return cut(table, self.kept)


@dataclass(frozen=True, kw_only=True)
class CutCandidates:
    """Candidates at some of the parts or columns; by what `identity` tells of their members,
    `whole` what each of them is on all cells, and `weights` how likely it is before beside the
    others of its candidate.
    """

    candidates: tuple[Candidate, ...]
    whole: Mapping[Identity, Member]
    weights: Mapping[Identity, float]


def cut_candidates(
    candidates: Sequence[Candidate], kept: NDArray[np.bool_], dimension: int
) -> CutCandidates:
    """The candidates' columns at some of the parts (dimension 0) or columns (1).

    Members that what is kept hardly shows are left out: a warm-up without the first parts. Of
    members that are the same on what is kept, such as steps between the same two parts, one is
    kept; on all cells it is their mean, and as likely as all together, as each of them may be
    meant. An equation keeps its centre:
    what has no mean over all cells has one over some of them, and no level of its own for that.
    """

    def cut(values: FloatArray) -> FloatArray:
        if values.shape[dimension] != len(kept) or len(kept) == 1:
            return values
        return values[kept] if dimension == 0 else values[:, kept]

    def cut_all(
        columns: Sequence[Mapping[int, FloatArray]],
    ) -> tuple[dict[int, FloatArray], ...]:
        return tuple({a: cut(v) for a, v in column.items()} for column in columns)

    own, whole, weights = [], {}, {}
    for candidate in candidates:
        members = []
        weight = dict(
            zip(map(id, candidate.members), shape_weights(candidate.members), strict=True)
        )
        for same in _alike([m for m in candidate.members if _shown(m.columns, cut)], cut):
            m = same[len(same) // 2]
            columns, tangent = cut_all(m.columns), cut_all(m.tangent)
            members.append(
                replace(m, columns=columns, tangent=tangent, centred=m.centred | _centred(m))
            )
            name = identity(candidate.name, m)
            whole[name] = _mean_of(same) if len(same) > 1 else m
            weights[name] = sum(weight[id(one)] for one in same)
        own.append(replace(candidate, members=tuple(members)))
    return CutCandidates(candidates=tuple(own), whole=whole, weights=weights)


Cut = Callable[[FloatArray], FloatArray]


def _centred(member: Member) -> frozenset[int]:
    """The axes along which no column has a mean."""
    means: dict[int, list[float]] = {}
    sizes: dict[int, list[float]] = {}
    for column in member.columns:
        for axis, values in column.items():
            means.setdefault(axis, []).append(abs(float(values.sum()) / values.size))
            sizes.setdefault(axis, []).append(sqrt(float((values**2).sum()) / values.size))
    return frozenset(axis for axis in means if max(means[axis]) <= CENTRED * max(sizes[axis]))


def _shown(columns: Sequence[Mapping[int, FloatArray]], cut: Cut) -> bool:
    """Whether what is kept shows enough of every column's variance to say something of the rest."""
    for column in columns:
        for values in column.values():
            kept = cut(values)
            if _variance(kept) < SHOWN * _variance(values):
                return False
    return True


def _variance(values: FloatArray) -> float:
    """As numpy's, which takes longer to begin than to sum: there are thousands of columns."""
    off = values - float(values.sum()) / values.size
    return float((off * off).sum()) / values.size


def _alike(members: Sequence[Member], cut: Cut) -> Iterable[list[Member]]:
    """The members, those together that are the same on what is kept."""
    groups: dict[object, list[Member]] = {}
    for member in members:
        key = tuple(
            (axis, values.shape, np.round(cut(values), 12).tobytes())
            for column in member.columns
            for axis, values in column.items()
        )
        groups.setdefault(key, []).append(member)
    return groups.values()


def _mean_of(members: Sequence[Member]) -> Member:
    """A member with the mean of the columns of some that have the same shape."""
    first = members[0]
    columns = tuple(
        {axis: np.mean([m.columns[j][axis] for m in members], axis=0) for axis in column}
        for j, column in enumerate(first.columns)
    )
    return replace(first, columns=columns)


def identity(name: str, member: Member) -> Identity:
    """What tells a candidate's members apart, on all cells as on some."""
    return (
        name,
        tuple(sorted(member.equations.items())),
        tuple(sorted(member.searched.items())),
        member.chosen,
        member.parameters,
        member.covariate,
    )
