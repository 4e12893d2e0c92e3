"""Readings to estimates: passes, several instruments, what the messages say."""

import json
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from compare_trials import fitted
from hypothesis import given
from hypothesis import strategies as st
from machine_trials import COMPONENTS, POINTS, Drift, machine, read_machine
from model_examples import Segment, estimate, loaded, model_of, readings, stated
from property_settings import tried
from scipy import stats
from scipy.linalg import block_diag
from support import read_components

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.machine import Component, LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import ComponentEstimate, JointPasses
from mtu_cli.model.estimation import ComponentFit, agreement, combine, fit_component
from mtu_cli.model.fit import (
    MachineFit,
    estimates_from_fit,
    estimates_from_report,
    fit_machine,
    fit_warnings,
)
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.prediction import predict
from mtu_cli.reports.fit_components import document
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
) -> Segment:
    """Passes over the positions: 2 um + 0.01 um/mm, a level a pass, repeatability s (mm)."""
    p = np.linspace(0, 140, 8) if positions is None else positions
    state = level * rng.standard_normal((passes, 2)) * [1.0, 0.01]
    error = 2e-3 + 1e-5 * p + state[:, :1] + state[:, 1:] * (p - p.mean())
    error = error + s * rng.standard_normal(error.shape)
    return Segment(
        name="c",
        position=np.tile(p, passes),
        error=error.ravel(),
        passes=np.repeat(np.arange(passes) + 1, len(p)),
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
    p_values = []
    for _ in range(200):
        pair: list[ComponentEstimate] = []
        for passes, points, s, level in ((10, 8, 1e-3, 1.5e-3), (6, 6, 0.3e-3, 1.0e-3)):
            given = segment(
                rng, passes=passes, positions=np.linspace(0, 140, points), s=s, level=level
            )
            if degree == 0:
                # Its level alone varies, which a constant can describe.
                state = level * np.repeat(rng.standard_normal(passes), points)
                noise = s * rng.standard_normal(passes * points)
                given = replace(given, error=2e-3 + state + noise)
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


# A machine's components from readings, from a report, or from its own file.


def reported(folder: Path, known: LoadedMachine, fit: MachineFit) -> Path:
    """The fit as `fit-components -o` writes it."""
    results = document(fit_result("m", fit, estimates_from_fit(known, fit))).record()
    path = folder / "components.json"
    path.write_text(json.dumps({"schema": "mtu/fit-components/1", "results": results}))
    return path


@pytest.mark.parametrize("drift", [Drift(1.0), Drift(0.0), Drift(1.0, common=True)])
def test_a_report_predicts_what_its_fit_predicts(tmp_path: Path, drift: Drift) -> None:
    known = machine(tmp_path)
    fit = fit_machine(known, read_machine(np.random.default_rng(1), drift))
    direct = estimates_from_fit(known, fit)
    again = estimates_from_report(known, read_components(reported(tmp_path, known, fit)))
    one, two = (predict(build_model(known, e), list("abc"), POINTS) for e in (direct, again))
    A = np.random.default_rng(2).normal(size=(5, 6))
    assert two.mean == pytest.approx(one.mean, rel=1e-12)
    assert two.variance(A).total == pytest.approx(one.variance(A).total, rel=1e-8)
    assert two.variance(A).dof == pytest.approx(one.variance(A).dof, rel=1e-6)
    assert two.independent_variance == pytest.approx(one.independent_variance, rel=1e-9)


def test_a_component_with_nothing_is_listed_and_not_predicted(tmp_path: Path) -> None:
    known = loaded(
        tmp_path, "components:\n  a: {unit: um}\n  b: {of: x, unit: um}\nequations: {Ex: a + b}\n"
    )
    given = readings([Segment(name="a", position=None, error=np.array([1.0, 3]))])
    fit = fit_machine(known, given)
    assert fit.missing == ("b",)
    (note,) = [str(each) for each in fit.warnings]
    assert note.startswith("machine.yaml:5: ")
    assert "coefficients (b); no readings in lbb.csv" in note
    with pytest.raises(InputError, match=r"components\.b: an estimate of b is missing"):
        build_model(known, estimates_from_fit(known, fit))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("a: {of: y, unit: um}", "machine.yaml: .of x in um"),
        ("a: {of: x, unit: urad}", "machine.yaml: .of x in um"),
        ("a: {of: x, unit: um, degree: 2}", "machine.yaml: .of degree 1"),
    ],
)
def test_a_report_of_another_machine_is_refused(tmp_path: Path, change: str, message: str) -> None:
    known = loaded(tmp_path, "components: {a: {of: x, unit: um}}\nequations: {Ex: a}\n")
    given = Segment(name="a", position=np.arange(5.0), error=np.array([1.0, 3, 2, 4, 1]))
    path = reported(tmp_path, known, fit_machine(known, readings([given])))
    equation = "0.5*x*a" if "rad" in change else "a"
    other = loaded(tmp_path, f"components: {{{change}}}\nequations: {{Ex: {equation}}}\n")
    with pytest.raises(InputError, match=message):
        estimates_from_report(other, read_components(path))


def test_components_of_a_machine_file(tmp_path: Path) -> None:
    """Every form in which a machine file may state what is known, by hand."""
    model = stated(
        tmp_path,
        """
        components:
          a: {of: x, unit: um, coefficients: [1, 0.1], s_repeat: 2, dof: 12,
              pass_covariance: [[4, 0.1], [0.1, 0.01]], pass_center_mm: 50}
          b: {of: x, unit: um, coefficients: [1, 0.1], u_future: 3, dof: 8}
          c: {unit: um, coefficients: [1], u_future: 3, dof: 4}
          d: {unit: um, coefficients: [1], covariance: [[9]], pass_dof: 5}
        equations: {Ex: a + b + c + d}
        """,
    )
    a, b, c, d = (term.estimate for term in model.terms)
    x = 20.0
    g = np.array([1.0, x])
    of_D = 4 + 2 * 0.1 * (x - 50) + 0.01 * (x - 50) ** 2
    assert g @ a.pass_covariance @ g == pytest.approx(of_D * 1e-6)
    assert [a.pass_dof, a.repeat_dof, a.s_repeat] == pytest.approx([12, 12, 2e-3])
    assert (b.pass_covariance == 0).all()
    assert [b.s_repeat, b.pass_dof, b.repeat_dof] == pytest.approx([3e-3, 0, 8])
    assert c.pass_covariance[0, 0] == pytest.approx(9e-6)
    assert (c.s_repeat, c.pass_dof) == (0, 4)
    assert d.covariance[0, 0] == pytest.approx(9e-6)


# Warnings of a fit: rare on clean machines, there where something is planted.


MACHINES = 160
KINDS = ("reversal", "passes-drift", "lack-of-fit")


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> list[MachineFit]:
    known = machine(tmp_path_factory.mktemp("clean"))
    rng = np.random.default_rng(1)
    return [fit_machine(known, read_machine(rng, Drift(i % 2))) for i in range(MACHINES)]


def test_clean_machines_are_warned_of_as_rarely_as_stated(clean: list[MachineFit]) -> None:
    """A family-wise rate of 5 % a kind: no more, and not so much less as to be blind."""
    found = Counter(code for fit in clean for code in {item.code for item in fit_warnings(fit)})
    high = stats.binom(MACHINES, 0.05).ppf(1 - 1e-4)
    low = stats.binom(MACHINES, 0.05).ppf(1e-4)
    for kind in KINDS:
        assert low <= found[kind] <= high, kind
    assert set(found) <= set(KINDS)


@pytest.mark.parametrize("name", ["dx_x", "ez_y"])
def test_p_values_of_clean_machines_are_uniform(clean: list[MachineFit], name: str) -> None:
    fits = [fit.components[name].instruments[0] for fit in clean]
    for test in ("reversal", "trend", "lack_of_fit"):
        p = [item.tests[test].p for item in fits]
        assert stats.kstest(p, "uniform").pvalue > 1e-3, test
    # Pass scatter is no fault; without drift it is not seen either.
    without = [item.tests["drift"].p for item in fits[0::2] if "drift" in item.tests]
    assert stats.kstest(without, "uniform").pvalue > 1e-3
    with_drift = [item.tests["drift"].p for item in fits[1::2] if "drift" in item.tests]
    assert np.median(with_drift) < 1e-3


def planted(given: Readings, name: str, what: str) -> Readings:
    """A reversal of 6 um, a drift of 4 um a pass there and back, or a bend of 6 um."""
    rows = given.code == given.components.index(name)
    size = 1e-3 if name.startswith("d") else 1e-5
    p = given.position_mm - 80
    shape = {
        "reversal": 3 * given.direction,
        "passes-drift": 2.0 * (2 * given.pass_number + (given.direction < 0)),
        "lack-of-fit": 6 * (p / 70) ** 2,
    }[what]
    return replace(given, error=given.error + np.where(rows, size * shape, 0.0))


@pytest.mark.parametrize("what", KINDS)
@pytest.mark.parametrize("name", ["dx_x", "ez_y"])
def test_what_is_planted_is_warned_of(tmp_path: Path, what: str, name: str) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(5), Drift(0.5))
    before = [item for item in fit_warnings(fit_machine(known, given)) if item.code == what]
    found = [
        item
        for item in fit_warnings(fit_machine(known, planted(given, name, what)))
        if item.code == what
    ]
    assert before == []
    assert len(found) == 1
    assert found[0].message.startswith(name)
    amount = {"reversal": "reverses by", "passes-drift": "drifts by", "lack-of-fit": "degree"}
    assert amount[what] in found[0].message


def test_scatter_that_cannot_be_split_is_warned_of(tmp_path: Path) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(7), Drift(1.0))
    rows = given.code == 0
    found = fit_warnings(fit_machine(known, replace(given, has_pass=given.has_pass & ~rows)))
    (item,) = [item for item in found if item.code == "not-separable"]
    assert "dx_x" in item.message
    assert not any(name in item.message for name in COMPONENTS if name != "dx_x")


def test_readings_without_any_scatter_are_warned_of(tmp_path: Path) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(7), Drift(1.0))
    exact = np.where(given.code == 0, 1e-3 + 1e-5 * given.position_mm, given.error)
    found = fit_warnings(fit_machine(known, replace(given, error=exact)))
    (item,) = [item for item in found if item.code == "no-scatter-known"]
    assert "readings is unknown (dx_x): they do not scatter" in item.message


# Propagation with covariance against loops over pairs of points.


seeds = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Case:
    """A random machine: lever arms c0 + cx x + cy y by component and axis, and its group."""

    model: MachineModel
    estimates: list[ComponentEstimate]
    levers: list[dict[str, tuple[float, float, float]]]
    group: JointPasses | None
    points: FloatArray


def spread(rng: np.random.Generator, k: int) -> FloatArray:
    """A random covariance, singular at times."""
    half = rng.normal(size=(k, rng.integers(1, k + 1)))
    whole: FloatArray = half @ half.T
    return whole


def case(seed: int, components: int, points: int, joint: bool) -> Case:
    rng = np.random.default_rng(seed)
    estimates, levers = [], []
    for c in range(components):
        of = (None, "x", "y")[int(rng.integers(3))]
        k = 1 if of is None else int(rng.integers(1, 5))
        scale = 20.0 ** -np.arange(k)
        estimates.append(
            estimate(
                f"c{c}",
                of,
                rng.normal(size=k) * scale,
                C=spread(rng, k) * np.outer(scale, scale),
                D=spread(rng, k) * np.outer(scale, scale),
                s=float(rng.uniform(0, 2)),
                pass_dof=float(rng.integers(3, 12)),
                repeat_dof=float(rng.integers(20, 80)),
            )
        )
        axes = [("x",), ("y",), ("x", "y")][int(rng.integers(3))]
        levers.append({axis: tuple(np.round(rng.normal(size=3), 3)) for axis in axes})
    group = None
    if joint:
        sizes = [len(item.coefficients) for item in estimates]
        scale = np.concatenate([20.0 ** -np.arange(k) for k in sizes])
        K = sum(sizes)
        group = JointPasses(
            components=tuple(item.name for item in estimates),
            widths=tuple(sizes),
            covariance=spread(rng, K) * np.outer(scale, scale),
            pass_covariance=spread(rng, K) * np.outer(scale, scale),
            pass_dof=7.0,
            n_passes=None,
        )
        # Some of a group need not stand in the equations.
        for own in levers[: int(rng.integers(components - 1))]:
            own.clear()
    model = model_of(
        [
            (estimates[c], {i: f"{a} + ({b})*x + ({d})*y" for i, (a, b, d) in levers[c].items()})
            for c in rng.permutation(components)
            if levers[c]
        ],
        joint=() if group is None else (group,),
    )
    places = np.column_stack([rng.uniform(-30, 30, (points, 2)), np.zeros(points)])
    return Case(model, estimates, levers, group, places)


def slow_covariance(found: Case) -> FloatArray:
    """x_p'(C + D)x_q + [p = q] s^2: a row of lever arms times powers for each point and axis."""
    S = block_diag(*(item.covariance + item.pass_covariance for item in found.estimates))
    if found.group is not None:
        S = found.group.covariance + found.group.pass_covariance
    rows, visits = [], []
    for place in found.points:
        for axis in "xy":
            arms = [
                np.dot(own[axis], [1, *place[:2]]) if axis in own else 0.0 for own in found.levers
            ]
            powers = [
                [
                    (0.0 if e.of is None else place["xyz".index(e.of)]) ** k
                    for k in range(len(e.coefficients))
                ]
                for e in found.estimates
            ]
            rows.append(
                np.concatenate([a * np.array(p) for a, p in zip(arms, powers, strict=True)])
            )
            visits.append([a * e.s_repeat for a, e in zip(arms, found.estimates, strict=True)])
    G, s = np.array(rows), np.array(visits)
    same = np.kron(np.eye(len(found.points)), np.ones((2, 2)))
    return np.asarray(G @ S @ G.T + same * (s @ s.T))


@tried(40)
@given(seeds, st.integers(1, 4), st.integers(1, 4), st.booleans())
def test_against_the_slow_sum(seed: int, components: int, points: int, joint: bool) -> None:
    found = case(seed, components, points, joint and components > 1)
    result = predict(found.model, [str(i) for i in range(points)], found.points)
    wanted = slow_covariance(found)
    size = max(np.abs(wanted).max(), 1e-300)
    assert result.covariance == pytest.approx(wanted, rel=1e-9, abs=1e-10 * size)
    A = np.random.default_rng(seed).normal(size=(5, 2 * points))
    variance = result.variance(A)
    assert variance.total == pytest.approx(np.diag(A @ wanted @ A.T), rel=1e-8, abs=1e-9 * size)
    assert variance.by_block.sum(axis=0) == pytest.approx(variance.total, rel=1e-12)
    parts = variance.coefficients + variance.passes + variance.repeatability
    assert parts == pytest.approx(variance.total, rel=1e-12)
    for i, total in enumerate(variance.total):
        shares = variance.shares(i)
        assert (shares is None) == (total == 0)
        if shares is not None:
            assert shares["passes"] == variance.passes[i] / total
            assert sum(shares.values()) == pytest.approx(1, rel=1e-12)
    assert (variance.total >= 0).all()
    own, multiplied = result.variance(), result.variance(np.eye(2 * points))
    for name in ("total", "dof", "by_block", "coefficients", "passes", "repeatability"):
        np.testing.assert_array_equal(getattr(own, name), getattr(multiplied, name))


@tried(40)
@given(seeds, st.booleans())
def test_mean_squares_add_up_to_what_they_stand_behind(seed: int, joint: bool) -> None:
    found = case(seed, 3, 3, joint)
    A = np.random.default_rng(seed).normal(size=(4, 6))
    variance = predict(found.model, list("abc"), found.points).variance(A)
    squares = variance.squares
    size = variance.total.max()
    assert squares.of_mean.sum(axis=0) == pytest.approx(variance.coefficients, abs=1e-9 * size)
    of_part = variance.passes + variance.repeatability
    assert squares.of_part.sum(axis=0) == pytest.approx(of_part, abs=1e-9 * size)
    assert len(squares.dof) == len(squares.of_mean)
    whole = squares.of_mean + squares.of_part
    spread = (whole**2 / squares.dof[:, None]).sum(axis=0)
    least = np.where(whole == 0, np.inf, squares.dof[:, None]).min(axis=0)
    assert variance.dof == pytest.approx(np.maximum(variance.total**2 / spread, least))


def test_what_passes_tell_has_their_degrees_of_freedom() -> None:
    """Two runs there and back, fitted: the coefficients have one degree of freedom (so has the axis
    angle, read once a pass), whatever size the moment estimate of D came out at.
    """
    prediction = predict(fitted(2, 3), ["a"], np.array([[75.0, 75.0, 127.0]]))
    squares = prediction.variance(np.eye(2)).squares
    behind_mean = squares.dof[(squares.of_mean > 1e-6 * squares.of_mean.sum(axis=0)).any(axis=1)]
    assert set(behind_mean) == {1.0}
    few = squares.dof <= 1
    assert (squares.of_part[few].sum(axis=0) > 0).all()
    # Repeatability alone is left for the others.
    assert squares.dof[~few].min() > 30
    # Of both axes together they count no less often than of one.
    behind = [x for x in squares.passes if x is not None]
    assert behind
    assert all(1 <= x.independent(np.ones(2)) <= 2 for x in behind)
