"""A shop day as the sealed loop sees it: for its tests, and to go with it."""

from __future__ import annotations

import numpy as np
from shop_day import REPEATS, ShopDay
from shop_day.day import Floats
from shop_day.noise import SIG_CMM, SIG_PART

from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

UM = 1e-3
"""In mm."""
PASS_DOF = 10.0
"""Of the machine's own scatter of parts, which its components were fitted with."""
GATE_SEED = 1


def shop_table(day: ShopDay, errors: Floats) -> ResidualTable:
    """The table of errors (P, H, 2) um of a day on a machine whose components are zero, and
    were measured in passes that scatter as the parts do, with `PASS_DOF` degrees of freedom.
    """
    P, H, A = errors.shape
    of_part = np.broadcast_to(SIG_PART * UM * np.eye(A), (1, H, A, A)).copy()
    return ResidualTable(
        axes=("x", "y"),
        component=None,
        unit="um",
        parts=day.parts,
        features=day.features,
        errors=errors * UM,
        repeats=np.full((P, H), REPEATS),
        repeat_variance=np.full(A, (SIG_CMM * UM) ** 2),
        repeat_dof=P * H * (REPEATS - 1),
        places=np.broadcast_to(day.places, (P, H, 3)).copy(),
        operations=day.operations,
        operation=day.operation,
        covariates=dict(day.covariates),
        common=np.zeros((1, H, A, 0)),
        of_part=of_part,
        pass_dof=PASS_DOF,
    )
