"""Points that no machine made, or that no CMM measured there: units, axes, origins, slips."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.checks import Odd, PointsData, check
from mtu_cli.checks.plausible import COORDINATES, POINT_ERROR_MM, SAME_MM
from mtu_cli.model.datum import freed
from mtu_cli.model.visits import axes_of, operations_of, visits_of
from mtu_cli.stats.outliers import group_medians, numbered, outlying

Rows = NDArray[np.int64]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
EXPLAINED = 0.1
"""A mistake is named where undoing it leaves less than this share of the distance."""
FEWEST = 3
"""Points from which on an origin or an order can be told from single slips."""
MOST = 5000
"""Points of a part up to which another order of its features is looked for."""
NEARLY_ALL = 0.9
RELATED = 0.99


class Mistake(NamedTuple):
    """What points look like, and whether it is a unit."""

    looks: str
    unit: bool = False


UNKNOWN = Mistake("no unit, sign, order or origin explains it")


def off(data: PointsData) -> tuple[Floats, tuple[int, ...]]:
    """Measured minus nominal (n, axes) less the freedoms of the datum, mm, and the axes."""
    axes = axes_of(data.table)
    loose, _ = freed(data.table, axes, data.datum)
    return (loose.measured - loose.nominal)[:, axes], axes


def typical(errors: Floats) -> float:
    """The median over points (n, axes) of the largest error along an axis."""
    return float(np.median(np.abs(errors).max(axis=1)))


def mistake_of(data: PointsData, rows: Rows, axes: tuple[int, ...]) -> Mistake:
    """The one mistake that explains where points `rows` are.

    The mistakes are tried from the likeliest on; undone, nearly all points lie where they belong.
    With a datum each part's own origin is none.
    """
    measured, nominal = (of[rows][:, axes] for of in (data.table.measured, data.table.nominal))
    part = None if data.datum == "none" else numbered(data.table.part[rows])
    now = typical(_less_origin(measured - nominal, part))
    near = min(EXPLAINED * now, POINT_ERROR_MM)

    def explained(errors: Floats) -> bool:
        left = _less_origin(errors, part)
        return float(np.quantile(np.abs(left).max(axis=1), NEARLY_ALL)) < near

    letters = "xyz"[: measured.shape[1]]
    for unit, factor in COORDINATES.items():
        if explained(measured * factor - nominal):
            return Mistake(f"{unit}, not mm", unit=True)
        for k, letter in enumerate(letters):
            one = np.where(np.arange(len(letters)) == k, factor, 1.0)
            if explained(measured * one - nominal):
                return Mistake(f"{letter} alone in {unit}, not mm", unit=True)
    if len(measured) < FEWEST:
        return UNKNOWN
    shift = np.median(measured - nominal, axis=0)
    if explained(measured - nominal - shift):
        return Mistake(f"another origin, off by {', '.join(f'{value:.3g}' for value in shift)} mm")
    for words, left in _orders(measured, nominal, letters):
        if explained(left):
            return Mistake(words)
    if _shuffled(measured, nominal, near):
        return Mistake("features in another order")
    if _are_errors(measured, nominal):
        return Mistake("errors, not the coordinates that they are errors of")
    return UNKNOWN


def _less_origin(errors: Floats, part: Rows | None) -> Floats:
    """Errors (n, axes) less the median of each `part` (n,); as they are where that is None."""
    if part is None:
        return errors
    found: Floats = errors - np.column_stack([group_medians(each, part) for each in errors.T])
    return found


def _orders(measured: Floats, nominal: Floats, letters: str) -> Iterator[tuple[str, Floats]]:
    """Other orders and ways round of the axes with what each leaves, the fewest changes first.

    An axis that runs the other way has a zero of its own. One along which all places are alike has
    no way round.
    """
    count = len(letters)
    flat = np.ptp(nominal, axis=0) <= POINT_ERROR_MM
    every = [*product(permutations(range(count)), product((False, True), repeat=count))]
    every.sort(key=lambda each: sum(np.not_equal(each[0], range(count))) + sum(each[1]))
    for order, turned in every[1:]:
        if not (flat & turned).any():
            left = measured[:, order] * np.where(turned, -1.0, 1.0) - nominal
            left = left - np.where(turned, np.median(left, axis=0), 0.0)
            moved = [letter for i, letter in enumerate(letters) if order[i] != i]
            other = [letters[i] for i in range(count) if turned[i]]
            words = [f"{' and '.join(moved)} swapped"] if moved else []
            words += [f"the sign of {' and '.join(other)} the other way round"] if other else []
            yield ", ".join(words), left


def _shuffled(measured: Floats, nominal: Floats, near: float) -> bool:
    """Whether the points are at places of the part, most of them at another's, each at its own."""
    if len(measured) > MOST:
        return False
    from scipy.spatial import KDTree

    away, which = KDTree(nominal).query(measured)
    at = np.asarray(away) < max(near, SAME_MM) * np.sqrt(nominal.shape[1])
    which = np.asarray(which)
    moved = (nominal[which] != nominal).any(axis=1)
    taken, there = (len(np.unique(nominal[rows], axis=0)) for rows in (which[at], slice(None)))
    share = np.mean(at) >= NEARLY_ALL and taken >= NEARLY_ALL * there
    return bool(share and 2 * np.count_nonzero(moved & at) > len(moved))


def _are_errors(measured: Floats, nominal: Floats) -> bool:
    """Values much smaller than the coordinates, and in the order of none of them."""
    if typical(measured) >= 0.5 * typical(nominal):
        return False
    columns = [*measured.T, *nominal.T]
    spread = np.array([np.std(column) for column in columns])
    if not spread.all():
        return True
    count = measured.shape[1]
    related = np.abs(np.corrcoef(columns)[:count, count:])
    return bool((related < RELATED).all())


def whole_files(data: PointsData) -> Iterator[tuple[Rows, float, Mistake]]:
    """The rows of each file most of whose points are far off, how far, and the mistake."""
    errors, axes = off(data)
    if not axes or not (np.abs(errors) > POINT_ERROR_MM).any():
        return
    for file in np.unique(data.table.file_index):
        rows = np.flatnonzero(data.table.file_index == file)
        if (size := typical(errors[rows])) > POINT_ERROR_MM:
            yield rows, size, mistake_of(data, rows, axes)


@check("unit-of-points", of="points")
def unit_of_points(data: PointsData) -> Iterator[Odd]:
    """A file in another unit."""
    for rows, size, mistake in whole_files(data):
        if mistake.unit:
            yield Odd(rows, {"off": size, "looks": mistake.looks})


@check("far-from-nominal", of="points")
def far_from_nominal(data: PointsData) -> Iterator[Odd]:
    """Files, measurements of a part, features and single points farther off than a machine errs."""
    errors, axes = off(data)
    if not axes or not (np.abs(errors) > POINT_ERROR_MM).any():
        return
    table = data.table
    left = np.asarray((np.abs(errors) > POINT_ERROR_MM).any(axis=1))
    for rows, size, mistake in whole_files(data):
        left[rows] = False
        if not mistake.unit:
            yield Odd(rows, {"what": "the points", "off": size, "looks": mistake.looks})
    found: dict[str, list[Rows]] = {}
    for group in (table.part, visits_of(table).of_point):
        for code in np.unique(group[left]):
            rows = np.flatnonzero(group == code)
            if 2 * np.count_nonzero(left[rows]) > len(rows):
                mistake = mistake_of(data, rows, axes)
                if mistake is not UNKNOWN:
                    found.setdefault(mistake.looks, []).append(rows)
                    left[rows] = False
    for looks, groups in found.items():
        names = dict.fromkeys(table.parts[table.part[rows[0]]] for rows in groups)
        rows = np.concatenate(groups)
        what = f"part{'s' if len(names) > 1 else ''} {', '.join(map(repr, names))}"
        yield Odd(rows, {"what": what, "off": typical(errors[rows]), "looks": looks})
    yield from _single(data, errors, axes, left)


def _single(data: PointsData, errors: Floats, axes: tuple[int, ...], left: Mask) -> Iterator[Odd]:
    """Features that are off in all parts, and single values with the slip that explains each."""
    table = data.table
    for code in np.unique(table.feature[left]):
        rows = np.flatnonzero(table.feature == code)
        if left[rows].all() and len(np.unique(table.part[rows])) > 1:
            left[rows] = False
            mistake = mistake_of(data, rows, axes)
            looks = mistake.looks if mistake.unit else "its nominal place mistyped"
            what = f"feature {table.features[code]!r} in every part"
            yield Odd(rows, {"what": what, "off": typical(errors[rows]), "looks": looks})
    for i in np.flatnonzero(left)[:MOST]:
        k = int(np.argmax(np.abs(errors[i])))
        value, place = (float(of[i, axes[k]]) for of in (table.measured, table.nominal))
        looks = f"{_slip(value, place)}; about {place:.9g} is expected"
        what, column = f"a point of part {table.parts[table.part[i]]!r}", f"{'xyz'[axes[k]]}_mm"
        facts = {"what": what, "off": abs(float(errors[i, k])), "looks": looks}
        yield Odd(np.array([i]), facts, column, f"{value:.9g}")


def _slip(value: float, place: float) -> str:
    """The slip of one coordinate that would bring it to its place."""

    def near(changed: float) -> bool:
        return abs(changed - place) < max(POINT_ERROR_MM, 1e-3 * abs(place))

    if near(-value):
        return "a lost sign"
    if any(near(value / 10.0**digits) for digits in range(-3, 7)):
        return "a decimal point out of place"
    return "a mistyped digit, or another feature"


@check("nominals-differ", of="points")
def nominals_differ(data: PointsData) -> Iterator[Odd]:
    """A feature with several nominal places."""
    table = data.table
    first = np.unique(table.feature, return_index=True)[1]
    place = np.full((len(table.features), 3), np.nan)
    place[table.feature[first]] = table.nominal[first]
    away = np.abs(table.nominal - place[table.feature]) > SAME_MM
    if len(rows := np.flatnonzero(away.any(axis=1))):
        names = [table.features[code] for code in np.unique(table.feature[rows])]
        yield Odd(rows, {"names": names})


@check("outlying-point", of="points")
def outlying_point(data: PointsData) -> Iterator[Odd]:
    """Single readings far off what the other parts have there, or the other repeats.

    Errors are compared among the parts of a feature and operation, each visit's own offset taken
    off where it has points enough, and repeats among themselves by their difference.
    """
    table = data.table
    errors, axes = off(data)
    _, operation = operations_of(table)
    feature = operation * len(table.features) + table.feature
    place = numbered(feature)
    visit = visits_of(table).of_point
    far = (np.abs(errors) > POINT_ERROR_MM).any(axis=1)
    for k, axis in enumerate(axes):
        own = errors[:, k] - group_medians(errors[:, k], place)
        several = np.bincount(visit)[visit] > FEWEST
        own = own - np.where(several, group_medians(own, visit), 0.0)
        found, s = outlying(own, place)
        paired, s_paired = _repeats(own, place * len(table.parts) + table.part)
        for rows, scatter, beside in (
            (np.flatnonzero(found & ~far), s, "the other parts"),
            (np.flatnonzero(paired & ~found & ~far), s_paired, "its other repeats"),
        ):
            if len(rows):
                worst = rows[np.argmax(np.abs(own[rows]))]
                facts = {
                    "axis": "xyz"[axis],
                    "off": 1e3 * abs(float(own[worst])),
                    "s": 1e3 * scatter,
                }
                value = f"{table.measured[worst, axis]:.9g}"
                order = np.r_[worst, rows[rows != worst]]
                yield Odd(order, {**facts, "beside": beside}, f"{'xyz'[axis]}_mm", value)


def _repeats(own: Floats, cell: Rows) -> tuple[NDArray[np.bool_], float]:
    """Which values (n,) differ too much from the repeat before or after them, and the s of these.

    Of two repeats that are apart the one farther from the other parts is meant.
    """
    order = np.argsort(cell, kind="stable")
    pair = np.flatnonzero(np.diff(cell[order]) == 0)
    one, other = order[pair], order[pair + 1]
    apart, s = outlying(own[other] - own[one], np.zeros(len(pair), np.int64))
    found = np.zeros(len(own), bool)
    found[np.where(np.abs(own[one]) > np.abs(own[other]), one, other)[apart]] = True
    return found, s / np.sqrt(2.0)
