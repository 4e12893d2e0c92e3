"""Runs along an axis, for the tests of the tables that they become."""

from pathlib import Path
from typing import TypeVar

import numpy as np
from model_examples import Segment, loaded
from numpy.typing import NDArray

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import estimates_from_fit
from mtu_cli.model.residuals import ResidualTable, reading_tables
from mtu_cli.stats.least_squares import FloatArray

Table = TypeVar("Table")

MACHINE = """
components:
  px: {of: x, unit: um}
  yaw: {of: y, unit: arcsec, degree: 2}
  ort: {unit: arcsec}
equations: {Ex: px + y*yaw - y*ort}
"""
TARGETS = np.array([-20.0, 0.0, 15.5, 40.0])


def machine(folder: Path) -> LoadedMachine:
    return loaded(folder, MACHINE)


def run(passes: int, *, seed: int = 0, slope: float = 0.0, role: str = "lbb") -> Segment:
    """Bidirectional runs in the ISO 230-2 pattern with 1 um of noise, a reading a minute."""
    rng = np.random.default_rng(seed)
    one = np.concatenate([TARGETS, TARGETS[::-1]])
    position = np.tile(one, passes)
    return Segment(
        name="px",
        position=position,
        error=1e-3 * rng.standard_normal(len(position)) + slope * position,
        passes=np.repeat(np.arange(passes) + 1, len(one)),
        direction=np.tile(np.repeat([1, -1], len(TARGETS)), passes),
        time=np.arange(len(position), dtype=np.float64),
        role=role,
    )


def tables_of(
    machine: LoadedMachine, known: Estimates | None, found: Readings
) -> tuple[tuple[ResidualTable, ...], tuple[Finding, ...]]:
    return reading_tables(machine, known or estimates_from_fit(machine, None), found)


def only(found: tuple[tuple[Table, ...], object]) -> Table:
    (table,) = found[0]
    return table


def at(table: ResidualTable, name: str, column: str) -> float:
    return float(table.errors[table.parts.index(name), table.features.index(column), 0])


def in_table_order(found: Readings, position: FloatArray | None = None) -> NDArray[np.int64]:
    """The readings by pass, target and direction, forward first."""
    place = found.position_mm if position is None else position
    keys = np.column_stack([found.pass_number, place, -found.direction.astype(float)])
    return np.array(sorted(range(len(keys)), key=lambda i: tuple(keys[i])))
