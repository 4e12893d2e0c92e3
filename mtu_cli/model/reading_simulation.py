"""Readings of a virtual machine's components, each with its own stream of random numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.stats.least_squares import FloatArray, polynomial
from mtu_cli.stats.streams import normal_draw, stream

IntArray = np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingsPlan:
    """How the components are read: `passes` in each of `directions`, at `positions` (mm)."""

    passes: int
    directions: tuple[int, ...]
    positions: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedReadings:
    """Columns of a readings file; `error` in each component's own unit."""

    component: tuple[str, ...]
    unit: tuple[str, ...]
    position: FloatArray
    pass_number: IntArray
    direction: IntArray
    error: FloatArray


def simulate_readings(model: MachineModel, plan: ReadingsPlan, seed: int) -> SimulatedReadings:
    """Readings of every component: its polynomial, a draw of D a pass, s_repeat a reading.

    A component without an axis is read once a pass, forward only. The parameters of declared
    effects are no components: nothing reads them.
    """
    rows: list[tuple[str, str, float, int, int, float]] = []
    for c, term in enumerate(model.terms):
        estimate = term.estimate
        if EFFECT_MARK in estimate.name:
            continue
        rng = stream(seed, 0, c)
        positions = np.zeros(1) if estimate.of is None else plan.positions[estimate.of]
        directions = (0,) if estimate.of is None else plan.directions
        for number in range(1, plan.passes + 1):
            for sign in directions:
                errors = _one_pass(estimate, positions[::sign] if sign else positions, rng)
                rows += [
                    (estimate.name, estimate.unit.name, float(p), number, sign, float(e))
                    for p, e in zip(positions[::sign] if sign else positions, errors, strict=True)
                ]
    component, unit, position, number_, direction, error = zip(*rows, strict=True)
    return SimulatedReadings(
        component=component,
        unit=unit,
        position=np.array(position),
        pass_number=np.array(number_),
        direction=np.array(direction),
        error=np.array(error),
    )


def _one_pass(
    estimate: ComponentEstimate, positions: FloatArray, rng: np.random.Generator
) -> FloatArray:
    b = estimate.coefficients + normal_draw(rng, estimate.pass_covariance)
    powers = polynomial(positions, estimate.degree)
    noise = estimate.s_repeat * rng.standard_normal(len(positions))
    errors: FloatArray = (powers @ b + noise) / estimate.unit.to_internal
    return errors
