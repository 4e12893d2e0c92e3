"""Whole studies of a virtual machine: truth, readings, fit, parts, comparison."""

from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
from made_tables import made_points
from support import SIMULATED, as_readings

from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import Points
from mtu_cli.model.features import feature_points
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import AXES, MachineModel, build_model
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.simulate import Columns, PartsPlan, simulate_points, simulate_readings
from mtu_cli.stats.composed_variance import CoefficientBlock
from mtu_cli.stats.least_squares import FloatArray

GRID = np.linspace(10.0, 140.0, 14)


@cache
def study() -> tuple[LoadedMachine, MachineModel, LoadedPart]:
    truth = load_machine(SIMULATED / "truth.yaml")
    model = build_model(truth, estimates_from_fit(truth, None))
    return load_machine(SIMULATED / "machine.yaml"), model, load_part(SIMULATED / "part.yaml")


def as_points(found: Columns, ids: tuple[str, ...], places: FloatArray) -> Points:
    """Simulated points as if they had been read from a file."""
    feature = np.array([ids.index(name) for name in found["feature"]])
    nowhere = np.full(len(feature), np.nan)
    measured = np.column_stack([found.get(f"{axis}_mm", nowhere) for axis in AXES])
    part, repeat = found["part"].tolist(), found["repeat"]
    return made_points(part, feature, ids, measured, places[feature], repeat=repeat)


def made(
    model: MachineModel,
    part: LoadedPart,
    seed: int,
    *,
    parts: int = 21,
    offset: float = 0.0,
) -> Points:
    """Parts that a machine makes, measured twice, with an offset in x, mm."""
    ids, places, _ = feature_points(part, model)
    plan = PartsPlan(parts=parts, repeats=2, cmm_u_um=1.0, reverse_every=0, minutes=0.5)
    points = as_points(simulate_points(model, ids, places, plan, seed), ids, places)
    shift = np.array([offset, 0.0, 0.0])
    return replace(points, measured=points.measured + shift)


@lru_cache(128)
def fitted(passes: int, seed: int) -> MachineModel:
    """The machine as `passes` each way of simulated readings know it."""
    machine, truth, _ = study()
    places = {"x": GRID, "y": GRID}
    made = simulate_readings(truth, seed, passes=passes, positions=places)
    readings = as_readings(made, truth)
    return build_model(machine, estimates_from_fit(machine, fit_machine(machine, readings)))


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
    block = CoefficientBlock(
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
        outside={},
    )
