"""The report of fit-components: complete, read back without loss, legible."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_examples import LINES, SAYS, SETTINGS, Example, example
from support import read_components

from mtu_cli.analyses.fit_components import (
    FitResult,
    fit_result,
    observability,
)
from mtu_cli.files.source import report_bytes
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.fit import (
    estimates_from_report,
)
from mtu_cli.reports.document import Document, envelope
from mtu_cli.reports.fit_components import document
from mtu_cli.reports.numbers import (
    plus_minus,
)
from mtu_cli.reports.tables import plain_text

STATED = "  ez0: {of: y, unit: um, coefficients: [3.0, -0.05], covariance: [[1, 0], [0, 1e-4]], "

STATED += "s_repeat: 0.4, pass_covariance: [[0.5, 0.001], [0.001, 1e-4]], pass_dof: 7, dof: 20}"

LONG = "  a_component_with_a_name_that_is_far_too_long_for_any_table: "

LONG += "{of: x, unit: um, coefficients: [1.5, 0.01], u_future: 1.9}"

CASES: dict[str, dict[str, Any]] = {
    "one instrument": {},
    "one run": {"passes": None, "directions": False},
    "two instruments": {"passes": 3, "roles": ("lbb", "laser")},
    "stated": {"passes": 4, "stated": STATED, "equation": "  Ez: ez0\n"},
    "quadratic": {"degree": 2},
}


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Example:
    return example(tmp_path_factory.mktemp("paper"))


def fitted(given: Example) -> FitResult:
    return fit_result("test machine", given.fit, given.estimates, says=SAYS)


def text_of(given: Example, *, detail: bool = False) -> str:
    return plain_text(document(fitted(given)).blocks(detail=detail))


def rows_of(made: Document) -> list[dict[str, str]]:
    """The rows of the table by the first lines of their headings."""
    sheet = made.tables[0].sheet(2, detail=False)
    titles = [column.title.partition("\n")[0] for column in sheet.columns]
    return [dict(zip(titles, row, strict=True)) for row in sheet.rows]


def report(given: Example) -> dict[str, Any]:
    result = fitted(given)
    return envelope(
        "fit-components",
        inputs=[given.machine.source],
        settings=SETTINGS,
        results=document(result).record(),
        warnings=result.warnings,
    )


def same(found: object, wanted: object) -> None:
    """Arrays to 1e-12 of the scale of their rows and columns, the rest exactly."""
    if wanted is None or found is None:
        assert found is wanted
        return
    a, b = np.asarray(found, float), np.asarray(wanted, float)
    assert a.shape == b.shape
    if b.ndim == 2:
        scale = np.sqrt(np.abs(np.outer(np.diag(b), np.diag(b))))
        assert np.all(np.abs(a - b) <= 1e-12 * scale)
    else:
        np.testing.assert_allclose(a, b, rtol=1e-12)


@pytest.mark.parametrize("case", CASES)
def test_prediction_reads_the_same_estimates_back(case: str, tmp_path: Path) -> None:
    given = example(tmp_path, **CASES[case])
    path = tmp_path / "components.json"
    path.write_bytes(report_bytes(report(given)))
    back = estimates_from_report(given.machine, read_components(path))
    assert set(back.components) == set(given.estimates.components)
    for name, wanted in given.estimates.components.items():
        found = back.components[name]
        for field in ComponentEstimate.__dataclass_fields__:
            if field in ("name", "of", "unit", "n_passes"):
                assert getattr(found, field) == getattr(wanted, field), (name, field)
            else:
                same(getattr(found, field), getattr(wanted, field))
    assert len(back.joint) == len(given.estimates.joint)
    for read, group in zip(back.joint, given.estimates.joint, strict=True):
        assert (read.components, read.widths, read.pass_dof, read.n_passes) == (
            group.components,
            group.widths,
            group.pass_dof,
            group.n_passes,
        )
        same(read.covariance, group.covariance)
        same(read.pass_covariance, group.pass_covariance)


def test_figures_against_plain_formulas(paper: Example) -> None:
    """Gilsinn & Ling 2004, eqs. (6) and (11), by numpy on the readings in um."""
    item = report(paper)["results"]["components"]["dx_x"]
    fit = paper.fit.components["dx_x"].instruments[0]
    X = np.column_stack([np.ones(80), fit.position])
    y = fit.error * 1000
    b = np.linalg.solve(X.T @ X, X.T @ y)
    residual = y - X @ b
    s2 = residual @ residual / 78
    np.testing.assert_allclose(item["coefficients"], b, rtol=1e-9)
    assert item["s"] == pytest.approx(np.sqrt(s2), rel=1e-9)
    assert (item["n"], item["n_passes"], item["passes_read"], item["dof"]) == (80, 10, 10, 78)
    np.testing.assert_allclose(
        item["covariance_independent"], s2 * np.linalg.inv(X.T @ X), rtol=1e-8
    )
    assert item["r2"] == pytest.approx(np.corrcoef(fit.position, y)[0, 1] ** 2, rel=1e-9)
    level = [y[(fit.group == g)].mean() for g in range(10)]
    forward = np.array([sign > 0 for *_, sign in fit.keys_read])
    back = np.mean(np.array(level)[forward]) - np.mean(np.array(level)[~forward])
    assert item["reversal"]["mean"] == pytest.approx(back, rel=1e-9)
    assert (item["reversal"]["dof"], item["pass_dof"]) == (4, 4)
    assert item["pass_center_mm"] == pytest.approx(75.0)
    assert item["s_pass"] == pytest.approx(np.sqrt(item["pass_covariance"][0][0]))
    assert item["drift"]["df"] == [16, 60]


def test_observability_of_several_instruments(tmp_path: Path) -> None:
    given = example(tmp_path, passes=3, roles=("lbb", "laser"), stated=LONG)
    (stated,) = (x for x in observability(given.fit, given.estimates) if "name" in x.component)
    assert "--lbb" in stated.reading_that_would
    item = report(given)["results"]["components"]["dx_x"]
    assert (item["n"], item["passes_read"], item["n_passes"]) == (96, 12, None)
    assert [(x["role"], x["n"]) for x in item["instruments"]] == [("lbb", 48), ("laser", 48)]
    assert 0 <= item["agreement_p"] <= 1
    notes = [x["facts"] for x in report(given)["warnings"] if x["code"] == "not-estimable"]
    assert ["dx_x", "dy_x"] in [x["names"][:2] for x in notes if x["quantity"] == "dof and r2"]


def test_values_of_a_table_are_listed_by_their_positions(tmp_path: Path) -> None:
    stated = (
        "  ez0: {of: y, unit: um, shape: table, at_mm: [0, 50, 100], coefficients: [1, 2, 4], "
        "covariance: [[0.01, 0, 0], [0, 0.04, 0], [0, 0, 0.09]]}"
    )
    given = example(tmp_path, passes=3, stated=stated, equation="  Ez: ez0\n")
    listed = text_of(given).partition("Values of the tables")[2].splitlines()[3:6]
    rows = [("0", "1.00 ± 0.10"), ("50", "2.00 ± 0.20"), ("100", "4.00 ± 0.30")]
    assert [line.split(maxsplit=3) for line in listed] == [["ez0", "um", *row] for row in rows]


@pytest.mark.parametrize("case", [*CASES, "long"])
def test_table_fits_100_columns(case: str, tmp_path: Path) -> None:
    given = example(tmp_path, **CASES.get(case, {"stated": LONG}))
    for detail in (False, True):
        text = text_of(given, detail=detail)
        assert max(map(len, text.splitlines())) <= 100
    rows = {row["component"]: row for row in rows_of(document(fitted(given)))}
    for name in LINES:
        estimate = given.estimates.components[name]
        slope, u = estimate.coefficients[1], np.sqrt(estimate.covariance[1, 1])
        per_m = 1000 / estimate.unit.to_internal
        assert rows[name]["slope"] == plus_minus(slope * per_m, u * per_m)


REASONS: dict[str, tuple[dict[str, Any], dict[str, str | None]]] = {
    # What the readings of dx_x, of an axis, and axy, of none, leave open.
    "no pass column": (
        {"passes": None, "directions": False},
        {
            "pass-to-pass drift apart from repeatability": "no `pass` is given",
            "reversal": "no `direction` is given",
            "lack of fit": "no position is repeated often enough, or its readings do not differ",
        },
    ),
    "one pass": (
        {"passes": 1, "directions": False},
        {"pass-to-pass drift apart from repeatability": "1 pass only"},
    ),
    "three passes": (
        {"passes": 3, "directions": False},
        {"steady drift from pass to pass": None, "reversal": "no `direction` is given"},
    ),
    "two runs there and back": (
        {"passes": 2},
        {
            "steady drift from pass to pass": "4 passes, too few or of equal levels",
            "reversal": None,
        },
    ),
    "as many coefficients as positions": (
        {"degree": 7},
        {"lack of fit": "8 positions for 8 coefficients"},
    ),
}


@pytest.mark.parametrize("case", REASONS)
def test_what_is_left_open_has_the_reason_of_these_readings(case: str, tmp_path: Path) -> None:
    given, wanted = REASONS[case]
    made = example(tmp_path, **given)
    found = {
        x.not_determined: x.because
        for x in observability(made.fit, made.estimates)
        if x.component == "dx_x"
    }
    assert {what: found.get(what) for what in wanted} == wanted


def test_what_is_not_repeated_in_a_pass_is_not_repeated_from_the_same_side(tmp_path: Path) -> None:
    """Of a squareness read once a pass, there and back: the two sides are no repeats."""
    made = example(tmp_path)
    because = {
        x.not_determined: x.because
        for x in observability(made.fit, made.estimates)
        if x.component == "axy"
    }
    assert "within a pass from the same side" in because["repeatability of one visit"]
