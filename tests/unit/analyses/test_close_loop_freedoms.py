"""Degrees of freedom beside a datum: traces of dense projectors, and intervals that cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats, coordinate_matrix
from loop_tables import candidate, crossed, prepared_with, residuals
from scipy.stats import binom, t

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.freedoms import degrees_of_freedom, freeing
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.model.visits import Datum

SHAPE = (7, 8, 2)


def prepared(seed: int, datum: Datum, *operations: int) -> Prepared:
    """A table, freed; its candidate shears x along y from part to part."""
    errors = crossed(np.random.default_rng(seed), SHAPE)
    whole = residuals(errors)
    if operations:
        whole = replace(
            whole, operations=("drilled", "milled"), operation=np.array(operations, np.int64)
        )
    whole = replace(whole, datum=datum)
    y = whole.places[0, :, 1] - whole.places[0, :, 1].mean()
    shear = candidate("shear", ({0: np.arange(7.0)[:, None] * y[None] / 100},))
    return prepared_with(replace(whole, errors=free_of(whole.freed, errors)), shear)


def free_of(freed: object, errors: Floats) -> Floats:
    assert callable(freed)
    return np.asarray(freed(errors[..., None])[..., 0])


@pytest.mark.parametrize("operations", [(), (0, 0, 0, 1, 1, 1, 1, 0)])
@pytest.mark.parametrize("datum", ["none", "offset", "offset,rotation"])
def test_they_are_the_traces_of_the_dense_projector(
    datum: Datum, operations: tuple[int, ...]
) -> None:
    own = prepared(1, datum, *operations)
    strata = own.scan.frame.strata
    T = coordinate_matrix(replace(own.scan.frame, freeing=None))
    N = int(np.prod(SHAPE))
    free = freeing(own.table)
    M = np.eye(N) if free is None else free(np.eye(N).reshape(N, *SHAPE)).reshape(N, N)
    expected = [float(np.sum((T[s.slice] @ M) ** 2)) for s in strata.all]
    np.testing.assert_allclose(degrees_of_freedom(own.table, own.scan.frame), expected, atol=1e-9)


def test_a_freed_rotation_is_taken_from_both_lines_it_turns() -> None:
    own = prepared(2, "offset,rotation")
    dof = dict(
        zip(
            ((s.kind, s.axis, s.line) for s in own.scan.frame.strata.all), own.scan.dof, strict=True
        )
    )
    assert dof["part", 0, 0] == dof["part", 1, 0] == 0
    lines = sum(n for (kind, _, _), n in dof.items() if kind == "line")
    # Four lines a part, of which the angle takes one.
    assert lines == pytest.approx(6 * (4 - 1), abs=1e-9)


def test_intervals_of_a_shear_cover_beside_a_freed_rotation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two strata say the same of it: together they have the freedom of one."""
    # Of 3000 tables u is drawn to 1.3 %, of 500 to 3.2 %: 0.7 % of coverage.
    monkeypatch.setattr("mtu_cli.close_loop_sealed.analyses.loop.estimate.DRAWN", 500)
    own, rng, count, hits = prepared(3, "offset,rotation"), np.random.default_rng(4), 400, 0
    none = np.zeros(len(own.scan.names))
    step = Step(index=0, member=0, p=0.0, log_bayes=0.0, posterior=1.0, credible=(0,))
    search = Search(steps=(step,), p=none, log_bayes=none, posterior=none, checks=())
    y = own.table.places[0, :, 1] - own.table.places[0, :, 1].mean()
    for _ in range(count):
        errors = crossed(rng, SHAPE, noise=0.3)
        errors[:, :, 0] += rng.normal(size=(7, 1)) * y / 50
        errors = free_of(own.table.freed, errors)
        fit = added(own.with_table(replace(own.table, errors=errors)), search, 1).fit
        assert fit is not None
        hits += bool(abs(fit.beta[0]) <= t.ppf(0.975, fit.dof[0]) * np.sqrt(fit.covariance[0, 0]))
    assert binom.ppf(1e-3, count, 0.93) <= hits <= binom.ppf(1 - 1e-3, count, 0.97)
