"""Tables drawn of the null have its covariance, whatever is missing or free, and its tails."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import (
    Floats,
    coordinate_matrix,
    dense_covariance,
    half_measured,
    holes,
    made,
    null,
)
from scipy.stats import kstest, t

from mtu_cli.close_loop_sealed.stats.crossed import Freeing, completion
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.loop_null import draw

STRATA = made(5, 6, 2)
COUNT = 20_000
ROOT = np.random.default_rng(1).normal(size=(6, 6))
COMMON = np.random.default_rng(2).normal(size=(6, 3))


def offsets(tables: Floats) -> Floats:
    return np.asarray(tables - tables.mean(axis=-2, keepdims=True))


FRAMES: dict[str, tuple[np.ndarray, Freeing | None]] = {
    "complete": (np.ones((5, 6), bool), None),
    "holes": (holes(5, 6, 0.25, 3), None),
    "half": (half_measured(5, 6), None),
    "free": (np.ones((5, 6), bool), offsets),
}


@pytest.mark.parametrize("name", FRAMES)
def test_drawn_coordinates_have_the_covariance_of_the_entries(name: str) -> None:
    there, freeing = FRAMES[name]
    frame = Frame(strata=STRATA, completion=completion(there), freeing=freeing)
    model = null(
        STRATA,
        interaction=np.array([1.0, 2.0]),
        column=np.array([0.5, 1.0]),
        part=ROOT @ ROOT.T,
        common=COMMON,
    )
    T = coordinate_matrix(frame)
    V = T @ dense_covariance(STRATA, model) @ T.T
    y, grand = draw(frame, model, COUNT, np.random.default_rng(4))
    assert y.shape == (COUNT, STRATA.size)
    assert grand.shape == (COUNT, 2)
    found = y.T @ y / COUNT
    # Isserlis: the variance of a product of normals is V_ii V_jj + V_ij^2.
    error = np.sqrt((np.outer(np.diag(V), np.diag(V)) + V**2) / COUNT)
    # Of about 1700 entries the largest deviation passes 5.5 in one case of 15 000.
    assert (np.abs(found - V) < 5.5 * error + 1e-12).all()


@pytest.mark.parametrize("name", ["complete", "holes"])
def test_drawn_grand_means_have_the_variance_of_the_mean(name: str) -> None:
    there, _ = FRAMES[name]
    frame = Frame(strata=STRATA, completion=completion(there), freeing=None)
    model = null(
        STRATA,
        interaction=np.array([1.0, 2.0]),
        column=np.array([0.5, 1.0]),
        part=ROOT @ ROOT.T,
        common=COMMON,
    )
    n = int(np.prod(STRATA.shape))
    G = frame.coordinates(np.eye(n).reshape(n, *STRATA.shape))[1].T
    T = coordinate_matrix(frame)
    V = dense_covariance(STRATA, model)
    y, grand = draw(frame, model, COUNT, np.random.default_rng(5))
    cross = G @ V @ T.T
    own = G @ V @ G.T
    error = np.sqrt((np.outer(np.diag(own), np.diag(T @ V @ T.T)) + cross**2) / COUNT)
    assert (np.abs(grand.T @ y / COUNT - cross) < 5 * error + 1e-12).all()
    error = np.sqrt((np.outer(np.diag(own), np.diag(own)) + own**2) / COUNT)
    assert (np.abs(grand.T @ grand / COUNT - own) < 5 * error + 1e-12).all()


def test_estimated_coefficients_follow_students_t() -> None:
    # Nothing but the coefficients' errors: one factor, so all coordinates are one t variable.
    factor = np.arange(1.0, 7.0)[:, None]
    model = null(
        STRATA,
        interaction=np.zeros(2),
        column=np.zeros(2),
        part=np.zeros((6, 6)),
        common=factor,
        dof=4.0,
    )
    frame = Frame(strata=STRATA, completion=completion(np.ones((5, 6), bool)), freeing=None)
    y, grand = draw(frame, model, 4000, np.random.default_rng(6))
    one = STRATA.find("column", 0)
    other = STRATA.find("column", 1)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(y[:, one.start] / 2, y[:, other.start + 1] / 6, rtol=1e-9)
    np.testing.assert_allclose(y[:, one.start] / 2, grand[:, 0] * np.sqrt(30), rtol=1e-9)
    assert kstest(y[:, one.start] / 2, t(4).cdf).pvalue > 1e-3
    assert kstest(y[:, one.start] / 2, "norm").pvalue < 1e-3


def test_the_same_stream_draws_the_same_bytes() -> None:
    model = null(
        STRATA, interaction=np.ones(2), column=np.ones(2), part=np.eye(6), common=COMMON, dof=3.0
    )
    frame = Frame(strata=STRATA, completion=completion(FRAMES["holes"][0]), freeing=None)
    first = draw(frame, model, 7, np.random.default_rng(7))
    again = draw(frame, model, 7, np.random.default_rng(7))
    assert [v.tobytes() for v in first] == [v.tobytes() for v in again]
