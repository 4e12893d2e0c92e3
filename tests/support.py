"""What tests share: the shipped studies, models made of them, and virtual machines."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from made_tables import made_readings

from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import Readings, read_readings
from mtu_cli.files.reports_read import ComponentsReport, read_report
from mtu_cli.files.source import files_written
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.simulate import Columns

ROOT = Path(__file__).resolve().parent.parent
CONFIGS = ROOT / "configs"
DATA = ROOT / "data"

PAPER = CONFIGS / "gilsinn-ling"
SIMULATED = CONFIGS / "gilsinn-ling-simulated"


def written_effect(
    parameters: Mapping[str, tuple[float, float, str]], **rest: Any
) -> dict[str, Any]:
    """An effect for a machine file, of value, u and unit of its parameters."""
    keys = ("value", "u", "unit")
    own = {name: dict(zip(keys, each, strict=True)) for name, each in parameters.items()}
    return {**rest, "parameters": own}


def write_files(contents: Mapping[Path, bytes]) -> None:
    with files_written(contents):
        pass


def read_components(path: Path) -> ComponentsReport:
    found = read_report(path)
    assert isinstance(found, ComponentsReport)
    return found


def codes(result: Any) -> list[str]:
    """The codes of a result's warnings."""
    return [item.code for item in result.warnings]


def leaves(value: Any, path: str = "") -> dict[str, Any]:
    """What a report or a record holds, by its place."""
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        return {k: v for key, item in pairs for k, v in leaves(item, f"{path}/{key}").items()}
    return {path: value}


@dataclass(frozen=True)
class Study:
    """A machine, its model with all components known, and a part."""

    machine: LoadedMachine
    model: MachineModel
    part: LoadedPart


def study(folder: Path, readings: list[Path]) -> Study:
    """A shipped study as the commands load it."""
    machine = load_machine(folder / "machine.yaml")
    found = read_readings(
        [(path, "lbb") for path in readings], machine.machine.components, for_fit=True
    )
    fit = fit_machine(machine, found)
    model = build_model(machine, estimates_from_fit(machine, fit))
    return Study(machine, model, load_part(folder / "part.yaml"))


def paper_study() -> Study:
    """Gilsinn & Ling 2004: Table 2's coefficients, Table 1's readings."""
    return study(PAPER, [DATA / "gilsinn-ling" / "axis_angle.csv"])


def simulated_study() -> Study:
    """The synthetic machine after Gilsinn & Ling 2004."""
    return study(SIMULATED, [DATA / "gilsinn-ling-simulated" / "lbb.csv"])


def as_readings(simulated: Columns, model: MachineModel) -> Readings:
    """Simulated readings as if they had been read from a ball-bar file."""
    units = {term.estimate.name: term.estimate.unit for term in model.terms}
    names = tuple(units)
    factor = np.array([units[name].to_internal for name in simulated["component"]])
    code = np.array([names.index(name) for name in simulated["component"]])
    axis = {term.estimate.name: term.estimate.of for term in model.terms}
    known = np.array([axis[name] is not None for name in simulated["component"]])
    return made_readings(
        simulated["error"] * factor,
        names,
        code=code,
        position=np.where(known, simulated["position_mm"], np.nan),
        dimension=[units[name].dimension for name in simulated["component"]],
        passes=simulated["pass"],
        direction=simulated["direction"],
    )
