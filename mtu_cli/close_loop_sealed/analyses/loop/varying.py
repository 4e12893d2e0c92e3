"""What an effect that is the same in all parts would be at 20 degC beside one of a temperature.

Where all parts were made at nearly one temperature far from 20 degC a scale was found, and a growth
is not told by what varies: the scale c is that of these days. With a growth g beside it, counted
from T_z, it is c - g (T_z - 20) at 20 degC. The same holds of an offset and a drift, of a
squareness and its change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.same_in_all import Constant, beside_all, vary_alike
from mtu_cli.close_loop_sealed.analyses.loop.same_strata import NEARLY
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.part import REFERENCE_TEMPERATURE
from mtu_cli.stats.least_squares import FloatArray, least_squares

THERMAL = "thermal-"
"""How the families of effects that are of a temperature begin."""


@dataclass(frozen=True, slots=True)
class AtReference:
    """What a step is at 20 degC: `value` and `u`, beside `constant`, the surest of those that
    have its shape; `p` is that of all of these (Sidak).
    """

    value: float
    u: float
    constant: Constant
    p: float


@dataclass(frozen=True, slots=True)
class _Like:
    """A member that is a found shape times `ratio` (T - `zero`); `mean` of T over the data."""

    index: int
    member: int
    ratio: float
    zero: float
    mean: float


def at_reference(
    prepared: Prepared, steps: Sequence[Step], step: Step, found: tuple[float, float]
) -> AtReference | None:
    """What a step of one parameter, `found` (value, u) at the mean temperature, is at 20 degC
    beside the surest effect of a temperature that has its shape. None where there is none, or one
    is found already.
    """
    members = [own.member for own in steps if own.member >= 0]
    of = _coefficient(prepared, members, step)
    return _at_reference(prepared, steps, _shape(prepared, step), of, found)


def level_at_reference(
    prepared: Prepared, steps: Sequence[Step], axis: int, found: tuple[float, float]
) -> AtReference | None:
    """The same of the level along an axis that an effect owns: the constant of its equation."""
    shape = {axis: np.ones(prepared.table.there.shape[1])}
    return _at_reference(prepared, steps, shape, -1, found)


def _at_reference(
    prepared: Prepared,
    steps: Sequence[Step],
    shape: dict[int, FloatArray] | None,
    of: int,
    found: tuple[float, float],
) -> AtReference | None:
    members = [own.member for own in steps if own.member >= 0]
    beside = []
    for like in _alike(prepared, steps, shape):
        own = beside_all(prepared, members, max(of, 0), like.index, like.member)
        if own is not None:
            beside.append((own, like))
    if not beside:
        return None
    own, like = min(beside, key=lambda pair: pair[0].p)
    # An offset is the mean error of the data, which its coefficients are free of.
    zero = like.zero if of >= 0 else like.mean
    by = like.ratio * (zero - REFERENCE_TEMPERATURE)
    value, variance, together = found[0], found[1] ** 2, 0.0
    if of >= 0:
        value, variance = float(own.beta[of]), float(own.covariance[of, of])
        together = float(own.together[of])
    u = float(np.sqrt(max(variance + (by * own.u) ** 2 - 2 * by * together, 0.0)))
    p = float(-np.expm1(len(beside) * np.log1p(-min(own.p, 1 - 1e-16))))
    return AtReference(value - by * own.value, u, own, p)


def _coefficient(prepared: Prepared, members: Sequence[int], step: Step) -> int:
    """Where a step stands among all coefficients; -1 of an offset, which is not one of them."""
    if step.member < 0:
        return -1
    place = members.index(step.member)
    return sum(len(prepared.members[m].columns) for m in members[:place])


def _alike(
    prepared: Prepared, steps: Sequence[Step], shape: dict[int, FloatArray] | None
) -> Iterator[_Like]:
    """The members of temperatures, one of a candidate, that have a shape (`_shape`)."""
    scan, known = prepared.scan, {own.index for own in steps}
    flat = scan.flat()
    every = [c for own in steps if own.member >= 0 for c in flat[own.member]]
    done: set[int] = set()
    for index, m, member in scan.walk():
        own = prepared.members[m]
        family = prepared.candidates[index].family
        thermal = family.startswith(THERMAL) and is_temperature(own.covariate or "")
        if not thermal or index in known | done or len(member) != 1 or own.searched:
            continue
        if shape is None or any(vary_alike(scan, member[0], column) for column in every):
            continue
        like = _times(prepared.table, own, shape)
        if like is not None:
            done.add(index)
            yield _Like(index, m, *like)


def _shape(prepared: Prepared, step: Step) -> dict[int, FloatArray] | None:
    """The levers (H,) by axis of an effect of one parameter that is the same in all parts."""
    scan, H = prepared.scan, prepared.table.there.shape[1]
    if step.member < 0:
        offset = step.index - len(scan.columns)
        return {scan.offsets[offset]: np.ones(H)} if 0 <= offset < len(scan.offsets) else None
    own = prepared.members[step.member]
    if own.covariate is not None or len(own.columns) != 1 or own.searched:
        return None
    found = {}
    for axis, lever in own.columns[0].items():
        whole = np.broadcast_to(lever, prepared.table.there.shape)
        if np.ptp(whole, axis=0).any():
            return None
        found[axis] = whole[0]
    return found


def _times(
    table: ResidualTable, member: Member, shape: dict[int, FloatArray]
) -> tuple[float, float, float] | None:
    """(ratio, zero, mean of T) of a member that is a shape times ratio (T - zero), None where it
    is not.
    """
    (column,) = member.columns
    there = table.there
    if column.keys() != shape.keys() or member.covariate not in table.covariates:
        return None
    T = np.broadcast_to(table.covariates[member.covariate], there.shape)[there]
    levers = [np.broadcast_to(own, there.shape)[there] for own in column.values()]
    shapes = [np.broadcast_to(shape[axis], there.shape)[there] for axis in column]
    y, s = np.concatenate(levers), np.concatenate(shapes)
    fit = least_squares(np.column_stack([s * np.tile(T - T.mean(), len(levers)), s]), y)
    slope, level = fit.coefficients.tolist()
    if fit.rank < 2 or not slope or fit.rss > NEARLY * float(y @ y):
        return None
    return slope, float(T.mean() - level / slope), float(T.mean())
