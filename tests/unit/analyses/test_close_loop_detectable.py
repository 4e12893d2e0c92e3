"""What would be found: an effect that is there is no scatter by which it is judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_tables import table
from loop_bench.folds import LIBRARY

from mtu_cli.analyses.close_loop.detectable import minimum_detectable
from mtu_cli.analyses.close_loop.prepare import prepare
from mtu_cli.analyses.close_loop.scan import calibrated
from mtu_cli.analyses.close_loop.search import search
from mtu_cli.model.effect_library import candidates

NOISE = 1e-3


@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_there_does_not_hide_itself(seed: int) -> None:
    """On 2 x 2 holes a scale has one of three coordinates: it would be most of their scatter."""
    places = np.array([[20.0, 20.0], [380.0, 20.0], [20.0, 280.0], [380.0, 280.0]])
    own = table(16, 4, places=np.column_stack([places, np.full(4, 10.0)]), covariates={})
    own = replace(own, operations=("",), operation=np.zeros(4, np.int64))
    noise = np.random.default_rng(seed).normal(0.0, NOISE, own.errors.shape)
    found = []
    for scale in (0.0, 14e-6):
        errors = noise.copy()
        errors[..., 0] += scale * places[:, 0]
        there = replace(own, errors=errors)
        prepared = prepare(there, candidates(there, LIBRARY), there.pass_dof)
        gate = calibrated(prepared.scan, 499, 1)
        nothing = search(prepared, gate, alpha=1e-12, most=1)
        assert not nothing.steps
        found.append(minimum_detectable(prepared, gate, nothing, 0.05))
    # The null is estimated with the effect in it, and its gate with the null.
    assert found[1]["scale-x"] == pytest.approx(found[0]["scale-x"], rel=0.5)
    assert found[0]["scale-x"] > NOISE / 4
