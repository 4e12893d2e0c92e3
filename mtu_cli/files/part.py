"""Part files (``mtu/part/1``): features and what is to be known about them."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from mtu_cli.files.contract import (
    Contract,
    Faults,
    IdText,
    Loaded,
    Name,
    NonNegative,
    Positive,
    check_contract,
    is_number,
    optional,
    present,
    wrong,
)
from mtu_cli.files.yaml_file import read_yaml

Place = tuple[float, float, float | None]
"""Nominal x, y, z in mm; z None where nothing states it."""
REFERENCE_TEMPERATURE = 20.0
LARGEST_MM = 1e9
"""A thousand kilometres: beyond it a coordinate is a slip, and products of them overflow."""

TOLERANCE = "Tolerance: plus-minus, or [low, high]"
Coordinate = Annotated[float, Field(ge=-LARGEST_MM, le=LARGEST_MM)]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The least and the largest error allowed, actual minus nominal, in the unit of its key."""

    low: float
    high: float

    @property
    def stated(self) -> float | tuple[float, float]:
        """As files and reports have it: a number is plus-minus, otherwise the pair."""
        return self.high if self.low == -self.high else (self.low, self.high)


def _tolerance(value: Any) -> Tolerance:
    """20 for plus-minus 20, or [-5, 25]."""
    ends: Any = [-value, value] if is_number(value) else value
    pair = isinstance(ends, list) and len(ends) == 2 and all(map(is_number, ends))
    if not (pair and all(map(isfinite, ends)) and ends[0] < ends[1]):
        raise wrong("a number above 0, or [low, high]")
    return Tolerance(*map(float, ends))


Tolerated = Annotated[
    Tolerance,
    BeforeValidator(
        _tolerance,
        json_schema_input_type=Positive | Annotated[list[float], Field(min_length=2, max_length=2)],
    ),
]


class Feature(Contract):
    """The nominal place of a feature in the part's frame, mm."""

    x_mm: Coordinate
    y_mm: Coordinate
    z_mm: Coordinate | None = optional("Default: the part's z_mm")
    position_um: Positive | None = optional("True position: diameter of its tolerance zone")


class Length(Contract):
    """A length between two features."""

    id: IdText = optional("Default: from-to", "")
    from_: IdText = Field(alias="from")
    to: IdText
    tolerance: Tolerated | None = optional(TOLERANCE, alias="tolerance_um")

    @model_validator(mode="before")
    @classmethod
    def _id(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("id") is None and "from" in data and "to" in data:
            return data | {"id": f"{data['from']}-{data['to']}"}
        return data


class Orthogonality(Contract):
    """The angle between a row and a column of features."""

    id: IdText
    row: Annotated[list[IdText], Field(min_length=2)] = Field(description="Features along x")
    column: Annotated[list[IdText], Field(min_length=2)] = Field(description="Features along y")
    tolerance: Tolerated | None = optional(TOLERANCE, alias="tolerance_arcsec")


def _by_temperature(value: object) -> object:
    """A calibrated diameter as {degC: mm}; a plain number holds at every temperature."""
    if is_number(value):
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


class Circle(Contract):
    """Features on a circle: a ring gauge, a milled circle."""

    id: IdText
    features: Annotated[list[IdText], Field(min_length=3)]
    calibrated_mm: Calibration | None = optional("Calibrated diameter, mm, or {degC: mm}")
    U_um: NonNegative | None = optional("Its expanded uncertainty (k = 2)")
    temperature: str | None = optional("The covariate that holds the temperature")


class Sphere(Circle):
    """Features on a sphere."""

    features: Annotated[list[IdText], Field(min_length=4)]


class Part(Contract):
    """A part as its features and the quantities between them."""

    schema_: Literal["mtu/part/1"] = Field(alias="schema")
    name: Name
    says: str | None = optional("What it is, in words")
    notes: str | None = optional("Free text")
    z_mm: Coordinate | None = optional("z of all features that do not state it")
    features: Annotated[dict[Name, Feature], Field(min_length=1)]
    lengths: list[Length] = optional("Lengths between features", [])
    orthogonality: list[Orthogonality] = optional("Right angles of rows and columns", [])
    circles: list[Circle] = optional("Features on circles", [])
    spheres: list[Sphere] = optional("Features on spheres", [])

    def places(self) -> dict[str, Place]:
        """Nominal (x, y, z) of every feature, mm; z is None where nothing states it."""
        return {
            name: (item.x_mm, item.y_mm, self.z_mm if item.z_mm is None else item.z_mm)
            for name, item in self.features.items()
        }

    def check(self, faults: Faults) -> None:
        """Features that the file has, none twice; lengths above 0; ids once."""
        places, keys = self.places(), faults.at("features").keys()
        references: list[tuple[Faults, str]] = []
        for kind in ("lengths", "orthogonality", "circles", "spheres"):
            entries = present(getattr(self, kind))
            ids = [(index, item.id) for index, item in entries]
            faults.at(kind).once(ids, "the id", "id", expected="another `id`")
            for index, item in entries:
                here = faults.at(kind, index)
                if isinstance(item, Length):
                    references += [(here.at("from"), item.from_), (here.at("to"), item.to)]
                    if places.get(item.from_, item.from_) == places.get(item.to, item.to):
                        expected = f"a feature at another place than {item.from_!r}"
                        here.at("to").add("appears-twice", what="the place", expected=expected)
                for key in ("row", "column", "features"):
                    names = [*enumerate(getattr(item, key, ()))]
                    here.at(key).once(names, "the feature")
                    references += [(here.at(key, place), name) for place, name in names]
                if len(getattr(item, "calibrated_mm", None) or ()) > 1 and item.temperature is None:
                    facts = {"what": "diameters at several temperatures", "other": "`temperature`"}
                    here.at("calibrated_mm").add("incomplete", **facts)
        for at, name in references:
            # A feature whose entry is faulty is not unknown.
            if name not in keys:
                at.unknown(name, keys, "feature")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedPart(Loaded):
    """A checked part file."""

    part: Part


def load_part(path: Path) -> LoadedPart:
    """Reads and checks a part file.

    Raises InputError with all faults of the file, each with its line.
    """
    document = read_yaml(path, "part")
    return LoadedPart(document=document, part=check_contract(document, Part, "part"))
