"""From a table of residuals and its candidates to what the search works on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.directions import (
    reversal_pairs,
    scatter_directions,
    smooth_directions,
)
from mtu_cli.close_loop_sealed.analyses.loop.freedoms import (
    degrees_of_freedom,
    fitted_powers,
    freeing,
    places_of,
)
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.model.effect_library import Candidate, Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns
from mtu_cli.close_loop_sealed.stats.crossed import completion
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame, grouped
from mtu_cli.close_loop_sealed.stats.loop_null import KnownScatter, NullModel, null_of, whitening_of
from mtu_cli.close_loop_sealed.stats.remainder import remainder_of
from mtu_cli.close_loop_sealed.stats.strata import Strata, strata_of
from mtu_cli.stats.least_squares import FloatArray

FEWEST_FOR_OFFSET = 3
"""Parts from whose scatter a common offset can be told."""
FEWEST_FOR_SCATTER = 5
ROUNDING = 1e-11
"""Share of the largest error that is rounding of it."""


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A table ready to be searched.

    `candidates` in the scan's order, those that cannot be tested left out; `members` all
    members of the mean candidates end to end, `means` (k, A) the grand means of their columns,
    `tangents` their derivatives by what was searched. `scan` belongs to the errors `y` (N,),
    `grand` (A,).
    """

    table: ResidualTable
    source: tuple[Candidate, ...]
    candidates: tuple[Candidate, ...]
    members: tuple[Member, ...]
    means: Mapping[int, FloatArray]
    tangents: Mapping[int, MemberColumns]
    scan: Scan
    y: FloatArray
    grand: FloatArray
    known: KnownScatter

    def with_table(self, table: ResidualTable) -> Prepared:
        """The same parts, columns and covariates with other errors: null and whitening are
        theirs. What is missing may differ.
        """
        if not np.array_equal(table.there, self.table.there):
            return prepare(table, self.source, self.known.dof)
        y, grand = _coordinates(self.scan.frame, table)
        return self.with_null_of(y, replace(self, table=table, y=y, grand=grand))

    def with_null_of(self, left: FloatArray, other: Prepared | None = None) -> Prepared:
        """With the null, and so the whitening, that coordinates `left` (N,) give."""
        scan = self.scan
        null = null_of(scan.frame, left, scan.dof, self.known)
        return replace(other or self, scan=scan_with_null(scan, null))

    def flat(self) -> list[MemberColumns]:
        """The coordinates of all members, end to end."""
        return self.scan.flat()

    def whole(self, members: Sequence[int]) -> list[MemberColumns]:
        """The coordinates of these members in all strata, also where they are not tested."""
        frame = self.scan.frame
        if frame.freeing is None and frame.completion.complete:
            flat = self.flat()
            return [flat[m] for m in members]
        return list(grouped(frame.whole_columns, [self.members[m].columns for m in members]))

    def with_tangents(self, members: Sequence[int]) -> list[MemberColumns]:
        """The coordinates of these members, and of their derivatives by what was searched."""
        flat = self.flat()
        found = []
        for m in members:
            found.append(flat[m])
            if m in self.tangents:
                found.append(self.tangents[m])
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """The mean candidates of which the data can see members, with their coordinates."""

    columns: tuple[tuple[MemberColumns, ...], ...]
    members: tuple[Member, ...]
    means: dict[int, FloatArray]
    tangents: dict[int, MemberColumns]
    candidates: tuple[Candidate, ...]


def prepare(
    table: ResidualTable, candidates: Sequence[Candidate], pass_dof: float = np.inf
) -> Prepared:
    """Strata, null and the candidates' columns of a table; see `Prepared`.

    `pass_dof` are the degrees of freedom of the predicted scatter of parts.
    """
    P, _, A = table.errors.shape
    strata = strata_of(P, smooth_directions(table), A, reversal_pairs(table))
    filling = completion(table.there, strata.smooth)
    frame = Frame(strata=strata, completion=filling, freeing=freeing(table))
    known = KnownScatter(*_factors(table, strata), pass_dof, _of_rounding(table))
    chosen = _testable(table, candidates, strata)
    seen = _columns(table, frame, chosen)
    y, grand = _coordinates(frame, table)
    scan, ordered = _scan(table, frame, known, chosen, seen, y)
    return Prepared(
        table=table,
        source=tuple(candidates),
        candidates=ordered,
        members=seen.members,
        means=seen.means,
        tangents=seen.tangents,
        scan=scan,
        y=y,
        grand=grand,
        known=known,
    )


def _coordinates(frame: Frame, table: ResidualTable) -> tuple[FloatArray, FloatArray]:
    """Coordinates and grand means of a table's errors; what is rounding of them is 0."""
    errors = np.where(np.isfinite(table.errors), table.errors, 0.0)
    y, grand = frame.coordinates(errors)
    return without_rounding(table, y), grand


def without_rounding(table: ResidualTable, y: FloatArray) -> FloatArray:
    """Coordinates (N,) of what is in a table, 0 where they are rounding of its errors."""
    largest = float(np.abs(table.errors[table.there]).max(initial=0.0))
    least = ROUNDING * largest * np.sqrt(table.errors[..., 0].size)
    return np.where(np.abs(y) > least, y, 0.0)


def _scan(
    table: ResidualTable,
    frame: Frame,
    known: KnownScatter,
    chosen: Sequence[Candidate],
    seen: _Seen,
    y: FloatArray,
) -> tuple[Scan, tuple[Candidate, ...]]:
    """The scan of coordinates `y`, and all its candidates in their order."""
    strata, dof = frame.strata, degrees_of_freedom(table, frame)
    powers = frame.columns(fitted_powers(table))
    offsets = [c for c in chosen if c.kind == "offset"]
    scatters = [c for c in chosen if c.kind == "scatter"]
    ordered = (*seen.candidates, *offsets, *scatters)
    null = null_of(frame, y, dof, known)
    whitening = whitening_of(strata, null)
    directions = scatter_directions(table, strata)
    scan = Scan(
        frame=frame,
        dof=dof,
        whitening=whitening,
        names=tuple(c.name for c in ordered),
        columns=seen.columns,
        base=(tuple(column for column in powers if column),) if powers else (),
        offsets=tuple(table.axes.index(c.axis or table.axes[0]) for c in offsets),
        scatters=tuple(c.name for c in scatters),
        remainder=remainder_of(strata, whitening, places_of(table)),
        null=null,
        operation=table.operation,
        directions=directions,
        turns=frame.direction_noise(directions, known.part) if scatters else (),
        predicted_dof=known.dof,
        least=_of_rounding(table)[[stratum.axis for stratum in strata.all]],
        parts_scatter=not table.scatter_known,
        readings=table.component is not None,
    )
    return scan, ordered


def _of_rounding(table: ResidualTable) -> FloatArray:
    """Variance (A,) that rounding alone gives an entry: a twelfth of the squared step, over the
    repeats of a cell (GUM, F.2.2.1).
    """
    steps = np.zeros(len(table.axes))
    steps[: len(table.resolution)] = table.resolution
    found: FloatArray = steps**2 / (12 * float(table.repeats.max(initial=1)))
    return found


def scan_with_null(scan: Scan, null: NullModel) -> Scan:
    """The scan with another null: its whitening, and the kernels in it, follow."""
    whitening = whitening_of(scan.frame.strata, null)
    remainder = scan.remainder.whitened(whitening)
    return replace(scan, null=null, whitening=whitening, remainder=remainder)


def _factors(table: ResidualTable, strata: Strata) -> tuple[FloatArray, FloatArray]:
    """The predicted covariance of a part's coordinates, and the factor of the coefficients'."""
    P, _, A = strata.shape
    k = strata.lines
    basis = strata.columns[:, : 1 + k]

    def coordinates(factor: FloatArray) -> FloatArray:
        turned = np.einsum("hj,phar->pajr", basis, factor)
        found: FloatArray = turned.reshape(len(factor), A * (1 + k), factor.shape[3])
        return found

    parts = coordinates(table.of_part)
    predicted: FloatArray = np.einsum("pir,pjr->ij", parts, parts) / len(parts)
    common: FloatArray = coordinates(table.common).mean(axis=0) * np.sqrt(P)
    return predicted, common


def _testable(
    table: ResidualTable, candidates: Sequence[Candidate], strata: Strata
) -> list[Candidate]:
    P = len(table.parts)
    found = []
    for candidate in candidates:
        if candidate.unavailable is not None:
            continue
        if candidate.kind == "offset" and (
            P < FEWEST_FOR_OFFSET or table.datum != "none" or table.fitted_degree >= 0
        ):
            continue
        if candidate.kind == "scatter" and not _scatter_testable(candidate.name, table, strata):
            continue
        found.append(candidate)
    return found


def _scatter_testable(name: str, table: ResidualTable, strata: Strata) -> bool:
    if len(table.parts) < FEWEST_FOR_SCATTER or strata.find("interaction", 0) is None:
        return False
    if name == "operation-scatter":
        return len(table.operations) > 1
    if name == "rotation-scatter" and table.datum == "offset,rotation":
        return False
    return {"x", "y"} <= set(table.axes) and strata.lines >= 2


def _columns(table: ResidualTable, frame: Frame, candidates: Sequence[Candidate]) -> _Seen:
    """Coordinates of the members that the data can see, with their means and tangents."""
    columns: list[tuple[MemberColumns, ...]] = []
    members: list[Member] = []
    means: dict[int, FloatArray] = {}
    tangents: dict[int, MemberColumns] = {}
    kept: list[Candidate] = []
    for candidate in candidates:
        own: list[MemberColumns] = []
        seen = grouped(frame.columns, [member.columns for member in candidate.members])
        tangent = grouped(frame.columns, [member.tangent for member in candidate.members])
        for member, coordinates, sloped in zip(candidate.members, seen, tangent, strict=True):
            if not all(coordinates):
                continue
            index = len(members)
            members.append(member)
            own.append(coordinates)
            means[index] = np.array([frame.means(column) for column in member.columns])
            turned = tuple(column for column in sloped if column)
            if turned:
                tangents[index] = turned
        if own:
            columns.append(tuple(own))
            kept.append(candidate)
    return _Seen(
        columns=tuple(columns),
        members=tuple(members),
        means=means,
        tangents=tangents,
        candidates=tuple(kept),
    )
