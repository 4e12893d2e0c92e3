"""Printed results of JCGM 100:2008, annex H, and of the budgets that are shipped.

Tolerances: half a unit of the last printed digit. Where the printed input figures are rounded
themselves and this moves the result, both are stated.

The printed figures were compared with those that other packages quote from it: H.1 (50 000 838,
32, 34 nm, 16, 2.92, 93 nm, the contributions, 9.7 nm with 25.6) with GTC's documentation and two
packages' tests; H.2 (inputs, values, u, r to two digits) with GTC's documentation and suncal's
test_examples.py; H.3 (readings, both coefficients, r, the correction) with GTC's documentation.
The third digits of the correlations of H.2.4 and the 11.7 and 1.7 nm of H.1.7 were not found
elsewhere.
"""

from __future__ import annotations

import numpy as np
import pytest
from budget_examples import agrees, drawn, evaluated, single
from support import CONFIGS

from mtu_cli.analyses.budget import BudgetResult, evaluate_budget
from mtu_cli.files.budget import load_budget
from mtu_cli.model.settings import Settings
from mtu_cli.stats.covariance import correlation_of
from mtu_cli.stats.coverage import coverage_factor

BUDGETS = CONFIGS / "budgets"


def shipped(name: str, seed: int = 1, trials: int | None = None) -> BudgetResult:
    settings = Settings(seed=seed, trials=trials)
    return evaluate_budget(load_budget(BUDGETS / f"{name}.yaml"), settings)


def test_h1_end_gauge_first_order() -> None:
    """H.1.5 to H.1.6: l = 50 000 838 nm, u_c = 32 nm, nu_eff = 16 (truncated), contributions."""
    result = shipped("gum-h1-end-gauge")
    output = single(result)
    agrees(output, value=(50_000_838, 0.5), u=(32, 0.5))
    assert int(output.dof) == 16
    assert output.dof == pytest.approx(16.7, abs=0.06)
    names = [item.name for item in result.given.quantities]
    contribution = np.abs(output.sensitivity) * [item.u for item in result.given.quantities]
    printed = {"ls": 25, "d": 9.7, "dalpha": 2.9, "theta": 0, "alphas": 0, "dtheta": 16.6}
    for name, value in printed.items():
        digit = 0.5 if name == "ls" else 0.05
        assert contribution[names.index(name)] == pytest.approx(value, abs=digit), name
    assert result.given.quantities[names.index("d")].dof == pytest.approx(25.6, abs=0.2)
    assert result.given.quantities[names.index("theta")].u == pytest.approx(0.41, abs=0.005)


def test_h1_expanded_uncertainty() -> None:
    """H.1.6 prints U99 = 93 nm = t_99(16) 32 nm = 2.92 x 32; with 16.75 degrees of freedom and
    31.66 nm unrounded it is 92 nm. Both: ours, and the printed product from the printed figures.
    """
    output = single(shipped("gum-h1-end-gauge"))
    assert output.expanded == pytest.approx(91.9, abs=0.1)
    assert coverage_factor(0.99, 16.0) == pytest.approx(2.92, abs=0.005)
    assert coverage_factor(0.99, np.floor(output.dof)) * 32 == pytest.approx(93, abs=0.5)


def test_h1_second_order() -> None:
    """H.1.7: with the terms of the second order u_c = 34 nm; they are 11.7 and 1.7 nm."""
    output = single(shipped("gum-h1-end-gauge"))
    assert output.second_u == pytest.approx(34, abs=0.5)
    added = np.sqrt(output.second_u**2 - output.u**2)
    assert added == pytest.approx(np.hypot(11.7, 1.7), abs=0.1)
    assert output.second_value == output.value


def test_h1_monte_carlo() -> None:
    """JCGM 101:2008, 9.5, Table 11: 838 nm, u = 36 nm, shortest 99 % interval [745, 932] nm.

    From the inputs of H.1, which Table 10 rounds: that moves u by 0.1 nm.
    """
    result = shipped("gum-h1-end-gauge", seed=95, trials=4_000_000)
    run = result.run
    drawn(run, mean=(50_000_838, 0.5), u=(36, 0.5))
    width = run.shortest_high[0] - run.shortest_low[0]
    assert width == pytest.approx(932 - 745, abs=1.0 + 3 * np.hypot(run.se_low[0], run.se_high[0]))
    # The place of the shortest interval scatters by 0.6 nm in their 1.4e6 trials, 0.4 nm in ours.
    assert run.shortest_low[0] == pytest.approx(50_000_745, abs=0.5 + 2 * np.hypot(0.4, 0.6))
    assert run.shortest_high[0] == pytest.approx(50_000_932, abs=0.5 + 2 * np.hypot(0.4, 0.6))
    assert single(result).validation.passed is False


def test_h2_impedance() -> None:
    """H.2, Tables H.2 to H.4: means, u, r of the readings; R, X, Z with their correlations.

    u(X) is printed as 0.295, from rounded figures; the readings give 0.2956.
    """
    result = shipped("gum-h2-impedance")
    for item, (mean, digit, u, u_digit) in zip(
        result.given.quantities,
        [
            (4.9990, 5e-5, 0.0032, 5e-5),
            (19.6610, 5e-5, 0.0095, 5e-5),
            (1.04446, 5e-6, 0.00075, 5e-6),
        ],
        strict=True,
    ):
        assert item.value == pytest.approx(mean, abs=digit)
        assert item.u == pytest.approx(u, abs=u_digit)
    r = correlation_of(result.given.covariance)
    assert [r[0, 1], r[0, 2], r[1, 2]] == pytest.approx([-0.36, 0.86, -0.65], abs=0.005)
    printed = {"R": (127.732, 0.071), "X": (219.847, 0.2956), "Z": (254.260, 0.236)}
    for output in result.outputs:
        value, u = printed[output.name]
        agrees(output, value=(value, 0.0005), u=(u, 0.0005))
        # H.2.4, approach 2: the five values of each output have four degrees of freedom.
        assert output.dof == pytest.approx(4.0)
        assert output.k == 2.0
    own = result.correlation
    printed_r = [-0.588, -0.485, 0.993]
    assert [own[0, 1], own[0, 2], own[1, 2]] == pytest.approx(printed_r, abs=0.0006)


def test_h2_second_approach() -> None:
    """H.2.4: the outputs of each of the five sets have the mean's u as their s/sqrt(5)."""
    result = shipped("gum-h2-impedance")
    inputs = load_budget(BUDGETS / "gum-h2-impedance.yaml").budget.inputs
    voltage, current, phi = (np.array(item.readings) for item in inputs.values())
    Z = 1000 * voltage / current
    sets = np.array([Z * np.cos(phi), Z * np.sin(phi), Z])
    for output, five in zip(result.outputs, sets, strict=True):
        # Both approaches have the same printed digits there.
        assert output.u == pytest.approx(five.std(ddof=1) / np.sqrt(5), abs=0.0005)


LINE = """
    quantity: {name: b, unit: degC}
    equation: y1 + y2*(t - 20)
    inputs:
      y1: {value: -0.1712, u: 0.0029, dof: 9}
      y2: {value: 0.00218, u: 0.00067, dof: 9}
      t: 30
    correlations: [[y1, y2, -0.930]]
"""


def test_h3_calibration_line() -> None:
    """H.3.4, eq. (H.15): b(30 degC) = -0.1494 degC, u_c = 0.0041 degC with nu = 9."""
    output = single(evaluated(LINE))
    agrees(output, value=(-0.1494, 5e-5), u=(0.0041, 5e-5))
    assert output.dof == pytest.approx(9.0)


T = [21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511]
B = [-0.171, -0.169, -0.166, -0.159, -0.164, -0.165, -0.156, -0.157, -0.159, -0.161, -0.160]


def test_h3_line_from_its_readings() -> None:
    """Table H.6 to y1 = -0.1712(29), y2 = 0.00218(67), r = -0.930 with s = 0.0035 degC.

    Least squares is linear in the readings: y1 and y2 are two outputs of one budget.
    """
    x = np.array(T) - 20.0
    centre = float(x.mean())
    weights = ((x - centre) / np.sum((x - centre) ** 2)).tolist()
    slope = " + ".join(f"({c!r})*b{i}" for i, c in enumerate(weights))
    level = " + ".join(f"({1 / len(T) - c * centre!r})*b{i}" for i, c in enumerate(weights))
    rows = "\n".join(f"      b{i}: {{value: {b}, u: 0.0035, dof: 9}}" for i, b in enumerate(B))
    result = evaluated(
        f"\n    equations:\n      y1: {level}\n      y2: {slope}\n    inputs:\n{rows}\n"
    )
    y1, y2 = result.outputs
    assert y1.value == pytest.approx(-0.1712, abs=5e-5)
    assert y2.value == pytest.approx(0.00218, abs=5e-6)
    assert y1.u == pytest.approx(0.0029, abs=5e-5)
    assert y2.u == pytest.approx(0.00067, abs=5e-6)
    assert result.correlation[0, 1] == pytest.approx(-0.930, abs=5e-4)
    s = np.sqrt(np.sum((np.array(B) - y1.value - y2.value * x) ** 2) / 9)
    assert s == pytest.approx(0.0035, abs=5e-5)


def test_valdes_table_4_contradicts_itself() -> None:
    """Valdes et al., Table 4: printed u 0.104 um, 4.05 degrees of freedom, k 2.78, U 0.289 um.

    Its rows give 0.0742 um with 4.05 degrees of freedom (4 (0.0742/0.074)^4), k = 2.76 and
    U = 0.205 um; 0.104 um is 1.40 times what they combine to, while 2.78 x 0.104 is 0.289.
    """
    output = single(shipped("valdes-x275"))
    assert output.value == -10.79
    agrees(output, u=(0.0742, 5e-5), dof=(4.05, 0.006), k=(2.76, 0.005))
    assert coverage_factor(0.95, 4.0) == pytest.approx(2.78, abs=0.005)
    assert output.expanded == pytest.approx(0.205, abs=0.0005)
    assert 0.104 / output.u == pytest.approx(1.40, abs=0.005)
