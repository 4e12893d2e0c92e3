"""Readings of a virtual machine's components, each with its own stream of random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.pass_draws import pass_draws
from mtu_cli.stats.least_squares import FloatArray, polynomial
from mtu_cli.stats.streams import stream

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

    Of components read together the passes are drawn together. A component without an axis is
    read once a pass, forward only. The parameters of declared effects are no components: nothing
    reads them.
    """
    estimates = [term.estimate for term in model.terms]
    places = [_places(estimate, plan) for estimate in estimates]
    drawn = [
        _numbers(len(estimate.coefficients), own, plan.passes, stream(seed, 0, c))
        for c, (estimate, own) in enumerate(zip(estimates, places, strict=True))
    ]
    # A component without an axis is read in the first direction alone.
    each = max(len(own) for own in places)
    normal = [np.broadcast_to(z, (plan.passes, each, z.shape[-1])) for z, _ in drawn]
    passes = pass_draws(model).of(normal)
    rows: list[tuple[str, str, float, int, int, float]] = []
    for estimate, own, deviations, (_, noise) in zip(estimates, places, passes, drawn, strict=True):
        if EFFECT_MARK in estimate.name:
            continue
        for number in range(1, plan.passes + 1):
            for i, (sign, positions) in enumerate(own):
                b = estimate.coefficients + deviations[number - 1, i]
                scatter = estimate.s_repeat * noise[number - 1, i]
                powers = polynomial(positions, estimate.degree)
                errors = (powers @ b + scatter) / estimate.unit.to_internal
                rows += [
                    (estimate.name, estimate.unit.name, float(p), number, sign, float(e))
                    for p, e in zip(positions, errors, strict=True)
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


def _places(estimate: ComponentEstimate, plan: ReadingsPlan) -> list[tuple[int, FloatArray]]:
    """Direction and positions of each run through them in a pass."""
    if estimate.of is None:
        return [(0, np.zeros(1))]
    return [(sign, plan.positions[estimate.of][::sign]) for sign in plan.directions]


def _numbers(
    k: int, places: Sequence[tuple[int, FloatArray]], passes: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Standard normal numbers of a component: of its coefficients (passes, directions, k), and
    of its readings (passes, directions, n).
    """
    normal = np.empty((passes, len(places), k))
    noise = np.empty((passes, len(places), len(places[0][1])))
    for one_pass in np.ndindex(normal.shape[:2]):
        normal[one_pass] = rng.standard_normal(k)
        noise[one_pass] = rng.standard_normal(noise.shape[2])
    return normal, noise
