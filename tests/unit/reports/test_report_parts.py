"""What anova, compare and correct report of measured parts: names and units of the contract, nulls,
verdicts, tables, and pictures in which all can be read.
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compare_trials import predicted
from correct_examples import error_at, machine, ring_part, ring_places, ring_points, seen
from matplotlib.figure import Figure
from matplotlib.text import Text
from measured_examples import part_file, points, study, with_measured
from report_examples import SETTINGS, Example, example
from support import leaves, read_components

from mtu_cli.analyses.anova import AnovaResult, analyse_variance
from mtu_cli.analyses.compare import Compared, CompareResult, Pooled, compared, judged
from mtu_cli.analyses.correct import CorrectResult, correct
from mtu_cli.analyses.fit_components import FitResult, fit_result, observability
from mtu_cli.files.readings import Points
from mtu_cli.files.source import report_bytes
from mtu_cli.model.fit import estimates_from_report
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.measured import Label, MeasuredTables
from mtu_cli.model.settings import Settings
from mtu_cli.reports import anova as of_anova
from mtu_cli.reports import compare as of_compare
from mtu_cli.reports import correct as of_correct
from mtu_cli.reports import predictions
from mtu_cli.reports.document import Document, envelope, plain_text
from mtu_cli.reports.fit_components import document
from mtu_cli.reports.numbers import plus_minus, significant
from mtu_cli.stats.anova import Cells

pytestmark = pytest.mark.usefixtures("styled")

ARCSEC = math.pi / 180 / 3600


def recorded(document: Document) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(document.record(), allow_nan=False))
    return found


def shown(document: Document, *, detail: bool = False) -> str:
    text = plain_text(document.blocks(detail=detail))
    assert max(map(len, text.splitlines())) <= 100
    return text


def names_beside(page: Figure) -> list[str]:
    """Those of the rows of a listing, which can be drawn, and are within the page."""
    page.draw_without_rendering()
    panel = page.axes[0]
    boxes = [text.get_window_extent() for text in (*panel.texts, *panel.get_yticklabels())]
    assert all(page.bbox.x0 <= box.x0 < box.x1 <= page.bbox.x1 for box in boxes)
    return [label.get_text() for label in panel.get_yticklabels()]


# anova


def analysed(found: Points) -> AnovaResult:
    return analyse_variance(found, None, "reml", Settings())


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> AnovaResult:
    """21 parts, the seventh 60 um off in y."""
    found = study(21, 2, 4)
    measured = found.measured.copy()
    measured[found.part == 6, 1] += 0.06
    part = part_file(tmp_path_factory.mktemp("part"))
    return analyse_variance(with_measured(found, measured), part, "reml", Settings())


def test_figures_of_anova(planted: AnovaResult) -> None:
    results = recorded(of_anova.document(planted))
    assert [len(results[k]) for k in ("features", "lengths", "orthogonality")] == [6, 2, 1]
    first, one = results["features"][0], planted.features
    assert first["mean_error_um"] == pytest.approx(one.one_way.mean[0] * 1e3)
    assert first["var_part_um2"] == pytest.approx(one.components.part[0] * 1e6)
    assert first["U_future_um"] == pytest.approx(2 * first["u_future_um"])
    low, high = first["interval95_future_um"]
    assert (low + high) / 2 == pytest.approx(first["mean_error_um"])
    angle, angles = results["orthogonality"][0], planted.kinds[2]
    assert angle["mean_error_arcsec"] == pytest.approx(angles.one_way.mean[0] / ARCSEC)
    assert angle["var_part_arcsec2"] == pytest.approx(angles.components.part[0] / ARCSEC**2)
    assert not any("_um" in name for name in angle)
    (item,) = results["unusual_parts"]
    assert (item["part"], item["where"]["axis"]) == ("P6", "y")
    assert item["deviation_um"] == pytest.approx(60, rel=0.25)
    units = [x["slope_um"] is not None for x in results["trends"]]
    assert units == [True] * 8 + [False]


def test_undefined_figures_of_anova_are_null_and_have_no_column() -> None:
    document = of_anova.document(analysed(study(1, 1, 1)))
    entry = recorded(document)["features"][0]
    assert recorded(document)["unusual_parts"] is None
    undefined = {
        "F", "p", "ms_between_um2", "ms_within_um2", "var_part_um2", "u_mean_um", "u_future_um",
        "var_part_interval95_um2", "s_pooled_um", "var_both_um2", "interval95_future_um",
    }  # fmt: skip
    assert {entry[name] for name in undefined} == {None}
    text = shown(document, detail=True)
    assert text.startswith("Too few parts or repeats")
    header = text.partition("Features\n")[2].splitlines()[0]
    assert header.split() == ["item", "axis", "n", "mean", "df", "df"]


def test_tables_and_verdict_of_anova(planted: AnovaResult) -> None:
    text = shown(of_anova.document(planted))
    assert "F test: parts differ significantly in 6 of 6 features and axes." in text
    assert "Outlying parts: P6." in text
    titles = ("by operation and axis", "Outlying parts\n", "Lengths", "Right angles", "Features\n")
    assert sorted(titles, key=text.index) == list(titles)
    cases = [(f"P{part}", i) for part in (1, 2) for i in range(20)]
    holes = points([(p, "a", 1, 0.001 * i, 0.0) for p, i in cases], [f"h{i}" for _, i in cases])
    many = shown(of_anova.document(analysed(holes)))
    worst = many.partition("Features: the 10 of 40 with the largest errors\n")[2].splitlines()
    assert [line.split()[0] for line in worst[1:12]] == ["um", *(f"h{i}" for i in range(19, 9, -1))]
    clean = shown(of_anova.document(analysed(study(21, 2, 4))), detail=True)
    assert "No part is an outlier.\n" in clean
    assert ("MS between" in clean, "MS between" in text) == (True, False)


@pytest.mark.parametrize(("operations", "parts"), [(1, 1), (1, 60), (6, 6)])
def test_nothing_is_written_over_or_outside(operations: int, parts: int) -> None:
    rng = np.random.default_rng(2)
    cases = [
        (f"operation {operation}", (f"part {p}", name, r))
        for operation in range(operations)
        for p in range(parts)
        for name in "abc"
        for r in range(2)
    ]
    rows = [(*case, *(0.01 * rng.standard_normal(2))) for _, case in cases]
    page = of_anova.figure(analysed(points(rows, [name for name, _ in cases])))
    page.draw_without_rendering()
    titles = {panel.get_title(loc="left") for panel in page.axes}
    written = [
        item
        for panel in page.axes
        for item in panel.get_children()
        if isinstance(item, Text) and item.get_text() in titles
    ]
    assert len(written) == len(page.axes)
    boxes = [item.get_window_extent() for item in [*written, *page.legends]]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])
        assert page.bbox.x0 <= box.x0
        assert box.x1 <= page.bbox.x1
        assert box.y1 <= page.bbox.y1


# compare


def made(labels: list[Label], seed: int) -> Compared:
    """Five parts measured twice; errors of some 10 um, predicted u 5 um; no faults by decree."""
    rng = np.random.default_rng(seed)
    m, n = len(labels), len(labels) // 2
    cells = Cells(
        origin=np.zeros(m),
        n=np.full((m, 5), 2.0),
        mean=0.01 * rng.standard_normal((m, 1)) + 0.003 * rng.standard_normal((m, 5)),
        within=np.full(m, 5e-6),
    )
    u2, mean = np.full(n, 0.005**2), 0.01 * rng.standard_normal(n)
    known = predicted(mean, 0.2 * u2, 0.8 * u2, 0.64 * u2, (np.inf, np.inf))
    tables = MeasuredTables(labels=tuple(labels), parts=tuple("12345"), cells=cells)
    of = {name: (known, np.eye(n)) for name in ("drilled", "milled")}
    return decreed(judged(compared(tables, of, 2.0))[0])


def decreed(
    found: Compared, *, under: tuple[int, ...] = (), biased: tuple[int, ...] = (), **more: Any
) -> Compared:
    """The same with these faults and no other."""
    rows = range(len(found.labels))
    answers = {
        "biased": tuple(i in biased for i in rows),
        "under_predicted": tuple(i in under for i in rows),
        "over_predicted": tuple(False for _ in rows),
    }
    return replace(found, **{"pooled": {}} | answers | more)


@pytest.fixture(scope="module")
def two() -> CompareResult:
    """24 features along two axes and two lengths, drilled and milled."""
    ids, ways = [str(i + 1) for i in range(24)], ("drilled", "milled")
    features = made([(o, name, axis) for o in ways for axis in "xy" for name in ids], 1)
    lengths = made([(o, name, "") for o in ways for name in ("1-2", "2-3")], 2)
    return CompareResult(
        features=decreed(features, under=(0,)), lengths=lengths, datum="none",
        coverage_factor=2.0, warnings=(),
    )  # fmt: skip


def test_figures_of_compare(two: CompareResult) -> None:
    results = recorded(of_compare.document(two))
    assert [len(results[kind]) for kind in ("features", "lengths")] == [96, 4]
    first = results["features"][0]
    assert (first["operation"], first["id"], first["axis"]) == ("drilled", "1", "x")
    of, measured = first["predicted"], first["measured"]
    assert of["mean_um"] == pytest.approx(1000 * two.features.predicted.mean[0])
    assert of["U_um"] == pytest.approx(10)
    assert (measured["parts"], measured["n"]) == (5, 10)
    assert first["bias_um"] == pytest.approx(measured["mean_um"] - of["mean_um"])
    width = 2 * (abs(measured["mean_um"]) + 2 * measured["u_um"])
    assert first["range_width_um"]["measured"] == pytest.approx(width)
    assert first["verdict"] == "under-predicted"
    drilled, milled = results["summary"]["features"]
    assert drilled["verdicts"]["under-predicted"] == 1
    assert milled["verdicts"]["consistent"] == 48
    # Undefined figures are null.
    none = np.full(96, np.nan)
    features = replace(two.features, ratio_u=none, E_n=none)
    results = recorded(of_compare.document(replace(two, features=features, lengths=None)))
    assert (results["features"][0]["ratio_u"], results["features"][0]["E_n"]) == (None, None)
    assert (results["lengths"], results["summary"]["lengths"]) == ([], None)


def test_every_fault_is_stated_with_its_size(two: CompareResult) -> None:
    """Both faults of an item, the graver one first; the pooled scatter where nothing else is."""
    found = decreed(two.features, under=(0, 1), biased=(1, 2))
    factor = sorted(found.ratio_scatter[:2])
    off = sorted(1000 * np.abs(found.bias[1:3]))
    ends = [f"{significant(a)} to {significant(b)}" for a, b in (factor, off)]
    drilled, milled = map(of_compare.verdict_text, found.summaries)
    assert drilled == (
        f"drilled features: under-predicted (2 of 48: scatter {ends[0]} times predicted); "
        f"biased (2 of 48: mean off by {ends[1]} um)"
    )
    assert milled == "milled features: consistent"
    text = shown(of_compare.document(replace(two, features=found)))
    assert "drilled 2 x  under-predicted, " in text
    pooled = {"drilled": Pooled(items=48, ratio=1.5, p=0.003, verdict="under-predicted")}
    (alone, _) = decreed(two.features, pooled=pooled).summaries
    words = "drilled features: under-predicted (pooled scatter 1.5 times predicted, p 0.003)"
    assert of_compare.verdict_text(alone) == words
    single, _ = decreed(two.features, under=(3,), pooled=pooled).summaries
    assert "pooled" not in of_compare.verdict_text(single)


def test_the_picture_of_compare_shows_differences_and_verdicts(two: CompareResult) -> None:
    page = of_compare.figure(two)
    names = names_beside(page)
    assert len(names) == 4 + 18
    assert page.get_suptitle().endswith("(22 of 100)")
    row = names.index("drilled 1 x")
    assert [text.get_text() for text in page.axes[0].texts][row] == "under-predicted"


# correct


def corrected(folder: Path, parts: int = 2, more: str = "", **ring: str) -> CorrectResult:
    """Rings of 180.0134 mm, a um larger than their calibration."""
    true = np.tile(ring_places(diameter=180.0134), (parts, 1))
    T = np.full(11 * parts, 21.0) + np.repeat(0.01 * np.arange(parts), 11)
    names = [f"part {i}" for i in range(parts)]
    found = ring_points(seen(true, error_at, T), names, None, {"T_scale_degC": T})
    return correct(machine(folder), ring_part(folder, more, **ring), found, Settings())


def test_errors_are_rounded_to_their_uncertainty(tmp_path: Path) -> None:
    found = corrected(tmp_path)
    text = shown(of_correct.document(found))
    before, after = (f"{1000 * value:.2g}" for value in found.rms("circle") or ())
    start = f"Correction reduces the rms error of the circles from {before} to {after}"
    assert text.startswith(start)
    first = found.sizes[0]
    (line,) = [item for item in text.splitlines() if item.startswith("ring  part 0 ")]
    # u = 0.4 um: two digits of it are hundredths of a um.
    assert 0.1 < 1000 * first.u_error < 0.99
    assert f"{1000 * first.error[1]:.2f} ± {1000 * first.u_error:.2f}" in line
    assert f"{first.size[1]:.5f} ± {first.u:.5f}" in line
    error = 0.0, first.size[1] - first.size[0]
    exact = replace(found, sizes=(replace(first, reference=first.size[0], u=0.0, error=error),))
    text = shown(of_correct.document(exact))
    assert text.startswith("Correction increases the rms error of the circles from 0 to ")


@pytest.mark.parametrize(("kind", "rows"), [("length", 50), ("points", 80)])
def test_pictures_of_correct(tmp_path: Path, kind: str, rows: int) -> None:
    """A row a part or point, of the first to the last of them."""
    found = corrected(tmp_path, parts=50, more="lengths: [{from: r0, to: r5}]\n", U_um="1.0")
    found = replace(found, sizes=found.of_kind("length") if kind == "length" else ())
    names = names_beside(of_correct.figure(found))
    assert len(names) == rows
    start = {"length": "r0-r5 part ", "points": "r"}[kind]
    assert all(name.startswith(start) for name in names)


# The report of fit-components: complete, read back without loss, legible.


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
    says = {name: item.says or "" for name, item in given.machine.machine.components.items()}
    return fit_result("test machine", given.fit, given.estimates, says=says)


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


@pytest.mark.parametrize("case", CASES)
def test_prediction_reads_the_same_estimates_back(case: str, tmp_path: Path) -> None:
    given = example(tmp_path, **CASES[case])
    path = tmp_path / "components.json"
    path.write_bytes(report_bytes(report(given)))
    back = estimates_from_report(given.machine, read_components(path))
    wanted = given.points()
    found = replace(given, model=build_model(given.machine, back)).points()
    np.testing.assert_allclose(found.covariance, wanted.covariance, rtol=1e-11, atol=1e-18)
    one, other = (leaves(predictions.points(each).record()) for each in (found, wanted))
    assert one.keys() == other.keys()
    for place, value in other.items():
        near = pytest.approx(value, rel=1e-9) if isinstance(value, float) else value
        assert one[place] == near, place


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
    assert item["pass_center_mm"] == pytest.approx(80.0)
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
    for name in given.fit.components.keys() - {"axy"}:
        estimate = given.estimates.components[name]
        slope, u = estimate.coefficients[1], np.sqrt(estimate.covariance[1, 1])
        per_m = 1000 / estimate.unit.to_internal
        assert rows[name]["slope"] == plus_minus(slope * per_m, u * per_m)


REASONS: dict[str, tuple[dict[str, Any], dict[str, str | None]]] = {
    # What the readings of dx_x leave open.
    "no pass column": (
        {"passes": None, "directions": False},
        {"pass-to-pass drift apart from repeatability": "no `pass` is given",
         "reversal": "no `direction` is given",
         "lack of fit": "no position is repeated often enough, or its readings do not differ"},
    ),
    "one pass": ({"passes": 1, "directions": False},
                 {"pass-to-pass drift apart from repeatability": "1 pass only"}),
    "three passes": ({"passes": 3, "directions": False},
                     {"steady drift from pass to pass": None,
                      "reversal": "no `direction` is given"}),
    "two runs there and back": (
        {"passes": 2},
        {"steady drift from pass to pass": "4 passes, too few or of equal levels",
         "reversal": None},
    ),
    "as many coefficients as positions": ({"degree": 7},
                                          {"lack of fit": "8 positions for 8 coefficients"}),
}  # fmt: skip


def left_open(made: Example, component: str) -> dict[str, str]:
    """Why, by what the readings of a component do not determine."""
    found = observability(made.fit, made.estimates)
    return {x.not_determined: x.because for x in found if x.component == component}


@pytest.mark.parametrize("case", REASONS)
def test_what_is_left_open_has_the_reason_of_these_readings(case: str, tmp_path: Path) -> None:
    given, wanted = REASONS[case]
    found = left_open(example(tmp_path, **given), "dx_x")
    assert {what: found.get(what) for what in wanted} == wanted


def test_what_is_not_repeated_in_a_pass_is_not_repeated_from_the_same_side(tmp_path: Path) -> None:
    """Of a squareness read once a pass, there and back: the two sides are no repeats."""
    because = left_open(example(tmp_path), "axy")
    assert "within a pass from the same side" in because["repeatability of one visit"]
