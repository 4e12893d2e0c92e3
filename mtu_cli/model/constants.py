"""Uncertain constants of a machine (Abbe offsets, lever arms) as blocks of variance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.model.blocks import component_blocks
from mtu_cli.model.design import Design, design, theta
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.variance import Block
from mtu_cli.stats.least_squares import FloatArray

NEGLIGIBLE = 1e-9
"""A change of lever arms below this share of the arms is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantEffects:
    """What the constants' uncertainties do to the errors: blocks, and a shift of the mean.

    `variance` (rows,) is their sum at each row, `shift` (rows,) in mm.
    """

    blocks: tuple[Block, ...]
    variance: FloatArray
    shift: FloatArray


def constant_effects(
    model: MachineModel,
    points: FloatArray,
    covariates: Mapping[str, FloatArray | float],
    centre: Design,
) -> ConstantEffects:
    """First and second order in every uncertain constant c (JCGM 100, 5.1.2, note).

    dE/dc and d2E/dc2 by central differences over one standard uncertainty. A constant is a
    lever arm of components that are uncertain themselves: their product adds
    u(c)^2 (dJ/dc) (C + D) (dJ/dc)', which is all there is where the components' mean is 0.
    `centre` is the design at the constants' values.
    """
    rows = len(centre.J)
    mean = centre.J @ theta(model) + centre.remainder
    blocks: list[Block] = []
    shift = np.zeros(rows)
    for name, (value, u) in model.constants.items():
        if u == 0:
            continue
        up, down = (
            design(replace(model, constants=model.constants | {name: (end, u)}), points, covariates)
            for end in (value + u, value - u)
        )
        own, curve = _of_errors(name, model, mean, up, down)
        shift += curve
        blocks += [*own, *_of_levers(model, centre, up, down)]
    variance = np.zeros(rows)
    for block in blocks:
        C = block.C + block.D
        variance += np.einsum("ri,ij,rj->r", block.G, C, block.G) + (block.noise**2).sum(axis=1)
    return ConstantEffects(blocks=tuple(blocks), variance=variance, shift=shift)


def _of_errors(
    name: str, model: MachineModel, mean: FloatArray, up: Design, down: Design
) -> tuple[list[Block], FloatArray]:
    """Blocks of dE/dc and d2E/dc2, and the latter's shift of the mean (rows,)."""
    at_up, at_down = (side.J @ theta(model) + side.remainder for side in (up, down))
    curve = (at_up + at_down - 2 * mean) / 2
    # Rounding of a difference of errors is no curvature.
    curve = np.where(np.abs(curve) > NEGLIGIBLE * np.abs(at_up - mean), curve, 0.0)
    blocks = [_simple(name, (at_up - at_down) / 2)]
    if curve.any():
        blocks.append(_simple(f"{name}^2", np.sqrt(2.0) * curve))
    return blocks, curve


def _of_levers(model: MachineModel, centre: Design, up: Design, down: Design) -> list[Block]:
    """Blocks of the components' own uncertainty through the change of their lever arms."""
    change = (up.J - down.J) / 2
    if np.abs(change).max() <= NEGLIGIBLE * np.abs(centre.J).max():
        return []
    return list(component_blocks(model, change, (up.levers - down.levers) / 2, centre.columns))


def _simple(name: str, column: FloatArray) -> Block:
    """A standard normal quantity times `column` (rows,)."""
    return Block(
        names=(name,),
        columns=(slice(0, 1),),
        G=column[:, None],
        C=np.eye(1),
        D=np.zeros((1, 1)),
        noise=np.zeros((len(column), 1)),
        pass_dof=0.0,
        repeat_dof=(np.inf,),
    )
