"""What passes and parts of a virtual machine differ by: of components read together, together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.blocks import component_blocks, positions_in_group
from mtu_cli.model.estimates import JointPasses
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.variance import Block, drawable_passes
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.positive_part import covariance_root

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
    return [finding("passes-cut", names=cut)] if cut else []


def _is_cut(D: FloatArray, C: FloatArray) -> bool:
    """Whether passes are drawn with another covariance than D (k, k)."""
    drawn = drawable_passes(D, C)
    # Where nothing is left to be drawn, by what noise alone gives.
    scale = np.sqrt(np.fmax(np.diag(drawn), np.diag(C)))
    return bool((np.abs(drawn - D) > SEEN * np.outer(scale, scale)).any())


def _blocks(model: MachineModel) -> list[Block]:
    """Of components read together one, where it is known how far they vary together."""
    joint = tuple(group for group in model.joint if _known_together(group, model))
    widths = [len(term.estimate.coefficients) for term in model.terms]
    ends = np.cumsum(widths).tolist()
    columns = [slice(end - k, end) for end, k in zip(ends, widths, strict=True)]
    nothing, none = np.zeros((0, sum(widths))), np.zeros((0, len(widths)))
    found = component_blocks(replace(model, joint=joint), nothing, none, columns)
    unknown = [block.names[0] for block in found if not np.isfinite(block.D).all()]
    if unknown:
        raise error(
            "not-determined",
            path=f"the pass-to-pass covariance of {', '.join(unknown)}",
            expected="a report of readings in several passes",
        )
    return found


def _known_together(group: JointPasses, model: MachineModel) -> bool:
    """Whether it is known how far those of a group that the machine has vary together."""
    used = {term.estimate.name for term in model.terms}
    kept = positions_in_group(group, [name for name in group.components if name in used])
    return bool(np.isfinite(group.pass_covariance[np.ix_(kept, kept)]).all())
