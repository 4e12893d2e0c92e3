"""What a machine's repeatability makes of one visit, by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from model_examples import stated
from residual_examples import MACHINE, measured

from mtu_cli.close_loop_sealed.model.residual_table import residual_table


def test_of_each_axis_the_variances_of_its_components(tmp_path: Path) -> None:
    """Ex: px + y sq, Ey: py; of 0.4 um, and of 3 urad that y carries, and 0.5 um."""
    text = MACHINE.replace("pass_covariance: [[9]]", "pass_covariance: [[9]], s_repeat: 3")
    model = stated(tmp_path, text.replace("dof: 8", "dof: 8, repeat_dof: 20", 1))
    points = measured(3, 5, 1)
    table, _ = residual_table(model, points, {"dir_x": 1.0})
    first = [int(np.flatnonzero(points.feature == f)[0]) for f in range(5)]
    y = points.nominal[first, 1]
    assert table.visit is not None
    # The fewest: 20 of px, 8 of py.
    assert table.visit.dof == 8
    wanted = np.array([0.4e-3**2 + 3e-6**2 * float(np.mean(y**2)), 0.5e-3**2])
    np.testing.assert_allclose(table.visit.variance, wanted, rtol=1e-12)
