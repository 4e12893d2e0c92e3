"""Readings to estimates: passes, several instruments, what the messages say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from model_examples import FloatArray, Segment, readings
from scipy import stats

from mtu_cli.files.machine_contract import Component
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import ComponentFit, agreement, fit_component
from mtu_cli.stats.coverage import coverage_factor

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
