"""Points that no machine made, or that no CMM measured there (units, axes, origins, slips), and
names, places and sizes that are hardly meant.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from mtu_cli.checks import (
    Data,
    DocumentData,
    Floats,
    Mask,
    Odd,
    PointsData,
    ReadingsData,
    Rows,
    check,
    limits,
    split,
)
from mtu_cli.files.headers import meant_by
from mtu_cli.files.readings import SAME_MM
from mtu_cli.model.visits import Visits
from mtu_cli.stats.outliers import FEWEST, median_polish, outlying
from mtu_cli.stats.resolution import rounding_variance
from mtu_cli.units import UNITS


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
    limit = min(limits.EXPLAINED * typical(measured - nominal), limits.POINT_ERROR_MM)
    result: dict[Mistake, list[str]] = {}
    for k, axis in enumerate(data.axes):
        for mistake, errors in _undone(measured, nominal, k):
            if np.quantile(np.abs(errors), limits.NEARLY_ALL) < limit:
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
    scaled = [(unit, measured[:, k] * to - place) for unit, to in limits.COORDINATES.items()]
    for unit, errors in sorted(scaled, key=lambda pair: np.abs(pair[1]).sum()):
        yield Mistake(f"in {unit}, not mm", unit=True), errors
    if len(place) < limits.FEWEST_POINTS:
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
    if not limits.FEWEST_POINTS <= len(measured) <= limits.MOST:
        return UNKNOWN
    from scipy.spatial import KDTree

    distance, index = KDTree(nominal).query(measured)
    at: Mask = np.asarray(distance) < max(limit, SAME_MM) * np.sqrt(nominal.shape[1])
    nearest = nominal[np.asarray(index)]
    hits, places = (len(np.unique(points, axis=0)) for points in (nearest[at], nominal))
    all_hit = np.mean(at) >= limits.NEARLY_ALL and hits >= limits.NEARLY_ALL * places
    if all_hit and np.mean(at & (nearest != nominal).any(axis=1)) > 0.5:
        return Mistake("features in another order")
    with np.errstate(invalid="ignore"):
        R = np.abs(np.corrcoef(measured, nominal, rowvar=False))
    count = measured.shape[1]
    if typical(measured) < typical(nominal) / 2 and not (R[:count, count:] >= limits.RELATED).any():
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
    far: Mask = np.abs(errors).max(axis=1, initial=0.0) > limits.POINT_ERROR_MM
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
    for row in np.flatnonzero(far)[: limits.MOST].tolist():
        axis = axes[np.argmax(np.abs(errors[row]))]
        value, place = (float(of[row, axis]) for of in (table.measured, table.nominal))
        facts = {"what": f"a point of part {table.parts[table.part[row]]!r}"}
        facts |= {"off": typical(errors[[row]]), "looks": _slip(value, place)}
        yield Odd(np.array([row]), facts, f"{'xyz'[axis]}_mm", f"{value:.9g}")


def _slip(value: float, place: float) -> str:
    """The slip of one coordinate that would bring it to its place."""
    limit = max(limits.POINT_ERROR_MM, 1e-3 * abs(place))
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
            rows = rows[(np.abs(data.errors[rows]) <= limits.POINT_ERROR_MM).all(axis=1)]
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


Position = tuple[Sequence[str], str, Floats, Rows, str]
NONE, FIRST = np.arange(0), np.arange(1)


@check("alike", of="points")
def names_alike(data: PointsData) -> Iterator[Odd]:
    """Parts, features or operations that are one but for case and blanks."""
    for column in ("part", "feature", "operation"):
        labels, first = getattr(data.table, f"{column}s"), dict[str, str]()
        spellings = [first.setdefault("".join(name.split()).casefold(), name) for name in labels]
        if pairs := [pair for pair in zip(spellings, labels, strict=True) if pair[0] != pair[1]]:
            odd = [labels.index(name) for _, name in pairs]
            rows = np.flatnonzero(np.isin(getattr(data.table, column), odd))
            names = [f"{spelling!r} and {name!r}" for spelling, name in pairs]
            facts = {"what": "names that differ by case or blanks only", "names": names}
            yield Odd(rows, facts, column)


@check("alike", of=("readings", "drift", "points"))
def columns_alike(data: ReadingsData | PointsData) -> Iterator[Odd]:
    """Covariates that are nearly called as a column of the contract that is not there."""
    table = data.table
    columns: dict[str, NDArray[np.bool_]]
    columns = dict.fromkeys(("time", "time_min"), ~np.isnan(table.time_min))
    if isinstance(data, PointsData):
        columns |= {"operation": table.operation >= 0, "repeat": table.repeat >= 0}
        columns |= {f"dir_{axis}": ~np.isnan(table.direction[:, i]) for i, axis in enumerate("xyz")}
        columns |= {"sequence": table.sequence != table.part + 1}
        columns |= {"z_mm": ~np.isnan(table.measured[:, 2])}
    else:
        columns |= {"pass": table.has_pass, "direction": table.direction != 0}
        columns |= {"cycle": table.cycle >= 0}
    for name, mask in columns.items():
        column = None if mask.any() else meant_by(name, [*table.covariates], limits.NEARLY)
        if column:
            what = "a covariate is nearly called as a column that is not there"
            yield Odd(FIRST, {"what": what, "names": [repr(name)]}, column)


@check("position-beyond-travel", of=("readings", "drift", "points", "part"))
def beyond(data: Data) -> Iterator[Odd]:
    """Positions so far out that no coordinate system of the machine holds them, and those of
    passes that cover too little of the travel, but not in metres or inches.
    """
    for names, axis, values, rows, column in _positions(data):
        low, high = data.travels.get(axis, (-np.inf, np.inf))
        travel = abs(high - low)
        # Readings are in the frame of the machine, places in one of the part.
        middle = 0.0 if isinstance(data, ReadingsData) else np.median(values)
        distance = np.abs(values - middle)
        odd, farthest = np.flatnonzero(distance > limits.BEYOND * travel), float(distance.max())
        size, least = float(np.ptp(values)), limits.NARROW
        if len(odd):
            size, least = farthest, limits.SPAN
        meant = [
            unit
            for unit, to in limits.POSITIONS.items()
            if least * travel < size * to <= travel and farthest * to <= limits.BEYOND * travel
        ]
        hint = f"; in {' or '.join(meant)} they would not be" if meant else ""
        facts = {"axis": axis, "travel": travel, "hint": hint}
        if isinstance(data, DocumentData):
            for i in odd.tolist():
                yield Odd(NONE, facts, column, f"{values[i]:g}", ("features", names[i], column))
        elif len(odd):
            yield Odd(rows[odd], facts, column, values=values[odd])
        elif meant and 0 < size < limits.NARROW * travel and isinstance(data, ReadingsData):
            facts = {"names": names[:1], **facts}
            if data.table.has_pass[rows].all():
                yield Odd(rows, facts, column, f"{size:g}", code="unit-of-positions")


def _positions(data: Data) -> Iterator[Position]:
    """Whose positions along an axis are where (mm), in which rows and column."""
    if isinstance(data, ReadingsData):
        for name, rows in data.by_component:
            if axis := getattr(data.components.get(name), "of", None):
                yield [name] * len(rows), axis, data.table.position_mm[rows], rows, "position_mm"
        return
    if isinstance(data, DocumentData):
        places, column = data.loaded.part.places(), "{}_mm"
        names, nominal = [*places], np.array([*places.values()], np.float64)
    else:
        at = slice(None) if data.part is None and data.travels else slice(0)
        names = np.take(data.table.features, data.table.feature[at]).tolist()
        nominal, column = data.table.nominal[at], "nominal_{}_mm"
    for axis, values in zip("xyz", nominal.T, strict=True):
        if names and np.isfinite(values).all():
            yield names, axis, values, np.arange(len(names)), column.format(axis)


@check("implausible-size", of="part")
def tolerances(data: DocumentData) -> Iterator[Odd]:
    """Tolerances and zones that are hardly in um."""
    part = data.loaded.part
    sizes = [
        (("lengths", i, "tolerance_um"), f"a tolerance of {half:g} um", half)
        for i, entry in enumerate(part.lengths)
        if (zone := entry.tolerance) and (half := (zone.high - zone.low) / 2)
    ] + [
        (("features", name, "position_um"), f"a zone of {zone:g} um", zone)
        for name, entry in part.features.items()
        if (zone := entry.position_um)
    ]
    for path, what, size in sizes:
        if size < limits.TOLERANCE_UM:
            yield Odd(NONE, {"what": what, "meant": "mm"}, path=path)


@check("implausible-size", of="machine")
def machine_sizes(data: DocumentData) -> Iterator[Odd]:
    """Travels and constants in another unit, and coefficients that make errors of no machine over
    the travel.
    """
    machine = data.loaded.machine
    travels = {axis: abs(high - low) for axis, (low, high) in machine.travels.items()}
    for axis, travel in travels.items():
        if travel < limits.TRAVEL_MM:
            facts = {"what": f"a travel of {travel:g} mm", "meant": "metres"}
            yield Odd(NONE, facts, path=("axes", axis, "travel_mm"))
    limit = limits.CONSTANT_TRAVELS * max(travels.values(), default=np.inf)
    for name, constant in machine.constants.items():
        if abs(constant.value) > limit:
            facts = {"what": f"a constant of {constant.value:g} mm", "meant": "um"}
            yield Odd(NONE, facts, path=("constants", name))
    for name, component in machine.components.items():
        low, high = data.travels.get(component.of, (0.0, 0.0))
        position, unit = np.linspace(low, high, 9), UNITS[component.unit]
        errors = np.abs(polynomial.polyval(position, component.coefficients or [0.0]))
        if component.is_table and component.coefficients:
            position, errors = np.array(component.at_mm), np.abs(component.coefficients)
        if (errors * unit.to_internal > limits.largest(unit.dimension, position)).any():
            what = f"errors of up to {errors.max():.3g} {component.unit}"
            facts = {"what": what, "meant": "a smaller unit"}
            yield Odd(NONE, facts, path=("components", name, "coefficients"))
