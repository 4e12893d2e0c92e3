"""A machine's components from readings, from a report, or from its own file."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_trials import COMPONENTS, POINTS, Drift, machine, read_machine
from model_examples import Segment, loaded, readings, stated
from scipy import stats
from support import read_components

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.readings import Readings
from mtu_cli.findings import InputError
from mtu_cli.model.fit import (
    MachineFit,
    estimates_from_fit,
    estimates_from_report,
    fit_machine,
    fit_warnings,
)
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import predict
from mtu_cli.reports.fit_components import document


def reported(folder: Path, known: object, fit: MachineFit) -> Path:
    """The fit as `fit-components -o` writes it."""
    from mtu_cli.files.machine import LoadedMachine

    assert isinstance(known, LoadedMachine)
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
        tmp_path,
        "components:\n  a: {unit: um}\n  b: {of: x, unit: um}\nequations: {Ex: a + b}\n",
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


def test_as_many_readings_as_coefficients_have_no_uncertainty(tmp_path: Path) -> None:
    known = loaded(tmp_path, "components: {a: {of: x, unit: um}}\nequations: {Ex: a}\n")
    two = Segment(name="a", position=np.array([0.0, 10.0]), error=np.array([1e-3, 2e-3]))
    fit = fit_machine(known, readings([two]))
    with pytest.raises(InputError) as error:
        build_model(known, estimates_from_fit(known, fit))
    wanted = "machine.yaml:3: components.a: too little data: as many readings"
    assert wanted in str(error.value)


def test_readings_without_any_scatter_are_warned_of(tmp_path: Path) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(7), Drift(1.0))
    exact = np.where(given.code == 0, 1e-3 + 1e-5 * given.position_mm, given.error)
    found = fit_warnings(fit_machine(known, replace(given, error=exact)))
    (item,) = [item for item in found if item.code == "no-scatter-known"]
    assert "readings is unknown (dx_x): they do not scatter" in item.message
