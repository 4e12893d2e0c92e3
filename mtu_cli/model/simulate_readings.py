"""Simulated readings: draws of passes, and the rows that they give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.findings import Finding, error, finding, listed
from mtu_cli.model.effect_parameters import EFFECT_MARK
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.variance import Block, component_blocks, drawable_passes, positions_in_group
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream

READINGS_STREAM = 0
SEEN = 0.1
"""Share of its variances from which on it is told that a covariance was changed."""


@dataclass(frozen=True, slots=True)
class PassDraws:
    """Roots F (k, k), F F' = D, of the blocks of terms that vary together, `terms` of each by
    their place in the model, k their coefficients in that order.

    D of readings is an unbiased estimate with a negative part where passes hardly differ: it is
    drawn from without that, as predictions are (`variance.drawable_passes`).
    """

    blocks: tuple[tuple[tuple[int, ...], FloatArray], ...]

    def of(self, normal: Sequence[FloatArray]) -> list[FloatArray]:
        """Deviations (..., k_t) of each term's coefficients, from as many standard normal draws."""
        found = list(normal)
        for terms, root in self.blocks:
            whole = np.concatenate([normal[t] for t in terms], axis=-1) @ root.T
            ends = np.cumsum([normal[t].shape[-1] for t in terms])[:-1]
            for t, own in zip(terms, np.split(whole, ends, axis=-1), strict=True):
                found[t] = own
        return found


def pass_draws(model: MachineModel) -> PassDraws:
    """Those of a machine. Raises InputError for passes of which nothing is known."""
    place = {term.estimate.name: t for t, term in enumerate(model.terms)}
    return PassDraws(
        tuple(
            (
                tuple(place[name] for name in block.names),
                covariance_root(drawable_passes(block.D, block.C)),
            )
            for block in _blocks(model)
        )
    )


def cut_warnings(model: MachineModel) -> list[Finding]:
    """Of components whose passes are drawn to differ by more than predictions take them to."""
    cut: list[str] = []
    for block in _blocks(model):
        if not _is_cut(block.D, block.C):
            continue
        own = [
            name
            for name, part in zip(block.names, block.columns, strict=True)
            if _is_cut(block.D[part, part], block.C[part, part])
        ]
        cut += own or [f"{' and '.join(block.names)} together"]
    consequence = "what is simulated scatters more than is predicted"
    facts = {"what": "pass-to-pass", "items": listed(cut), "consequence": consequence}
    return [finding("negative-variance", **facts)] if cut else []


def _is_cut(D: FloatArray, C: FloatArray) -> bool:
    """Whether passes are drawn with another covariance than D (k, k)."""
    drawn = drawable_passes(D, C)
    # Where nothing is left to be drawn, by what noise alone gives.
    scale = np.sqrt(np.fmax(np.diag(drawn), np.diag(C)))
    return bool((np.abs(drawn - D) > SEEN * np.outer(scale, scale)).any())


def _blocks(model: MachineModel) -> list[Block]:
    """Of components read together one, where it is known how far they vary together."""
    used = {term.estimate.name for term in model.terms}
    joint = []
    for group in model.joint:
        kept = positions_in_group(group, [name for name in group.components if name in used])
        if np.isfinite(group.pass_covariance[np.ix_(kept, kept)]).all():
            joint.append(group)
    widths = [len(term.estimate.coefficients) for term in model.terms]
    ends = np.cumsum(widths).tolist()
    columns = [slice(end - k, end) for end, k in zip(ends, widths, strict=True)]
    nothing, none = np.zeros((0, sum(widths))), np.zeros((0, len(widths)))
    found = component_blocks(replace(model, joint=tuple(joint)), nothing, none, columns)
    unknown = [block.names[0] for block in found if not np.isfinite(block.D).all()]
    if unknown:
        raise error(
            "too-little-data",
            what="the readings do not determine it",
            path=f"the pass-to-pass covariance of {', '.join(unknown)}",
            expected="a report of readings in several passes",
        )
    return found


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
    # Direction and positions of each run through them in a pass.
    places = [
        [(0, np.zeros(1))]
        if estimate.of is None
        else [(sign, plan.positions[estimate.of][::sign]) for sign in plan.directions]
        for estimate in estimates
    ]
    # Of coefficients (passes, directions, k), and of readings (passes, directions, n); a component
    # without an axis is read in the first direction alone.
    each = max(len(own) for own in places)
    drawn, normal = [], []
    for c, (estimate, own) in enumerate(zip(estimates, places, strict=True)):
        rng, shape = stream(seed, READINGS_STREAM, c), (plan.passes, len(own))
        z = np.empty((*shape, len(estimate.coefficients)))
        noise = np.empty((*shape, len(own[0][1])))
        for one_pass in np.ndindex(shape):
            z[one_pass] = rng.standard_normal(z.shape[2])
            noise[one_pass] = rng.standard_normal(noise.shape[2])
        drawn.append(noise)
        normal.append(np.broadcast_to(z, (plan.passes, each, z.shape[2])))
    passes = pass_draws(model).of(normal)
    rows: list[tuple[str, str, float, int, int, float]] = []
    for estimate, own, deviations, noise in zip(estimates, places, passes, drawn, strict=True):
        if EFFECT_MARK in estimate.name:
            continue
        for number in range(1, plan.passes + 1):
            for i, (sign, positions) in enumerate(own):
                b = estimate.coefficients + deviations[number - 1, i]
                scatter = estimate.s_repeat * noise[number - 1, i]
                powers = estimate.shape.columns(positions)
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
