"""Results of the synthetic machine after Gilsinn & Ling 2004, read in several ways."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from support import DATA, PAPER, SIMULATED

from mtu_cli.analyses.predictions import (
    LengthsResult,
    OrthogonalityResult,
    PointsResult,
    predict_lengths,
    predict_orthogonality,
    predict_points,
)
from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import read_readings
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import MachineFit, estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.settings import Settings

SETTINGS = Settings(trials=20_000, threads=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    """One machine from its files to its model."""

    machine: LoadedMachine
    fit: MachineFit
    estimates: Estimates
    model: MachineModel
    part: LoadedPart

    def points(self, settings: Settings = SETTINGS) -> PointsResult:
        return predict_points(self.model, self.part, settings)

    def lengths(self, settings: Settings = SETTINGS) -> LengthsResult:
        return predict_lengths(self.model, self.part, settings)

    def angles(self, settings: Settings = SETTINGS) -> OrthogonalityResult:
        return predict_orthogonality(self.model, self.part, settings)


def example(
    folder: Path,
    *,
    passes: int | None = 5,
    directions: bool = True,
    roles: tuple[str, ...] = ("lbb",),
    stated: str = "",
    equation: str = "",
    degree: int = 1,
) -> Example:
    """The machine read in `passes` (None: no pass column) by every role.

    `stated` adds components to the machine file, `equation` an equation.
    """
    machine = load_machine(_machine(folder, stated, equation, degree))
    files = [(_readings(folder, role, passes, directions), role) for role in roles]
    readings = read_readings(files, machine.machine.components, for_fit=True)
    fit = fit_machine(machine, readings)
    estimates = estimates_from_fit(machine, fit)
    return Example(
        machine=machine,
        fit=fit,
        estimates=estimates,
        model=build_model(machine, estimates),
        part=load_part(PAPER / "part.yaml"),
    )


def _machine(folder: Path, stated: str, equation: str, degree: int) -> Path:
    text = (SIMULATED / "machine.yaml").read_text("utf-8")
    text = text.replace("{of:", f"{{degree: {degree}, of:")
    text = text.replace("equations:", f"{stated}\nequations:")
    (folder / "machine.yaml").write_text(text + equation, "utf-8")
    return folder / "machine.yaml"


def _readings(folder: Path, role: str, passes: int | None, directions: bool) -> Path:
    """The shipped readings; the laser's scatter on their own."""
    found = pd.read_csv(DATA / "gilsinn-ling-simulated" / "lbb.csv", comment="#")
    found = found[(found["pass"] <= (passes or 1)) | (found["component"] == "axy")]
    if role == "laser":
        found["error"] += np.random.default_rng(8).normal(0, 0.5, len(found)).round(6)
    if not directions:
        found = found[found["direction"] != "reverse"].drop(columns="direction")
    found = found.drop(columns="pass") if passes is None else found
    found.to_csv(folder / f"{role}.csv", index=False)
    return folder / f"{role}.csv"
