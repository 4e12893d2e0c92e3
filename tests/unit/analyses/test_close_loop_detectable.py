"""What would be found: an effect that is there is no scatter by which it is judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats
from effect_tables import table
from loop_bench.folds import LIBRARY
from scipy.stats import nct

from mtu_cli.close_loop_sealed.analyses.loop.detectable import minimum_detectable
from mtu_cli.close_loop_sealed.analyses.loop.estimate import raw_design
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import search
from mtu_cli.close_loop_sealed.model.effect_library import candidates
from mtu_cli.close_loop_sealed.stats.column_groups import whitened
from mtu_cli.close_loop_sealed.stats.family_gate import Gate

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
        size, power = found[-1]["scale-x"], power_of(prepared, gate, places[:, 0])
        assert power(size) == pytest.approx(0.8, abs=0.02)
    # Whitened, and its gate drawn, with the effect in the data.
    assert found[1]["scale-x"] == pytest.approx(found[0]["scale-x"], rel=1e-6)


def test_an_effect_of_several_forms_is_told_by_the_one_that_shows_least() -> None:
    """A squareness in x, which scatters ten times as much as y, is not found by what y shows."""
    x, y = np.meshgrid([20.0, 140.0, 265.0, 380.0], [15.0, 140.0, 290.0])
    places = np.stack([x.ravel(), y.ravel(), np.full(12, 10.0)], axis=1)
    own = table(12, 12, places=places, covariates={})
    own = replace(own, operations=("",), operation=np.zeros(12, np.int64))
    errors = np.random.default_rng(3).normal(0.0, NOISE, own.errors.shape) * [10.0, 1.0]
    own = replace(own, errors=errors)
    prepared = prepare(own, candidates(own, LIBRARY), own.pass_dof)
    gate = calibrated(prepared.scan, 499, 1)
    found = minimum_detectable(prepared, gate, search(prepared, gate, alpha=1e-12, most=1), 0.05)
    assert found["scale-x"] > 5 * found["scale-y"]
    assert 0.5 < found["squareness-xy"] / found["scale-x"] < 2


def power_of(prepared: Prepared, gate: Gate, places: Floats) -> Callable[[float], float]:
    """By Student's noncentral distribution, of a scale of a root mean square over the holes; its
    scatter is that of the two coordinates of columns beside it.
    """
    scan, strata = prepared.scan, prepared.scan.frame.strata
    place = scan.names.index("scale-x")
    own = next(s.slice for s in strata.all if (s.kind, s.axis) == ("column", 0))
    X = whitened(strata, scan.whitening, raw_design(scan, scan.columns[place]))
    x, y = X[own][:, 0], whitened(strata, scan.whitening, prepared.y)[own]
    rest = y - x * (x @ y) / (x @ x)
    # Two coordinates may happen to be smaller than what single entries scatter.
    entries = next(s.slice for s in strata.all if (s.kind, s.axis) == ("interaction", 0))
    variance = max(float(rest @ rest) / 2, float(np.mean(prepared.y[entries] ** 2)))
    u = np.std(places) * np.sqrt(variance / (x @ x))
    limit = gate.statistic_of(float(np.quantile(gate.largest, 0.95)), place)
    c = np.sqrt(2 * np.expm1(limit / 3))
    return lambda size: float(nct.sf(c, 2, size / u))
