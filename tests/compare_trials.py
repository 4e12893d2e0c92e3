"""Whole studies of a virtual machine: truth, readings, fit, parts, comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from support import SIMULATED, as_readings

from mtu_cli.analyses.compare import CompareResult, compare
from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.points import Points
from mtu_cli.files.source import Source
from mtu_cli.files.study import Datum
from mtu_cli.model.features import feature_points
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.model.simulate import (
    PartsPlan,
    ReadingsPlan,
    SimulatedPoints,
    simulate_points,
    simulate_readings,
)
from mtu_cli.model.variance import Block
from mtu_cli.stats.least_squares import FloatArray

GRID = np.linspace(10.0, 140.0, 14)


@cache
def study() -> tuple[LoadedMachine, MachineModel, LoadedPart]:
    """The synthetic machine's equations, its truth, and its part."""
    truth = load_machine(SIMULATED / "truth.yaml")
    model = build_model(truth, estimates_from_fit(truth, None))
    return load_machine(SIMULATED / "machine.yaml"), model, load_part(SIMULATED / "part.yaml")


def as_points(found: SimulatedPoints, ids: tuple[str, ...], places: FloatArray) -> Points:
    """Simulated points as if they had been read from a file."""
    n = len(found.part)
    feature = np.array([ids.index(name) for name in found.feature])
    parts = tuple(dict.fromkeys(found.part))
    measured = np.full((n, 3), np.nan)
    measured[:, : found.measured.shape[1]] = found.measured
    return Points(
        parts=parts,
        part=np.array([parts.index(name) for name in found.part]),
        features=ids,
        feature=feature,
        operations=(),
        operation=np.full(n, -1),
        measured=measured,
        nominal=places[feature],
        repeat=np.asarray(found.repeat),
        time_min=np.full(n, np.nan),
        sequence=np.array([parts.index(name) + 1 for name in found.part]),
        direction=np.full((n, 3), np.nan),
        covariates={},
        file_index=np.zeros(n, np.int64),
        row=np.arange(n) + 2,
        sources=(Source(role="cmm", path=Path("cmm.csv"), shown="cmm.csv", sha256=""),),
    )


def made(
    model: MachineModel,
    part: LoadedPart,
    seed: int,
    *,
    parts: int = 21,
    repeats: int = 2,
    extra: float = 0.0,
    offset: float = 0.0,
) -> Points:
    """Parts that a machine makes, with an offset in x and a random one of each part, mm."""
    ids, places, _ = feature_points(part, model)
    plan = PartsPlan(
        parts=parts, repeats=repeats, cmm_u=1e-3, part_offset=extra, reverse_every=0, minutes=0.5
    )
    points = as_points(simulate_points(model, ids, places, plan, seed), ids, places)
    shift = np.array([offset, 0.0, 0.0])
    return replace(points, measured=points.measured + shift)


@lru_cache(128)
def fitted(passes: int, seed: int) -> MachineModel:
    """The machine as `passes` each way of simulated readings know it."""
    machine, truth, _ = study()
    plan = ReadingsPlan(passes=passes, directions=(1, -1), positions={"x": GRID, "y": GRID})
    readings = as_readings(simulate_readings(truth, plan, seed), truth)
    return build_model(machine, estimates_from_fit(machine, fit_machine(machine, readings)))


def trial(passes: int, seed: int, datum: Datum = "none", **plan: float) -> CompareResult:
    """One study from beginning to end."""
    _, truth, part = study()
    numbers: Mapping[str, float] = plan
    points = made(truth, part, seed + 1_000_000, **numbers)  # type: ignore[arg-type]  # by name
    return compare(fitted(passes, seed), part, points, Settings(), datum)


def predicted(
    mean: FloatArray,
    coefficients: FloatArray,
    scatter: FloatArray,
    independent: FloatArray,
    dof: tuple[float, float],
) -> Prediction:
    """Errors along x of some features: the variance of the coefficients and that of one visit, a
    mean square each.
    """
    m = len(mean)
    block = Block(
        names=("dx",),
        columns=(slice(0, m),),
        G=np.eye(m),
        C=np.diag(coefficients),
        D=np.zeros((m, m)),
        noise=np.sqrt(scatter)[:, None],
        pass_dof=dof[0],
        repeat_dof=(dof[1],),
    )
    return Prediction(
        ids=tuple(map(str, range(m))),
        axes=("x",),
        points=np.zeros((m, 3)),
        mean=mean,
        blocks=(block,),
        independent_variance=independent,
        outside=(),
    )
