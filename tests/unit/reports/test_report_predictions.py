"""Reports of predictions: complete against the contract, true to the results, legible."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from report_examples import Example, example

from mtu_cli.files.json_file import report_bytes
from mtu_cli.files.part import Feature
from mtu_cli.model.settings import Settings
from mtu_cli.model.variance import Shares
from mtu_cli.reports import lengths, orthogonality, predict_points
from mtu_cli.reports.csv_text import csv_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.numbers import interval, significant, with_u
from mtu_cli.reports.tables import plain_text

POINT = [
    "id",
    "x_mm",
    "y_mm",
    "z_mm",
    "Ex_um",
    "Ey_um",
    "u_x_um",
    "u_y_um",
    "var_x_um2",
    "var_y_um2",
    "U_x_um",
    "U_y_um",
    "dof_effective_x",
    "dof_effective_y",
    "interval95_x_um",
    "interval95_y_um",
    "independent",
]
LENGTH = [
    "id",
    "from",
    "to",
    "nominal_mm",
    "estimated_mm",
    "error_um",
    "variance_um2",
    "u_um",
    "shares",
    "U_um",
    "k",
    "dof_effective",
    "interval_um",
    "interval95_um",
    "independent",
    "conformance",
]
ANGLE = [
    "id",
    "mean_arcsec",
    "u_arcsec",
    "U_arcsec",
    "interval95_arcsec",
    "trials",
    "converged",
    "first_order",
    "validation",
    "independent",
]
ARCSEC = np.pi / 648000


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Example:
    return example(tmp_path_factory.mktemp("paper"))


@pytest.fixture(scope="module")
def spatial(tmp_path_factory: pytest.TempPathFactory) -> Example:
    """With an equation for z and a component from the machine file."""
    return example(
        tmp_path_factory.mktemp("spatial"),
        passes=3,
        stated="  ez0: {of: y, unit: um, coefficients: [3.0, -0.05], u_future: 1.9}",
        equation="  Ez: ez0 + x*ex_y\n",
    )


def test_points_hold_the_contract_fields(paper: Example) -> None:
    result = paper.points()
    found = predict_points.document(result)
    assert "covariance_um2" not in found
    assert len(found["points"]) == 24
    for i, point in enumerate(found["points"]):
        assert set(POINT) <= set(point)
        assert point["Ex_um"] == pytest.approx(result.prediction.mean[2 * i] * 1e3, rel=1e-12)
        assert point["var_y_um2"] == pytest.approx(result.variance[2 * i + 1] * 1e6, rel=1e-12)
        assert point["U_x_um"] == pytest.approx(2 * point["u_x_um"], rel=1e-12)
        assert point["u_x_um"] ** 2 == pytest.approx(point["var_x_um2"], rel=1e-12)
        low, high = point["interval95_x_um"]
        assert (low + high) / 2 == pytest.approx(point["Ex_um"], abs=1e-9)
        parts = point["variance_x_um2"]
        assert sum(parts.values()) == pytest.approx(point["var_x_um2"], rel=1e-9)
        apart = point["independent"]
        assert apart["U_y_um"] == pytest.approx(2 * np.sqrt(apart["var_y_um2"]), rel=1e-12)
        assert point["z_mm"] is None
    assert json.loads(report_bytes(found)) == found


def test_covariance_of_the_points_only_on_request(spatial: Example) -> None:
    result = spatial.points()
    found = predict_points.document(result, with_covariance=True)
    assert found["covariance_rows"][:4] == ["21.x", "21.y", "21.z", "22.x"]
    np.testing.assert_allclose(found["covariance_um2"], result.covariance * 1e6, rtol=1e-12)
    point = found["points"][0]
    assert point["u_z_um"] == pytest.approx(np.sqrt(found["covariance_um2"][2][2]), rel=1e-9)


def test_many_features_take_no_memory_for_their_covariance(paper: Example) -> None:
    """1500 features: that of all their errors alone were 72 MB."""
    features = {
        str(i): Feature(x_mm=10.0 + 2.6 * (i % 50), y_mm=10.0 + 4.3 * (i // 50))
        for i in range(1500)
    }
    part = paper.part.part.model_copy(update={"features": features})
    tracemalloc.start()
    result = replace(paper, part=replace(paper.part, part=part)).points()
    found = predict_points.document(result)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found["points"]) == 1500
    assert peak < 30e6


@pytest.mark.parametrize("digits", [1, 2, 4])
def test_tables_show_u_to_the_digits_asked_for(paper: Example, digits: int) -> None:
    points, of_points = predict_points.table(paper.points(), digits)
    long, of_lengths = lengths.table(paper.lengths(), digits)
    right, of_angles = orthogonality.table(paper.angles(), 2.0, digits)
    u_x = float(np.sqrt(paper.points().variance[0])) * 1e3
    assert points.rows[0][4] == significant(u_x, digits)
    assert long.rows[0][3] == significant(paper.lengths().lengths[0].u * 1e3, digits)
    u = float(paper.angles().angles[0].run.u[0])
    assert right.rows[0][2] == significant(u * 180 * 3600 / np.pi, digits)
    u = float(np.sqrt(paper.points().variance.max())) * 1e3
    assert of_points.rows[0][1] == significant(u, digits)
    assert of_lengths.rows[0][1] == long.rows[0][3]
    assert of_angles.rows[0][1] == right.rows[0][5]


def test_independent_settings_state_no_split_of_variance(paper: Example) -> None:
    result = paper.points(Settings(trials=4000, threads=1, correlation="independent"))
    point = predict_points.document(result)["points"][0]
    assert point["var_x_um2"] == point["independent"]["var_x_um2"]
    assert point["dof_effective_x"] is None
    assert "variance_x_um2" not in point
    assert "independent" in plain_text(predict_points.table(result))


def test_lengths_hold_the_contract_fields(paper: Example) -> None:
    result = paper.lengths()
    found = lengths.document(result)
    for item, source in zip(found["lengths"], result.lengths, strict=True):
        assert set(LENGTH) <= set(item)
        assert item["error_um"] == pytest.approx(source.error * 1e3, rel=1e-12)
        assert item["estimated_mm"] == source.nominal + source.error
        low, high = item["interval_um"]
        assert high - low == pytest.approx(2 * item["U_um"], rel=1e-9)
        assert item["interval95_um"][0] == pytest.approx(source.interval95[0] * 1e3, rel=1e-12)
        assert item["between_components"]["u_bounds_um"][0] <= item["u_um"] + 1e-9
        assert item["validation"]["tolerance_um"] > 0
    assert found["lengths"][0]["conformance"]["tolerance_um"] == pytest.approx(12.0)
    assert found["lengths"][2]["conformance"] is None
    assert found["joint_conformance"]["lengths"] == ["3-9", "9-15"]
    assert json.loads(report_bytes(found)) == found


def test_it_is_told_what_u_consists_of(paper: Example) -> None:
    long, right = paper.lengths(), paper.angles()
    of_lengths = [item["shares"] for item in lengths.document(long)["lengths"]]
    of_angles = [orthogonality.document(right, 2.0)["orthogonality"][0]["first_order"]["shares"]]
    for shares, tables in (
        (of_lengths, lengths.table(long)),
        (of_angles, orthogonality.table(right, 2.0)),
    ):
        for item, row in zip(shares, tables[1].rows, strict=True):
            assert list(item) == ["coefficients", "passes", "repeatability"]
            assert sum(item.values()) == pytest.approx(1, rel=1e-12)
            assert row[2:5] == [f"{100 * share:.1f}" for share in item.values()]
            assert item["repeatability"] > 0


def test_it_is_told_what_u_of_a_point_consists_of(paper: Example) -> None:
    result = paper.points()
    found = predict_points.document(result)["points"]
    for point in found:
        for axis in "xy":
            shares = point["shares"][axis]
            assert sum(shares.values()) == pytest.approx(1, rel=1e-12)
            parts = {
                k: v / point[f"var_{axis}_um2"] for k, v in point[f"variance_{axis}_um2"].items()
            }
            assert shares == pytest.approx(parts)
    sheet = predict_points.table(result)[-1]
    assert sheet.title == "What u consists of"
    u = {f"u({x['id']}.{axis})": x[f"u_{axis}_um"] for x in found for axis in "xy"}
    assert [row[0] for row in sheet.rows] == sorted(u, key=lambda name: -float(f"{u[name]:.9g}"))[
        :12
    ]
    assert "the 12 largest u of 48; all are in the report (-o FILE)" in sheet.notes
    apart = paper.points(Settings(correlation="independent"))
    assert predict_points.document(apart)["points"][0]["shares"] == {"x": None, "y": None}
    assert len(predict_points.table(apart)) == 1


def test_the_u_of_few_points_are_taken_apart_in_their_order(paper: Example) -> None:
    result = paper.points()
    few = replace(
        result,
        prediction=result.prediction.first(2), points=result.points[:2],
        variance=result.variance[:4], interval95=result.interval95[:4],
    )  # fmt: skip
    sheet = predict_points.table(few)[-1]
    first, second = result.prediction.ids[:2]
    names = [f"{first}.x", f"{first}.y", f"{second}.x", f"{second}.y"]
    assert [row[0] for row in sheet.rows] == [f"u({name})" for name in names]
    assert float(sheet.rows[2][1]) == pytest.approx(np.sqrt(result.variance[2]) * 1e3, rel=0.05)
    assert not any("largest" in note for note in sheet.notes)


def test_shares_below_nothing_are_explained_and_none_are_made_up(paper: Example) -> None:
    result = paper.lengths()
    first, *others = result.lengths
    steady = Shares(coefficients=0.25, passes=-0.05, repeatability=0.8)
    found = [replace(first, shares=steady), *(replace(item, shares=None) for item in others)]
    sheet = lengths.table(replace(result, lengths=tuple(found)))[1]
    # What u would be had the passes not taken 5 % off its square: u sqrt(0.25 + 0.8).
    without = f"{first.u * 1e3 * 1.05**0.5:.1f}"
    assert sheet.columns[-1].title == "u without\npasses, um"
    rows = [["25.0", "-5.0", "80.0", without], ["-"] * 4, ["-"] * 4]
    assert [row[2:] for row in sheet.rows] == rows
    assert any("below 0" in note for note in sheet.notes)
    assert sheet.notes[-1].endswith("take the u without passes for one part to come")
    assert any(note.startswith("u is of one part to come; of the mean") for note in sheet.notes)
    found[0] = replace(first, shares=replace(steady, passes=0.0, repeatability=0.75))
    sheet = lengths.table(replace(result, lengths=tuple(found)))[1]
    assert not any("below 0" in note for note in sheet.notes)
    assert [len(row) for row in sheet.rows] == [5] * 3
    apart = Settings(trials=4000, threads=1, correlation="independent")
    assert len(lengths.table(paper.lengths(apart))) == 1
    assert lengths.document(paper.lengths(apart))["lengths"][0]["shares"] is None
    assert len(orthogonality.table(paper.angles(apart), 2.0)) == 1


def test_three_axes_keep_their_95_percent(spatial: Example) -> None:
    """Half its width where the ends have no room; an axis below the other where not even that."""
    result = spatial.points()
    sheet, _ = predict_points.table(result)
    titles = [column.title for column in sheet.columns]
    assert titles.count("95 %\n± um") == 3
    assert not any("dof" in title for title in titles)
    assert any(note.startswith("95 %: E ± so much") for note in sheet.notes)
    low, high = result.interval95[2] * 1e3
    u = float(np.sqrt(result.variance[2])) * 1e3
    assert sheet.rows[0][-1] == with_u((high - low) / 2, u)[0]
    sheet, _ = predict_points.table(result, 5)
    titles = [column.title for column in sheet.columns]
    assert titles.count("95 %\num") == 3
    assert [column.title for column in sheet.columns if column.begins] == [
        "Ex\num", "Ey\num", "Ez\num",
    ]  # fmt: skip
    for j in range(3):
        low, high = result.interval95[3 + j] * 1e3
        u = float(np.sqrt(result.variance[3 + j])) * 1e3
        last = titles.index(f"E{'xyz'[j]}\num") + 3
        assert sheet.rows[1][last] == interval(low, high, u, 5)
        assert sheet.rows[1][last - 2] == significant(u, 5)
    lines = plain_text([sheet]).splitlines()
    assert max(map(len, lines)) <= 100
    heads = [line.split() for line in lines if line.startswith("feature")]
    assert [[word for word in head if word[0] == "E"] for head in heads] == [["Ex"], ["Ey", "Ez"]]
    assert sum(line.startswith("21 ") for line in lines) == 2


def test_no_part_conforms_by_more_than_all(paper: Example) -> None:
    sure = replace(paper.lengths(), joint_conformance=(0.999995, 7e-6))
    shown = " ".join(plain_text(lengths.table(sure)).split())
    assert "all toleranced lengths of one part conform: >99.99 %" in shown


def test_orthogonality_holds_the_contract_fields(paper: Example) -> None:
    result = paper.angles()
    (item,) = orthogonality.document(result, 2.0)["orthogonality"]
    assert set(ANGLE) <= set(item)
    (angle,) = result.angles
    assert item["mean_arcsec"] == pytest.approx(angle.run.mean[0] / ARCSEC, rel=1e-12)
    assert item["U_arcsec"] == pytest.approx(2 * item["u_arcsec"], rel=1e-12)
    # eq. (28) of Gilsinn & Ling 2004: u^2 = s^2 (1 + 1/M)
    wanted = item["u_arcsec"] ** 2 * (1 + 1 / item["trials"])
    assert item["u_eq28_arcsec"] ** 2 == pytest.approx(wanted, rel=1e-12)
    low, high = item["shortest95_arcsec"]
    assert high - low <= item["interval95_arcsec"][1] - item["interval95_arcsec"][0] + 0.2
    assert set(item["monte_carlo"]) == {
        "se_mean_arcsec", "se_u_arcsec", "se_low_arcsec", "se_high_arcsec", "gain",
    }  # fmt: skip
    assert item["independent"]["first_order_u_arcsec"] > 0
    assert set(item["validation"]) == {
        "passed", "d_low_arcsec", "d_high_arcsec", "tolerance_arcsec",
    }  # fmt: skip


def test_an_angle_without_standard_uncertainty_says_why(paper: Example) -> None:
    result = paper.angles()
    (angle,) = result.angles
    nothing = np.array([np.nan])
    run = replace(angle.run, u=nothing, se_mean=nothing, se_u=nothing)
    without = replace(result, angles=(replace(angle, run=run),))
    found = orthogonality.document(without, 2.0)
    assert found["orthogonality"][0]["u_arcsec"] is None
    assert found["orthogonality"][0]["U_arcsec"] is None
    report_bytes(found)
    codes = {item.code for item in orthogonality.warnings(without)}
    assert "no-standard-uncertainty" in codes
    text = plain_text(orthogonality.table(without, 2.0))
    assert "nan" not in text
    assert figure_bytes(orthogonality.figure(without), "png")


def test_warnings_tell_what_clause_8_found(paper: Example) -> None:
    result = paper.lengths()
    first, second, third = result.lengths

    def judged(passed: bool | None, item: Any) -> Any:
        return replace(item, validation=replace(item.validation, passed=passed))

    changed = replace(
        result,
        lengths=(judged(True, first), judged(False, second), judged(None, third)),
        run=replace(result.run, converged=False),
    )
    said = {item.code: item.facts for item in lengths.warnings(changed)}
    assert said["validation-failed"]["names"] == ["9-15"]
    assert said["validation-undecided"]["names"] == ["3-15"]
    assert said["not-converged"]["trials"] == 20000


@pytest.mark.parametrize("planar", [True, False])
def test_tables_fit_and_round_to_the_uncertainty(
    paper: Example, spatial: Example, planar: bool
) -> None:
    given = paper if planar else spatial
    points, long, right = given.points(), given.lengths(), given.angles()
    named = replace(
        points.prediction, ids=tuple("hole_number_" * 4 + i for i in map(str, range(24)))
    )
    tables = [
        predict_points.table(points),
        predict_points.table(replace(points, prediction=named)),
        lengths.table(long),
        orthogonality.table(right, 2.0),
    ]
    for table in tables:
        assert max(map(len, plain_text(table).splitlines())) <= 100
    row = next(x for x in plain_text(tables[2]).splitlines() if x.startswith("3-15"))
    error, u = row.split()[2:4]
    assert float(u) == pytest.approx(long.lengths[2].u * 1e3, rel=0.05)
    assert float(error) == pytest.approx(long.lengths[2].error * 1e3, abs=0.05)
    assert len(error.partition(".")[2]) == len(u.partition(".")[2])


def test_rows_beyond_the_measured_range_are_marked_alike(paper: Example) -> None:
    points, long, right = paper.points(), paper.lengths(), paper.angles()
    beyond = (("9", "dy_y", 140.0, 0.0, 120.0), ("15", "dx_x", 140.0, 0.0, 120.0))

    def changed(result: Any) -> Any:
        return replace(result, prediction=replace(result.prediction, outside=beyond))

    def marked(sheets: Any) -> list[str]:
        sheet, *others = sheets
        assert len(others) == 1
        names = [row[0] for row in sheet.rows if row[0].endswith("†")]
        assert ("† outside the measured range of a component" in sheet.notes) == bool(names)
        return names

    assert marked(predict_points.table(changed(points))) == ["9†", "15†"]
    assert marked(lengths.table(changed(long))) == ["3-9†", "9-15†", "3-15†"]
    only = replace(long.prediction, outside=beyond[:1])
    assert marked(lengths.table(replace(long, prediction=only))) == ["3-9†", "9-15†"]
    off = replace(right, angles=(changed(right.angles[0]),))
    assert marked(orthogonality.table(off, 2.0)) == ["xy†"]
    for table in (predict_points.table(points), lengths.table(long), orthogonality.table(right, 2)):
        assert marked(table) == []


def test_csv_agrees_with_the_document(paper: Example) -> None:
    import csv

    def read(header: list[str], rows: Any) -> list[dict[str, str]]:
        return list(csv.DictReader(csv_text(header, rows).splitlines()))

    points = predict_points.document(paper.points())["points"]
    for row, point in zip(read(*predict_points.csv_rows(paper.points())), points, strict=True):
        assert float(row["u_x_um"]) == point["u_x_um"]
        assert float(row["interval95_y_low_um"]) == point["interval95_y_um"][0]
        assert float(row["independent_u_y_um"]) == point["independent"]["u_y_um"]
    items = lengths.document(paper.lengths())["lengths"]
    for row, item in zip(read(*lengths.csv_rows(paper.lengths())), items, strict=True):
        assert float(row["U_um"]) == item["U_um"]
        assert float(row["independent_U_um"]) == item["independent"]["U_um"]
        assert float(row["u_bound_high_um"]) == item["between_components"]["u_bounds_um"][1]
        assert row["tolerance_um"] == ("" if item["conformance"] is None else row["tolerance_um"])
    (row,) = read(*orthogonality.csv_rows(paper.angles(), 2.0))
    (angle,) = orthogonality.document(paper.angles(), 2.0)["orthogonality"]
    assert float(row["shortest95_low_arcsec"]) == angle["shortest95_arcsec"][0]
    assert float(row["independent_u_arcsec"]) == angle["independent"]["u_arcsec"]
