"""thermal-fit on planted drifts: gradients, groups, sensors that fail, cycles, order of rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from made_tables import made_readings
from plain_selection import by_full_refits
from support import codes
from synthetic_drift import (
    LINE,
    METHODS,
    PLACES,
    REFERENCE,
    ROUNDING,
    UM,
    Plan,
    fitted,
    one,
    reordered,
    rises,
    sensor_names,
)

from mtu_cli.analyses.thermal_fit import ComponentDrift, design, thermal_fit
from mtu_cli.files.readings import Readings
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray

PLAIN = Plan(gradients=np.array([[2.0, 1.0, 0.5]]))


def gradients(drift: ComponentDrift, sensors: int) -> FloatArray:
    """(positions, sensors) um per degC; 0 of one that the model does not use."""
    by_place = {(x.position, x.sensors[0]): x.value / UM for x in drift.gradients}
    names, places = sensor_names(sensors), drift.positions or (None,)
    return np.array([[by_place.get((p, name), 0.0) for name in names] for p in places])


@pytest.mark.parametrize("method", METHODS)
def test_noise_free_gradients_come_back(method: str) -> None:
    """To rounding: a held-out error of nothing is lowest without a penalty."""
    plan = Plan(gradients=LINE, positions=PLACES, noise=0.0, n=30)
    drift = one(plan.read(np.random.default_rng(1)), method)
    assert drift.estimate.degree == 1
    assert gradients(drift, 4) == pytest.approx(LINE, abs=ROUNDING)
    assert drift.r2_fit == pytest.approx(1.0, abs=ROUNDING)
    if method == "stepwise":
        assert drift.estimate.sensors == ("T_01_degC", "T_02_degC", "T_04_degC")


def test_coefficients_are_powers_of_the_position_in_mm() -> None:
    """g(p) = a + b p of each sensor, also where the positions are far from 0 and uneven; the
    reference temperature only moves the levels.
    """
    places = (900.0, 1000.0, 1250.0, 1300.0)
    g = np.array([[2.0 + 0.01 * p, -1.0] for p in places])
    plan = Plan(gradients=g, positions=places, noise=0.0, n=30)
    found = plan.read(np.random.default_rng(2))
    estimate = one(found).estimate
    expected = np.array([[2.0, -1.0], [0.01, 0.0]])
    assert estimate.coefficients / UM == pytest.approx(expected, abs=2 * ROUNDING)
    at = {"T_01_degC": np.full(2, 23.0), "T_02_degC": np.full(2, 21.0)}
    drift = estimate.drift(np.array([950.0, 1100.0]), at)
    assert drift / UM == pytest.approx([3 * 11.5 - 1, 3 * 13.0 - 1], rel=ROUNDING)
    assert estimate.position_range == (900.0, 1300.0)
    warm = thermal_fit(found, {"p": ("x", "um")}, reference=23.0, method="ridge").components["p"]
    assert warm.estimate.coefficients / UM == pytest.approx(expected, abs=2 * ROUNDING)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("method", ["stepwise", "ridge"])
def test_twins_are_one_group(method: str, sign: int) -> None:
    """T_03 goes with T_01, or against it: the group's gradient is shared equally."""
    plan, rng = Plan(gradients=np.array([[4.0, 1.0, 0.0]])), np.random.default_rng(4)
    T = plan.temperatures(rng)
    T[..., 2] = REFERENCE + sign * (T[..., 0] - REFERENCE) + 1e-3 * rng.normal(size=T.shape[:2])
    drift = one(plan.read(rng, T), method)
    assert drift.groups == (("T_01_degC", "T_03_degC"),)
    ((first, _, third),) = gradients(drift, 3)
    assert first == pytest.approx(sign * third, rel=ROUNDING)
    C = drift.estimate.covariance
    assert abs(first - 2.0) < 5 * np.sqrt(C[0, 0]) / UM
    assert set(drift.vif) == set(drift.estimate.sensors)
    i, j = (drift.estimate.sensors.index(name) for name in drift.groups[0])
    assert C[i, j] == pytest.approx(sign * C[i, i], rel=ROUNDING)
    assert [x.sensors for x in drift.inseparable] == list(drift.groups)


def test_still_sensors_and_readings() -> None:
    """What does not move is left out, and no figure is made of the rounding of readings."""
    rng = np.random.default_rng(6)
    T = PLAIN.temperatures(rng)
    T[..., 1] = 21.3
    found = fitted(PLAIN.read(rng, T), "auto")
    assert "T_02_degC" not in found.components["p"].estimate.sensors
    (warned,) = [item for item in found.warnings if item.code == "sensor-still"]
    assert (warned.facts["sensor"], warned.facts["where"]) == ("T_02_degC", " at 21.3 degC")
    same = PLAIN.read(rng, np.full_like(T, 21.3))
    read = PLAIN.read(rng)
    for given in (same, *(replace(read, error=np.full(len(read), x * UM)) for x in (0, 3, 0.1))):
        found = fitted(given, "auto")
        drift = found.components["p"]
        assert drift.estimate.coefficients.shape == (1, 0)
        assert drift.rms_after == pytest.approx(drift.rms_before, rel=ROUNDING)
        assert np.isnan(drift.r2_fit) == (given is not same)
        assert drift.held_out is None
        assert "no-effect-of-temperature" in codes(found)
        assert "no-better" not in codes(found)


@pytest.mark.parametrize("positions", [(np.nan,), (0.0, 200.0)])
@pytest.mark.parametrize("how", ["test", "first readings", "setting"])
def test_a_probe_that_is_zeroed_in_every_cycle(positions: tuple[float, ...], how: str) -> None:
    """Its gradients and held-out rms are those of a probe that was zeroed once."""
    g = PLAIN.gradients * np.array([[1.0], [1.1]])[: len(positions)]
    plan, rng = replace(PLAIN, gradients=g, positions=positions), np.random.default_rng(9)
    T = plan.temperatures(rng)
    T -= T[:, :1] - 20.0
    found = plan.read(rng, T)
    free = fitted(found)
    assert "order-of-cycles" not in codes(free)
    code = len(positions) * found.cycle + (found.position_mm > 0)
    _, first, which = np.unique(code, return_index=True, return_inverse=True)
    off = {"test": -40 * UM * found.cycle, "setting": np.full(len(found), 5 * UM)}
    moved = replace(found, error=found.error - off.get(how, found.error[first][which]))
    result = fitted(moved, zeroed="cycle" if how == "setting" else "auto")
    drift, other = result.components["p"], free.components["p"]
    assert (drift.offsets, drift.by, other.offsets) == (True, how, False)
    assert ("order-of-cycles" in codes(result)) == (how != "setting")
    assert gradients(drift, 3) == pytest.approx(gradients(other, 3), abs=0.1)
    assert drift.held_out is not None
    assert other.held_out is not None
    assert drift.held_out.after == pytest.approx(other.held_out.after, rel=0.1)


@pytest.mark.parametrize("places", [(0.0,), (0.0, 100.0)])
def test_fewest_readings(places: tuple[float, ...]) -> None:
    """A level and a gradient at each position, and one reading more."""
    rng, n = np.random.default_rng(22), 2 * len(places) + 1
    found = made_readings(
        rng.normal(size=n) * UM, ("p",), position=np.resize(places, n), time=np.arange(n),
        role="drift", covariates={"T_01_degC": 20 + rng.normal(size=n)},
    )  # fmt: skip
    assert one(found).n == n
    with pytest.raises(InputError, match=f"expected {n} for the "):
        fitted(reordered(found, np.arange(n - 1)))


def test_more_rows_than_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every fifth of each position and cycle, in whatever order the file has them."""
    found = Plan(gradients=LINE, positions=PLACES, n=100).read(np.random.default_rng(16))
    order = np.argsort(found.time_min, kind="stable")
    fifths = reordered(found, np.flatnonzero(np.arange(len(found)) % 5 == 0))
    monkeypatch.setattr(design, "MOST_ROWS", len(found) // 5)
    thinned = fitted(reordered(found, order))
    (warned,) = [item for item in thinned.warnings if item.code == "not-used"]
    assert "of 1200 readings every 5th of a cycle is fitted" in warned.message
    monkeypatch.undo()
    drift, alone = thinned.components["p"], one(fifths)
    assert drift.n == 240
    assert drift.estimate.coefficients == pytest.approx(alone.estimate.coefficients, rel=ROUNDING)
    assert drift.held_out == pytest.approx(alone.held_out, rel=ROUNDING)


def test_columns_that_are_no_sensors_or_not_in_every_file() -> None:
    found = PLAIN.read(np.random.default_rng(19))
    more = dict.fromkeys(("T_c_DegC", "t_oil", "speed"), np.full(len(found), 20.0))
    warnings = fitted(replace(found, covariates=found.covariates | more)).warnings
    (warning,) = (item for item in warnings if item.code == "not-used")
    assert warning.facts["names"] == ["T_c_DegC", "t_oil", "speed"]
    with pytest.raises(InputError, match="columns such as T_01_degC"):
        fitted(replace(found, covariates=more))
    gap = {"T_09_degC": np.where(found.cycle == 1, np.nan, 20.0)}
    with pytest.raises(InputError, match=r"T_09_degC.*the column in every file, or in none"):
        fitted(replace(found, covariates=found.covariates | gap))


# Evidence of thermal models: choice and held-out errors once more by plain nested fits of raw
# rows, nothing compressed, merged or reused; lags that are found.


AT = (0.0, 120.0, 200.0)
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
        positions=AT, cycles=4, n=20, noise=0.5,
    ),
    "weak": Plan(
        gradients=np.array([[0.05, 0.0, 0.02], [0.06, 0.02, 0.0], [0.05, 0.0, 0.0]]),
        positions=AT, cycles=3, n=25, noise=0.6, slow=(0.4,),
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
    before = 0.0
    for cycle in np.unique(rows.cycle):
        others, left = rows.only(rows.cycle != cycle), rows.only(rows.cycle == cycle)
        means = np.array([others.y[others.place == k].mean() for k in range(3)])
        before += left.loss(np.zeros((3, 3)), means)
    assert held.before / UM == pytest.approx(np.sqrt(before / len(found)), rel=ROUNDING)


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


# Covariances of thermal models against many simulated drift tests with the same temperatures.


STRONG = np.array([[3.0, 2.0, 4.0], [5.0, 1.5, 2.0]])
ENDS = (50.0, 250.0)


def drawn(plan: Plan, draws: int, method: str = "ridge") -> list[ThermalEstimate]:
    """Fits of data sets that differ in their noise alone."""
    T = plan.temperatures(np.random.default_rng(41))
    return [
        one(plan.read(np.random.default_rng(1000 + k), T), method).estimate for k in range(draws)
    ]


@pytest.mark.parametrize("method", ["stepwise", "ridge"])
def test_coefficients_scatter_as_their_covariance_says(method: str) -> None:
    """Independent noise, one cycle (no penalty), all sensors far beyond doubt."""
    draws = 120
    plan = Plan(gradients=STRONG, positions=ENDS, cycles=1, n=60, noise=0.3)
    found = drawn(plan, draws, method)
    assert {item.degree for item in found} == {1}
    b = np.array([item.coefficients.ravel() for item in found]) / UM
    seen, reported = np.cov(b.T), np.mean([item.covariance for item in found], axis=0) / UM**2
    # Each element of a sample covariance has the variance (C_ij^2 + C_ii C_jj)/draws.
    error = np.sqrt((reported**2 + np.outer(np.diag(reported), np.diag(reported))) / draws)
    # The residuals' own autocorrelation, -used/n on average, is taken as 0 where negative only:
    # their scale is too large by E max(r, 0), which is 0.4/sqrt(n).
    assert (np.abs(seen - reported) < 4.5 * error + 0.8 / np.sqrt(120) * np.abs(reported)).all()
    planted = np.array([STRONG[0] - 0.25 * (STRONG[1] - STRONG[0]), (STRONG[1] - STRONG[0]) / 200])
    assert (np.abs(b.mean(axis=0) - planted.ravel()) < 4.5 * np.sqrt(np.diag(seen) / draws)).all()


def test_intervals_of_a_drift_cover_it() -> None:
    """The drift in the middle of the axis, of readings that follow each other."""
    plan = Plan(gradients=STRONG, positions=ENDS, cycles=1, n=100, noise=0.3, noise_memory=0.5)
    inside = []
    x = np.kron([1.0, 150.0], [3.0, 2.0, 2.5])
    truth = STRONG.mean(axis=0) @ [3.0, 2.0, 2.5]
    for item in drawn(plan, 100):
        u = np.sqrt(x @ item.covariance @ x) / UM
        inside.append(abs(x @ item.coefficients.ravel() / UM - truth) < 1.96 * u)
    assert np.mean(inside) > 0.95 - 4 * np.sqrt(0.05 * 0.95 / 100)


def test_a_slow_misfit_is_the_leftover() -> None:
    """A level and a slope that each follow themselves: leftover is their covariance at one step.

    Of the effective number of residuals the fit takes the share used/number with it.
    """
    draws, memory = 60, 0.8
    slow = (0.5, 0.004)
    plan = Plan(gradients=STRONG, positions=ENDS, cycles=1, n=1500, slow=slow, memory=memory)
    found = [item.leftover / UM**2 for item in drawn(plan, draws)]
    planted = np.diag(np.square(slow)) * memory
    taken = 2 * 5 / (1500 * (1 - memory) / (1 + memory))
    mean, error = np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(draws)
    assert (np.abs(mean - planted) < 4 * error + taken * planted).all()
