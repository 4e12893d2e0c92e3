"""Which diameters and lengths the part file asks for, their calibration, and the rows of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from typing import Any, Literal, NamedTuple

import numpy as np

from mtu_cli.files.part import Circle, LoadedPart, Sphere
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, counted, error, finding, nearest
from mtu_cli.model.covariates import numbers_of, point_columns
from mtu_cli.model.visits import IntArray, only_features, operations_of, visits_of
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

Kind = Literal["circle", "sphere", "length"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A size of the part file. Of circles and spheres `calibrated` (k, 2): diameters, mm, by
    ascending temperature, degC, with the expanded uncertainty `U_reference` (k = 2, nan: not
    given).

    `temperature` (n,) of every point, nan where it is not known; `ranged` whether the diameter was
    stated with a temperature.
    """

    kind: Kind
    id: str
    features: tuple[str, ...]
    U_reference: float = nan
    calibrated: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    temperature: FloatArray = field(default_factory=lambda: np.zeros(0))
    ranged: bool = False

    @property
    def name(self) -> str:
        """Kind and id: ``circle 'ring'``."""
        return f"{self.kind} {self.id!r}"

    def reference(self, temperature: float) -> float:
        """The calibrated diameter: linear between calibrated temperatures and beyond, constant with
        one; nan without any.
        """
        if len(self.calibrated) < 2:
            return float(self.calibrated[0, 1]) if len(self.calibrated) else nan
        degrees = self.calibrated[:, 0]
        right = int(np.clip(np.searchsorted(degrees, temperature), 1, len(degrees) - 1))
        (start, low), (end, high) = self.calibrated[right - 1 : right + 1]
        return float(low + (temperature - start) / (end - start) * (high - low))


class Task(NamedTuple):
    """A size, the `order`-th of the part file, in one visit: `rows` of its features, in their
    order, among the points.
    """

    wanted: Wanted
    order: int
    part: str
    operation: str
    visit: int
    rows: IntArray


def wanted_of(
    part: LoadedPart, points: Points, at: Mapping[str, float]
) -> tuple[list[Wanted], list[Finding]]:
    """The sizes of the part file of which at least one feature was measured.

    Raises InputError for a temperature that is needed and not known.
    """
    wanted, absent = list[Wanted](), list[str]()
    rounds: dict[Kind, Sequence[Any]] = {"circle": part.part.circles, "sphere": part.part.spheres}
    for kind, items in rounds.items():
        for index, item in enumerate(items):
            if set(item.features).isdisjoint(points.features):
                absent.append(f"{kind} {item.id!r}")
            else:
                wanted.append(_calibrated(part, kind, index, item, points, at))
    for length in part.part.lengths:
        ends = (length.from_, length.to)
        if set(ends).isdisjoint(points.features):
            absent.append(f"length {length.id!r}")
        else:
            wanted.append(Wanted(kind="length", id=length.id, features=ends))
    reason = "none of its features was measured"
    return wanted, [finding("not-measured", names=absent, reason=reason)] if absent else []


def _calibrated(
    part: LoadedPart,
    kind: Kind,
    index: int,
    item: Circle | Sphere,
    points: Points,
    at: Mapping[str, float],
) -> Wanted:
    """The circle or sphere at `index` of its list in the part file, with its calibration.

    Raises InputError where the calibration needs a temperature that nobody gives, or cells of it
    among the item's features are empty.
    """
    table = sorted((item.calibrated_mm or {}).items())
    columns, name = point_columns(points), item.temperature or ""
    known, temperature = [*columns, *at], np.full(len(points), nan)
    if name in columns:
        codes = [i for i, feature in enumerate(points.features) if feature in item.features]
        problems: list[Finding] = []
        rows = np.flatnonzero(np.isin(points.feature, codes))
        temperature = numbers_of(points, name, columns[name], problems, rows)
        if problems:
            raise InputError(problems)
    elif name in at:
        temperature[:] = at[name]
    elif name and table:
        near = nearest(name, known)
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
    return Wanted(
        kind=kind,
        id=item.id,
        features=tuple(item.features),
        U_reference=nan if item.U_um is None else item.U_um * UM,
        calibrated=np.array(table, np.float64).reshape(-1, 2),
        temperature=temperature,
        ranged=isinstance(part.document.at(f"{kind}s", index, "calibrated_mm"), dict),
    )


def tasks_of(wanted: Sequence[Wanted], points: Points) -> tuple[list[Task], list[Finding]]:
    """Every size in every visit that measured all its features, visit by visit.

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    used = only_features(points, [name for item in wanted for name in item.features])
    if not len(used):
        return [], []
    visits, (operations, _) = visits_of(used), operations_of(used)
    # The last column stands for features that nobody measured.
    row = np.full((len(visits.part), len(used.features) + 1), -1)
    codes = [points.features.index(name) for name in used.features]
    row[visits.of_point, used.feature] = np.flatnonzero(np.isin(points.feature, codes))
    columns = {name: i for i, name in enumerate(used.features)}
    places = [[columns.get(name, -1) for name in item.features] for item in wanted]
    tasks, partial = [], dict[str, list[str]]()
    for visit, (code, operation) in enumerate(zip(visits.part, visits.operation, strict=True)):
        for order, item in enumerate(wanted):
            rows, part = row[visit, places[order]], used.parts[code]
            if (rows >= 0).all():
                tasks.append(Task(item, order, part, operations[operation], visit, rows))
            elif (rows >= 0).any():
                partial.setdefault(item.name, []).append(part)
    problems = []
    for name, visited in partial.items():
        # Repeats are no parts of their own.
        count = counted(len(set(visited)), "part")
        reason = f"not all its features were measured on {count} ({visited[0]!r})"
        facts = {"names": [name], "reason": reason, "measurements": len(visited)}
        problems.append(finding("not-measured", **facts))
    return tasks, problems
