"""How far apart effects are in parts that do not exist yet, in standard deviations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.directions import reversal_pairs, smooth_directions
from mtu_cli.close_loop_sealed.analyses.loop.freedoms import fitted_powers, freeing
from mtu_cli.close_loop_sealed.analyses.loop.further_parts import FollowUp
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.model.effect_candidate import Column, Member
from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.column_groups import whiten
from mtu_cli.close_loop_sealed.stats.crossed import completion
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame, grouped
from mtu_cli.close_loop_sealed.stats.loop_null import NullModel, whitening_of
from mtu_cli.close_loop_sealed.stats.strata import Strata, strata_of
from mtu_cli.language import evaluate, linear_form, parse
from mtu_cli.stats.least_squares import FloatArray, least_squares, shortened

Seen = dict[int, FloatArray]
"""The coordinates of a column, by the number of the stratum that they lie in."""
TOGETHER = 256
"""Members whose columns are turned at once."""


def member_columns(
    member: Member, table: ResidualTable, plan: FollowUp, *, new_tool: bool = False
) -> tuple[Column, ...]:
    """The levers of a member's parameters over the table and the further parts.

    Evaluated from its equations; without any, features and operations keep theirs, and a part
    that stands out does so again where it is measured again. `new_tool`: effects of a tool
    begin again with it, whatever counts for it.
    """
    if not member.equations:
        return tuple(
            {axis: _kept(lever, table, plan) for axis, lever in column.items()}
            for column in member.columns
        )
    values = {**plan.values, **plan.new_tool} if new_tool else plan.values
    found: dict[str, Column] = {name: {} for name, _ in member.parameters}
    for key, text in member.equations.items():
        form = linear_form(parse(text), found)
        for name, node in form.coefficients.items():
            lever = np.atleast_2d(np.asarray(evaluate(node, values), float))
            found[name][table.axes.index(key[1:])] = lever
    return tuple(found.values())


def _kept(lever: FloatArray, table: ResidualTable, plan: FollowUp) -> FloatArray:
    if len(table.parts) == 1 or len(lever) == 1:
        return lever
    new = np.zeros((plan.count, lever.shape[1]))
    if plan.copied:
        new = lever[list(plan.copied)]
    return np.concatenate([lever, new])


def has_new_tool(member: Member, plan: FollowUp) -> bool:
    """Whether a new tool begins this member again: not where it is a step that was searched."""
    return member.covariate in plan.new_tool and not member.searched


@dataclass(frozen=True, kw_only=True)
class Sight:
    """Coordinates of columns over a follow-up's parts, in standard deviations of the null.

    Inner products are those of generalised least squares with a free mean of each axis; `root`
    (S,) are one over the standard deviations of the strata. `nuisance` is what is fitted beside
    all columns: what was found, and the polynomial of readings.
    """

    frame: Frame
    whitening: FloatArray
    root: FloatArray
    nuisance: tuple[Seen, ...]

    def columns(self, member: Sequence[Column]) -> tuple[Seen, ...]:
        """The columns of a member."""
        (found,) = self.members([member])
        return found

    def members(self, members: Iterable[Sequence[Column]]) -> Iterator[tuple[Seen, ...]]:
        """The columns of many members, one after the other."""
        left = iter(members)
        while some := list(islice(left, TOGETHER)):
            for own in grouped(self.frame.columns, some):
                yield tuple(self._whitened(column) for column in own)

    def _whitened(self, column: Seen) -> Seen:
        found = {}
        for index, values in column.items():
            own = values * self.root[index]
            whiten(self.frame.strata, self.whitening, index, own)
            found[index] = own
        return found

    def left(self, effects: Mapping[int, Seen], columns: Sequence[Seen] = ()) -> dict[int, float]:
        """The squares that `columns`, fitted beside the nuisances, leave of each effect."""
        Z = self.stacked([*self.nuisance, *columns, *effects.values()])
        rows = shortened(Z)
        X, Y = np.split(rows, [Z.shape[1] - len(effects)], axis=1)
        return {i: least_squares(X, y).rss for i, y in zip(effects, Y.T, strict=True)}

    def stacked(self, columns: Sequence[Seen]) -> FloatArray:
        """The columns side by side, over the strata that any of them lies in."""
        strata = self.frame.strata.all
        blocks = []
        for index in sorted({index for column in columns for index in column}):
            none = np.zeros(strata[index].size)
            blocks.append(np.column_stack([column.get(index, none) for column in columns]))
        return np.concatenate(blocks) if blocks else np.zeros((1, len(columns)))


def combined(columns: Sequence[Seen], beta: FloatArray) -> Seen:
    """The sum of columns times their coefficients (k,)."""
    found: Seen = {}
    for value, column in zip(beta, columns, strict=True):
        for index, own in column.items():
            found[index] = found.get(index, 0.0) + value * own
    return found


def sight_of(prepared: Prepared, plan: FollowUp, beside: Sequence[int] = ()) -> Sight:
    """The view of a follow-up's parts, under the null of `prepared`.

    Variances of the strata follow from those of parts, their smooth directions, columns and
    single entries, and from the number of parts.
    """
    table, old = prepared.table, prepared.scan.frame.strata
    P = len(table.parts)
    # The directions that those of the table were made of: of some of them others would follow.
    along, pairs = smooth_directions(table), reversal_pairs(table)
    strata = strata_of(P + plan.count, along, old.shape[2], pairs)
    grown = (P + plan.count) / P
    null = replace(prepared.scan.null, common=prepared.scan.null.common * np.sqrt(grown))
    whole = longer(table, plan)
    # Where whole parts are free, their means tell nothing.
    offsets = 0.0 if table.datum != "none" else 1.0
    weights = [
        _weight(strata, null, i) * (offsets if s.kind == "part" else 1.0)
        for i, s in enumerate(strata.all)
    ]
    frame = Frame(
        strata=strata,
        completion=completion(whole.there, strata.smooth),
        freeing=freeing(whole),
    )
    plain = Sight(
        frame=frame,
        whitening=whitening_of(strata, null),
        root=np.sqrt(weights),
        nuisance=(),
    )
    known = [member_columns(prepared.members[m], table, plan) for m in beside]
    columns = [*fitted_powers(table), *(column for member in known for column in member)]
    return replace(plain, nuisance=plain.columns(columns))


def _weight(strata: Strata, null: NullModel, index: int) -> float:
    """One over the variance of a coordinate of a stratum; 0 where there is none."""
    s = strata.all[index]
    variance = float(null.interaction[s.axis])
    if s.kind in ("column", "reversal"):
        variance += strata.shape[0] * null.of_columns(s.kind, s.axis)
    elif s.kind != "interaction":
        own = s.axis * (1 + strata.lines) + s.line
        variance += float(null.part[own, own])
    return 1 / variance if variance > 0 else 0.0


def longer(table: ResidualTable, plan: FollowUp) -> ResidualTable:
    """The table with the further parts, all of them measured: all but their errors."""
    P, H, A = table.errors.shape
    return replace(
        table,
        parts=(*table.parts, *(f"+{i + 1}" for i in range(plan.count))),
        errors=np.zeros((P + plan.count, H, A)),
        repeats=np.concatenate([table.repeats, np.ones((plan.count, H), np.int64)]),
        places=plan.places,
        covariates={n: v for n, v in plan.values.items() if n not in POSITIONS},
    )
