"""How much one visit to a place scatters by the machine's own repeatability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.prediction import Prediction
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitScatter:
    """`variance` (A,), mm^2, of one visit by axis, the mean over the features: what s_repeat of
    the components makes of it; `dof` are the fewest that any of these is known with.
    """

    variance: FloatArray
    dof: float


def visit_scatter(model: MachineModel, at: Prediction, own: Sequence[int]) -> VisitScatter:
    """Of the features of a prediction `at`, along `own` of the model's axes."""
    variance = at.variance().repeatability.reshape(-1, len(at.axes))[:, list(own)]
    dof = [t.estimate.repeat_dof for t in model.terms if t.estimate.s_repeat > 0]
    return VisitScatter(variance=np.mean(variance, axis=0), dof=float(min(dof, default=np.inf)))
