"""Points that no machine made, or that no CMM measured there: units, axes, origins, slips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mtu_cli.checks import Floats, Mask, Odd, PointsData, Rows, check, split
from mtu_cli.checks.plausible import (
    COORDINATES,
    EXPLAINED,
    FEWEST_POINTS,
    MOST,
    NEARLY_ALL,
    POINT_ERROR_MM,
    RELATED,
)
from mtu_cli.files.points import SAME_MM
from mtu_cli.model.visits import Visits
from mtu_cli.stats.outliers import FEWEST, median_polish, outlying
from mtu_cli.stats.resolution import rounding_variance


class Mistake(NamedTuple):
    """What points look like, and whether it is a unit."""

    looks: str
    unit: bool = False


UNKNOWN = Mistake("no unit, sign, order or origin explains it")


def typical(errors: Floats) -> float:
    """The median over points (n, axes) of the largest error along an axis."""
    return float(np.median(np.abs(errors).max(axis=1)))


def mistake_of(data: PointsData, rows: Rows) -> Mistake:
    """The mistakes of the axes that explain where points `rows` are.

    Along each axis they are tried from the likeliest on; undone, nearly all points lie where they
    belong. With a datum another origin of a part is no mistake.
    """
    measured, nominal = (of[rows][:, data.axes] for of in (data.table.measured, data.table.nominal))
    for part in [] if data.datum == "none" else split(None, data.table.part[rows]):
        measured[part] -= measured[part].mean(axis=0)
        nominal[part] -= nominal[part].mean(axis=0)
    limit = min(EXPLAINED * typical(measured - nominal), POINT_ERROR_MM)
    result: dict[Mistake, list[str]] = {}
    for k, axis in enumerate(data.axes):
        for mistake, errors in _undone(measured, nominal, k):
            if np.quantile(np.abs(errors), NEARLY_ALL) < limit:
                result.setdefault(mistake, []).append("xyz"[axis])
                break
        else:
            return _joint_mistake(measured, nominal, limit)
    looks = ", ".join(f"{' and '.join(result[item])} {item.looks}" for item in result if item.looks)
    return Mistake(looks, any(item.unit for item in result)) if looks else UNKNOWN


def _undone(measured: Floats, nominal: Floats, k: int) -> Iterator[tuple[Mistake, Floats]]:
    """Mistakes along one axis (of n, axes) and the errors (n,) that remain once each is undone:
    none, units, an origin, the other way round, and another axis. An axis that runs the other way
    has another zero.
    """
    place = nominal[:, k]
    yield Mistake(""), measured[:, k] - place
    scaled = ((unit, measured[:, k] * factor - place) for unit, factor in COORDINATES.items())
    for unit, errors in sorted(scaled, key=lambda pair: np.abs(pair[1]).sum()):
        yield Mistake(f"in {unit}, not mm", unit=True), errors
    if len(place) < FEWEST_POINTS:
        return
    shift = np.median(measured[:, k] - place)
    yield Mistake(f"from an origin {shift:.3g} mm off"), measured[:, k] - shift - place
    for i in sorted(range(measured.shape[1]), key=lambda i: i != k):
        if i != k:
            yield Mistake("swapped"), measured[:, i] - place
        mirror = -measured[:, i] - place
        words = "with the other sign" if i == k else "swapped and with the other sign"
        yield Mistake(words), mirror - np.median(mirror)


def _joint_mistake(measured: Floats, nominal: Floats, limit: float) -> Mistake:
    """A mistake of all axes: points at the places of others, most of them, or values much smaller
    than the coordinates that follow none of them.
    """
    if not FEWEST_POINTS <= len(measured) <= MOST:
        return UNKNOWN
    from scipy.spatial import KDTree

    distance, index = KDTree(nominal).query(measured)
    at: Mask = np.asarray(distance) < max(limit, SAME_MM) * np.sqrt(nominal.shape[1])
    nearest = nominal[np.asarray(index)]
    hits, places = (len(np.unique(points, axis=0)) for points in (nearest[at], nominal))
    all_hit = np.mean(at) >= NEARLY_ALL and hits >= NEARLY_ALL * places
    if all_hit and np.mean(at & (nearest != nominal).any(axis=1)) > 0.5:
        return Mistake("features in another order")
    with np.errstate(invalid="ignore"):
        R = np.abs(np.corrcoef(measured, nominal, rowvar=False))
    count = measured.shape[1]
    if typical(measured) < typical(nominal) / 2 and not (R[:count, count:] >= RELATED).any():
        return Mistake("errors, not the coordinates that they are errors of")
    return UNKNOWN


@check("far-from-nominal", of="points")
def far_from_nominal(data: PointsData) -> Iterator[Odd]:
    """Whatever is farther off than a machine errs, the largest first: files, parts, measurements
    of a part, features of all parts, and single values, each with the mistake that explains it.

    A group is named where most of its points are far off; those of one mistake are one finding,
    and what is named is no longer looked at in smaller groups. A file in another unit is an error.
    """
    errors, axes, table = data.errors, data.axes, data.table
    far: Mask = np.abs(errors).max(axis=1, initial=0.0) > POINT_ERROR_MM
    levels: tuple[tuple[str, Rows, Sequence[str]], ...] = (
        ("points of", table.file_index, [source.shown for source in table.sources]),
        ("part", table.part, table.parts),
        ("part", data.visits.of_point, data.named(data.visits.part)),
        ("the nominal place of", table.feature, table.features),
    )
    mistakes: dict[tuple[str, Mistake, int], list[tuple[str, Rows]]] = {}
    for level, group, names in levels:
        for code in np.unique(group[far]).tolist():
            rows = np.flatnonzero(group == code)
            if 2 * np.count_nonzero(far[rows]) <= len(rows):
                continue
            mistake = mistake_of(data, rows)
            if mistake is not UNKNOWN or level == "points of":
                key = level, mistake, int(table.file_index[rows[0]])
                mistakes.setdefault(key, []).append((repr(names[code]), rows))
                far[rows] = False
    for (level, mistake, _), groups in mistakes.items():
        rows = np.concatenate([item for _, item in groups])
        what = f"{level} {', '.join(dict.fromkeys(name for name, _ in groups))}"
        facts = {"what": what, "off": typical(errors[rows]), "looks": mistake.looks}
        file_unit = mistake.unit and level == "points of"
        yield Odd(rows, facts, code="unit-of-points" if file_unit else None)
    for row in np.flatnonzero(far)[:MOST].tolist():
        axis = axes[np.argmax(np.abs(errors[row]))]
        value, place = (float(of[row, axis]) for of in (table.measured, table.nominal))
        facts = {"what": f"a point of part {table.parts[table.part[row]]!r}"}
        facts |= {"off": typical(errors[[row]]), "looks": _slip(value, place)}
        yield Odd(np.array([row]), facts, f"{'xyz'[axis]}_mm", f"{value:.9g}")


def _slip(value: float, place: float) -> str:
    """The slip of one coordinate that would bring it to its place."""
    limit = max(POINT_ERROR_MM, 1e-3 * abs(place))
    slip = "a mistyped digit, or another feature"
    if any(abs(value / 10.0**digits - place) < limit for digits in range(-3, 7)):
        slip = "a decimal point out of place"
    if abs(value + place) < limit:
        slip = "a lost sign"
    return f"{slip}; about {place:.9g} is expected"


@check("nominals-differ", of="points")
def nominals_differ(data: PointsData) -> Iterator[Odd]:
    """A feature with several nominal places."""
    table = data.table
    # The place that stands last in the table is what the others are compared with.
    away = np.zeros(len(table.feature), bool)
    for nominal, place in zip(table.nominal.T, data.visits.nominal.T, strict=True):
        away |= np.abs(nominal - place[table.feature]) > SAME_MM
    if len(rows := np.flatnonzero(away)):
        codes = np.unique(table.feature[rows])
        yield Odd(rows, {"names": [table.features[code] for code in codes]})


@check("outlying-value", of="points")
def outlying_points(data: PointsData) -> Iterator[Odd]:
    """Single readings far off what the other parts have there, or the other repeats.

    Errors are compared among the measurements of a feature in one operation, the level of each
    measurement taken off, and repeats among themselves by their difference.
    """
    table, visits = data.table, data.visits
    at = visits.of_point, table.feature
    for k, axis in enumerate(data.axes):
        errors, columns = np.full(visits.errors.shape[:2], np.nan), 0
        errors[at] = data.errors[:, k]
        judged = errors.copy()
        for group in split(None, visits.operation):
            run = slice(group[0], group[-1] + 1)  # visits are in the order of operations
            enough = np.isfinite(errors[run]).sum(axis=0) >= FEWEST
            errors[run] = median_polish(errors[run])
            judged[run] = np.where(enough, errors[run], np.nan)
            columns += int(enough.sum())
        r = rounding_variance(table.measured[:, axis])
        outliers, s = outlying(judged, columns, r)
        repeat_outliers, s_paired = _repeats(errors, visits, r)
        other = repeat_outliers & ~outliers, s_paired, "its other repeats"
        for mask, scatter, beside in ((outliers, s, "the other parts"), other):
            rows = np.flatnonzero(mask[at]) if mask.any() else np.zeros(0, np.int64)
            rows = rows[(np.abs(data.errors[rows]) <= POINT_ERROR_MM).all(axis=1)]
            if len(rows):
                size = 1e3 * np.abs(errors[at][rows])
                rows = rows[np.argsort(-size, kind="stable")]
                facts = {"what": "xyz"[axis], "off": float(size.max()), "unit": "um"}
                facts |= {"beside": beside, "s": 1e3 * scatter}
                value = f"{table.measured[rows[0], axis]:.9g}"
                yield Odd(rows, facts, f"{'xyz'[axis]}_mm", value)


def _repeats(errors: Floats, visits: Visits, r: float) -> tuple[Mask, float]:
    """Which errors (visits, features) differ too much from the repeat before or after them, and
    the s of these. Of two such repeats the one farther from the other parts is meant.
    """
    one = np.flatnonzero((np.diff(visits.part) == 0) & (np.diff(visits.operation) == 0))
    outliers, s = outlying(errors[one + 1] - errors[one], r=2 * r)
    first = np.abs(errors[one]) > np.abs(errors[one + 1])
    result = np.zeros(errors.shape, bool)
    result[one] |= outliers & first
    result[one + 1] |= outliers & ~first
    return result, s / np.sqrt(2.0)
