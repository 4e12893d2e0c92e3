"""The report of fit-components: complete, read back without loss, legible."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_examples import LINES, SAYS, SETTINGS, Example, example
from support import read_components

from mtu_cli.analyses.fit_components import FitResult, fit_result
from mtu_cli.analyses.observability import NotDetermined, not_estimable, observability
from mtu_cli.files.write import report_bytes
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.fit import MachineFit, estimates_from_report
from mtu_cli.reports.document import Document, envelope
from mtu_cli.reports.fit_components import document
from mtu_cli.reports.numbers import p_value, plus_minus, significant
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
    return plain_text(document(fitted(given)).shown(detail=detail))


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


def test_pass_covariance_for_people_has_no_negative_part(tmp_path: Path) -> None:
    given = example(tmp_path, passes=3, roles=("lbb", "laser"))
    for item in report(given)["results"]["components"].values():
        D, moment = (np.array(item[f"pass_covariance{end}"]) for end in ("", "_moment"))
        assert np.linalg.eigvalsh(D)[0] >= -1e-12 * np.abs(D).max()
        if np.linalg.eigvalsh(moment)[0] > 0:
            np.testing.assert_allclose(D, moment, rtol=1e-9)


def named(found: list[NotDetermined], component: str) -> dict[str, str]:
    return {x.not_determined: x.reading_that_would for x in found if x.component == component}


def test_observability_of_one_run(tmp_path: Path) -> None:
    given = example(tmp_path, passes=None, directions=False)
    found = named(observability(given.fit, given.estimates), "dx_x")
    assert set(found) == {"pass-to-pass drift apart from repeatability", "reversal", "lack of fit"}
    assert "at least 3 times, numbered in `pass`" in next(iter(found.values()))
    assert "`direction`" in found["reversal"]
    item = report(given)["results"]["components"]["dx_x"]
    assert [item[key] for key in ("drift", "trend", "lack_of_fit", "reversal")] == [None] * 4
    noted = {item["facts"]["quantity"]: item for item in report(given)["warnings"]}
    assert noted["reversal"]["facts"]["names"][:2] == ["dx_x", "dy_x"]
    assert {item["severity"] for item in noted.values()} == {"note"}


def test_each_quantity_that_is_not_estimable_is_one_note(paper: Example) -> None:
    """A note for each quantity, with its components."""
    noted = fitted(paper).warnings
    assert [item.code for item in noted] == ["not-estimable"] * 2
    assert [item.facts["quantity"] for item in noted] == [
        "repeatability of one visit",
        "correlation of drift with other components",
    ]
    two = ["no axis", "one run"]
    several = [NotDetermined(name, "it", "so", name) for name in two]
    (one,) = not_estimable(several)
    assert one.message == "not estimable: it (no axis, one run); so"


def test_observability_of_stated_components_and_several_instruments(tmp_path: Path) -> None:
    given = example(tmp_path, passes=3, roles=("lbb", "laser"), stated=LONG)
    found = observability(given.fit, given.estimates)
    assert (
        "--lbb"
        in named(found, "a_component_with_a_name_that_is_far_too_long_for_any_table")[
            "drift, reversal and lack of fit"
        ]
    )
    item = report(given)["results"]["components"]["dx_x"]
    assert item["n"] == 96
    assert item["passes_read"] == 12
    assert item["n_passes"] is None
    assert [x["role"] for x in item["instruments"]] == ["lbb", "laser"]
    assert [x["n"] for x in item["instruments"]] == [48, 48]
    assert 0 <= item["agreement_p"] <= 1
    notes = [x["facts"] for x in report(given)["warnings"] if x["code"] == "not-estimable"]
    assert ["dx_x", "dy_x"] in [x["names"][:2] for x in notes if x["quantity"] == "dof and r2"]


def test_what_makes_passes_those_of_others_can_be_done(tmp_path: Path) -> None:
    """A time or a set-up joins no passes of which some have a direction and others have none."""
    given = example(tmp_path, passes=3)

    def would(fit: MachineFit) -> set[str]:
        every = observability(fit, given.estimates)
        return {x.reading_that_would for x in every if "correlation" in x.not_determined}

    def turned(way: int) -> MachineFit:
        """With the first instrument of every component read one way, of the first `way`."""
        found = {}
        for i, (name, one) in enumerate(given.fit.components.items()):
            item = one.instruments[0]
            ways = np.full_like(item.direction, way if i == 0 else 1)
            found[name] = replace(one, instruments=(replace(item, direction=ways),))
        return replace(given.fit, components=found)

    assert would(turned(1)) == {
        "read it in the same passes (same set-up) as the others, or give `time` or `setup`"
    }
    for other in (0, -1):
        assert would(turned(other)) == {
            "read it in the same directions of the same passes (same set-up) as the others"
        }
    several = example(tmp_path, passes=3, roles=("lbb", "laser"))
    apart = [
        x for x in observability(several.fit, several.estimates) if "drift with" in x.not_determined
    ]
    assert {x.reading_that_would for x in apart if x.because == "read by several instruments"} == {
        "read it by one instrument, in the same passes as the others"
    }


def test_each_of_several_instruments_has_a_row_of_its_own(tmp_path: Path) -> None:
    """Level, slope and tests; of the component itself there are no tests."""
    given = example(tmp_path, passes=3, roles=("lbb", "laser"))
    rows = rows_of(document(fitted(given)))
    names = [row["component"] for row in rows]
    at = names.index("dx_x")
    assert names[at : at + 3] == ["dx_x", "  lbb", "  laser"]
    assert [rows[at][test] for test in ("drift", "trend", "misfit", "reversal")] == ["-"] * 4
    middle = report(given)["results"]["components"]["dx_x"]["pass_center_mm"]
    for item, row in zip(given.fit.components["dx_x"].instruments, rows[at + 1 :], strict=False):
        b, u = item.fit.plain.coefficients, np.sqrt(np.diag(item.fit.covariance))
        assert row["at 0"] == plus_minus(1e3 * b[0], 1e3 * u[0])
        assert row["slope"] == plus_minus(1e6 * b[1], 1e6 * u[1])
        assert item.scatter is not None
        assert item.reversal is not None
        assert row["drift"].rstrip("*") == p_value(item.scatter.p)
        shown = plus_minus(1e3 * item.reversal.value, 1e3 * item.reversal.u)
        assert row["reversal"].rstrip("*") == shown
        # In um, at the same place as that of the component.
        lever = np.array([1.0, middle - item.fit.center])
        s_pass = np.sqrt(lever @ item.fit.D @ lever)
        assert row["s_pass"] == significant(1e3 * s_pass)


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


def test_what_is_significant_is_marked_and_named_first(paper: Example) -> None:
    rows = {row["component"]: row for row in rows_of(document(fitted(paper)))}
    tests = ("drift", "trend", "misfit", "reversal")
    marked = {name: [t for t in tests if row[t].endswith("*")] for name, row in rows.items()}
    assert marked["ez_y"] == ["drift", "misfit"]
    assert marked["dx_x"] == ["drift", "reversal"]
    verdict = document(fitted(paper)).verdict
    assert "misfit of the polynomial of ez_y" in verdict
    assert "reversal of dx_x" in verdict


def test_csv_is_the_json_side_by_side(paper: Example) -> None:
    made = document(fitted(paper))
    header, rows = made.rows()
    table = [dict(zip(header, row, strict=True)) for row in rows]
    components = made.record()["components"]
    assert [row["component"] for row in table] == list(components)
    for row in table:
        item = components[str(row["component"])]
        assert row["coefficient_0"] == item["coefficients"][0]
        assert row["u_coefficient_0"] == pytest.approx(np.sqrt(item["covariance"][0][0]))
        assert row["drift_p"] == (item["drift"] or {}).get("p")
        assert row["reversal_mean"] == (item["reversal"] or {}).get("mean")
    assert table[-1]["coefficient_1"] is None


@pytest.mark.parametrize(("s_pass", "shown"), [(2.2e-19, "-"), (2.2e-11, "2.2e-8")])
def test_a_scatter_that_is_rounding_is_none(paper: Example, s_pass: float, shown: str) -> None:
    """Of passes that are equal, beside readings of um: 2.2e-16 um is no figure."""
    known = paper.estimates.components["dx_x"]
    stated = replace(known, pass_covariance=np.diag([s_pass**2, 0.0]))
    every = replace(paper.estimates, components={"dx_x": stated, "dy_x": known}, joint=())
    row, _ = rows_of(document(fit_result("m", MachineFit(components={}, joint=()), every)))
    assert row["s_pass"] == shown
