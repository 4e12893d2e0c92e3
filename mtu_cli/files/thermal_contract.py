"""The known drift of a component in a machine file: its keys, and what they must fulfil."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from mtu_cli.errors import did_you_mean
from mtu_cli.files.contract_errors import told
from mtu_cli.files.contracts import MAX_DEGREE, Contract, Findings, NonNegative, duplicates
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.yaml_file import YamlPath


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _listed(value: object) -> object:
    if not isinstance(value, list) and not _is_number(value):
        raise told("wrong value", "a number, or a list of one a position")
    return value if isinstance(value, list) else [value]


def _by_sensor(value: object) -> object:
    if not isinstance(value, dict):
        raise told("wrong value", "a number of at least 0, or one for each sensor")
    return value


NOT_MISSED = 0.01
"""Share of the largest gradient by which a polynomial may pass one by without a word."""
STEEPEST = 1e6
"""Per degC in any unit: beyond it a gradient is a slip, and its square overflows."""
SensorU = Annotated[float, Field(ge=0, le=100)]
"""degC; more is no reading of a sensor."""
TimeConstant = Annotated[float, Field(ge=0, le=1e6)]
"""min; what is slower has not settled in two years."""
Gradients = Annotated[
    list[Annotated[float, Field(ge=-STEEPEST, le=STEEPEST)]],
    Field(min_length=1),
    BeforeValidator(_listed, json_schema_input_type=float | list[float]),
]
SensorNoise = Annotated[
    dict[str, SensorU],
    BeforeValidator(_by_sensor, json_schema_input_type=float | dict[str, float]),
]


class Thermal(Contract):
    """Drift that is linear in temperatures: through given values at given positions.

    Gradients are per degC above the machine's reference temperature, in the component's unit.
    Valdes et al., eqs. (5)-(8) and (13).
    """

    positions_mm: Annotated[list[float], Field(min_length=1)] | None = Field(
        default=None, description="Where the gradients hold; none: the drift is the same everywhere"
    )
    degree: Annotated[int, Field(ge=0, le=MAX_DEGREE)] = Field(
        default=0, description="Degree in position; number of positions - 1 unless said"
    )
    gradients: Annotated[dict[str, Gradients], Field(min_length=1)] = Field(
        description="By sensor (T_<sensor>_degC): unit per degC at each position"
    )
    time_constants_min: dict[str, TimeConstant] = Field(
        default={}, description="By sensor: time constant of its first-order lag, min"
    )
    s_leftover: NonNegative = Field(
        default=0.0,
        description="Standard deviation of what the model leaves, shared by the points of a part",
    )
    sensor_u_degC: SensorNoise = Field(  # noqa: N815  # unit
        default={}, description="Standard uncertainty of a reading; a number, or by sensor"
    )

    @model_validator(mode="before")
    @classmethod
    def _what_follows(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        found = dict(data)
        if found.get("degree") is None:
            positions = found.get("positions_mm")
            found["degree"] = max(0, len(positions) - 1) if isinstance(positions, list) else 0
        noise, gradients = found.get("sensor_u_degC"), found.get("gradients")
        if isinstance(noise, (int, float)) and _is_number(noise) and noise >= 0:
            # What is no standard uncertainty stays a number, and is told as such.
            sensors = gradients if isinstance(gradients, dict) else ()
            found["sensor_u_degC"] = dict.fromkeys(sensors, noise)
        return found


def check_thermal(
    thermal: Thermal,
    of: str | None,
    travel: Sequence[float] | None,
    path: YamlPath,
    findings: Findings,
) -> None:
    """Positions, degree, sensors and the number of gradients of a drift.

    `of` is its axis and `travel` that axis's, mm, where the machine states it.
    """
    positions = thermal.positions_mm
    _check_positions(positions, of, travel, (*path, "positions_mm"), findings)
    count = len(positions) if positions is not None else 1
    if thermal.degree >= count:
        findings.add(
            (*path, "degree"),
            "degree too high for the positions" if positions else "a degree without positions",
            value=thermal.degree,
            expected=f"at most {count - 1}",
        )
    for sensor, values in thermal.gradients.items():
        _check_sensor(sensor, (*path, "gradients", sensor), findings)
        if len(values) != count:
            plural = "s" if len(values) > 1 else ""
            where = f"{count} positions" if positions is not None else "no positions"
            findings.add(
                (*path, "gradients", sensor),
                f"{len(values)} gradient{plural} at {where}",
                expected=f"{count}, one a position" if positions is not None else "one",
            )
    for key in ("time_constants_min", "sensor_u_degC"):
        _check_known(getattr(thermal, key), thermal.gradients, (*path, key), findings)


def _check_positions(
    positions: list[float] | None,
    of: str | None,
    travel: Sequence[float] | None,
    path: YamlPath,
    findings: Findings,
) -> None:
    if positions is not None and of is None:
        findings.add(
            path,
            "positions of a component without `of`",
            expected="`of: x` of the component, or no positions",
        )
    for index, value, _ in duplicates(enumerate(str(value + 0.0) for value in positions or ())):
        findings.add((*path, index), "the position stands twice", value=value.removesuffix(".0"))
    if travel is None:
        return
    low, high = min(travel), max(travel)
    for index, position in enumerate(positions or ()):
        if not low <= position <= high:
            findings.add(
                (*path, index),
                f"outside the travel of {of}",
                value=f"{position:g}",
                expected=f"from {low:g} to {high:g} mm",
            )


def missed_gradient(thermal: Thermal) -> tuple[str, float, float] | None:
    """The sensor and position whose given gradient the polynomial misses most, and by how much.

    None where the degree takes it through all of them, or they lie on it all the same.
    """
    positions = thermal.positions_mm
    if positions is None or thermal.degree >= len(positions) - 1:
        return None
    import numpy as np

    place = np.array(positions, float)
    half = float(np.ptp(place)) / 2
    powers = np.vander((place - place.mean()) / half, thermal.degree + 1)
    given = np.array(list(thermal.gradients.values()), float).T
    left = np.abs(given - powers @ np.linalg.lstsq(powers, given, rcond=None)[0])
    p, s = np.unravel_index(np.argmax(left), left.shape)
    if left[p, s] <= NOT_MISSED * np.abs(given).max():
        return None
    return list(thermal.gradients)[s], positions[p], float(left[p, s])


_WORD = re.compile(r"\w+", re.ASCII)


def _check_sensor(sensor: str, path: YamlPath, findings: Findings) -> None:
    if is_temperature(sensor):
        return
    known = f"T_{sensor}_degC"
    hint = f", such as {known}" if _WORD.fullmatch(sensor) and "degC" not in sensor else ""
    findings.add(
        path,
        "not the name of a temperature",
        value=sensor,
        expected=f"T_<sensor>_degC, the column of its readings{hint}",
    )


def _check_known(
    names: Iterable[str], sensors: Iterable[str], path: YamlPath, findings: Findings
) -> None:
    known = tuple(sensors)
    for name in names:
        if name not in known:
            findings.add(
                (*path, name),
                "a sensor without gradients",
                value=name,
                expected=did_you_mean(name, known),
            )
