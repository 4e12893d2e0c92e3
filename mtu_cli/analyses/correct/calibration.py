"""Calibrated diameters at the temperature of the measurement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.correct.quantity import Size
from mtu_cli.files.covariates import closest_covariate
from mtu_cli.files.part import Circle, LoadedPart, Sphere
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, InputError, error, finding, nearest
from mtu_cli.model.residual_covariates import numbers_of, point_columns
from mtu_cli.stats.least_squares import FloatArray

SLACK_DEGC = 1e-9
FAR_MM = 1.0
"""A ring this far from its calibrated diameter is another one, or in another unit."""


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

    def warnings(self, sizes: Sequence[Size]) -> list[Finding]:
        """Of a missing calibration, or one that cannot be that of the `sizes` of single visits."""
        if len(self.degrees) == 0:
            return [
                finding(
                    "not-estimable",
                    quantity="errors and their reduction",
                    names=[self.name],
                    reason="no calibrated_mm",
                )
            ]
        return [*self._unknown(), *self._beyond(sizes), *self._far(sizes)]

    def _unknown(self) -> list[Finding]:
        if not self.missing:
            return []
        span = f" of {self.degrees[0]:g} degC" if self.ranged else ""
        return [
            finding(
                "missing-values",
                what=f"the temperature of {self.name}",
                names=[repr(self.missing)],
                consequence="neither a column of the points nor given by --at, so that the "
                f"calibrated diameter{span} is taken as it is",
                meant=self.near,
            )
        ]

    def _beyond(self, sizes: Sequence[Size]) -> list[Finding]:
        known = np.array([size.temperature for size in sizes])
        if not self.ranged or not np.isfinite(known).any():
            return []
        low, high = float(self.degrees[0]), float(self.degrees[-1])
        beyond = np.maximum(low - known, known - high)
        if not (beyond > SLACK_DEGC).any():
            return []
        worst = float(known[np.nanargmax(beyond)])
        return [
            finding(
                "outside-measured-range",
                what=f"{worst:.4g} degC",
                names=[f"the calibration of {self.name}"],
                low=low,
                high=high,
                unit="degC",
            )
        ]

    def _far(self, sizes: Sequence[Size]) -> list[Finding]:
        far = [size for size in sizes if abs(size.error[0]) > FAR_MM]
        if not far:
            return []
        worst = max(far, key=lambda size: abs(size.error[0]))
        return [
            finding(
                "calibrated-far-from-measured",
                name=self.name,
                measured_mm=worst.size[0],
                part=worst.part,
                calibrated_mm=worst.reference,
            )
        ]


def calibration_of(
    part: LoadedPart,
    place: tuple[str, int],
    item: Circle | Sphere,
    points: Points,
    at: Mapping[str, float],
) -> Calibration:
    """The calibration of a circle or sphere, `place` its list and index in the part file.

    Raises InputError where diameters at several temperatures lack the temperature, or cells of
    it among the item's features are empty.
    """
    table = sorted((item.calibrated_mm or {}).items())
    temperature = _temperature(part, place, item, points, at, needed=len(table) > 1)
    lost = item.temperature is not None and bool(np.isnan(temperature).all())
    raw = part.document.data[place[0]][place[1]].get("calibrated_mm")
    return Calibration(
        name=f"{place[0].removesuffix('s')} {item.id!r}",
        degrees=np.array([key for key, _ in table]),
        diameter=np.array([value for _, value in table]),
        temperature=temperature,
        ranged=isinstance(raw, dict),
        missing=(item.temperature or "") if lost else "",
        near=_near(item.temperature or "", points, at) if lost else (),
    )


def _near(name: str, points: Points, at: Mapping[str, float]) -> tuple[str, ...]:
    near = closest_covariate(name, [*point_columns(points), *at])
    return (near,) if near else ()


def _temperature(
    part: LoadedPart,
    place: tuple[str, int],
    item: Circle | Sphere,
    points: Points,
    at: Mapping[str, float],
    *,
    needed: bool,
) -> FloatArray:
    name, unknown = item.temperature, np.full(len(points), np.nan)
    columns = point_columns(points)
    column = None if name is None else columns.get(name)
    if name is None or (column is None and name not in at and not needed):
        return unknown
    if column is not None:
        codes = [i for i, feature in enumerate(points.features) if feature in item.features]
        problems: list[Finding] = []
        rows = np.flatnonzero(np.isin(points.feature, codes))
        values = numbers_of(points, name, column, problems, rows)
        if problems:
            raise InputError(problems)
        return values
    if name in at:
        return np.full(len(points), at[name])
    near = nearest(name, [*columns, *at])
    there = f" (there is {' or '.join(map(repr, near))})" if near else ""
    raise error(
        "unknown-name",
        what="temperature",
        file=part.source.shown,
        line=part.line_of(*place, "temperature"),
        path=f"{place[0]}[{place[1]}].temperature",
        value=name,
        expected=f"a column of this name{there}, or --at {name}=VALUE",
    )
