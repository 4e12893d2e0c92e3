"""Evidence of thermal models: choice and held-out errors once more by plain nested fits of raw
rows, nothing compressed, merged or reused; lags that are found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from plain_selection import by_full_refits
from synthetic_drift import ROUNDING, UM, Plan, fitted, one, rises

from mtu_cli.files.readings import Readings
from mtu_cli.stats.least_squares import FloatArray

PLACES = (0.0, 120.0, 200.0)
PENALTIES = (0.0, *(10.0**k for k in np.arange(-8.0, 0.6, 0.5)))
WORTH = 0.02


@dataclass(frozen=True, kw_only=True)
class Table:
    """Raw rows: `u` (n, s) rises, `y` (n,), `place` (n,) index, `cycle` (n,); `scaled` places."""

    u: FloatArray
    y: FloatArray
    place: np.ndarray
    cycle: np.ndarray
    scaled: FloatArray

    def only(self, here: np.ndarray) -> Table:
        rows = {name: getattr(self, name)[here] for name in ("u", "y", "place", "cycle")}
        return replace(self, **rows)

    def loss(self, gradients: FloatArray, levels: FloatArray) -> float:
        modelled = levels[self.place] + np.sum(self.u * gradients[self.place], axis=1)
        return float(np.sum((self.y - modelled) ** 2))


def solved(X: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(X, y, rcond=None)[0], float)


def ridge_model(rows: Table, degree: int, penalty: float) -> tuple[FloatArray, FloatArray]:
    """Gradients (places, s) and levels (places,) by augmented rows; every column is scaled by its
    standard deviation about the means.
    """
    places, s, n = len(rows.scaled), rows.u.shape[1], len(rows.y)
    powers = rows.scaled[:, None] ** np.arange(degree + 1)
    X = (powers[rows.place][:, :, None] * rows.u[:, None, :]).reshape(n, -1)
    free = (rows.place[:, None] == np.arange(places)).astype(float)
    deviation = np.sqrt(np.mean((X - free @ solved(free, X)) ** 2, axis=0))
    below = np.hstack([np.zeros((X.shape[1], places)), np.diag(np.sqrt(n * penalty) * deviation)])
    b = solved(np.vstack([np.hstack([free, X]), below]), np.append(rows.y, np.zeros(X.shape[1])))
    return powers @ b[places:].reshape(degree + 1, s), b[:places]


def selected(rows: Table) -> tuple[list[int], FloatArray]:
    """Sensors by the effective number of the residuals on all of them, and their gradients."""
    Z = np.column_stack([np.ones(len(rows.y)), rows.u, rows.y])
    e = rows.y - Z[:, :-1] @ solved(Z[:, :-1], rows.y)
    products = (e[:-1] * e[1:])[np.diff(rows.cycle) == 0]
    r = max(float(np.mean(products) / np.mean(e**2)), 0.0)
    columns = by_full_refits(Z, max(len(e) * (1 - r) / (1 + r), 1.0))
    return [j - 1 for j in columns], solved(Z[:, [0, *columns]], rows.y)[1:]


def stepwise_model(rows: Table, degree: int, penalty: float) -> tuple[FloatArray, FloatArray]:
    """Selection at each place, a polynomial through the places, the levels after that."""
    gradients = np.zeros((len(rows.scaled), rows.u.shape[1]))
    parts = [rows.only(rows.place == k) for k in range(len(rows.scaled))]
    for k, part in enumerate(parts):
        chosen, found = selected(part)
        gradients[k, chosen] = found
    powers = rows.scaled[:, None] ** np.arange(degree + 1)
    smooth = powers @ solved(powers, gradients)
    return smooth, np.array([np.mean(x.y - x.u @ smooth[k]) for k, x in enumerate(parts)])


MODELS = {"stepwise": (stepwise_model, (0.0,)), "ridge": (ridge_model, PENALTIES)}
KINDS = {"auto": ("stepwise", "ridge"), "ridge": ("ridge",), "stepwise": ("stepwise",)}


def held_out_error(rows: Table, method: str) -> float:
    """Root mean square over cycles that took no part in fit or choice."""
    total = 0.0
    for held in np.unique(rows.cycle):
        others = rows.only(rows.cycle != held)
        tried = []
        for kind in KINDS[method]:
            maker, penalties = MODELS[kind]
            for degree in range(len(rows.scaled)):
                losses = np.zeros(len(penalties))
                for inner in np.unique(others.cycle):
                    known, left = (others.only((others.cycle == inner) == x) for x in (False, True))
                    losses += [left.loss(*maker(known, degree, each)) for each in penalties]
                i = int(np.argmin(losses))
                tried.append((losses[i], degree, penalties[i], kind))
        least, *_, best = min(tried)
        alike = [x for x in tried if x[3] == best and x[0] <= least * (1 + WORTH)]
        _, degree, penalty, kind = min(alike, key=lambda x: x[1])
        total += rows.only(rows.cycle == held).loss(*MODELS[kind][0](others, degree, penalty))
    return float(np.sqrt(total / len(rows.y)))


def table(found: Readings) -> Table:
    places = np.unique(found.position_mm)
    middle, half = (places.max() + places.min()) / 2, np.ptp(places) / 2
    return Table(u=rises(found, 3), y=found.error / UM, cycle=found.cycle,
                 place=np.searchsorted(places, found.position_mm),
                 scaled=(places - middle) / half)  # fmt: skip


PLANS = {
    "clear": Plan(
        gradients=np.array([[2.0, -1.0, 0.0], [1.0, -1.0, 0.3], [0.0, -1.0, 0.0]]),
        positions=PLACES, cycles=4, n=20, noise=0.5,
    ),
    "weak": Plan(
        gradients=np.array([[0.05, 0.0, 0.02], [0.06, 0.02, 0.0], [0.05, 0.0, 0.0]]),
        positions=PLACES, cycles=3, n=25, noise=0.6, slow=(0.4,),
    ),
}  # fmt: skip


@pytest.mark.parametrize("method", KINDS)
@pytest.mark.parametrize("name", PLANS)
def test_held_out_errors_are_those_of_plain_nested_fits(name: str, method: str) -> None:
    """And without temperature those about the means of the others, at each place."""
    found = PLANS[name].read(np.random.default_rng(31))
    found = replace(found, time_min=np.full(len(found), np.nan))
    held, rows = one(found, method).held_out, table(found)
    assert held is not None
    assert held.after / UM == pytest.approx(held_out_error(rows, method), rel=ROUNDING)
    assert held.r2 == pytest.approx(1 - (held.after / held.before) ** 2, rel=ROUNDING)
    before = least = 0.0
    for cycle in np.unique(rows.cycle):
        others, left = rows.only(rows.cycle != cycle), rows.only(rows.cycle == cycle)
        means = np.array([others.y[others.place == k].mean() for k in range(3)])
        before += left.loss(np.zeros((3, 3)), means)
        least += left.loss(*ridge_model(others, 2, 0.0))
    expected = np.sqrt(np.array([before, least]) / len(found))
    assert np.array([held.before, held.ordinary]) / UM == pytest.approx(expected, rel=ROUNDING)


def test_noise_alone_is_no_better_held_out() -> None:
    plan = Plan(gradients=np.zeros((1, 4)), n=40, noise=1.0)
    found = [one(plan.read(np.random.default_rng(seed))).held_out for seed in range(30)]
    r2 = np.array([item.r2 for item in found if item is not None])
    assert len(r2) == 30
    assert r2.mean() < 3 * r2.std() / np.sqrt(30)


@pytest.mark.parametrize("method", ["lagged", "auto"])
@pytest.mark.parametrize(
    "constants", [(4.0,), (128.0,), (16.0, 16.0, 16.0), (32.0, 0.0, 0.0), (0.0, 64.0, 8.0)]
)
def test_time_constants_on_the_grid_are_found(method: str, constants: tuple[float, ...]) -> None:
    """The grid is 4, 8, ... 128 min: powers of two from twice the step."""
    planted = np.array([2.0, -1.5, 1.0])[: len(constants)]
    plan = Plan(gradients=planted[None], n=96, noise=0.1, lags=constants)
    drift = one(plan.read(np.random.default_rng(34)), method)
    assert drift.model == "lagged"
    assert drift.estimate.time_constants == pytest.approx(constants, rel=ROUNDING)
    u = np.sqrt(np.diag(drift.estimate.covariance))
    assert (np.abs(drift.estimate.coefficients[0] - planted * UM) < 5 * u).all()
    # 0.1 um is the noise of the 384 readings, whose rms has the standard error 0.1/sqrt(2*384).
    assert drift.rms_after / UM == pytest.approx(0.1, rel=5 / np.sqrt(2 * 384))
    residual = np.concatenate([curve.measured - curve.modelled for curve in drift.curves])
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(drift.rms_after, rel=ROUNDING)


def test_no_lag_is_found_where_there_is_none_or_no_time() -> None:
    plan = Plan(gradients=np.array([[2.0, -1.5, 1.0]]), n=96, noise=0.1)
    drift = one(plan.read(np.random.default_rng(35)), "lagged")
    lagged = replace(plan, lags=(32.0, 0.0, 0.0)).read(np.random.default_rng(37))
    untimed = replace(lagged, time_min=np.full(len(lagged), np.nan))
    for item in (drift, fitted(untimed, "lagged").components["p"]):
        assert (item.estimate.time_constants == 0).all()
        assert item.model == "ridge"
