"""Noise along directions of whole parts: entry by entry, and how often what it says is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import (
    Floats,
    Mask,
    coordinate_matrix,
    frame_of,
    half_measured,
    holes,
    made,
    sizes,
    turned_out,
)
from scipy.integrate import simpson
from scipy.stats import binom, chi2, f

from mtu_cli.close_loop_sealed.stats import design_inputs as module
from mtu_cli.close_loop_sealed.stats import direction_noise as direction_module
from mtu_cli.close_loop_sealed.stats.direction_noise import DirectionNoise
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.scatter_tests import scatter_p

STRATA = made(9, 8, 2)
MASKS: dict[str, Mask] = {
    "complete": np.ones((9, 8), bool),
    "holes": holes(9, 8, 0.3, 3),
    "half": half_measured(9, 8),
}
DIRECTIONS = np.random.default_rng(1).normal(size=(2, 2, 3))
ROOT = np.random.default_rng(2).normal(size=(6, 4))
PREDICTED = ROOT @ ROOT.T
"""Of a part's offset and two lines along two axes; two of their sums do not scatter."""
NOTHING = np.zeros((6, 6))


def made_frame(mask: str, *, freed: bool) -> Frame:
    frame = frame_of(STRATA, MASKS[mask])
    if not freed:
        return frame
    freeing = turned_out(MASKS[mask])
    return Frame(strata=STRATA, completion=frame.completion, freeing=freeing)


def along(direction: Floats, y: Floats) -> Floats:
    """Contrasts (..., P - 1) of coordinates (..., N)."""
    total = np.zeros((*y.shape[:-1], STRATA.shape[0] - 1))
    for stratum in STRATA.all:
        if stratum.kind in ("part", "line"):
            total += direction[stratum.axis, stratum.line] * y[..., stratum.slice]
    return total


@pytest.mark.parametrize("freed", [False, True])
@pytest.mark.parametrize("mask", MASKS)
def test_moments_are_those_of_every_single_entry_and_part(mask: str, freed: bool) -> None:
    frame = made_frame(mask, freed=freed)
    # (P H, A, N): what one entry does, nothing where it is not there.
    T = coordinate_matrix(frame).T.reshape(72, 2, -1) * MASKS[mask].reshape(72, 1, 1)
    found = frame.direction_noise(DIRECTIONS, PREDICTED)
    for own, direction in zip(found, DIRECTIONS, strict=True):
        t = along(direction, T)
        S = [t[:, a].T @ t[:, a] for a in range(2)]
        # (P, A (1 + k), P - 1): what each coordinate of a part does, entry by entry.
        basis = STRATA.columns[:, :3]
        of_parts = np.einsum("phac,hj->pajc", t.reshape(9, 8, 2, -1), basis).reshape(9, 6, -1)
        S.append(np.einsum("pic,ij,pje->ce", of_parts, PREDICTED, of_parts))
        np.testing.assert_allclose(own.mean, [np.trace(item) for item in S], rtol=1e-9)
        products = [[np.trace(a @ b) for b in S] for a in S]
        np.testing.assert_allclose(own.products, products, rtol=1e-9)


def test_of_many_entries_some_sums_do(monkeypatch: pytest.MonkeyPatch) -> None:
    strata = made(150, 8, 2)
    frame = frame_of(strata, holes(150, 8, 0.3, 3))
    exact = frame.direction_noise(DIRECTIONS, PREDICTED)
    for place in (module, direction_module):
        monkeypatch.setattr(place, "MOST", 3)
    for own, probed in zip(exact, frame.direction_noise(DIRECTIONS, PREDICTED), strict=True):
        # Of 400 sums a trace is known to sqrt(2 tr S^2 / 400), a product to about twice its share.
        error = np.sqrt(2 * own.products.diagonal() / 400)
        assert (np.abs(probed.mean - own.mean)[:2] <= 5 * error[:2]).all()
        share = 2 * np.sqrt(2 / 400)
        np.testing.assert_allclose(probed.products[:2, :2], own.products[:2, :2], rtol=share)
        assert not np.array_equal(probed.mean, own.mean)
        # Each of very many parts is taken to scatter as one that is whole.
        w = DIRECTIONS[0].ravel() if own is exact[0] else DIRECTIONS[1].ravel()
        assert probed.mean[2] == pytest.approx(149 * w @ PREDICTED @ w)
        assert probed.mean[2] >= own.mean[2]


def judged(frame: Frame, tables: Floats, predicted: Floats) -> Floats:
    """Mean variances (A,) of entries of `tables`, after holding how often what scatters parts is
    taken for more against what is stated.
    """
    count, missing = len(tables), int((~frame.completion.observed).sum())
    y, _ = frame.coordinates(tables * frame.completion.observed[:, :, None])
    dof = sizes(STRATA, missing)
    noise = [frame.noise(own, dof, dof, predicted) for own in y]
    found = frame.direction_noise(DIRECTIONS, predicted)
    for own, direction in zip(found, DIRECTIONS, strict=True):
        squares = (along(direction, y) ** 2).sum(axis=1)
        p = np.array(
            [
                own.p(float(q), item.variance, item.dof, np.inf)
                for q, item in zip(squares, noise, strict=True)
            ]
        )
        for level in (0.05, 0.01):
            # Satterthwaite's moments are right to a few tenths of the level.
            least = binom.ppf(1e-4, count, 0.7 * level)
            assert least <= (p < level).sum() <= binom.ppf(1 - 1e-4, count, 1.3 * level)
    return np.asarray(np.mean([item.variance for item in noise], axis=0))


@pytest.mark.parametrize("mask", MASKS)
def test_noise_alone_is_taken_for_scatter_as_rarely_as_stated(mask: str) -> None:
    """Entries of 1 and 3, estimated from the same tables."""
    tables = np.random.default_rng(2).normal(size=(2000, 9, 8, 2)) * [1.0, 3.0]
    found = judged(made_frame(mask, freed=True), tables, NOTHING)
    np.testing.assert_allclose(found, [1.0, 9.0], rtol=0.02)


@pytest.mark.parametrize("mask", MASKS)
def test_the_machines_own_scatter_is_taken_for_more_as_rarely_as_stated(mask: str) -> None:
    """Lines of parts that scatter five times as much as entries, known exactly: parts that are
    filled in show less of it, and their entries more noise than they have.
    """
    rng = np.random.default_rng(4)
    lines = rng.normal(size=(2000, 9, 2, 3)) * np.sqrt([0.0, 5.0, 5.0])
    tables = rng.normal(size=(2000, 9, 8, 2))
    tables += np.einsum("npaj,hj->npha", lines, STRATA.columns[:, :3])
    found = judged(made_frame(mask, freed=False), tables, np.diag([0.0, 5.0, 5.0] * 2))
    # Of some 20 degrees of freedom a table.
    np.testing.assert_allclose(found, 1.0, rtol=4.5 * np.sqrt(2 / 20 / 2000))


def test_directions_without_the_machines_scatter_are_judged_by_little_where_it_is_large() -> None:
    """Most of what is in the interaction then is the machine's: what is left when it is taken off
    tells the noise by few degrees of freedom, and no alarm of growths or of columns comes of it.
    """
    frame, count = made_frame("holes", freed=False), 1000
    missing = int((~MASKS["holes"]).sum())
    predicted, dof = np.diag([0.0, 50.0, 0.0] * 2), sizes(STRATA, missing)
    rng = np.random.default_rng(5)
    lines = rng.normal(size=(count, 9, 2)) * np.sqrt(50.0)
    tables = rng.normal(size=(count, 9, 8, 2)) + rng.normal(size=(count, 1, 8, 2))
    tables += lines[:, :, None] * STRATA.columns[:, 1][:, None]
    y, _ = frame.coordinates(tables * MASKS["holes"][:, :, None])
    growth = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    (own,) = frame.direction_noise(growth, predicted)
    noise = [frame.noise(item, dof, dof, predicted) for item in y]
    squares = (along(growth[0], y) ** 2).sum(axis=1)
    p = np.array(
        [
            (
                own.p(float(q), item.variance, item.dof, np.inf),
                scatter_p(STRATA, coordinates, item, np.zeros(2), np.inf, np.zeros(99))[0],
            )
            for coordinates, q, item in zip(y, squares, noise, strict=True)
        ]
    )
    assert ((p < 0.05).sum(axis=0) <= binom.ppf(1 - 1e-4, count, 0.06)).all()
    assert np.median([item.dof for item in noise]) < 0.3 * dof.max()
    # A machine that is not well known leaves less of them.
    doubted = frame.noise(y[0], dof, dof, predicted, 4.0)
    assert (doubted.dof < noise[0].dof).all()
    np.testing.assert_array_equal(doubted.variance, noise[0].variance)


def test_a_prediction_of_few_degrees_of_freedom_says_less() -> None:
    (own, _) = made_frame("complete", freed=False).direction_noise(DIRECTIONS, PREDICTED)
    q, one, many = 3 * float(own.mean.sum()), np.ones(2), np.full(2, 1e9)
    assert own.p(q, one, many, 4.0) > own.p(q, one, many, np.inf)


def test_the_leak_of_one_part_is_known_by_one_degree_of_freedom() -> None:
    """What is left of the interaction varies by it from table to table."""
    observed = np.ones((9, 8), bool)
    observed[3, :4] = False
    frame, count, size = frame_of(STRATA, observed), 4000, 100.0
    dof = sizes(STRATA, 4)
    rng = np.random.default_rng(8)
    lines = rng.normal(size=(count, 9, 1, 2)) * np.sqrt(size) * STRATA.columns[:, 1][:, None]
    y, _ = frame.coordinates((rng.normal(size=(count, 9, 8, 2)) + lines) * observed[:, :, None])
    noise = [frame.noise(own, dof, dof, np.diag([0.0, size, 0.0] * 2)) for own in y]
    growth = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    (own,) = frame.direction_noise(growth[None], np.diag([0.0, size, 0.0] * 2))
    squares = (along(growth, y) ** 2).sum(axis=1)
    p = np.array(
        [
            own.p(float(q), item.variance, item.dof, np.inf)
            for q, item in zip(squares, noise, strict=True)
        ]
    )
    for level in (0.05, 0.01):
        assert (p < level).sum() <= binom.ppf(1 - 1e-4, count, level)


def test_an_axis_without_any_scatter_silences_no_other() -> None:
    frame = made_frame("holes", freed=False)
    dof = sizes(STRATA, int((~MASKS["holes"]).sum()))
    tables = np.random.default_rng(9).normal(size=(9, 8, 2)) * [1.0, 0.0]
    y, _ = frame.coordinates(tables * MASKS["holes"][:, :, None])
    noise = frame.noise(y, dof, dof, NOTHING)
    assert noise.dof[1] == pytest.approx(noise.dof[0])
    assert noise.variance[1] == 0.0


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_few_passes_that_showed_little_by_chance_raise_no_alarm(share: float) -> None:
    """The machine's scatter, a `share` of it all, is known by 5 passes, which by chance show a
    tenth of it now and then: Satterthwaite's degrees of freedom do not show that then, and at
    0.001 would be wrong 5 to 20 times as often.
    """
    rng = np.random.default_rng(8)
    count, dof, passes = 20_000, 32, 4
    noise = (1 - share) * rng.chisquare(dof, count) / dof
    shown = share * rng.chisquare(passes, count) / passes
    squares = rng.chisquare(19, count)
    p = []
    for q, v, D in zip(squares, noise, shown, strict=True):
        products = 19.0 * np.array([[1.0, D], [D, D**2]])
        own = DirectionNoise(mean=np.array([19.0, 19.0 * D]), products=products)
        p.append(own.p(float(q), np.array([v]), np.array([float(dof)]), float(passes)))
    for level in (0.05, 0.01, 0.001):
        assert (np.array(p) < level).sum() <= binom.ppf(1 - 1e-4, count, level)


def test_what_is_known_exactly_is_judged_by_a_chi_squared() -> None:
    own = DirectionNoise(mean=np.array([8.0, 4.0]), products=np.array([[8.0, 4.0], [4.0, 2.0]]))
    found = own.p(31.0, np.ones(1), np.array([np.inf]), np.inf)
    # E = 12, Var = 2 (8 + 8 + 2): 8 degrees of freedom.
    assert found == pytest.approx(chi2.sf(31.0 / 12.0 * 8.0, 8), rel=1e-4)


@pytest.mark.parametrize("passes", [2.0, 4.0, 12.0])
@pytest.mark.parametrize("ratio", [1.5, 4.0])
def test_beside_noise_the_machines_scatter_is_what_its_mean_square_may_stand_for(
    passes: float, ratio: float
) -> None:
    """The tail of F integrated over the chi-squared of the passes: on a fine grid of its
    logarithm, by Simpson's rule, in place of the house's nodes.
    """
    noise, shown, dof, n = 2.0, 3.0, 11.0, 9.0
    products = n * np.array([[1.0, shown], [shown, shown**2]])
    own = DirectionNoise(mean=np.array([n, n * shown]), products=products)
    square = ratio * n * (noise + shown)
    found = own.p(square, np.array([noise]), np.array([dof]), passes)
    logs = np.linspace(-30.0, np.log(400.0), 20_001)
    W = np.exp(logs)
    total = n * (noise + shown * passes / W)
    tail = f.sf(square / total, n, total**2 * dof / (n * noise) ** 2)
    wanted = simpson(tail * chi2.pdf(W, passes) * W, x=logs)
    # The house's nodes lie 0.19 apart and end at 6 standard deviations of the normal scale.
    assert found == pytest.approx(wanted, rel=1e-4)
