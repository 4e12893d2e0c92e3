"""Part files (``mtu/part/1``): features and what is to be known about them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from mtu_cli.errors import Notice
from mtu_cli.files.contract_errors import path_text, told
from mtu_cli.files.contracts import (
    Contract,
    Findings,
    IdText,
    NonNegative,
    Positive,
    check_contract,
    duplicates,
    present,
)
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding

Place = tuple[float, float, float | None]
REFERENCE_TEMPERATURE = 20.0


LARGEST_MM = 1e9
"""A thousand kilometres: beyond it a coordinate is a slip, and products of them overflow."""

LEAST_TOLERANCE_UM = 0.1
"""No machine tool holds less: 0.025 is a number in mm."""

Coordinate = Annotated[float, Field(ge=-LARGEST_MM, le=LARGEST_MM)]


class Feature(Contract):
    """The nominal place of a feature in the part's frame, mm."""

    x_mm: Coordinate
    y_mm: Coordinate
    z_mm: Coordinate | None = Field(default=None, description="Default: the part's z_mm")


class _Identified(Contract):
    id: IdText


class Length(_Identified):
    """A length between two features."""

    id: IdText = Field(default="", description="Default: from-to")
    from_: IdText = Field(alias="from")
    to: IdText
    tolerance_um: Positive | None = Field(default=None, description="Tolerance, plus-minus")

    @model_validator(mode="before")
    @classmethod
    def _id(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("id") is None and "from" in data and "to" in data:
            return data | {"id": f"{data['from']}-{data['to']}"}
        return data


class Orthogonality(_Identified):
    """The angle between a row and a column of features."""

    row: Annotated[list[IdText], Field(min_length=2)] = Field(description="Features along x")
    column: Annotated[list[IdText], Field(min_length=2)] = Field(description="Features along y")


def _by_temperature(value: object) -> object:
    """A calibrated diameter as {degC: mm}; a plain number holds at every temperature."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if not 0.0 < value < math.inf:
            raise told("wrong value", "a number above 0, the diameter in mm")
        return {REFERENCE_TEMPERATURE: value}
    if not isinstance(value, dict):
        raise told("wrong value", "a diameter in mm, or {temperature in degC: diameter in mm}")
    try:
        return {float(key): item for key, item in value.items()}
    except ValueError:
        raise told("a key is not a temperature", "keys in degC, such as 20") from None


Calibration = Annotated[
    dict[Annotated[float, Field(allow_inf_nan=False)], Positive],
    Field(min_length=1),
    BeforeValidator(_by_temperature, json_schema_input_type=float | dict[str, float]),
]


class _Round(_Identified):
    calibrated_mm: Calibration | None = Field(
        default=None, description="Calibrated diameter, mm, or {degC: mm}"
    )
    U_um: NonNegative | None = Field(default=None, description="Its expanded uncertainty (k = 2)")
    temperature: str | None = Field(
        default=None, description="The covariate that holds the temperature"
    )


class Circle(_Round):
    """Features on a circle: a ring gauge, a milled circle."""

    features: Annotated[list[IdText], Field(min_length=3)]


class Sphere(_Round):
    """Features on a sphere."""

    features: Annotated[list[IdText], Field(min_length=4)]


class Part(Contract):
    """A part as its features and the quantities between them."""

    schema_: Literal["mtu/part/1"] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1)]
    says: str | None = Field(default=None, description="What it is, in words")
    notes: str | None = Field(default=None, description="Free text")
    z_mm: Coordinate | None = Field(
        default=None, description="z of all features that do not state it"
    )
    features: Annotated[dict[str, Feature], Field(min_length=1)]
    lengths: list[Length] = Field(default=[], description="Lengths between features")
    orthogonality: list[Orthogonality] = Field(
        default=[], description="Right angles of rows and columns"
    )
    circles: list[Circle] = Field(default=[], description="Features on circles")
    spheres: list[Sphere] = Field(default=[], description="Features on spheres")

    def places(self) -> dict[str, Place]:
        """Nominal (x, y, z) of every feature, mm; z is None where nothing states it."""
        return {
            name: (item.x_mm, item.y_mm, self.z_mm if item.z_mm is None else item.z_mm)
            for name, item in self.features.items()
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedPart:
    """A checked part file."""

    source: Source
    part: Part
    document: YamlDocument
    warnings: tuple[Finding, ...] = ()

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value of the file."""
        return self.document.line_of(*path)


def load_part(path: Path, role: str = "part") -> LoadedPart:
    """Reads and checks a part file.

    Raises InputError with all problems of the file, each with its line.
    """
    document = read_yaml(path, role)
    part = check_contract(document, Part, "part", _check)
    warnings = tuple(_small_tolerances(part, document))
    return LoadedPart(source=document.source, part=part, document=document, warnings=warnings)


def _small_tolerances(part: Part, document: YamlDocument) -> Iterator[Finding]:
    """One warning of all tolerances that are likely in mm."""
    small = [
        (index, item.tolerance_um)
        for index, item in enumerate(part.lengths)
        if item.tolerance_um is not None and item.tolerance_um < LEAST_TOLERANCE_UM
    ]
    if not small:
        return
    index, tolerance = small[0]
    place: YamlPath = ("lengths", index, "tolerance_um")
    more = f" (and of {len(small) - 1} more)" if small[1:] else ""
    text = (
        f"{document.source.shown}:{document.line_of(*place)}: {path_text(place)}: a tolerance of "
        f"{tolerance:g} um{more}, which no machine tool holds: is {tolerance * 1000:g}, for "
        f"{tolerance:g} mm, meant?"
    )
    yield Notice(code="tolerance-small", message=text)


def _check(part: Part, findings: Findings) -> None:
    places = part.places() if part.features else {}
    for index, length in present(part.lengths):
        _check_length(length, ("lengths", index), places, findings)
    for index, item in present(part.orthogonality):
        _check_line(item.row, ("orthogonality", index, "row"), 0, places, findings)
        _check_line(item.column, ("orthogonality", index, "column"), 1, places, findings)
    rounds: dict[str, Sequence[_Round]] = {
        "circles": part.circles or (),
        "spheres": part.spheres or (),
    }
    for kind, items in rounds.items():
        for index, group in present(items):
            _check_round(group, (kind, index), places, findings)
    identified: dict[str, Sequence[_Identified]] = {
        "lengths": part.lengths or (),
        "orthogonality": part.orthogonality or (),
        **rounds,
    }
    for kind, named in identified.items():
        ids = [(index, item.id) for index, item in present(named)]
        for index, name, first in duplicates(ids):
            line = findings.document.line_of(kind, first)
            what = f"the id stands twice, first in line {line}"
            findings.add((kind, index, "id"), what, value=name, expected="an `id` of its own")


def _check_length(
    length: Length, path: YamlPath, places: Mapping[str, Place], findings: Findings
) -> None:
    ends = {"from": length.from_, "to": length.to}
    known = [_known(name, (*path, key), places, findings) for key, name in ends.items()]
    if length.from_ == length.to:
        findings.add(path, "a length from a feature to itself", value=length.to)
    elif all(known) and places.get(length.from_, 0) == places.get(length.to, 1):
        what = f"the features {length.from_!r} and {length.to!r} stand at the same place"
        findings.add(path, what, expected="a length above zero")


def _check_line(
    names: Sequence[str],
    path: YamlPath,
    axis: int,
    places: Mapping[str, Place],
    findings: Findings,
) -> None:
    known = _check_list(names, path, places, findings)
    distinct = {places[name][axis] for name in known if name in places}
    if len(known) == len(names) >= 2 and len(distinct) == 1 and len(set(names)) > 1:
        letter = "xy"[axis]
        what = f"all features of the {path[-1]} stand at the same {letter}"
        findings.add(path, what, expected=f"features that differ in {letter}")


def _check_list(
    names: Sequence[str], path: YamlPath, places: Mapping[str, Place], findings: Findings
) -> list[str]:
    for index, name, _ in duplicates(enumerate(names)):
        findings.add((*path, index), "the feature is listed twice", value=name)
    return [
        name for index, name in enumerate(names) if _known(name, (*path, index), places, findings)
    ]


def _check_round(
    group: _Round, path: YamlPath, places: Mapping[str, Place], findings: Findings
) -> None:
    names = group.features if isinstance(group, (Circle, Sphere)) else []
    _check_list(names, (*path, "features"), places, findings)
    if len(group.calibrated_mm or ()) > 1 and group.temperature is None:
        findings.add(
            (*path, "calibrated_mm"),
            "diameters at several temperatures, and nothing says which holds",
            expected="`temperature:` with the name of a covariate",
        )


def _known(name: str, path: YamlPath, places: Mapping[str, Place], findings: Findings) -> bool:
    if name in places:
        return True
    names = findings.keys("features")
    # A feature whose own entry is faulty has its own message; it is not unknown.
    if name not in names:
        findings.add_unknown(path, "unknown feature", name, names)
    return False
