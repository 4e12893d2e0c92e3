"""What passes there and back of a run share, of a component that several instruments read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import Segment, loaded, readings
from reading_examples import only

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.reports_read import report_from
from mtu_cli.files.source import Source
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.estimation import agreement, combine
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report, fit_machine
from mtu_cli.model.reading_residuals import reading_tables
from mtu_cli.reports.fit_components import document
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import Shift

P = np.linspace(0.0, 90.0, 4)
MACHINE = "components: {a: {of: x, unit: mm}}\nequations: {Ex: a}\n"
SCHEMA = "mtu/fit-components/1"


def segment(role: str, runs: int, seed: int, *, one_way: bool = False) -> Segment:
    """Level and slope of each run, of each pass, and noise."""
    rng = np.random.default_rng(seed)
    line = 3.0 * rng.normal(size=(runs, 1, 2)) + rng.normal(size=(runs, 2, 2))
    line[..., 1] *= 0.01
    error = line[..., :1] + line[..., 1:] * (P - P.mean())
    error = error + 0.5 * rng.standard_normal(error.shape)
    way = np.tile(np.repeat([1, -1], len(P)), runs)
    found = Segment(
        name="a",
        position=np.tile(P, 2 * runs),
        error=error.ravel(),
        passes=np.repeat(np.arange(runs) + 1, 2 * len(P)),
        direction=way,
        role=role,
    )
    if not one_way:
        return found
    there = way > 0
    own = {name: getattr(found, name)[there] for name in ("position", "error", "passes")}
    return replace(found, **own, direction=way[there])


def of_runs(item: Segment, runs: int) -> FloatArray:
    """K from the lines of the passes by numpy: covariance of there and back, made symmetric."""
    lines = np.polyfit(P, item.error.reshape(-1, len(P)).T, 1)[::-1]
    K = np.cov(lines[:, 0::2], lines[:, 1::2])[:2, 2:]
    assert lines.shape[1] == 2 * runs
    return np.asarray((K + K.T) / 2)


@pytest.mark.parametrize("one_way", [False, True], ids=["both ways", "one ran one way"])
def test_it_is_pooled_over_those_that_ran_both_ways(one_way: bool, tmp_path: Path) -> None:
    known = loaded(tmp_path, MACHINE)
    both = [segment("lbb", 6, 1), segment("laser", 4, 2, one_way=one_way)]
    estimate = fit_machine(known, readings(both)).components["a"].estimate
    assert estimate.half_differences is None
    wanted = of_runs(both[0], 6)
    if not one_way:
        wanted = (5 * wanted + 3 * of_runs(both[1], 4)) / 8
    assert estimate.run_covariance is not None
    np.testing.assert_allclose(estimate.run_covariance, wanted, rtol=1e-9, atol=1e-12)


def test_further_readings_share_it_as_reported(tmp_path: Path) -> None:
    """Of the table's factor; also of the report read back. A damaged one is told."""
    known = loaded(tmp_path, MACHINE)
    fit = fit_machine(known, readings([segment("lbb", 6, 1), segment("laser", 4, 2)]))
    own = estimates_from_fit(known, fit)
    results = document(fit_result("m", fit, own)).record()
    source = Source(role="components", path=tmp_path, shown="c.json", sha256="", rows=0)
    report = report_from(source, {"schema": SCHEMA, "results": results})
    K = own.components["a"].run_covariance
    assert K is not None
    assert np.linalg.eigvalsh(K)[0] > 0
    for estimates in (own, estimates_from_report(known, report)):
        one = Estimates(components={"a": estimates.components["a"]})
        table = only(reading_tables(known, one, readings([segment("laser", 5, 3)])))
        X = np.column_stack([np.ones(2 * len(P)), table.places[0, :, 0]])
        way, R = table.covariates["dir_x"][0], table.of_part[0, :, 0]
        found, same = R @ R.T, way[:, None] == way
        D = own.components["a"].pass_covariance
        np.testing.assert_allclose(found[same], (X @ D @ X.T)[same], rtol=1e-6)
        np.testing.assert_allclose(found[~same], (X @ K @ X.T)[~same], rtol=1e-6)
    for damaged, told in (([[None, 0], [0, 0]], "wrong value: 'null'"), ([[1.0]], "another size")):
        results["components"]["a"]["run_covariance"] = damaged
        with pytest.raises(InputError, match=told):
            report_from(source, {"schema": SCHEMA, "results": results})


@pytest.mark.parametrize("way", [1, -1])
def test_a_line_of_one_way_is_brought_to_the_mean_of_both(way: int, tmp_path: Path) -> None:
    """By half of the reversal that the other instrument tells, whose u counts; both agree then."""
    known, lost = loaded(tmp_path, MACHINE), -40.0
    both = segment("lbb", 6, 1)
    both = replace(both, error=both.error + 0.5 * lost * np.asarray(both.direction))
    alone = segment("laser", 5, 2, one_way=True)
    alone = replace(
        alone, error=alone.error + 0.5 * lost * way, direction=np.full(len(alone.error), way)
    )
    fit = fit_machine(known, readings([both, alone])).components["a"]
    back = fit.instruments[0].tests["reversal"]
    assert isinstance(back, Shift)
    plain = [
        fit_machine(known, readings([item])).components["a"].estimate for item in (both, alone)
    ]
    moved = replace(
        plain[1],
        coefficients=plain[1].coefficients - np.array([0.5 * way * back.value, 0.0]),
        covariance=plain[1].covariance + np.diag([0.25 * back.u**2, 0.0]),
    )
    wanted = combine([plain[0], moved], [len(both.error), len(alone.error)])
    np.testing.assert_allclose(fit.estimate.coefficients, wanted.coefficients, rtol=1e-9)
    np.testing.assert_allclose(fit.estimate.covariance, wanted.covariance, rtol=1e-9)
    assert fit.agreement_p == pytest.approx(agreement(plain[0], moved))
    assert abs(fit.estimate.coefficients[0]) < 4 * np.sqrt(fit.estimate.covariance[0, 0])
