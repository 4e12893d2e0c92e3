"""One declaration of a figure gives its JSON, CSV and cell; the envelope and the CSV's text."""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, nan, pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_examples import Example, example
from rich.console import Console

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.source import Source, report_bytes
from mtu_cli.findings import finding
from mtu_cli.model.settings import Settings
from mtu_cli.reports import fit_components, numbers, predictions
from mtu_cli.reports.document import (
    REPORTS,
    Document,
    Sheet,
    Table,
    column_meanings,
    declaration,
    envelope,
    meanings,
    plain_text,
)
from mtu_cli.reports.fields import Field, Fields, csv_rows, csv_text, declare, record, rows_of
from mtu_cli.reports.figures import blank, figure_bytes

pytestmark = pytest.mark.usefixtures("styled")

FIELDS: Fields = declare(
    """
    id | | its name | name, text, mark=star()
    error_um | error | its error | error, u=u
    variance_um2 | squared(u) | u squared
    ends.interval_arcsec | ends | where it lies | 95 %, interval, csv=ends_arcsec, u=u
    part. | | |
        value_um | value | so | inner
        n | | | -, json
    members.{} | | |
        value_um | value | so
    p | | of the test | p, p, detail
    """,
    star=lambda item: "*" if item.flag else "",
    squared=lambda u: u**2,
)


def item(**changed: Any) -> Any:
    given = {
        "id": "a", "flag": True, "error": 0.00123, "u": 0.0005, "ends": (-pi / 648000, pi / 648000),
        "part": SimpleNamespace(value=0.002, n=3), "members": {"m": SimpleNamespace(value=nan)},
        "p": 0.04,
    }  # fmt: skip
    return SimpleNamespace(**(given | changed))


def test_the_name_states_the_unit_and_dots_nest() -> None:
    assert record(FIELDS, item()) == {
        "id": "a",
        "error_um": 0.00123 / 1e-3,
        "variance_um2": pytest.approx(0.25),
        "ends": {"interval_arcsec": [pytest.approx(-1), pytest.approx(1)]},
        "part": {"value_um": pytest.approx(2), "n": 3},
        "members": {"m": {"value_um": None}},
        "p": 0.04,
    }
    nothing = record(FIELDS, item(part=None, error=inf, ends=(0.0, inf), members={}))
    assert (nothing["part"], nothing["error_um"], nothing["members"]) == (None, None, {})
    assert nothing["ends"] == {"interval_arcsec": None}


def test_csv_has_the_same_figures_side_by_side() -> None:
    items = [item(), item(part=None, ends=None, id="b, c")]
    header, rows = csv_rows(FIELDS, items)
    first, second = csv.DictReader(csv_text(header, rows).splitlines())
    assert header == [
        "id", "error_um", "variance_um2", "ends_low_arcsec", "ends_high_arcsec", "part_value_um",
        "p",
    ]  # fmt: skip
    assert float(first["ends_high_arcsec"]) == pytest.approx(1)
    assert (second["id"], second["part_value_um"], second["ends_low_arcsec"]) == ("b, c", "", "")
    named = Field("limits_um", "ends", csv="limit_{}95_um", show="interval")
    assert named.columns == ("limit_low95_um", "limit_high95_um")


def test_csv_text_keeps_every_digit() -> None:
    value = 0.1 + 0.2
    text = csv_text(["a", "b,c", "d"], [[np.float64(value), 'say "x"', None], [nan, True, 3]])
    assert text.endswith("\n")
    assert "\r" not in text
    rows = list(csv.reader(io.StringIO(text)))
    assert rows == [["a", "b,c", "d"], [repr(value), 'say "x"', ""], ["", "true", "3"]]


def test_a_table_rounds_to_u_and_leaves_out_what_is_empty() -> None:
    items = [item(part=None), item(id="b", flag=False, part=None, error=None)]
    table = Table(title="t", fields=FIELDS, items=items, footer="one line", notes=["more"])
    sheet = table.sheet(2, detail=False)
    assert [column.title for column in sheet.columns] == ["name\n", "error\num", "95 %\narcsec"]
    assert [row[:2] for row in sheet.rows] == [("a*", "1.23"), ("b", "-")]
    assert sheet.notes == ["one line"]
    full = table.sheet(2, detail=True)
    assert full.columns[-1].title == "p\n"
    assert full.notes == ["one line", "more"]


def test_millimetres_have_decimals_where_any_has() -> None:
    fields = (Field("x_mm", "", head="x", show="mm"),)
    for items, cells in (([1.0, 20.0], ["1", "20"]), ([1.0, 20.5], ["1.000", "20.500"])):
        sheet = Table(title="t", fields=fields, items=items).sheet(2, detail=False)
        assert [row[0] for row in sheet.rows] == cells


def test_what_needs_detail_is_not_shown_without_it() -> None:
    tables = [Table(title=t, fields=FIELDS, items=[item()], detail=t == "B") for t in "AB"]
    document = Document("t", (FIELDS, item()), tables, None, verdict="It is so.")
    short, long = (plain_text(document.blocks(detail=detail)) for detail in (False, True))
    assert short.startswith("It is so.\nA\n")
    assert ("B\n" in short, "B\n" in long) == (False, True)


@dataclass
class Arrays:
    mean: Any
    inner: Any


def test_rows_of_arrays_are_items() -> None:
    table = Arrays(np.array([1.0, 2.0]), Arrays(np.array([[3.0, 4.0], [5.0, 6.0]]), None))
    fields = (Field("mean_mm", "mean"), Field("last_mm", "inner.mean.1"))
    assert [record(fields, row) for row in rows_of(table, 2)] == [
        {"mean_mm": 1.0, "last_mm": 4.0},
        {"mean_mm": 2.0, "last_mm": 6.0},
    ]


@pytest.mark.parametrize("name", REPORTS)
def test_every_figure_is_declared_once_and_explained(name: str) -> None:
    results, row = declaration(name)
    for known in (list(meanings(results)), list(column_meanings(row))):
        assert [path for path, meaning in known if not meaning] == []
        assert [path for path, n in Counter(path for path, _ in known).items() if n > 1] == []


def test_envelope_has_the_contract_fields_and_each_warning_once() -> None:
    path = Path("/secret/machine.yaml")
    source = Source(role="machine", path=path, shown="machine.yaml", sha256="ab")
    warning = finding("unrelated", output="C.x", names=["a"], file="a.csv", row=3)
    document = envelope(
        "lengths",
        inputs=[source],
        settings=Settings(trials=None, seed=3),
        results={"lengths": []},
        warnings=[warning, warning],
        at={"dir_x": 1},
    )
    assert list(document) == ["schema", "tool", "inputs", "settings", "results", "warnings"]
    assert document["schema"] == "mtu/lengths/1"
    (given,), (listed,) = document["inputs"], document["warnings"]
    assert given == {"role": "machine", "path": "machine.yaml", "sha256": "ab", "rows": None}
    assert document["settings"] == {
        "coverage_factor": 2.0, "seed": 3, "correlation": "shared", "digits": 2, "trials": None,
        "at": {"dir_x": 1.0},
    }  # fmt: skip
    assert listed == {
        "code": "unrelated", "severity": "warning", "file": "a.csv", "row": 3,
        "message": "a.csv, row 3: C.x does not depend on a",
        "facts": {"output": "C.x", "names": ["a"]},
    }  # fmt: skip
    assert b"secret" not in report_bytes(document)


def shown_at(sheet: Sheet, width: int) -> str:
    """What a terminal of this width receives, without its colours."""
    out = io.StringIO()
    Console(file=out, force_terminal=True, width=width).print(sheet, crop=False)
    return re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())


SHEET = Sheet(
    title="Errors",
    columns=[
        Field("", "", head="feature\n", show="text"),
        Field("", "", head="of\n", show="text"),
        *(Field("", "", head=f"value {i}\num") for i in range(9)),
    ],
    rows=[
        ["bore_of_the_flange_04", "x", *(f"-12{i}.4 ± 5.6" for i in range(9))],
        ["b", "y", *["1"] * 9],
    ],
    notes=["a note"],
)


@pytest.mark.parametrize("width", [10, 20, 34, 60, 80, 90, 100, 200])
def test_no_digit_and_no_name_is_lost_on_any_terminal(width: int) -> None:
    shown = shown_at(SHEET, width)
    for i in range(9):
        assert f"-12{i}.4 ± 5.6" in shown
        assert f"value {i}" in shown
    heads = [line for line in shown.splitlines() if line.startswith("feature")]
    assert len(heads) == shown.count("bore_of_the_") >= 1
    if width >= 34:
        assert max(map(len, shown.splitlines())) <= min(width, 100)


# Rounding to the uncertainty: cases worked by hand (JCGM 100, 7.2.6).


@pytest.mark.parametrize(
    ("value", "u", "shown"),
    [
        (100.021471, 0.00035, ("100.02147", "0.00035")),
        (0.04, 8.06, ("0.0", "8.1")),
        (5.0, 0.0996, ("5.00", "0.10")),
        (-49.0, 1234.0, ("0", "1200")),
        (3.4e-9, 1.2e-10, ("3.40e-9", "0.12e-9")),
        (0.0, 1.2e-10, ("0", "1.2e-10")),
        (1.5, 0.0, ("1.5", "0")),
        (-0.0, 0.0, ("0", "0")),
        (1.23456789, None, ("1.23457", "-")),
        (1.5, nan, ("1.5", "-")),
        (1.5, inf, ("1.5", "-")),
        (nan, 0.123, ("-", "0.12")),
        (None, None, ("-", "-")),
    ],
)
def test_value_follows_its_uncertainty(
    value: float | None, u: float | None, shown: tuple[str, str]
) -> None:
    assert numbers.with_u(value, u) == shown


@given(
    st.floats(-1e9, 1e9, allow_subnormal=False),
    st.floats(1e-9, 1e9, allow_subnormal=False),
    st.integers(1, 3),
)
def test_rounding_is_within_half_a_digit_of_u(value: float, u: float, digits: int) -> None:
    first, second = numbers.with_u(value, u, digits)
    last = 10.0 ** (int(f"{u:.{digits - 1}e}".partition("e")[2]) - digits + 1)
    assert abs(float(first) - value) <= 0.5 * last * (1 + 1e-6) + 1e-12 * abs(value)
    assert abs(float(second) - u) <= 0.5 * last * (1 + 1e-6)
    assert not (float(first) == 0 and first.startswith("-"))


@pytest.mark.parametrize(
    ("show", "shown"),
    [
        (numbers.p_value, {0.0214: "0.021", 0.0: "<0.001", 0.09961: "0.10", 1.0: "1.00",
                           None: "-"}),
        (numbers.percent, {0.9973: "99.73", 0.512: "51.2", 0.004: "0.40", 1.0: ">99.99",
                           1e-9: "<0.01", nan: "-"}),
        (numbers.significant, {0.0: "0", 0.0996: "0.10", 14.46: "14", 1234.0: "1200",
                               1.23e-7: "1.2e-7", nan: "-"}),
        (numbers.degrees_of_freedom, {4.05: "4.0", 9.0: "9", 123.4: "123", 3e8: ">999",
                                      inf: "inf"}),
        (lambda value: numbers.fixed(value, 4), {-1e-9: "0.0000", -6e-5: "-0.0001", nan: "-"}),
    ],
)  # fmt: skip
def test_single_numbers(show: Callable[[Any], str], shown: dict[Any, str]) -> None:
    """No certainty is claimed, and zero has no sign."""
    assert {value: show(value) for value in shown} == shown


@pytest.mark.parametrize(
    ("p", "se", "shown"),
    [
        (0.9723, 0.0026, "97.2 ± 0.3"), (0.0031, 0.0009, "0.31 ± 0.09"), (0.999995, 7e-6, ">99.99"),
        (1.0, 0.0099, ">97.0"), (0.0, 5e-6, "<0.01"), (0.0, 0.0099, "<3.0"), (0.512, 0.0, "51.2"),
    ],
)  # fmt: skip
def test_a_chance_with_its_error_stays_within_certainty(p: float, se: float, shown: str) -> None:
    assert numbers.chance(p, se) == shown


def test_intervals() -> None:
    assert numbers.interval(-16.46, 15.78, 8.06) == "[-16.5, 15.8]"
    assert numbers.interval(-0.01, inf, 8.06) == "-"
    assert numbers.plus_minus(-0.34, 8.06) == "-0.3 ± 8.1"
    assert numbers.plus_minus(-0.34, None) == "-0.34"
    assert (numbers.span("0.58", "2.6"), numbers.span("2.0", "2.0")) == ("0.58 to 2.6", "2.0")


# Figures: what they show, that nothing hides anything, and the same bytes every time.


def draw(suffix: str) -> bytes:
    def inner():  # type: ignore[no-untyped-def]  # a figure, whatever it holds
        page = blank(3.0, 2.0)
        page.subplots().plot([0, 1], [0, 1], "o-", label="a")
        return page

    return figure_bytes(inner, suffix)


@pytest.mark.parametrize("suffix", ["png", ".svg", ".PDF"])
def test_the_same_figure_has_the_same_bytes_and_no_date(suffix: str) -> None:
    """Whatever settings of matplotlib the user has."""
    import matplotlib

    first = draw(suffix)
    with matplotlib.rc_context({"lines.linewidth": 9.0, "axes.facecolor": "red"}):
        assert draw(suffix) == first
        assert matplotlib.rcParams["lines.linewidth"] == 9.0
    assert len(first) > 1000
    assert not re.search(rb"CreationDate|<dc:date>|20\d\d-\d\d-\d\dT", first)


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Example:
    return example(tmp_path_factory.mktemp("paper"))


def test_ellipses_are_k_sigma_of_the_covariance(paper: Example) -> None:
    from matplotlib.collections import EllipseCollection

    result = paper.points()
    (panel,) = predictions.points_figure(result).axes
    (found,) = [item for item in panel.collections if isinstance(item, EllipseCollection)]
    parts = (found.get_offsets(), found.get_widths(), found.get_heights(), found.get_angles())
    drawn = [*zip(*map(np.asarray, parts), strict=True)]
    assert len(drawn) == 24
    for i, (tip, width, height, turned) in enumerate(drawn):
        place = result.prediction.points[i, :2]
        scale = np.linalg.norm(tip - place) / np.linalg.norm(
            result.prediction.mean[2 * i : 2 * i + 2]
        )
        block = result.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] * scale**2
        angle = np.radians(turned)
        along = np.array([np.cos(angle), np.sin(angle)])
        assert (width / 2) ** 2 == pytest.approx(4 * along @ block @ along, rel=1e-6)
        across = np.array([-along[1], along[0]])
        assert (height / 2) ** 2 == pytest.approx(4 * across @ block @ across, rel=1e-6)
        assert abs(along @ block @ across) <= 1e-9 * np.trace(block)


def test_names_of_the_holes_keep_clear_of_arrows_and_one_another(paper: Example) -> None:
    result = paper.points()
    page = predictions.points_figure(result)
    figure_bytes(lambda: page, "png")
    (panel,) = page.axes
    ids = set(result.prediction.ids)
    texts: list[Any] = [text for text in panel.texts if text.get_text() in ids]
    boxes = [text.get_window_extent() for text in texts]
    assert len(boxes) == 24
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])
    marks = panel.transData.transform(result.prediction.points[:, :2])
    for box in boxes:
        assert not any(box.contains(x, y) for x, y in marks)


def test_band_is_that_of_a_future_reading(paper: Example) -> None:
    page = fit_components.figure(fit_result("m", paper.fit, paper.estimates))
    panel = next(p for p in page.axes if p.get_title(loc="left").startswith("dx_x"))
    (band,) = panel.collections
    outline = np.asarray(band.get_paths()[0].vertices)
    edges = outline[np.isclose(outline[:, 0], 10.0)][:, 1]
    estimate, at = paper.estimates.components["dx_x"], np.array([1.0, 10.0])
    variance = at @ (estimate.covariance + estimate.pass_covariance) @ at + estimate.s_repeat**2
    assert np.ptp(edges) == pytest.approx(4 * np.sqrt(variance) * 1000, rel=1e-9)
