"""Readings to estimates: passes, several instruments, what the messages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from model_examples import Segment, estimate, readings
from scipy import stats

from mtu_cli.files.machine import Component
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import ComponentFit, agreement, combine, fit_component
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

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


def test_without_a_pass_column_nothing_is_separated() -> None:
    given = replace(segment(np.random.default_rng(1)), passes=None)
    found = fit(given)
    assert found.instruments[0].keys_read == ()
    assert not found.instruments[0].fit.separated
    assert found.estimate.n_passes is None
    assert (found.estimate.pass_covariance == 0).all()
    assert found.estimate.pass_dof == 0
    assert found.estimate.repeat_dof == 40 - 2


def test_a_constant_without_a_pass_column_is_read_once_a_pass() -> None:
    error = np.array([3e-6, 5e-6, 4e-6, 9e-6])
    found = fit(Segment(name="c", position=None, error=error), component=Component(unit="urad"))
    assert found.instruments[0].keys_read == ((0, 1, 0), (0, 2, 0), (0, 3, 0), (0, 4, 0))
    assert found.estimate.pass_covariance[0, 0] == pytest.approx(error.var(ddof=1))
    assert found.estimate.covariance[0, 0] == pytest.approx(error.var(ddof=1) / 4)
    assert found.estimate.s_repeat == 0
    assert found.estimate.position_range is None


def test_instruments_are_weighted_by_the_variance_of_their_level() -> None:
    """By hand: 1/W = d^2/G + s^2/n at the middle of the range; C = sum W^2 C whatever W is."""
    D = np.diag([2.0, 0.0])
    first = estimate("c", "x", [1.0, 0.1], C=np.eye(2), D=D, s=1.0, pass_dof=4, repeat_dof=30)
    second = estimate("c", "x", [3.0, 0.3], C=2 * np.eye(2), D=D, s=0.5, pass_dof=9, repeat_dof=60)
    first = replace(first, n_passes=5, independent_covariance=np.eye(2), independent_s=1.5)
    second = replace(second, n_passes=10, independent_covariance=np.eye(2), independent_s=1.2)
    found = combine([first, second], [40, 80])
    precision = np.array([1 / (2 / 5 + 1 / 40), 1 / (2 / 10 + 0.25 / 80)])
    W = precision / precision.sum()
    assert found.coefficients == pytest.approx(W @ [[1.0, 0.1], [3.0, 0.3]])
    assert found.covariance == pytest.approx((W[0] ** 2 + 2 * W[1] ** 2) * np.eye(2))
    shares = np.array([W[0] ** 2, 2 * W[1] ** 2])
    assert found.pass_dof == pytest.approx(shares.sum() ** 2 / (shares**2 / [4, 9]).sum())
    assert found.repeat_dof == 90
    # They differ by 2 units of u 1.7.
    assert 0.2 < agreement(first, second) < 0.9


def test_instruments_agree_on_one_degree() -> None:
    both = [segment(np.random.default_rng(1), role=role) for role in ("lbb", "laser")]
    chosen = fit(*both, component=Component(of="x", unit="um", degree="auto"))
    assert len({item.powers for item in chosen.instruments}) == 1
    with pytest.raises(InputError, match="several instruments, whose tables are not combined"):
        fit(*both, component=Component(of="x", unit="um", shape="table"))


@pytest.mark.parametrize("passes", [2, 5])
def test_two_instruments_cover_what_they_both_read(passes: int) -> None:
    """95 % intervals of the level in the middle, few passes and unequal noise."""
    component = Component(of="x", unit="um", degree=1)
    x = np.array([1.0, 70.0])
    hits = []
    for rng in np.random.default_rng(5).spawn(300):
        both = [
            segment(rng, passes=passes, s=s, level=1.2e-3, role=role)
            for s, role in ((1e-3, "lbb"), (0.5e-3, "laser"))
        ]
        found = fit(*both, component=component).estimate
        u = np.sqrt(x @ found.covariance @ x)
        hits.append(
            abs(x @ found.coefficients - 2.7e-3) < coverage_factor(0.95, found.pass_dof) * u
        )
    # With two or three passes Welch-Satterthwaite errs on the wide side, never the narrow one.
    assert np.mean(hits) > 0.95 - 3.3 * np.sqrt(0.95 * 0.05 / len(hits))


def test_pooled_scatter_is_weighted_by_degrees_of_freedom() -> None:
    a = estimate("c", None, [1.0], C=np.eye(1), D=4 * np.eye(1), s=1.0, pass_dof=9, repeat_dof=70)
    b = estimate("c", None, [2.0], C=np.eye(1), D=1 * np.eye(1), s=3.0, pass_dof=3, repeat_dof=10)
    a, b = (replace(item, independent_covariance=np.eye(1), independent_s=1.0) for item in (a, b))
    found = combine([a, b], [10, 10])
    assert found.coefficients == pytest.approx([(9 * 1 + 1 * 2) / 10])
    assert found.pass_covariance[0, 0] == pytest.approx((9 * 4 + 3 * 1) / 12)
    assert found.s_repeat**2 == pytest.approx((70 * 1 + 10 * 9) / 80)


@pytest.mark.parametrize("degree", [0, 3])
def test_agreement_is_uniform_where_the_instruments_agree(degree: int) -> None:
    """Different scatter, passes and positions; 200 pairs of fits."""
    rng = np.random.default_rng(20 + degree)
    component = Component(of="x", unit="um", degree=degree)
    slope = 1.0 if degree else 0.0
    p_values = []
    for _ in range(200):
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


def test_an_instrument_without_scatter_has_no_weight() -> None:
    exact = segment(np.random.default_rng(1), s=0.0, level=0.0, role="laser")
    with pytest.raises(InputError) as error:
        fit(segment(np.random.default_rng(2)), exact)
    assert "laser.csv" in str(error.value)
    assert "'c' by laser do not scatter" in str(error.value)
    assert fit(exact).estimate.s_repeat == 0
    two = Segment(name="c", position=np.array([0.0, 9.0]), error=np.array([1.0, 2.0]), role="laser")
    with pytest.raises(InputError, match="do not scatter"):
        fit(segment(np.random.default_rng(2)), two)
