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
from scipy.stats import binom

from mtu_cli.stats import design_inputs as module
from mtu_cli.stats.loop_frame import Frame

STRATA = made(9, 8, 2)
MASKS: dict[str, Mask] = {
    "complete": np.ones((9, 8), bool),
    "holes": holes(9, 8, 0.3, 3),
    "half": half_measured(9, 8),
}
DIRECTIONS = np.random.default_rng(1).normal(size=(2, 2, 3))


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
def test_moments_are_those_of_every_single_entry(mask: str, freed: bool) -> None:
    frame = made_frame(mask, freed=freed)
    # (P H, A, N): what one entry does, nothing where it is not there.
    T = coordinate_matrix(frame).T.reshape(72, 2, -1) * MASKS[mask].reshape(72, 1, 1)
    found = frame.direction_noise(DIRECTIONS)
    for own, direction in zip(found, DIRECTIONS, strict=True):
        S = [along(direction, T[:, a]).T @ along(direction, T[:, a]) for a in range(2)]
        np.testing.assert_allclose(own.mean, [np.trace(item) for item in S], rtol=1e-9)
        products = [[np.trace(a @ b) for b in S] for a in S]
        np.testing.assert_allclose(own.products, products, rtol=1e-9)


def test_of_many_entries_some_sums_do(monkeypatch: pytest.MonkeyPatch) -> None:
    strata = made(150, 8, 2)
    frame = frame_of(strata, holes(150, 8, 0.3, 3))
    exact = frame.direction_noise(DIRECTIONS)
    monkeypatch.setattr(module, "MOST", 3)
    for own, probed in zip(exact, frame.direction_noise(DIRECTIONS), strict=True):
        # Of 400 sums a trace is known to sqrt(2 tr S^2 / 400), a product to about twice its share.
        error = np.sqrt(2 * own.products.diagonal() / 400)
        assert (np.abs(probed.mean - own.mean) <= 5 * error).all()
        share = 2 * np.sqrt(2 / 400)
        np.testing.assert_allclose(probed.products, own.products, rtol=share)
        assert not np.array_equal(probed.mean, own.mean)


@pytest.mark.parametrize("mask", MASKS)
def test_noise_alone_is_taken_for_scatter_as_rarely_as_stated(mask: str) -> None:
    """Entries of 1 and 3, estimated from the same tables; parts turn by twice that of axis x."""
    frame, count = made_frame(mask, freed=True), 2000
    there = MASKS[mask][:, :, None]
    rng = np.random.default_rng(2)
    tables = rng.normal(size=(count, 9, 8, 2)) * [1.0, 3.0] * there
    y, _ = frame.coordinates(tables)
    dof = sizes(STRATA, int((~there).sum()))
    noise = [frame.noise(own, dof, dof) for own in y]
    np.testing.assert_allclose(
        np.mean([item.variance for item in noise], axis=0), [1.0, 9.0], rtol=0.02
    )
    for own, direction in zip(frame.direction_noise(DIRECTIONS), DIRECTIONS, strict=True):
        squares = (along(direction, y) ** 2).sum(axis=1)
        p = np.array(
            [
                own.p(float(q), item.variance, item.dof, 0.0, np.inf)
                for q, item in zip(squares, noise, strict=True)
            ]
        )
        for level in (0.05, 0.01):
            # Satterthwaite's moments are right to a few tenths of the level.
            least = binom.ppf(1e-4, count, 0.7 * level)
            assert least <= (p < level).sum() <= binom.ppf(1 - 1e-4, count, 1.3 * level)


def test_what_parts_do_beside_the_noise_is_held_against_the_prediction() -> None:
    frame = made_frame("complete", freed=False)
    (own, _), direction = frame.direction_noise(DIRECTIONS), DIRECTIONS[0]
    rng = np.random.default_rng(3)
    t = rng.normal(size=(4000, 8)) * np.sqrt(np.sum(direction**2) + 5.0)
    one = np.ones(2)
    p = np.array([own.p(float(q), one, np.full(2, 1e9), 5.0, np.inf) for q in (t**2).sum(axis=1)])
    assert binom.ppf(1e-4, 4000, 0.05) <= (p < 0.05).sum() <= binom.ppf(1 - 1e-4, 4000, 0.05)
    # A prediction of few degrees of freedom says less.
    q = float((t**2).sum(axis=1).max())
    assert own.p(q, one, np.full(2, 1e9), 5.0, 4.0) > own.p(q, one, np.full(2, 1e9), 5.0, np.inf)
