"""How often the 95 % interval of a corrected diameter holds the true one.

Machines as in `machine_trials`, read by a ball bar and fitted by the package; each then measures
a ring whose true size is known, with a state and repeatabilities of its own and a probing noise
that the machine's readings know nothing of, anew in every repeat.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from correct_examples import ring_places, ring_points
from machine_trials import Drift, make_parts, read_machine

from mtu_cli.analyses.correct import Size, correct
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.part import LoadedPart
from mtu_cli.model.fit import estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

CENTRE_OF_RING = (80.0, 80.0)
DIAMETER = 120.0


@dataclass(frozen=True)
class FittedMachines:
    """Models of machines that were read, each with the generator as the readings left it."""

    drift: Drift
    machines: list[tuple[MachineModel, np.random.Generator]]


def fitted_machines(known: LoadedMachine, drift: Drift, machines: int, seed: int) -> FittedMachines:
    """Virtual machines as the package knows them from their readings."""
    found = []
    for rng in np.random.default_rng(seed).spawn(machines):
        fit = fit_machine(known, read_machine(rng, drift))
        found.append((build_model(known, estimates_from_fit(known, fit)), rng))
    return FittedMachines(drift, found)


def errors_at(rng: np.random.Generator, drift: Drift, place: FloatArray) -> FloatArray:
    """True errors (n, 3) of one part's points at `place` (n, 3), mm."""
    return np.column_stack([make_parts(rng, drift, 1, place)[0], np.zeros(len(place))])


def diameter_coverage(
    fitted: FittedMachines, part: LoadedPart, rings: int, *, probing: float, repeats: int
) -> FloatArray:
    """Of each machine the shares of its rings whose intervals hold the diameter, and the length of
    two points (machines, 2).
    """
    true = ring_places(CENTRE_OF_RING, DIAMETER)
    length = float(np.linalg.norm(true[0] - true[5]))
    names = [f"ring {i}" for i in range(rings) for _ in range(repeats)]
    nominal = np.tile(true, (len(names), 1))
    nominal[:, 2] = np.nan
    shares = []
    for model, after_readings in fitted.machines:
        rng = deepcopy(after_readings)
        noise = probing * rng.standard_normal((rings, repeats, *true.shape))
        own = np.array([errors_at(rng, fitted.drift, true) for _ in range(rings)])
        measured = (true + own[:, None] + noise).reshape(-1, 3)
        points = ring_points(measured, names, list(range(1, repeats + 1)) * rings)
        result = correct(model, part, replace(points, nominal=nominal), Settings())
        circles, lengths = result.of_kind("circle"), result.of_kind("length")
        assert len(circles) == len(lengths) == rings
        shares.append([_held(circles, DIAMETER), _held(lengths, length)])
    return np.array(shares)


def with_form(fitted: FittedMachines, part: LoadedPart, *, probing: float, repeats: int) -> int:
    """How many machines report a form of the one round ring that they measure."""
    true = ring_places(CENTRE_OF_RING, DIAMETER)
    nominal = np.tile(true, (repeats, 1))
    nominal[:, 2] = np.nan
    called = 0
    for model, after_readings in fitted.machines:
        rng = deepcopy(after_readings)
        noise = probing * rng.standard_normal((repeats, *true.shape))
        measured = (true + errors_at(rng, fitted.drift, true) + noise).reshape(-1, 3)
        points = ring_points(measured, ["ring"] * repeats, list(range(1, repeats + 1)))
        result = correct(model, part, replace(points, nominal=nominal), Settings())
        called += "form-left" in [item.code for item in result.warnings]
    return called


def _held(found: Sequence[Size], size: float) -> float:
    return float(np.mean([x.interval95[0] <= size <= x.interval95[1] for x in found]))
