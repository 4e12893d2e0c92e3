"""The fitted null: analysis of variance by hand, components recovered, what is known weighed in."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import (
    Floats,
    Mask,
    dense_covariance,
    frame_of,
    grid,
    half_measured,
    holes,
    made,
    nothing_known,
    null,
    pairs,
    sizes,
    turned_out,
    whole_frame,
    within,
)

from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.loop_null import KnownScatter, NullModel, null_of, whitening_of
from mtu_cli.close_loop_sealed.stats.strata import Strata, strata_of

Draws = tuple[Strata, NullModel]


def lively() -> Draws:
    """Two axes whose offsets and lines are correlated, columns and all."""
    strata = made(12, 10, 2)
    root = np.random.default_rng(1).normal(size=(6, 6))
    model = null(
        strata,
        interaction=np.array([1.0, 2.0]),
        column=np.array([0.5, 1.0]),
        part=root @ root.T + 3.0 * np.eye(6),
    )
    return strata, model


def tables_of(strata: Strata, model: NullModel, count: int, seed: int) -> Floats:
    """Tables (count, P, H, A) of a null by the root of its dense covariance."""
    V = dense_covariance(strata, model)
    values, vectors = np.linalg.eigh(V)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = np.random.default_rng(seed).normal(size=(count, len(V))) @ root.T
    return np.asarray(drawn.reshape(count, *strata.shape))


def fitted(strata: Strata, there: Mask, tables: Floats) -> list[NullModel]:
    frame = frame_of(strata, there)
    dof = sizes(strata, int((~there).sum()))
    y, _ = frame.coordinates(np.where(there[:, :, None], tables, 0.0))
    return [null_of(frame, own, dof, nothing_known(strata)) for own in y]


def test_a_complete_table_gives_the_analysis_of_variance() -> None:
    # Henderson's first method by sums over parts and columns, no strata in sight.
    P, H = 7, 9
    strata = strata_of(P, np.zeros((H, 0)), 1)
    rng = np.random.default_rng(2)
    X = rng.normal(size=(P, H)) + 2 * rng.normal(size=(P, 1)) + 1.5 * rng.normal(size=(1, H))
    (found,) = fitted(strata, np.ones((P, H), bool), X[None, :, :, None])
    row, column = X.mean(axis=1), X.mean(axis=0)
    rest = X - row[:, None] - column + X.mean()
    square = np.sum(rest**2) / ((P - 1) * (H - 1))
    assert found.interaction[0] == pytest.approx(square, rel=1e-12)
    assert found.column[0] == pytest.approx(np.var(column, ddof=1) - square / P, rel=1e-12)
    assert found.part[0, 0] == pytest.approx(H * np.var(row, ddof=1) - square, rel=1e-12)


def test_the_ratings_of_shrout_and_fleiss() -> None:
    # Psychol. Bull. 86 (1979) 420, tables 2 and 3: six targets, four judges; mean squares
    # 11.24, 32.49 and 1.02, ICC(2,1) 0.29 and ICC(3,1) 0.71.
    ratings = np.array(
        [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float
    )
    strata = strata_of(6, np.zeros((4, 0)), 1)
    y, _ = strata.coordinates(ratings[:, :, None])
    squares = {s.kind: float(np.mean(y[s.slice] ** 2)) for s in strata.all}
    assert squares["part"] == pytest.approx(11.24, abs=0.005)
    assert squares["column"] == pytest.approx(32.49, abs=0.005)
    assert squares["interaction"] == pytest.approx(1.02, abs=0.005)
    (found,) = fitted(strata, np.ones((6, 4), bool), ratings[None, :, :, None])
    target, noise = found.part[0, 0] / 4, found.interaction[0]
    # Three judges beyond their mean tell their scatter to three quarters (four would all of it).
    judge = (squares["column"] - noise) / 6
    assert found.column[0] == pytest.approx(0.75 * judge, rel=1e-12)
    assert target / (target + judge + noise) == pytest.approx(0.29, abs=0.005)
    assert target / (target + noise) == pytest.approx(0.71, abs=0.005)


@pytest.mark.parametrize("name", ["complete", "holes", "half"])
def test_components_are_recovered(name: str) -> None:
    strata, model = lively()
    masks = {
        "complete": np.ones((12, 10), bool),
        "holes": holes(12, 10, 0.2, 3),
        "half": half_measured(12, 10),
    }
    count = 400 if name == "complete" else 60
    found = fitted(strata, masks[name], tables_of(strata, model, count, 4))
    for what in ("interaction", "column", "part"):
        values = np.array([getattr(item, what) for item in found])
        error = values.std(axis=0) / np.sqrt(count)
        assert within(values.mean(axis=0), getattr(model, what), error), what


@pytest.mark.parametrize("what", ["part", "column", "with_noise"])
def test_one_missing_entry_changes_a_fit_by_little(what: str) -> None:
    """Four parts lean on the prediction (100 for a truth of 12), the scatter of one column beyond
    the lines is told to a quarter: as much with an entry less. Mean differences of 200 tables.
    """
    P, H = (4, 12) if what == "part" else (8, 4 if what == "column" else 12)
    strata = made(P, H, 1)
    truth = null(
        strata,
        interaction=np.ones(1),
        column=np.array([9.0 if what == "column" else 0.0]),
        part=(0.0 if what == "with_noise" else 12.0) * np.eye(1 + strata.lines),
    )
    known = KnownScatter(100.0 * np.eye(3), np.zeros((3, 0)), 8.0)
    if what != "part":
        known = nothing_known(strata)
    less = np.ones((P, H), bool)
    less[1, 2] = False
    tables = tables_of(strata, truth, 200, 10)
    found = []
    for there in (np.ones((P, H), bool), less):
        frame, dof = frame_of(strata, there), sizes(strata, int((~there).sum()))
        y, _ = frame.coordinates(np.where(there[:, :, None], tables, 0.0))
        fits = [null_of(frame, own, dof, known) for own in y]
        if what == "with_noise":
            # Its least eigenvalue: what the estimates of few parts leave of the noise itself.
            found.append([np.linalg.eigvalsh(item.with_noise)[0] for item in fits])
        else:
            found.append([np.mean(np.diag(np.atleast_2d(getattr(item, what)))) for item in fits])
    apart, scatter = np.subtract(*np.array(found)), np.std(found[0])
    assert abs(apart.mean()) < 0.2 * scatter
    assert np.sqrt(np.mean(apart**2)) < 0.6 * scatter


def test_reversals_have_their_own_component() -> None:
    strata = strata_of(9, np.repeat(np.linspace(-1, 1, 8), 2)[:, None], 1, pairs(16))
    n = 1 + strata.lines
    model = null(
        strata,
        interaction=np.array([1.0]),
        column=np.array([4.0]),
        reversal=np.array([0.5]),
        part=4.0 * np.eye(n),
    )
    found = fitted(strata, np.ones((9, 16), bool), tables_of(strata, model, 400, 5))
    for what in ("column", "reversal", "interaction"):
        values = np.array([getattr(item, what)[0] for item in found])
        assert within(values.mean(), getattr(model, what)[0], values.std() / 20), what


def test_components_are_never_negative() -> None:
    strata = made(6, 8, 2)
    model = null(strata, interaction=np.ones(2), column=np.zeros(2), part=np.zeros((6, 6)))
    for item in fitted(strata, np.ones((6, 8), bool), tables_of(strata, model, 50, 6)):
        assert (item.column >= 0).all()
        assert np.linalg.eigvalsh(item.part).min() > -1e-12


@pytest.mark.parametrize("rounding", [1e-35, 1e-18])
def test_an_axis_of_rounding_alone_does_not_swell_the_others(rounding: float) -> None:
    """All on nominal along y, but for what taking an effect out leaves there of the parts.

    Beside 0.3 of truth, ten are not reached by chance in three tables.
    """
    strata = made(8, 12, 2)
    there = np.ones((8, 12), bool)
    there.flat[[3, 17, 40, 66, 90]] = False
    frame, dof = frame_of(strata, there), sizes(strata, 5)
    tables = np.random.default_rng(7).normal(size=(3, 8, 12, 2)) * there[..., None]
    for y in frame.coordinates(tables)[0]:
        for stratum in strata.all:
            if stratum.axis == 1:
                y[stratum.slice] *= rounding if stratum.kind == "part" else 0.0
        item = null_of(frame, y, dof, nothing_known(strata))
        assert np.abs(np.diag(item.part)).max() < 10.0
        for own in whitening_of(strata, item):
            assert np.isfinite(own).all()


def test_few_parts_lean_on_what_the_model_knows() -> None:
    # With n = P - 1 of its own and 3 for the prediction: (n own + 3 known) / (n + 3).
    known_part = 5.0 * np.eye(3)
    for P, weight in ((7, 3 / 9), (10, 3 / 12), (11, 0.0)):
        strata = made(P, 9, 1)
        frame = whole_frame(strata)
        truth = null(strata, interaction=np.ones(1), column=np.zeros(1), part=40.0 * np.eye(3))
        y, _ = frame.coordinates(tables_of(strata, truth, 1, 7)[0])
        own = null_of(frame, y, sizes(strata), nothing_known(strata))
        both = null_of(frame, y, sizes(strata), KnownScatter(known_part, np.zeros((3, 0)), 8.0))
        expected = (1 - weight) * own.part + weight * known_part
        np.testing.assert_allclose(both.part, expected, rtol=1e-9)
        assert both.model_dof == 8.0


def test_one_part_scatters_as_its_columns_do() -> None:
    strata = strata_of(1, grid(12), 2)
    frame = whole_frame(strata)
    table = np.random.default_rng(8).normal(size=(1, 12, 2)) * [1.0, 3.0]
    y, _ = frame.coordinates(table)
    known = KnownScatter(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), np.zeros((6, 0)), 5.0)
    found = null_of(frame, y, sizes(strata), known)
    X = np.column_stack([np.ones(12), grid(12)])
    left = table[0] - X @ np.linalg.lstsq(X, table[0], rcond=None)[0]
    np.testing.assert_allclose(found.interaction, np.sum(left**2, axis=0) / 9, rtol=1e-12)
    np.testing.assert_array_equal(found.column, 0)
    np.testing.assert_allclose(found.part, known.part, rtol=1e-12)


def test_of_one_part_the_noise_is_never_less_than_nothing() -> None:
    """Its columns scatter less than what the prediction of parts, freed in part, makes expect."""
    strata = strata_of(1, grid(8), 2)
    frame = Frame(
        strata=strata,
        completion=whole_frame(strata).completion,
        freeing=turned_out(np.ones((1, 8), bool)),
    )
    known = KnownScatter(1e5 * np.eye(6), np.zeros((6, 0)), 5.0)
    y, _ = frame.coordinates(np.random.default_rng(11).normal(size=(20, 1, 8, 2)))
    for own in y:
        found = null_of(frame, own, sizes(strata), known)
        assert (found.interaction > 0).all()


def test_whitening_makes_the_column_coordinates_equally_uncertain() -> None:
    strata, model = lively()
    common = np.random.default_rng(9).normal(size=(6, 2)) * 3
    model = null(
        strata,
        interaction=model.interaction,
        column=model.column,
        part=model.part,
        common=common,
    )
    W = whitening_of(strata, model)
    frame = whole_frame(strata)
    n = int(np.prod(strata.shape))
    T = frame.coordinates(np.eye(n).reshape(n, *strata.shape))[0].T
    V = T @ dense_covariance(strata, model) @ T.T
    for axis in range(2):
        stratum = strata.find("column", axis)
        assert stratum is not None
        own = V[stratum.slice, stratum.slice]
        whole = np.eye(stratum.size)
        whole[:2, :2] = W[axis]
        level = model.interaction[axis] + 12 * model.column[axis]
        white = whole @ own @ whole.T
        np.testing.assert_allclose(white, level * np.eye(stratum.size), rtol=0, atol=1e-10)


def test_entries_scatter_no_less_than_their_rounding() -> None:
    strata = made(6, 8, 2)
    known = nothing_known(strata)
    none = np.zeros(strata.size)
    frame = whole_frame(strata)
    rounded = KnownScatter(known.part, known.common, known.dof, np.array([0.3, 0.0]))
    assert null_of(frame, none, sizes(strata), rounded).interaction.tolist() == [0.3, 0.0]
    y = np.random.default_rng(1).normal(size=strata.size)
    larger = null_of(frame, y, sizes(strata), rounded)
    assert larger.interaction == pytest.approx(null_of(frame, y, sizes(strata), known).interaction)
