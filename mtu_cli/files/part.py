"""Part files (``mtu/part/1``): features and what is to be known about them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from mtu_cli.files.contract import (
    Contract,
    Faults,
    IdText,
    NonNegative,
    Positive,
    check_contract,
    duplicates,
    present,
    wrong,
)
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import YamlDocument, YamlPath, read_yaml
from mtu_cli.findings import Finding

Place = tuple[float, float, float | None]
REFERENCE_TEMPERATURE = 20.0


LARGEST_MM = 1e9
"""A thousand kilometres: beyond it a coordinate is a slip, and products of them overflow."""

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
            raise wrong("a number above 0, the diameter in mm")
        return {REFERENCE_TEMPERATURE: value}
    if not isinstance(value, dict):
        raise wrong("a diameter in mm, or {temperature in degC: diameter in mm}")
    try:
        return {float(key): item for key, item in value.items()}
    except ValueError:
        raise wrong("keys in degC, such as 20") from None


Calibration = Annotated[
    dict[Annotated[float, Field(allow_inf_nan=False)], Positive],
    Field(min_length=1),
    BeforeValidator(_by_temperature, json_schema_input_type=float | dict[str, float]),
]


class _Round(_Identified):
    features: list[IdText]
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

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, role)
    part = check_contract(document, Part, "part", _check)
    return LoadedPart(source=document.source, part=part, document=document)


def _check(part: Part, faults: Faults) -> None:
    # Features that are faulty as a whole have their own message.
    places = part.places() if part.features else {}
    for index, length in present(part.lengths):
        path: YamlPath = ("lengths", index)
        ends = {"from": length.from_, "to": length.to}
        known = [_known(name, (*path, key), faults) for key, name in ends.items()]
        if length.from_ == length.to:
            faults.add(path, "same-place", value=length.to, what="both ends", where="feature")
        elif all(known) and places.get(length.from_, 0) == places.get(length.to, 1):
            what = f"the features {length.from_!r} and {length.to!r}"
            faults.add(path, "same-place", what=what, where="place", expected="a length above 0")
    for index, item in present(part.orthogonality):
        for axis, (key, names) in enumerate((("row", item.row), ("column", item.column))):
            path, letter = ("orthogonality", index, key), "xy"[axis]
            sound = [name for name in _known_names(names, path, faults) if name in places]
            apart = len({places[name][axis] for name in sound}) > 1
            if len(set(names)) > 1 and len(sound) == len(names) and not apart:
                what, expected = f"all features of the {key}", f"features that differ in {letter}"
                faults.add(path, "same-place", what=what, where=letter, expected=expected)
    for kind in ("circles", "spheres"):
        groups: list[_Round | None] = getattr(part, kind)
        for index, group in present(groups):
            _known_names(group.features, (kind, index, "features"), faults)
            if len(group.calibrated_mm or ()) > 1 and group.temperature is None:
                expected = "`temperature:` with the name of a covariate"
                path = (kind, index, "calibrated_mm")
                faults.add(path, "no-temperature-stated", expected=expected)
    for kind in ("lengths", "orthogonality", "circles", "spheres"):
        ids = [(index, item.id) for index, item in present(getattr(part, kind))]
        for index, name, first in duplicates(ids):
            expected = f"another `id` than that of line {faults.document.line_of(kind, first)}"
            path = (kind, index, "id")
            faults.add(path, "appears-twice", value=name, what="the id", expected=expected)


def _known_names(names: Sequence[str], path: YamlPath, faults: Faults) -> list[str]:
    faults.once(path, enumerate(names), "the feature")
    return [name for index, name in enumerate(names) if _known(name, (*path, index), faults)]


def _known(name: str, path: YamlPath, faults: Faults) -> bool:
    """Whether the file has a feature; one whose own entry is faulty is not unknown."""
    names = faults.keys("features")
    if name not in names:
        faults.unknown(path, name, names, "feature")
    return name in names
