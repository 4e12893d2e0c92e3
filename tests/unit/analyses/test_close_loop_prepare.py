"""From residuals to coordinates: factors, degrees of freedom, means, what cannot be tested."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats, contrasts, coordinate_matrix, holes
from loop_tables import candidate, crossed, offset, prepared_with, residuals, whole_column

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.model.effect_candidate import Column

SHAPE = (8, 9, 2)
RNG = np.random.default_rng(1)
CELLS: Column = {0: RNG.normal(size=(8, 9))}
PLACE: Column = {0: RNG.normal(size=(1, 9)), 1: RNG.normal(size=(1, 9))}
DRIFT: Column = {1: RNG.normal(size=(8, 1))}
ALL = (
    candidate("cells", (CELLS,)),
    candidate("place", (PLACE,)),
    candidate("drift", (DRIFT,), (CELLS,)),
    offset("x"),
)


def noise(seed: int) -> Floats:
    return crossed(np.random.default_rng(seed), SHAPE)


def kinds(own: Prepared, kind: str) -> Floats:
    strata = own.scan.frame.strata
    return np.array([n for s, n in zip(strata.all, own.scan.dof, strict=True) if s.kind == kind])


def test_degrees_of_freedom_are_those_of_the_table() -> None:
    there = holes(8, 9, 0.2, 2)
    whole, some = (prepared_with(residuals(noise(1), there=t), *ALL) for t in (None, there))
    np.testing.assert_array_equal(kinds(whole, "interaction"), 7 * (9 - 3))
    # What every single entry that is there adds to the interaction's sum of squares.
    T = coordinate_matrix(some.scan.frame).reshape(-1, 72, 2)[:, there.ravel()]
    of_entries = [np.sum(T[s.slice, :, s.axis] ** 2)
                  for s in some.scan.frame.strata.all if s.kind == "interaction"]  # fmt: skip
    np.testing.assert_allclose(kinds(some, "interaction"), of_entries, rtol=1e-9)
    for kind, size in (("part", 7), ("line", 7), ("column", 8)):
        np.testing.assert_array_equal(kinds(some, kind), size)
    freed = prepared_with(residuals(noise(1), datum="offset"), *ALL)
    np.testing.assert_array_equal(kinds(freed, "part"), 0)


def test_factors_are_the_covariance_of_a_parts_coordinates() -> None:
    # J D J' of each part and J C J' of all, turned by the dense rotation of whole tables.
    rng = np.random.default_rng(3)
    lever = np.stack([np.ones(9), *residuals(noise(1)).places[0, :, :2].T / 50.0], axis=1)
    common = np.einsum("hj,jak->hak", lever, rng.normal(size=(3, 2, 2)))[None]
    of_part = np.einsum("hj,pjar->phar", lever, rng.normal(size=(8, 3, 2, 4)))
    own = prepared_with(residuals(noise(1), common=common, of_part=of_part), *ALL)
    strata = own.scan.frame.strata
    T = coordinate_matrix(own.scan.frame)
    V = np.zeros((8, 9, 2, 8, 9, 2))
    for p in range(8):
        V[p, :, :, p] = np.einsum("har,gbr->hagb", of_part[p], of_part[p])
    V = T @ V.reshape(144, 144) @ T.T
    C = np.broadcast_to(common, (8, 9, 2, 2)).reshape(144, 2)
    C = T @ C @ C.T @ T.T
    k = 1 + strata.lines
    for s in strata.all:
        at = s.axis * k + s.line
        if s.kind in ("part", "line"):
            # Contrasts of parts of unlike covariance: their mean is the parts' mean.
            mean = np.trace(V[s.slice, s.slice]) / s.size
            weights = np.sum(contrasts(8) ** 2, axis=1) / 7
            turned = np.einsum("h,phr->pr", strata.columns[:, s.line], of_part[:, :, s.axis])
            assert mean == pytest.approx(weights @ (turned**2).sum(axis=1), rel=1e-9)
            assert own.known.part[at, at] == pytest.approx(mean, rel=0.5)
        if s.kind == "column":
            lead = slice(s.start, s.start + len(s.lead))
            rows = [s.axis * k + j for j in s.lead]
            F = own.known.common[rows]
            np.testing.assert_allclose(F @ F.T, C[lead, lead], rtol=1e-9, atol=1e-10)
    alike = prepared_with(residuals(noise(1), of_part=of_part[:1]), *ALL)
    each = prepared_with(residuals(noise(1), of_part=np.repeat(of_part[:1], 8, axis=0)), *ALL)
    np.testing.assert_allclose(alike.known.part, each.known.part, rtol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.25])
def test_another_table_of_the_same_design_is_as_if_prepared_anew(share: float) -> None:
    there = holes(8, 9, share, 4)
    first = prepared_with(residuals(noise(5), there=there), *ALL)
    other = residuals(noise(6), there=there)
    moved, anew = first.with_table(other), prepared_with(other, *ALL)
    np.testing.assert_array_equal(moved.y, anew.y)
    np.testing.assert_array_equal(moved.grand, anew.grand)
    for what in ("interaction", "column", "part"):
        expected = getattr(anew.scan.null, what)
        np.testing.assert_array_equal(getattr(moved.scan.null, what), expected)
    np.testing.assert_array_equal(moved.scan.whitening, anew.scan.whitening)


def test_other_missing_cells_are_prepared_anew() -> None:
    first = prepared_with(residuals(noise(5)), *ALL)
    there = holes(8, 9, 0.2, 7)
    moved = first.with_table(residuals(noise(5), there=there))
    np.testing.assert_array_equal(moved.scan.frame.completion.observed, there)
    assert len(moved.scan.columns) == len(first.scan.columns)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_without_noise_the_grand_mean_is_that_of_the_columns(share: float) -> None:
    # What is missing must not make a mean error out of an effect that has none.
    there = holes(8, 9, share, 8)
    levels = np.array([0.3, -0.2])
    for i, column in enumerate((CELLS, PLACE, DRIFT)):
        errors = 5.0 * whole_column(column, SHAPE) + levels
        own = prepared_with(residuals(errors, there=there), *ALL)
        found = own.grand - 5.0 * own.means[i][0]
        np.testing.assert_allclose(found, levels, rtol=0, atol=1e-10)


def test_candidates_stand_in_the_order_mean_offset_scatter() -> None:
    table = residuals(noise(9))
    scatter = candidate("rotation-scatter", kind="scatter")
    own = prepare(table, (offset("y"), scatter, *ALL), 10.0)
    names = ("cells", "place", "drift", "offset-y", "offset-x", "rotation-scatter")
    assert own.scan.names == names
    assert tuple(c.name for c in own.candidates) == names
    assert own.scan.offsets == (1, 0)
    assert own.scan.scatters == ("rotation-scatter",)
    assert [len(m) for m in own.scan.columns] == [1, 1, 2]
    assert len(own.members) == len(own.flat()) == 4


def test_what_cannot_be_tested_is_left_out() -> None:
    gone = replace(candidate("gone", (CELLS,)), unavailable="no such column")
    constant = candidate("constant", ({0: np.ones((1, 1))},))
    scatter = candidate("rotation-scatter", kind="scatter")

    def names(P: int, *, flat: bool = False, datum: str = "none") -> tuple[str, ...]:
        errors = crossed(np.random.default_rng(10), (P, 9, 2))
        table = residuals(errors, flat=flat, datum=datum)
        return prepare(table, (gone, constant, scatter, offset("x"))).scan.names

    assert names(8) == ("offset-x", "rotation-scatter")
    assert names(2) == ()
    assert names(4) == ("offset-x",)
    assert names(8, flat=True) == ("offset-x",)
    assert names(8, datum="offset") == ("rotation-scatter",)
    assert names(8, datum="offset,rotation") == ()
