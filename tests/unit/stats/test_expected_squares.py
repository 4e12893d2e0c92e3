"""Expected mean squares of incomplete and of freed tables: dense covariances, drawn tables."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import (
    Floats,
    Mask,
    coordinate_matrix,
    dense_covariance,
    expected,
    half_measured,
    holes,
    made,
    null,
    pairs,
    sizes,
    turned_out,
    within,
)

from mtu_cli.close_loop_sealed.stats import design_inputs as module
from mtu_cli.close_loop_sealed.stats.crossed import completion
from mtu_cli.close_loop_sealed.stats.expected_squares import expected_squares
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.loop_null import NullModel, draw
from mtu_cli.close_loop_sealed.stats.mean_squares import MeanSquares, mean_squares
from mtu_cli.close_loop_sealed.stats.strata import Strata, strata_of

KINDS = ("interaction", "rest", "turned", "part")
MASKS: dict[str, Mask] = {
    "complete": np.ones((6, 8), bool),
    "holes": holes(6, 8, 0.3, 3),
    "half": half_measured(6, 8),
}


def model_of(strata: Strata) -> NullModel:
    n = strata.shape[2] * (1 + strata.lines)
    rng = np.random.default_rng(6)
    root = rng.normal(size=(n, n))
    return null(
        strata,
        interaction=np.array([1.0, 2.0]),
        column=np.array([0.5, 1.0]),
        reversal=np.array([0.3, 0.7]),
        part=root @ root.T,
        common=rng.normal(size=(n, 2)),
    )


def frame_of(strata: Strata, there: Mask, *, freed: bool) -> Frame:
    return Frame(
        strata=strata,
        completion=completion(there, strata.smooth),
        freeing=turned_out(there) if freed else None,
    )


def dense(frame: Frame, model: NullModel, dof: Floats) -> MeanSquares:
    """Mean squares by the covariance of all coordinates, entry by entry of the table."""
    strata = frame.strata
    P, _, A = strata.shape
    T = coordinate_matrix(frame)
    V = T @ dense_covariance(strata, model) @ T.T
    own = {kind: np.full(A, np.nan) for kind in KINDS[:3]}
    k = 1 + strata.lines
    part = np.zeros((A * k, A * k))
    for s, stratum in enumerate(strata.all):
        rest = np.arange(stratum.start + len(stratum.lead), stratum.start + stratum.size)
        name = {"interaction": "interaction", "column": "rest", "reversal": "turned"}
        if stratum.kind in name and len(rest):
            n = dof[s] if stratum.kind == "interaction" else len(rest)
            own[name[stratum.kind]][stratum.axis] = np.trace(V[np.ix_(rest, rest)]) / n
        for other in strata.all:
            if {stratum.kind, other.kind} <= {"part", "line"}:
                block = V[stratum.slice, other.slice]
                place = stratum.axis * k + stratum.line, other.axis * k + other.line
                part[place] = np.trace(block) / (P - 1)
    return MeanSquares(part=part, **own)


def strata_by(name: str) -> Strata:
    if name == "reversals":
        return strata_of(6, np.repeat(np.linspace(-1, 1, 4), 2)[:, None], 2, pairs(8))
    return made(6, 8, 2, lines=name == "lines")


@pytest.mark.parametrize("freed", [False, True])
@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("directions", ["none", "lines", "reversals"])
def test_they_are_those_of_the_dense_covariance(directions: str, mask: str, freed: bool) -> None:
    strata = strata_by(directions)
    frame = frame_of(strata, MASKS[mask], freed=freed)
    model, dof = model_of(strata), sizes(strata, int((~MASKS[mask]).sum()))
    found, by_hand = expected(frame, model, dof), dense(frame, model, dof)
    for what in KINDS:
        np.testing.assert_allclose(getattr(found, what), getattr(by_hand, what), rtol=1e-9)


def test_they_are_the_mean_of_drawn_tables() -> None:
    strata = strata_by("lines")
    frame = frame_of(strata, MASKS["holes"], freed=True)
    model, dof = model_of(strata), sizes(strata, int((~MASKS["holes"]).sum()))
    y, _ = draw(frame, model, 2000, np.random.default_rng(7))
    drawn = [mean_squares(strata, own[None], dof) for own in y]
    found = expected(frame, model, dof)
    for what in ("interaction", "rest", "part"):
        values = np.array([getattr(item, what) for item in drawn])
        error = values.std(axis=0) / np.sqrt(len(values))
        assert within(values.mean(axis=0), getattr(found, what), error), what


def test_random_signs_leave_the_squares_of_each_input_alone() -> None:
    found = module.signs(module.MOST + 1)
    assert found.shape == (module.PROBES, module.MOST + 1)
    np.testing.assert_allclose((found**2).sum(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(module.signs(module.MOST), np.eye(module.MOST))


def test_of_many_inputs_some_sums_do(monkeypatch: pytest.MonkeyPatch) -> None:
    # A sum of squares of n degrees of freedom is known to sqrt(2 / (400 n)) of it.
    strata = strata_by("lines")
    frame = frame_of(strata, MASKS["holes"], freed=False)
    model, dof = model_of(strata), sizes(strata, int((~MASKS["holes"]).sum()))
    exact = expected(frame, model, dof)
    monkeypatch.setattr(module, "MOST", 3)
    probed = expected(frame, model, dof, expected_squares(strata, frame.completion, None))
    for what, n in (("interaction", dof.min()), ("rest", 5), ("part", 5)):
        wanted, got = getattr(exact, what), getattr(probed, what)
        scale = np.abs(wanted) if what != "part" else np.sqrt(np.outer(*[np.diag(wanted)] * 2))
        assert within(got, wanted, scale * np.sqrt(2 / (module.PROBES * n))), what
        assert not np.array_equal(got, wanted)
