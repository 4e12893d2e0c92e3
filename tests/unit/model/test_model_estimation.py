"""Readings to estimates: passes, several instruments, what the messages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from model_examples import FloatArray, Segment, estimate, readings
from scipy import stats

from mtu_cli.errors import InputError
from mtu_cli.files.machine_contract import Component
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import ComponentFit, agreement, combine, fit_component

AXIS = Component(of="x", unit="um")


def segment(
    rng: np.random.Generator,
    *,
    passes: int = 5,
    positions: FloatArray | None = None,
    s: float = 1e-3,
    level: float = 1.5e-3,
    role: str = "lbb",
    both: bool = False,
    degree: int = 1,
) -> Segment:
    """Passes over the positions: 2 um + 0.01 um/mm, a level a pass, repeatability s (mm)."""
    p = np.linspace(0, 140, 8) if positions is None else positions
    runs = 2 * passes if both else passes
    state = level * rng.standard_normal((runs, 2)) * [1.0, 0.01]
    error = 2e-3 + 1e-5 * p + state[:, :1] + state[:, 1:] * (p - p.mean())
    error = error + (1e-9 * p**2 if degree > 1 else 0.0) + s * rng.standard_normal(error.shape)
    number = np.repeat(np.arange(runs) // 2 + 1 if both else np.arange(runs) + 1, len(p))
    sign = np.repeat(np.where(np.arange(runs) % 2 == 0, 1, -1) if both else np.zeros(runs), len(p))
    return Segment(
        name="c",
        position=np.tile(p, runs),
        error=error.ravel(),
        passes=number,
        direction=sign.astype(np.int64),
        role=role,
    )


def fit(*segments: Segment, component: Component = AXIS) -> ComponentFit:
    return fit_component(readings(list(segments)), "c", component)


def test_passes_are_pairs_of_number_and_direction() -> None:
    given = segment(np.random.default_rng(1), both=True, passes=3)
    found = fit(given).instruments[0]
    assert found.keys == ((1, 1), (1, -1), (2, 1), (2, -1), (3, 1), (3, -1))
    assert found.fit.n_passes == 6
    assert found.fit.pass_dof == 4
    error = given.error.reshape(6, 8)
    assert found.group is not None
    for g in range(6):
        assert found.error[found.group == g] == pytest.approx(error[g])


def test_without_direction_a_pass_is_its_number() -> None:
    given = segment(np.random.default_rng(1), passes=4)
    found = fit(given).instruments[0]
    assert found.keys == ((1, 0), (2, 0), (3, 0), (4, 0))
    assert found.fit.pass_dof == 3
    assert found.reversal is None


def test_without_a_pass_column_nothing_is_separated() -> None:
    given = replace(segment(np.random.default_rng(1)), passes=None)
    found = fit(given)
    assert found.instruments[0].keys == ()
    assert not found.instruments[0].fit.separated
    assert found.estimate.n_passes is None
    assert (found.estimate.pass_covariance == 0).all()
    assert found.estimate.pass_dof == 0
    assert found.estimate.repeat_dof == 40 - 2


def test_a_constant_without_a_pass_column_is_read_once_a_pass() -> None:
    error = np.array([3e-6, 5e-6, 4e-6, 9e-6])
    found = fit(Segment(name="c", position=None, error=error), component=Component(unit="urad"))
    assert found.instruments[0].keys == ((1, 0), (2, 0), (3, 0), (4, 0))
    assert found.estimate.pass_covariance[0, 0] == pytest.approx(error.var(ddof=1))
    assert found.estimate.covariance[0, 0] == pytest.approx(error.var(ddof=1) / 4)
    assert found.estimate.s_repeat == 0
    assert found.estimate.position_range is None


def test_two_instruments_against_stacked_generalised_least_squares() -> None:
    """With known variances: b = (X'V^-1 X)^-1 X'V^-1 y over all readings at once."""
    rng = np.random.default_rng(3)
    estimates, blocks, designs, response = [], [], [], []
    for positions, passes, s, D in (
        (np.linspace(0, 140, 8), 5, 1.0, np.diag([2.0, 1e-4])),
        (np.linspace(20, 200, 5), 3, 0.3, np.diag([0.5, 4e-4])),
    ):
        X = np.column_stack([np.ones_like(positions), positions])
        Z = np.column_stack([np.ones_like(positions), positions - positions.mean()])
        V = np.kron(np.eye(passes), s**2 * np.eye(len(positions)) + Z @ D @ Z.T)
        stacked = np.tile(X, (passes, 1))
        y = stacked @ [3.0, -0.02] + np.linalg.cholesky(V) @ rng.standard_normal(len(V))
        inverse = np.linalg.inv(stacked.T @ stacked)
        C = inverse @ stacked.T @ V @ stacked @ inverse
        b = inverse @ stacked.T @ y
        estimates.append(estimate("c", "x", b, C=C, s=s, pass_dof=passes - 1, repeat_dof=30))
        estimates[-1] = replace(estimates[-1], independent_covariance=C, independent_s=1.0)
        blocks.append(V)
        designs.append(stacked)
        response.append(y)
    X, y = np.vstack(designs), np.concatenate(response)
    V = np.block([[blocks[0], np.zeros((40, 15))], [np.zeros((15, 40)), blocks[1]]])
    information = X.T @ np.linalg.solve(V, X)
    wanted = np.linalg.solve(information, X.T @ np.linalg.solve(V, y))
    found, _ = combine(estimates)
    assert found.coefficients == pytest.approx(wanted, rel=1e-9)
    assert found.covariance == pytest.approx(np.linalg.inv(information), rel=1e-9)
    assert (found.pass_dof, found.repeat_dof) == (6, 60)
    assert found.s_repeat == pytest.approx(np.sqrt((1.0 + 0.09) / 2))


def test_pooled_scatter_is_weighted_by_degrees_of_freedom() -> None:
    a = estimate("c", None, [1.0], C=np.eye(1), D=4 * np.eye(1), s=1.0, pass_dof=9, repeat_dof=70)
    b = estimate("c", None, [2.0], C=np.eye(1), D=1 * np.eye(1), s=3.0, pass_dof=3, repeat_dof=10)
    a, b = (replace(item, independent_covariance=np.eye(1), independent_s=1.0) for item in (a, b))
    found, _ = combine([a, b])
    assert found.coefficients == pytest.approx([1.5])
    assert found.pass_covariance[0, 0] == pytest.approx((9 * 4 + 3 * 1) / 12)
    assert found.s_repeat**2 == pytest.approx((70 * 1 + 10 * 9) / 80)


def test_one_instrument_is_left_alone() -> None:
    item = estimate("c", None, [1.0], C=np.eye(1))
    assert combine([item]) == (item, None)


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_agreement_is_uniform_where_the_instruments_agree(degree: int) -> None:
    """Different scatter, passes and positions; 300 pairs of fits."""
    rng = np.random.default_rng(20 + degree)
    component = Component(of="x", unit="um", degree=degree)
    slope = 1.0 if degree else 0.0
    p_values = []
    for _ in range(300):
        pair: list[ComponentEstimate] = []
        for passes, points, s, level in ((10, 8, 1e-3, 1.5e-3), (6, 6, 0.3e-3, 1.0e-3)):
            given = segment(
                rng, passes=passes, positions=np.linspace(0, 140, points), s=s, level=level
            )
            line = 1e-5 * np.asarray(given.position)
            if degree == 0:
                # Its level alone varies, which a constant can describe.
                state = level * np.repeat(rng.standard_normal(passes), points)
                noise = s * rng.standard_normal(passes * points)
                given = replace(given, error=2e-3 + slope * line + state + noise)
            pair.append(fit(given, component=component).estimate)
        p_values.append(agreement(*pair))
    assert stats.kstest(p_values, "uniform").pvalue > 0.005


def test_agreement_sees_a_difference() -> None:
    rng = np.random.default_rng(30)
    first = segment(rng, passes=10)
    second = segment(rng, passes=10, role="laser")
    assert (fit(first, second).agreement_p or 0) > 0.001
    apart = fit(first, replace(second, error=second.error + 8e-3)).agreement_p
    assert apart is not None
    assert apart < 1e-4


def test_agreement_without_enough_degrees_of_freedom_says_nothing() -> None:
    items = [
        estimate("c", "x", [value, 0.0], C=np.diag([1.0, 1e-4]), pass_dof=0, repeat_dof=0.4)
        for value in (0.0, 50.0)
    ]
    assert agreement(*items) == 1.0


def test_an_instrument_without_scatter_has_no_weight() -> None:
    exact = segment(np.random.default_rng(1), s=0.0, level=0.0, role="laser")
    with pytest.raises(InputError) as error:
        fit(segment(np.random.default_rng(2)), exact)
    assert "laser.csv" in str(error.value)
    assert "'c' by laser show no scatter" in str(error.value)
    assert fit(exact).estimate.s_repeat == 0
    two = Segment(name="c", position=np.array([0.0, 9.0]), error=np.array([1.0, 2.0]), role="laser")
    with pytest.raises(InputError, match="no scatter"):
        fit(segment(np.random.default_rng(2)), two)


def test_the_noise_of_two_instruments_makes_wider_predictions_of_neither() -> None:
    rng = np.random.default_rng(40)
    found = fit(segment(rng, passes=8), segment(rng, passes=8, role="laser"))
    alone = [item.fit.covariance for item in found.instruments]
    for C in alone:
        assert np.linalg.eigvalsh(C - found.estimate.covariance)[0] > 0
    assert found.estimate.position_range == (0.0, 140.0)
    assert [item.role for item in found.instruments] == ["lbb", "laser"]
