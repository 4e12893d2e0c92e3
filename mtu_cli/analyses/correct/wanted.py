"""Which diameters and lengths the part file asks for, their calibration, and the rows of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.files.covariates import closest_covariate
from mtu_cli.files.part import Circle, LoadedPart, Sphere
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, counted, error, finding, nearest
from mtu_cli.model.covariates import numbers_of, point_columns
from mtu_cli.model.geometry import GeometryError, fit_circle, fit_sphere
from mtu_cli.model.visits import IntArray, only_features, operations_of, visits_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

Kind = Literal["circle", "sphere", "length"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Diameters (k,) mm at ascending `degrees` (k,), degC.

    `temperature` (n,) of every point, nan where it is not known; `ranged` whether the diameter
    was stated with a temperature; `missing` names the column of the temperature that is not there,
    "" where nothing is missing, and `near` the columns that it may be.
    """

    name: str
    degrees: FloatArray
    diameter: FloatArray
    temperature: FloatArray
    ranged: bool
    missing: str = ""
    near: tuple[str, ...] = ()

    def at(self, temperature: float) -> float:
        """The diameter: linear between calibrated temperatures and beyond, constant with one."""
        if len(self.degrees) == 0:
            return float("nan")
        if len(self.degrees) == 1:
            return float(self.diameter[0])
        right = int(np.clip(np.searchsorted(self.degrees, temperature), 1, len(self.degrees) - 1))
        share = (temperature - self.degrees[right - 1]) / (
            self.degrees[right] - self.degrees[right - 1]
        )
        low, high = self.diameter[right - 1 : right + 1]
        return float(low + share * (high - low))


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A size of the part file; circles and spheres with their calibration."""

    kind: Kind
    id: str
    features: tuple[str, ...]
    calibration: Calibration | None
    U_reference: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A size in one visit: `rows` of its features, in their order, among the points.

    `order` is the size's place in the part file.
    """

    wanted: Wanted
    part: str
    operation: str
    repeat: int
    order: int
    visit: int
    rows: IntArray


def wanted_of(
    part: LoadedPart, points: Points, at: Mapping[str, float]
) -> tuple[list[Wanted], list[Finding]]:
    """The sizes of the part file of which at least one feature was measured.

    Raises InputError for a temperature that is needed and not known, or features that are drawn
    where no circle or sphere goes through.
    """
    wanted, problems = list[Wanted](), list[Finding]()
    absent: list[str] = []
    rounds: dict[Kind, Sequence[Circle | Sphere]] = {
        "circle": part.part.circles,
        "sphere": part.part.spheres,
    }
    for kind, items in rounds.items():
        for index, item in enumerate(items):
            if set(item.features).isdisjoint(points.features):
                absent.append(f"{kind} {item.id!r}")
                continue
            problems += _drawn(part, kind, index, item, points)
            wanted.append(
                Wanted(
                    kind=kind,
                    id=item.id,
                    features=tuple(item.features),
                    calibration=_calibration(part, kind, index, item, points, at),
                    U_reference=float("nan") if item.U_um is None else item.U_um * UM,
                )
            )
    if problems:
        raise InputError(problems)
    for length in part.part.lengths:
        ends = (length.from_, length.to)
        if set(ends).isdisjoint(points.features):
            absent.append(f"length {length.id!r}")
        else:
            wanted.append(Wanted(kind="length", id=length.id, features=ends, calibration=None))
    reason = "none of its features was measured"
    return wanted, [finding("not-measured", names=absent, reason=reason)] if absent else []


def _calibration(
    part: LoadedPart,
    kind: Kind,
    index: int,
    item: Circle | Sphere,
    points: Points,
    at: Mapping[str, float],
) -> Calibration:
    """The calibration of a circle or sphere at `index` of its list in the part file.

    Raises InputError where diameters at several temperatures lack the temperature, or cells of
    it among the item's features are empty.
    """
    table = sorted((item.calibrated_mm or {}).items())
    columns, name = point_columns(points), item.temperature or ""
    temperature = np.full(len(points), np.nan)
    if name in columns:
        codes = [i for i, feature in enumerate(points.features) if feature in item.features]
        problems: list[Finding] = []
        rows = np.flatnonzero(np.isin(points.feature, codes))
        temperature = numbers_of(points, name, columns[name], problems, rows)
        if problems:
            raise InputError(problems)
    elif name in at:
        temperature[:] = at[name]
    elif name and len(table) > 1:
        near = nearest(name, [*columns, *at])
        there = f" (there is {' or '.join(map(repr, near))})" if near else ""
        raise error(
            "unknown-name",
            what="temperature",
            file=part.source.shown,
            line=part.line_of(f"{kind}s", index, "temperature"),
            path=f"{kind}s[{index}].temperature",
            value=name,
            expected=f"a column of this name{there}, or --at {name}=VALUE",
        )
    unknown = bool(np.isnan(temperature).all())
    closest = closest_covariate(name, [*columns, *at]) if name and unknown else None
    return Calibration(
        name=f"{kind} {item.id!r}",
        degrees=np.array([key for key, _ in table]),
        diameter=np.array([value for _, value in table]),
        temperature=temperature,
        ranged=isinstance(part.document.data[f"{kind}s"][index].get("calibrated_mm"), dict),
        missing=name if unknown else "",
        near=(closest,) if closest else (),
    )


def _drawn(
    part: LoadedPart, kind: Kind, index: int, item: Circle | Sphere, points: Points
) -> Iterator[Finding]:
    """Of a circle or sphere that the drawn places of its features do not determine: what is
    measured of them bends by chance. As it is measured, without z in the plane of x and y.
    """
    codes = [points.features.index(name) for name in item.features if name in points.features]
    places = points.nominal[[int(np.argmax(points.feature == code)) for code in codes]]
    flat = np.isnan(points.measured[np.isin(points.feature, codes), 2]).any()
    seen = places[:, :2] if flat and kind == "circle" else places
    if len(codes) < len(item.features) or not np.isfinite(seen).all():
        return
    reason = _undetermined(kind, seen)
    if reason is None:
        return
    expected = "features all around it"
    if seen is not places and np.isfinite(places).all() and _undetermined(kind, places) is None:
        reason = "it stands upright, and its points were measured without z"
        expected = "a column z_mm with all of its points"
    yield finding(
        "too-little-data",
        what=f"no {kind} goes through the nominal places of {item.id!r}: {reason}",
        file=part.source.shown,
        line=part.line_of(f"{kind}s", index),
        path=f"{kind}s[{index}].features",
        expected=expected,
    )


def _undetermined(kind: Kind, places: FloatArray) -> str | None:
    """Why places (n, 2 or 3) determine no circle or sphere; None where they do."""
    try:
        (fit_sphere if kind == "sphere" else fit_circle)(places)
    except GeometryError as error:
        return str(error)
    return None


def tasks_of(wanted: Sequence[Wanted], points: Points) -> tuple[list[Task], list[Finding]]:
    """Every size in every visit that measured all its features, visit by visit.

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    names = dict.fromkeys(name for item in wanted for name in item.features)
    used = only_features(points, names)
    if not len(used):
        return [], []
    codes = [points.features.index(name) for name in used.features]
    origin = np.flatnonzero(np.isin(points.feature, codes))
    visits = visits_of(used)
    row = np.full((len(visits.part), len(used.features)), -1)
    row[visits.of_point, used.feature] = origin
    operations, _ = operations_of(used)
    columns = {name: i for i, name in enumerate(used.features)}
    tasks, partial = [], dict[str, list[str]]()
    for visit, (part, operation) in enumerate(zip(visits.part, visits.operation, strict=True)):
        for order, item in enumerate(wanted):
            rows = np.array([row[visit, columns[f]] if f in columns else -1 for f in item.features])
            if (rows < 0).all():
                continue
            if (rows < 0).any():
                partial.setdefault(f"{item.kind} {item.id!r}", []).append(used.parts[part])
                continue
            tasks.append(
                Task(
                    wanted=item,
                    part=used.parts[part],
                    operation=operations[operation],
                    repeat=int(points.repeat[rows[0]]),
                    order=order,
                    visit=visit,
                    rows=rows,
                )
            )
    return tasks, [_partial(name, visited) for name, visited in partial.items()]


def _partial(name: str, visited: list[str]) -> Finding:
    """`visited` names the part of every visit: its repeats are no parts of their own."""
    parts = list(dict.fromkeys(visited))
    reason = f"not all its features were measured on {counted(len(parts), 'part')} ({parts[0]!r})"
    return finding("not-measured", names=[name], reason=reason, measurements=len(visited))
