"""Drawn parts against the covariance they are drawn from."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from model_examples import Segment, estimate, loaded, model_of, part_of, readings
from property_settings import tried
from scipy import stats
from support import paper_study

from mtu_cli.analyses.predictions import reportable
from mtu_cli.files.machine import Component
from mtu_cli.files.part import Tolerance
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import fit_component, shared_passes
from mtu_cli.model.features import feature_points
from mtu_cli.model.fit import fit_machine
from mtu_cli.model.measurands import (
    LARGEST_SLOPE,
    AngleTrials,
    PointTrials,
    check_square,
    conformance_of,
    position_conformance,
)
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings
from mtu_cli.stats.composed_variance import CoefficientBlock
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

TRIALS = 200_000
POINTS = np.array([[0.0, 0, 0], [30, 10, 0], [60, -20, 0]])


def prediction(s: float = 0.8) -> Prediction:
    a = estimate(
        "a",
        "x",
        [5.0, -0.1],
        C=np.array([[0.3, -0.002], [-0.002, 1e-4]]),
        D=np.array([[1.0, -0.01], [-0.01, 4e-4]]),
        s=s,
    )
    b = estimate("b", "y", [1.0], D=np.array([[0.5]]), s=0.3)
    model = model_of([(a, {"x": "1", "y": "0.4"}), (b, {"x": "-2", "y": "1 + y/50"})])
    return predict(model, list("abc"), POINTS)


def trials(given: Prediction, combine: FloatArray, dof: FloatArray) -> PointTrials:
    """Trials of linear combinations of the errors: the measure hands them through."""
    k = len(combine)
    return PointTrials(
        given,
        tuple(str(i) for i in range(k)),
        lambda combined: combined,
        combine,
        np.arange(k),
        combine,
        replace(given.variance(combine), dof=dof),
    )


def drawn(model: PointTrials, seed: int = 1) -> FloatArray:
    return model.draw(np.random.default_rng(seed), TRIALS).values.copy()


def test_mean_and_covariance_of_the_draws() -> None:
    given = prediction()
    combine = np.vstack([np.eye(6), np.eye(6)[2] - np.eye(6)[0], np.full(6, 1 / 6)])
    values = drawn(trials(given, combine, np.full(8, np.inf)))
    wanted = combine @ given.covariance @ combine.T
    # Of normal data: se^2 of a covariance is (c_ii c_jj + c_ij^2)/m.
    variances = np.diag(wanted)
    error = np.sqrt((np.outer(variances, variances) + wanted**2) / TRIALS)
    assert (np.abs(np.cov(values) - wanted) < 4.5 * error).all()
    away = np.abs(values.mean(axis=1) - combine @ given.mean)
    assert (away < 4.5 * np.sqrt(variances / TRIALS)).all()


def test_finite_degrees_of_freedom_give_a_scaled_t() -> None:
    given = prediction()
    dof = np.array([5.0, 7.5, 20.0, np.inf, 5.0, 40.0])
    model = trials(given, np.eye(6), dof)
    values = drawn(model, 3)
    u = np.sqrt(np.diag(given.covariance))
    standard = (values - given.mean[:, None]) / u[:, None]
    for i, nu in enumerate(dof):
        law = stats.norm() if np.isinf(nu) else stats.t(nu)
        assert stats.kstest(standard[i], law.cdf).pvalue > 1e-4
        for probability in (0.025, 0.5, 0.975):
            q = law.ppf(probability)
            error = np.sqrt(probability * (1 - probability) / TRIALS) / law.pdf(q)
            assert abs(np.quantile(standard[i], probability) - q) < 4.5 * error
        assert model.linear_variance[i] == pytest.approx(u[i] ** 2 * law.var())
    # Heavy tails: the variance's own standard error needs kurtosis; 7.5 has one, 5 too.
    for i in (1, 2, 3, 5):
        kurtosis = 3.0 if np.isinf(dof[i]) else 3 + 6 / (dof[i] - 4)
        error = np.sqrt((kurtosis - 1) / TRIALS) * model.linear_variance[i]
        assert abs(values[i].var() - model.linear_variance[i]) < 4.5 * error


def test_outputs_have_the_first_order_variance_where_D_is_negative() -> None:
    """A mean of many points: what is drawn and what is stated may not part."""
    n = 25
    s2 = 1.0
    low = estimate(
        "a",
        "x",
        [0.0],
        C=np.array([[0.05 / 5]]),
        D=np.array([[0.05 - s2 / 8]]),
        s=np.sqrt(s2),
        pass_dof=4,
        repeat_dof=35,
        n_passes=5,
    )
    model = model_of([(low, {"x": "1"})], axes=("x",))
    points = np.column_stack([np.linspace(0, 100, n), np.zeros(n), np.zeros(n)])
    given = predict(model, [str(i) for i in range(n)], points)
    mean = np.full((1, n), 1 / n)
    wanted = given.variance(mean).total
    assert float((mean @ given.covariance @ mean.T)[0, 0]) < 0
    values = drawn(trials(given, mean, np.array([np.inf])))
    assert values.var() == pytest.approx(wanted[0], rel=4.5 * np.sqrt(2 / TRIALS))


# Reduced trials of an angle against all errors drawn and two lines laid through them.


Case = tuple[Prediction, list[str], list[str]]


def of_paper() -> Case:
    study = paper_study()
    entry = study.part.part.orthogonality[0]
    ids, points, _ = feature_points(study.part, study.model, [*entry.row, *entry.column])
    return predict(study.model, ids, points), list(entry.row), list(entry.column)


def bent(size: float, dof: float = 1e9) -> Case:
    """Four features a line a few millimetres apart, errors of that size: far from linear."""
    row = np.array([[0.0, 0], [3, 0.02], [6, -0.01], [10, 0.03]])
    column = np.array([[0.0, 0], [-0.02, 4], [0.01, 7], [0.02, 9]])
    places = np.vstack([row, column[1:]])
    D = np.array([[0.04, 0.001], [0.001, 4e-4]]) * size**2
    a = estimate("a", "x", [0.3, -0.01], D=D, s=0.3 * size, pass_dof=dof, repeat_dof=dof)
    b = estimate("b", "y", [0.1], D=np.array([[0.03]]) * size**2, s=0.2 * size, repeat_dof=dof)
    model = model_of([(a, {"x": "1", "y": "-0.4"}), (b, {"x": "0.5", "y": "1 + y/20"})])
    given = predict(model, list("abcdefg"), np.column_stack([places, np.zeros(7)]))
    return given, list("abcd"), list("aefg")


CASES = {
    "paper": of_paper(),
    "bent": bent(1.0),
    # Without a feature that both lines have, nothing of them is common but the machine.
    "disjoint": (bent(1.0)[0], list("abc"), list("efg")),
    "t": bent(0.7, dof=6.0),
}


def model_of_case(case: Case, *, independent: bool = False) -> AngleTrials:
    given, row, column = case
    return AngleTrials(given, "a", row, column, independent=independent)


def drawn_angles(
    model: AngleTrials, seed: int, *, plain: bool = False
) -> tuple[FloatArray, FloatArray]:
    """`plain`: of all errors, with lines laid through them."""
    rng = np.random.default_rng(seed)
    draws = PointTrials.draw(model, rng, TRIALS) if plain else model.draw(rng, TRIALS)
    assert draws.linear is not None
    return draws.values[0].copy(), draws.linear[0].copy()


@pytest.mark.parametrize("independent", [False, True])
@pytest.mark.parametrize("name", list(CASES))
def test_the_same_distribution_with_fewer_normals(name: str, independent: bool) -> None:
    reduced = model_of_case(CASES[name], independent=independent)
    # One column of the product is of the means.
    assert reduced.product.shape[1] - 1 < reduced.factor.shape[1]
    values, linear = drawn_angles(reduced, 1)
    if not independent:
        # The first-order form is exactly what is stated.
        dof = float(reduced.linear_dof[0])
        law = stats.norm() if np.isinf(dof) else stats.t(dof)
        standard = (linear - reduced.linear_mean[0]) / reduced.linear_u[0, 0]
        assert stats.kstest(standard, law.cdf).pvalue > 1e-3
    slow_values, slow_linear = drawn_angles(reduced, 2, plain=True)
    assert stats.ks_2samp(values, slow_values).pvalue > 1e-3
    assert stats.ks_2samp(linear, slow_linear).pvalue > 1e-3
    # What the first-order form leaves is small: of the values alone it would not be seen.
    curved, slow_curved = values - linear, slow_values - slow_linear
    if name == "t" and not independent:
        return
    error = np.hypot(curved.std(), slow_curved.std()) / np.sqrt(TRIALS)
    assert abs(curved.mean() - slow_curved.mean()) < 4.5 * error


def test_no_error_at_all_is_no_scatter() -> None:
    reduced = model_of_case(bent(0.0), independent=True)
    values = reduced.draw(np.random.default_rng(7), 100).values
    assert np.ptp(values) == 0.0
    assert values[0, 0] == pytest.approx(reduced.linear_mean[0], rel=1e-9)


# Which rows and columns have an angle that their slopes stand for.


def test_a_line_that_leans_is_told_with_its_path(tmp_path: Path) -> None:
    """Of its height by more than the limit, to -x; the line before it is square."""
    lean = 1.01 * LARGEST_SLOPE
    text = f"""
    features: {{a: {{x_mm: 0, y_mm: 0}}, b: {{x_mm: 200, y_mm: 0}}, c: {{x_mm: 0, y_mm: 300}},
      d: {{x_mm: {-300 * lean}, y_mm: 300}}}}
    orthogonality: [{{id: q, row: [a, b], column: [a, c]}}, {{id: r, row: [a, b], column: [a, d]}}]
    """
    with pytest.raises(InputError, match=r"orthogonality\[1\].column: .* -5.77 degrees off y"):
        check_square(part_of(tmp_path, text), [0, 1])
    check_square(part_of(tmp_path, text), [0])


# Degrees of freedom by hand, and variances where a moment estimate of D is negative.


POSITIONS = np.linspace(20.0, 160.0, 8)


def read(
    rng: np.random.Generator, passes: int, level: float, slope: float, curve: float = 0.0
) -> FloatArray:
    """Readings (passes, 8) with repeatability 1."""
    p = POSITIONS - POSITIONS.mean()
    errors: FloatArray = (
        level * rng.standard_normal((passes, 1))
        + slope * rng.standard_normal((passes, 1)) * p
        + curve * p**2
        + rng.standard_normal((passes, len(p)))
    )
    return errors


def fitted(errors: FloatArray, degree: int = 1) -> ComponentEstimate:
    passes = len(errors)
    segment = Segment(
        name="c",
        position=np.tile(POSITIONS, passes),
        error=errors.ravel(),
        passes=np.repeat(np.arange(1, passes + 1), len(POSITIONS)),
    )
    component = Component(of="x", unit="mm", degree=degree)
    return fit_component(readings([segment]), "c", component).estimate


def at(item: ComponentEstimate, *x: float) -> tuple[FloatArray, FloatArray]:
    """Total variance and degrees of freedom of each point and of last minus first."""
    points = np.array([[value, 0.0, 0.0] for value in x])
    model = model_of([(item, {"x": "1"})], axes=("x",))
    A = np.vstack([np.eye(len(x)), np.eye(len(x))[-1] - np.eye(len(x))[0]])
    found = predict(model, [str(i) for i in range(len(x))], points).variance(A)
    return found.total, found.dof


def orthonormal(degree: int, x: FloatArray) -> FloatArray:
    """Rows phi_0(x) ... phi_degree(x), orthonormal over the positions of one pass."""
    centre, size = POSITIONS.mean(), np.ptp(POSITIONS)
    _Q, R = np.linalg.qr(np.vander((POSITIONS - centre) / size, degree + 1, increasing=True))
    values: FloatArray = np.linalg.solve(
        R.T, np.vander((x - centre) / size, degree + 1, increasing=True).T
    ).T
    return values


@pytest.mark.parametrize(("degree", "drift"), [(3, 0.0), (3, 1.0), (1, 0.0)])
def test_intervals_cover_inside_and_outside_of_the_range(degree: int, drift: float) -> None:
    """Extrapolated by half the range, where the powers without passes outweigh all."""
    rng = np.random.default_rng(77)
    x = np.array([90.0, 160.0, 230.0])
    p = x - POSITIONS.mean()
    hits, widths, machines = np.zeros(3), [], 250
    for _ in range(machines):
        item = fitted(read(rng, 6, drift, 0.01 * drift), degree)
        total, dof = at(item, *x)
        half = [coverage_factor(0.95, nu) * np.sqrt(v) for v, nu in zip(total, dof, strict=True)][
            :3
        ]
        state = drift * rng.standard_normal() + 0.01 * drift * rng.standard_normal() * p
        future = state + rng.standard_normal(3)
        powers = np.vander(x, degree + 1, increasing=True)
        hits += np.abs(future - powers @ item.coefficients) <= half
        widths.append(half)
    assert hits / machines == pytest.approx(np.full(3, 0.95), abs=4 * np.sqrt(0.0475 / machines))
    # 1.96 standard deviations of the truth; t of five degrees of freedom is 2.57.
    g = orthonormal(degree, x)
    noise = 1 + (g**2).sum(axis=1) / 6
    ideal = 1.96 * np.sqrt(noise + drift**2 * (1 + (0.01 * p) ** 2) * (1 + 1 / 6))
    assert (np.median(widths, axis=0) < 1.5 * ideal).all()


LINE = np.linspace(20.0, 160.0, 25)


def undrifted(seed: int) -> ComponentEstimate:
    return fitted(read(np.random.default_rng(seed), 5, 0.0, 0.0))


def test_variance_is_never_negative_and_never_next_to_nothing() -> None:
    """Means, slopes and far extrapolation of passes that hardly differ."""
    x = LINE - LINE.mean()
    A = np.vstack(
        [np.eye(25), x / (x @ x) * 140, np.full(25, 1 / 25), np.eye(25)[-1] - np.eye(25)[0]]
    )
    indefinite = 0
    for seed in range(60):
        item = undrifted(seed)
        indefinite += np.linalg.eigvalsh(item.pass_covariance)[0] < 0
        model = model_of([(item, {"x": "1"})], axes=("x",))
        for scale in (1.0, 5.0):
            points = np.column_stack([90 + scale * x, np.zeros(25), np.zeros(25)])
            found = predict(model, [str(i) for i in range(25)], points).variance(A)
            # Coefficients alone, and no fewer degrees of freedom than the passes have.
            assert (found.total >= found.coefficients * (1 - 1e-12)).all()
            assert (found.total > 0).all()
            assert (found.dof >= 4 * (1 - 1e-12)).all()
            parts = found.coefficients + found.passes + found.repeatability
            assert parts == pytest.approx(found.total, rel=1e-12)
    assert indefinite > 30


def test_the_reported_covariance_is_one() -> None:
    points = np.column_stack([np.linspace(-400.0, 600.0, 30), np.zeros(30), np.zeros(30)])
    mended = 0
    for seed in range(20):
        model = model_of([(undrifted(seed), {"x": "1"})], axes=("x",))
        prediction = predict(model, [str(i) for i in range(30)], points)
        variance = prediction.variance(np.eye(30)).total
        found = reportable(prediction, variance)
        assert np.diag(found) == pytest.approx(variance, rel=1e-9)
        assert np.linalg.eigvalsh(found)[0] > -1e-9 * np.linalg.eigvalsh(found)[-1]
        mended += found is not prediction.covariance
    assert 0 < mended < 20


# Covariance between components that share passes.


P = np.linspace(0.0, 90.0, 4)
CENTRE = P.mean()
PASSES = 5
MACHINE = """
components: {a: {of: x, unit: mm}, b: {of: y, unit: mm}, t: {unit: rad}}
equations: {Ex: a - y*t, Ey: b + x*t}
"""
# Level and slope of a, of b, and the angle, at the centre of the readings.
D = np.array(
    [
        [1.0, 4e-3, 0.9, 0.0, 3e-3],
        [4e-3, 1e-4, 2e-3, 3e-5, 1e-5],
        [0.9, 2e-3, 2.0, -6e-3, 4e-3],
        [0.0, 3e-5, -6e-3, 2e-4, 0.0],
        [3e-3, 1e-5, 4e-3, 0.0, 5e-5],
    ]
)
TO_ORIGIN = np.array([[1.0, -CENTRE], [0.0, 1.0]])
T = np.block(
    [
        [TO_ORIGIN, np.zeros((2, 3))],
        [np.zeros((2, 2)), TO_ORIGIN, np.zeros((2, 1))],
        [np.zeros((1, 4)), np.ones((1, 1))],
    ]
)
S_REPEAT = (0.8, 1.5)


def segments(states: FloatArray, rng: np.random.Generator) -> list[Segment]:
    """Passes with the given states (passes, 5)."""
    n = len(states)
    number = np.repeat(np.arange(1, n + 1), len(P))
    found = []
    for c, (name, s) in enumerate(zip("ab", S_REPEAT, strict=True)):
        lines = states[:, 2 * c, None] + states[:, 2 * c + 1, None] * (P - CENTRE)
        noise = s * rng.standard_normal(lines.shape)
        error = (lines + noise).ravel()
        found.append(Segment(name=name, position=np.tile(P, n), error=error, passes=number))
    found.append(Segment(name="t", position=None, error=states[:, 4], passes=np.arange(1, n + 1)))
    return found


def test_joint_covariances_are_unbiased(tmp_path: Path) -> None:
    """C, D and a future part's covariance over many machines, against what drew them."""
    machine = loaded(tmp_path, MACHINE)
    rng = np.random.default_rng(1)
    half = np.linalg.cholesky(D)
    machines = 400
    found_C, found_D, coefficients = [], [], []
    for _ in range(machines):
        states = rng.standard_normal((PASSES, 5)) @ half.T
        fit = fit_machine(machine, readings(segments(states, rng)))
        (group,) = fit.joint
        assert group.components == ("a", "b", "t")
        assert (group.pass_dof, group.n_passes) == (PASSES - 1, PASSES)
        found_C.append(group.covariance)
        found_D.append(group.pass_covariance)
        coefficients.append(
            np.concatenate([fit.components[name].estimate.coefficients for name in "abt"])
        )
    X = np.column_stack([np.ones_like(P), P])
    of_noise = np.zeros((5, 5))
    for c, s in enumerate(S_REPEAT):
        of_noise[2 * c : 2 * c + 2, 2 * c : 2 * c + 2] = s**2 * np.linalg.inv(X.T @ X)
    in_origin = T @ D @ T.T
    of_C = (in_origin + of_noise) / PASSES
    for found, wanted in ((found_D, in_origin), (found_C, of_C)):
        sample = np.array(found)
        error = sample.std(axis=0, ddof=1) / np.sqrt(machines)
        assert (np.abs(sample.mean(axis=0) - wanted) < 4.5 * error).all()
        # The test can tell: cross terms stand out from zero.
        assert abs(wanted[0, 2]) > 4.5 * error[0, 2]
    seen = np.cov(np.array(coefficients).T)
    scale = np.sqrt(np.outer(np.diag(of_C), np.diag(of_C)) + of_C**2) / np.sqrt(machines)
    assert (np.abs(seen - of_C) < 4.5 * scale).all()


@pytest.mark.parametrize(
    ("shared", "first", "second"),
    [
        (1, {}, {}),
        # Another instrument, other pass numbers, other directions, no pass column.
        (0, {}, {"role": "laser"}),
        (0, {}, {"passes": np.repeat(np.arange(2, PASSES + 2), len(P))}),
        (0, {}, {"direction": np.tile(np.repeat([1, -1], [2, 2]), PASSES)}),
        (0, {}, {"passes": None}),
        # Set-ups decide where they are given.
        (1, {"setup": "A"}, {"setup": "A"}),
        (0, {"setup": "A"}, {"setup": "B"}),
        (0, {"setup": "A"}, {}),
    ],
)
def test_who_shares_passes(
    tmp_path: Path, shared: int, first: dict[str, Any], second: dict[str, Any]
) -> None:
    rng = np.random.default_rng(3)
    a, b, _ = segments(rng.standard_normal((PASSES, 5)), rng)
    text = MACHINE.replace(", t: {unit: rad}", "").replace("- y*t", "").replace("+ x*t", "")
    given = readings([replace(a, **first), replace(b, **second)])
    fit = fit_machine(loaded(tmp_path, text), given)
    assert len(shared_passes(fit.components)) == shared


# Probability of conformance against scipy and against counted parts.


@tried(100)
@given(
    st.tuples(st.floats(-100, 100), st.floats(0.1, 100)),
    st.floats(-0.2, 0.2),
    st.floats(1e-4, 0.1),
    st.sampled_from([2.5, 7, 1e9, np.inf]),
)
def test_against_student_and_normal(
    zone: tuple[float, float], error: float, u: float, dof: float
) -> None:
    low, high = zone[0], zone[0] + zone[1]
    found = conformance_of(Tolerance(low, high), UM, error, u, dof)
    assert found is not None
    law = stats.norm(error, u) if dof == np.inf else stats.t(dof, loc=error, scale=u)
    assert found.probability == pytest.approx(law.cdf(high * UM) - law.cdf(low * UM), abs=1e-7)


def test_without_uncertainty_and_without_tolerance() -> None:
    assert conformance_of(None, UM, 0.0, 1.0, np.inf) is None
    zone = Tolerance(-10.0, 12.0)
    for error, inside in ((0.0119, 1.0), (0.0121, 0.0), (-0.0099, 1.0), (-0.011, 0.0)):
        found = conformance_of(zone, UM, error, 0.0, 5.0)
        assert found is not None
        assert found.probability == inside


def _prediction(C: FloatArray, dof: float, visits: tuple[float, float], nu: float) -> Prediction:
    """Two points with errors along x and y: coefficients C (2, 2) of `dof` that both share, and a
    visit of each with s (along x, along y) of `nu`.
    """
    rows, nothing = np.tile(np.eye(2), (2, 1)), np.zeros((2, 2))

    def block(G: FloatArray, s: FloatArray, own: float) -> CoefficientBlock:
        return CoefficientBlock(
            names=("a",),
            columns=(slice(0, 2),),
            G=G,
            C=C,
            D=nothing,
            noise=np.tile(s[:, None], (2, 1)),
            pass_dof=0.0,
            repeat_dof=(own,),
        )

    blocks = block(rows, np.zeros(2), dof), block(0 * rows, np.array(visits), nu)
    return Prediction(
        ids=("p", "q"),
        axes=("x", "y"),
        points=np.zeros((2, 3)),
        mean=np.array([0.0, 0.0, 0.004, -0.003]),
        blocks=blocks,
        independent_variance=np.full(4, 1e-6),
        outside={},
    )


def test_position_against_counted_parts() -> None:
    """Errors of x and y correlated; every source with its own chi-squared."""
    C, s, n = 1e-6 * np.array([[9.0, 6.0], [6.0, 16.0]]), np.array([0.002, 0.001]), 400_000
    at = _prediction(C, 5.0, (s[0], s[1]), 7.0)
    found = position_conformance(at, [None, 12.0], Settings(trials=n))[1]
    rng = np.random.default_rng(3)
    scale = np.sqrt(5 / rng.chisquare(5, n)), np.sqrt(7 / rng.chisquare(7, n))
    errors = rng.multivariate_normal([0, 0], C, n) * scale[0][:, None] + [0.004, -0.003]
    errors += (rng.standard_normal(n) * scale[1])[:, None] * s
    inside = np.mean(np.hypot(*errors.T) <= 0.006)
    assert found is not None
    assert found.probability == pytest.approx(inside, abs=6.5 * found.se)
    alone = replace(at, axes=("z",), ids=("p", "q", "r", "s"))
    assert position_conformance(alone, [12.0] * 4, Settings()) == (None,) * 4
