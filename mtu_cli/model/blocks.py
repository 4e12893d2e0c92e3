"""The components' coefficients as blocks that share a covariance, seen from the points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.model.estimates import JointPasses, between_passes, from_mean
from mtu_cli.model.machine_model import MachineModel, Term
from mtu_cli.model.variance import Block
from mtu_cli.stats.least_squares import FloatArray


def component_blocks(
    model: MachineModel, J: FloatArray, levers: FloatArray, columns: Sequence[slice]
) -> list[Block]:
    """One block a group of components that share passes, one for every other component.

    `J` (rows, K) and `levers` (rows, c) as `design` gives them, `columns` of each term in J.
    """
    index = {term.estimate.name: t for t, term in enumerate(model.terms)}
    blocks: list[Block] = []
    taken: set[str] = set()
    for group in model.joint:
        kept = [name for name in group.components if name in index]
        if len(kept) < 2:
            continue
        own = [
            _own_block(model.terms[i], J[:, columns[i]], levers[:, i])
            for i in (index[name] for name in kept)
        ]
        blocks.append(_joint_block(group, positions_in_group(group, kept), own))
        taken.update(kept)
    for t, term in enumerate(model.terms):
        if term.estimate.name not in taken:
            blocks.append(_own_block(term, J[:, columns[t]], levers[:, t]))
    return blocks


def positions_in_group(group: JointPasses, kept: Sequence[str]) -> list[int]:
    """Rows of the kept components in a group's covariance."""
    starts = np.concatenate([[0], np.cumsum(group.widths)]).astype(int)
    return [
        row
        for name, start, width in zip(group.components, starts, group.widths, strict=False)
        if name in kept
        for row in range(start, start + width)
    ]


def _own_block(term: Term, G: FloatArray, lever: FloatArray) -> Block:
    estimate = term.estimate
    return Block(
        names=(estimate.name,),
        columns=(slice(0, G.shape[1]),),
        G=G,
        C=estimate.covariance,
        D=estimate.pass_covariance,
        noise=(lever * estimate.s_repeat)[:, None],
        pass_dof=estimate.pass_dof,
        repeat_dof=(estimate.repeat_dof,),
        between=between_passes(estimate),
        n_passes=estimate.n_passes or 0,
        half_differences=estimate.half_differences,
    )


def _joint_block(group: JointPasses, inside: Sequence[int], own: Sequence[Block]) -> Block:
    """The components of a group as one block; their own blocks lie on its diagonal."""
    ends = np.cumsum([block.G.shape[1] for block in own])
    columns = tuple(
        slice(int(end) - block.G.shape[1], int(end)) for block, end in zip(own, ends, strict=True)
    )
    C = group.covariance[np.ix_(inside, inside)]
    between, halves = None, group.half_differences
    if halves is not None:
        halves = halves[np.ix_(inside, inside)]
    if group.n_passes is not None and all(block.between is not None for block in own):
        # Between components C is of their level and slope alone, whatever their degree.
        between = from_mean(C, group.n_passes, halves)
        for part, block in zip(columns, own, strict=True):
            between[part, part] = block.between
    return Block(
        names=tuple(block.names[0] for block in own),
        columns=columns,
        G=np.column_stack([block.G for block in own]),
        C=C,
        D=group.pass_covariance[np.ix_(inside, inside)],
        noise=np.column_stack([block.noise for block in own]),
        pass_dof=group.pass_dof,
        repeat_dof=tuple(block.repeat_dof[0] for block in own),
        between=between,
        n_passes=group.n_passes or 0,
        half_differences=halves,
    )
