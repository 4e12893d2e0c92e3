"""Calibrated diameters at the temperature of the measurement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.correct.covariates import column_of, known_names, numbers_of
from mtu_cli.errors import InputError, Problem, did_you_mean
from mtu_cli.files.part import Circle, LoadedPart, Sphere
from mtu_cli.files.points import Points
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray

SLACK_DEGC = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Diameters (k,) mm at ascending `degrees` (k,), degC.

    `temperature` (n,) of every point, nan where it is not known; `ranged` whether the diameter
    was stated with a temperature.
    """

    name: str
    degrees: FloatArray
    diameter: FloatArray
    temperature: FloatArray
    ranged: bool

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

    def warnings(self, temperatures: Sequence[float]) -> list[Warned]:
        """Of temperatures beyond the calibrated ones, and of a missing calibration."""
        if len(self.degrees) == 0:
            text = f"{self.name} has no calibrated_mm: its errors and their reduction are not known"
            return [Warned(code="not-calibrated", message=text)]
        known = np.array(temperatures)
        if not self.ranged or not np.isfinite(known).any():
            return []
        low, high = float(self.degrees[0]), float(self.degrees[-1])
        beyond = np.maximum(low - known, known - high)
        if not (beyond > SLACK_DEGC).any():
            return []
        worst = float(known[np.nanargmax(beyond)])
        how = "taken as it is" if len(self.degrees) == 1 else "extrapolated linearly"
        span = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        text = (
            f"{self.name} is calibrated at {span} degC and was measured at up to {worst:.4g} degC: "
            f"the diameter is {how}"
        )
        return [Warned(code="outside-calibrated-temperature", message=text)]


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
    raw = part.document.data[place[0]][place[1]].get("calibrated_mm")
    return Calibration(
        name=f"{place[0].removesuffix('s')} {item.id!r}",
        degrees=np.array([key for key, _ in table]),
        diameter=np.array([value for _, value in table]),
        temperature=_temperature(part, place, item, points, at, needed=len(table) > 1),
        ranged=isinstance(raw, dict),
    )


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
    column = None if name is None else column_of(points, name)
    if name is None or (column is None and name not in at and not needed):
        return unknown
    if column is not None:
        codes = [i for i, feature in enumerate(points.features) if feature in item.features]
        problems: list[Problem] = []
        rows = np.flatnonzero(np.isin(points.feature, codes))
        values = numbers_of(points, name, column, rows, problems)
        if problems:
            raise InputError(problems)
        return values
    if name in at:
        return np.full(len(points), at[name])
    raise InputError(
        Problem(
            what=f"the temperature of {item.id!r} is neither a column of the points nor given",
            file=part.source.shown,
            line=part.line_of(*place, "temperature"),
            path=f"{place[0]}[{place[1]}].temperature",
            value=name,
            expected=f"a column of this name, or --at {name}=VALUE; "
            + did_you_mean(name, known_names(points, at)),
        )
    )
