"""Components of incomplete tables give, on average, the mean squares that they were told by."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import (
    Mask,
    coordinate_matrix,
    dense_covariance,
    half_measured,
    holes,
    made,
    null,
    sizes,
    turned_out,
)

from mtu_cli.close_loop_sealed.stats import as_if_complete as module
from mtu_cli.close_loop_sealed.stats.as_if_complete import as_if_complete
from mtu_cli.close_loop_sealed.stats.crossed import completion
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.mean_squares import LEAST, MeanSquares, mean_squares

STRATA = made(8, 9, 2)
MASKS: dict[str, Mask] = {
    "complete": np.ones((8, 9), bool),
    "holes": holes(8, 9, 0.3, 3),
    "half": half_measured(8, 9),
}
COMMON = np.random.default_rng(2).normal(size=(6, 2))


def frame_of(mask: str, *, freed: bool) -> Frame:
    there = MASKS[mask]
    freeing = turned_out(there) if freed else None
    return Frame(strata=STRATA, completion=completion(there, STRATA.smooth), freeing=freeing)


def by_components(frame: Frame, aim: MeanSquares, dof: np.ndarray) -> MeanSquares:
    """The mean squares that the components of `aim` give on average: entry by entry."""
    noise = np.repeat(aim.interaction, 3)
    model = null(
        STRATA,
        interaction=aim.interaction,
        column=(aim.rest - aim.interaction) / 8,
        reversal=np.zeros(2),
        part=aim.part - np.diag(noise),
        common=COMMON,
    )
    T = coordinate_matrix(frame) * np.tile(frame.completion.observed.ravel(), (2, 1)).T.ravel()
    V = T @ dense_covariance(STRATA, model) @ T.T
    # Components may be negative here: sums of squares of its eigenvectors, each as often as it
    # counts, are expectations.
    values, vectors = np.linalg.eigh(V)
    own = [mean_squares(STRATA, vector[None], dof) for vector in vectors.T]
    interaction, rest, turned, part = (
        sum(value * getattr(item, kind) for value, item in zip(values, own, strict=True))
        for kind in ("interaction", "rest", "turned", "part")
    )
    return MeanSquares(interaction=interaction, rest=rest, turned=turned, part=part)


@pytest.mark.parametrize("freed", [False, True])
@pytest.mark.parametrize("mask", MASKS)
def test_they_give_what_was_found(mask: str, freed: bool) -> None:
    frame = frame_of(mask, freed=freed)
    dof = sizes(STRATA, int((~MASKS[mask]).sum()))
    rng = np.random.default_rng(1)
    tables = rng.normal(size=(1, 8, 9, 2)) * [1.0, 2.0] + rng.normal(size=(1, 8, 1, 2))
    tables += 2 * rng.normal(size=(1, 1, 9, 2))
    wanted = mean_squares(STRATA, frame.coordinates(tables)[0], dof)
    aim = as_if_complete(frame, wanted, dof, np.zeros((6, 6)), COMMON)
    got = by_components(frame, aim, dof)
    near = 1e-3
    np.testing.assert_allclose(got.interaction, wanted.interaction, rtol=near)
    np.testing.assert_allclose(got.rest, wanted.rest, rtol=near)
    scale = np.sqrt(wanted.part.diagonal())
    assert (np.abs(got.part - wanted.part) <= near * np.outer(scale, scale) + 1e-9).all()
    if mask == "complete" and not freed:
        assert aim.interaction == pytest.approx(wanted.interaction)


def test_noise_of_entries_is_never_all_taken_for_something_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Parts that go far along their lines and entries that hardly scatter; and it ends."""
    frame, dof = frame_of("half", freed=False), sizes(STRATA, 40)
    wanted = MeanSquares(
        interaction=np.full(2, 1e-3),
        rest=np.full(2, 1.0),
        turned=np.full(2, np.nan),
        part=np.diag([1.0, 1e3, 1e3] * 2),
    )
    rounds, share = [], module._share

    def counted(*given: MeanSquares) -> float:
        rounds.append(share(*given))
        return rounds[-1]

    monkeypatch.setattr(module, "_share", counted)
    aim = as_if_complete(frame, wanted, dof, np.zeros((6, 6)), np.zeros((6, 0)))
    np.testing.assert_allclose(aim.interaction, LEAST * wanted.interaction)
    assert 1 < len(rounds) < module.CORRECTIONS
