"""What compare reports: names and units, the summary, and a picture in which all can be read."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from typing import Any, TypeGuard

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.quiver import Quiver
from matplotlib.text import Text

from mtu_cli.analyses.compare import Compared, CompareResult, Verdict
from mtu_cli.analyses.compare.evidence import Foretold, evidence
from mtu_cli.analyses.compare.summary import summarised
from mtu_cli.analyses.compare.verdicts import judged
from mtu_cli.findings import Finding
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.reports import arrows
from mtu_cli.reports.compare import csv_rows, document, figure, table
from mtu_cli.reports.compare_figure import ITEMS
from mtu_cli.reports.compare_words import verdict, verdict_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.numbers import significant
from mtu_cli.reports.tables import plain_text
from mtu_cli.stats.anova import Cells
from mtu_cli.stats.least_squares import FloatArray

Labels = list[tuple[str, str, str]]
K = 2.0
NO: tuple[Verdict] = ("consistent",)


def compared(labels: Labels, seed: int) -> Compared:
    """Five parts measured twice; errors of some 10 um, predicted u 5 um; verdicts by decree."""
    rng = np.random.default_rng(seed)
    m = len(labels)
    cells = Cells(
        origin=np.zeros(m),
        n=np.full((m, 5), 2.0),
        mean=0.01 * rng.standard_normal((m, 1)) + 0.003 * rng.standard_normal((m, 5)),
        within=np.full(m, 5e-6),
        within_part=np.full((m, 5), 1e-6),
    )
    # A feature is predicted once, whatever the operation.
    one = {label[1:]: 0.01 * rng.standard_normal() for label in labels}
    u2 = np.full(m, 0.005**2)
    foretold = Foretold(
        mean=np.array([one[label[1:]] for label in labels]),
        total=u2,
        coefficients=0.2 * u2,
        scatter=0.8 * u2,
        independent=0.64 * u2,
        holes=np.full(m, np.nan),
        of_mean=0.2 * u2[None],
        of_part=0.8 * u2[None],
        dof=np.array([np.inf]),
        joint={},
    )
    tables = MeasuredTables(labels=tuple(labels), parts=tuple("12345"), cells=cells)
    found, _ = judged(evidence(tables, foretold, K), None)
    return decreed(found, under=(0,))


def decreed(
    found: Compared, *, under: tuple[int, ...] = (), biased: tuple[int, ...] = ()
) -> Compared:
    """The same with these faults and no other."""
    rows = range(len(found.labels))
    no = tuple(False for _ in rows)
    names = {True: "under-predicted", False: "consistent"}
    verdicts = [names[i in under] if i in under or i not in biased else "biased" for i in rows]
    return replace(
        found,
        biased=tuple(i in biased for i in rows),
        under_predicted=tuple(i in under for i in rows),
        over_predicted=no,
        inconsistent=tuple(None for _ in rows),
        withheld=no,
        verdicts=tuple(verdicts),  # type: ignore[arg-type]  # literals
    )


def with_p(found: Compared, ratio: FloatArray, p: FloatArray) -> Compared:
    """The same with scatters of these sizes and p."""
    return replace(found, ratio_scatter=ratio, p_scatter=p, unlikely=tuple((p < 1).tolist()))


def with_features(result: CompareResult, features: Compared) -> CompareResult:
    """The result with other features, summed up again."""
    return replace(result, features=features, feature_summaries=summarised(features))


def result_of(
    places: FloatArray,
    operations: tuple[str, ...] = ("",),
    axes: str = "xy",
    lengths: bool = True,
) -> CompareResult:
    ids = tuple(str(i + 1) for i in range(len(places)))
    labels = [(o, name, axis) for o in operations for axis in axes for name in ids]
    pairs = [(o, name, "") for o in operations for name in ("1-2", "2-3")]
    features, others = compared(labels, 1), compared(pairs, 2)
    return CompareResult(
        ids=ids,
        places=places,
        features=features,
        lengths=others if lengths else None,
        feature_summaries=summarised(features),
        length_summaries=summarised(others) if lengths else (),
        datum="none",
        coverage_factor=K,
        warnings=(),
    )


def ring() -> FloatArray:
    """24 holes on the square 10..140 mm."""
    side = np.linspace(10, 140, 7)
    places = [(x, 10) for x in side] + [(x, 140) for x in side]
    places += [(x, y) for y in side[1:-1] for x in (10, 140)]
    return np.array([(x, y, 127) for x, y in places], dtype=np.float64)


def grid(columns: int, rows: int) -> FloatArray:
    return np.array([(6 * i, 7 * j, 0) for j in range(rows) for i in range(columns)], dtype=float)


@pytest.fixture(scope="module")
def two() -> CompareResult:
    return result_of(ring(), ("drilled", "milled"))


def title_of(panel: Axes) -> Text:
    """The title as it is drawn."""
    words = panel.get_title(loc="left")
    (found,) = (child for child in panel.get_children() if is_text(child, words))
    return found


def is_text(item: object, words: str) -> TypeGuard[Text]:
    return isinstance(item, Text) and item.get_text() == words


def quivers(page: Any) -> list[tuple[Any, Quiver]]:
    return [
        (panel, item)
        for panel in page.axes
        for item in panel.collections
        if isinstance(item, Quiver)
    ]


def test_report_names_and_units(two: CompareResult) -> None:
    results: dict[str, Any] = json.loads(json.dumps(document(two), allow_nan=False))
    assert [len(results[kind]) for kind in ("features", "lengths")] == [96, 4]
    first, found = results["features"][0], two.features
    assert (first["operation"], first["id"], first["axis"]) == ("drilled", "1", "x")
    predicted, measured = first["predicted"], first["measured"]
    assert predicted["mean_um"] == pytest.approx(1000 * found.predicted.mean[0])
    assert predicted["U_um"] == pytest.approx(10)
    assert measured["parts"] == 5
    assert measured["n"] == 10
    assert first["bias_um"] == pytest.approx(measured["mean_um"] - predicted["mean_um"])
    assert first["ratio_u"] == pytest.approx(measured["u_um"] / predicted["u_um"])
    width = 2 * (abs(measured["mean_um"]) + 2 * measured["u_um"])
    assert first["range_width_um"]["measured"] == pytest.approx(width)
    assert first["verdict"] == "under-predicted"
    assert results["lengths"][0]["axis"] is None
    drilled, milled = results["summary"]["features"]
    assert drilled["verdicts"]["under-predicted"] == 1
    assert milled["verdicts"] == {
        "consistent": 48, "biased": 0, "under-predicted": 0, "over-predicted": 0,
        "inconsistent": 0,
    }  # fmt: skip
    ratios = [item["ratio_u"] for item in results["features"] if item["operation"] == "milled"]
    assert milled["ratio_u"] == [min(ratios), max(ratios)]


def test_csv_has_both_kinds(two: CompareResult) -> None:
    header, rows = csv_rows(two)
    listed = [dict(zip(header, row, strict=True)) for row in rows]
    assert [row["kind"] for row in listed] == ["feature"] * 96 + ["length"] * 4
    assert listed[96]["predicted_mean_um"] == document(two)["lengths"][0]["predicted"]["mean_um"]


def test_figures_that_cannot_be_had_are_null(two: CompareResult) -> None:
    none = np.full(len(two.features.labels), np.nan)
    found = replace(two.features, ratio_u=none, E_n=none, ratio_ms=np.full_like(none, np.inf))
    results = document(with_features(two, found))
    entry = json.loads(json.dumps(results["features"][0], allow_nan=False))
    assert (entry["ratio_u"], entry["E_n"], entry["ratio_ms_between"]) == (None, None, None)
    assert entry["ratio_range"] is not None
    assert results["summary"]["features"][0]["ratio_u"] is None


def test_one_sentence_an_operation_and_kind(two: CompareResult) -> None:
    """Both faults of an item are told, the graver one first, with their sizes."""
    found = decreed(two.features, under=(0, 1), biased=(1, 2))
    result = with_features(two, found)
    factor = sorted(found.ratio_scatter[:2])
    off = sorted(1000 * np.abs(found.bias[1:3]))
    shown = [f"{significant(a)} to {significant(b)}" for a, b in (factor, off)]
    drilled, milled = document(result)["summary"]["features"]
    assert drilled["verdict_text"] == (
        f"drilled features: under-predicted: the scatter is {shown[0]} times the predicted one "
        f"(2 of 48); biased: the mean is off by {shown[1]} um (2 of 48)"
    )
    assert milled["verdict_text"].startswith("milled features: consistent: no difference")
    assert drilled["under_predicted_factor"] == pytest.approx(factor)
    assert (drilled["biased"], drilled["under_predicted"]) == (2, 2)
    assert drilled["verdicts"]["biased"] == 1
    text = " ".join(plain_text(table(result)).split())
    assert text.startswith(f"Predicted against measured {drilled['verdict_text']}")
    assert "in anova ± is the u of the mean" in text
    assert "E_n p of scatter p of verdict" in text
    few = with_features(
        two, replace(result_of(ring()[:3]).features, labels=two.features.labels[:6])
    )
    both = decreed(few.features, under=(1,), biased=(1,))
    assert "biased, under-predicted" in plain_text(table(with_features(two, both)))


def test_the_scatter_that_a_sentence_tells_is_found_again_in_its_line(two: CompareResult) -> None:
    """u of a future part holds the uncertainty of the mean, too: another ratio, 7.7 beside 7.6."""
    one = np.zeros(len(two.features.labels))
    one[0] = 1.0
    found = replace(decreed(two.features, under=(0,)), ratio_scatter=7.6 * one, ratio_u=7.7 * one)
    text = plain_text(table(with_features(two, found)))
    assert "the scatter is 7.6 times the predicted one (1 of 48)" in " ".join(text.split())
    line = next(x for x in text.splitlines() if x.startswith("drilled 1 x"))
    assert "7.6" in line.split()
    assert "7.7" not in line
    told = "u: of one future part, its scatter and what is not known of the mean"
    assert told in " ".join(text.split())


def test_scatter_that_is_large_but_no_finding_is_told_as_undecided(two: CompareResult) -> None:
    """From twice the predicted on, where the p of all items together is not 1."""
    found, m = decreed(two.features, biased=(1,)), len(two.features.labels)
    ratio, p = np.ones(m), np.ones(m)
    ratio[[0, 2, 5, 50]], p[[0, 2, 5, 50]] = (3.52, 2.4, 1.9, 9.0), (0.454, 0.49, 0.1, 1.0)
    result = with_features(two, with_p(found, ratio, p))
    drilled, milled = document(result)["summary"]["features"]
    assert drilled["verdict_text"].endswith(
        "(1 of 48); undecided: the scatter is 2.4 to 3.5 times the predicted one (2 of 48, most at "
        "1 x), which so few passes and parts cannot tell from chance (p = 0.45)"
    )
    assert drilled["scatter_undecided"] == {
        "items": 2, "factor": [2.4, 3.52], "largest": {"id": "1", "axis": "x"},
        "p_familywise": 0.454,
    }  # fmt: skip
    assert milled["scatter_undecided"] == {"items": 0, "factor": []}
    assert "undecided" not in milled["verdict_text"]
    one = with_features(two, with_p(found, ratio, np.where(p > 0.46, 1.0, p)))
    consistent = with_features(one, replace(one.features, biased=(False,) * m, verdicts=NO * m))
    entry = document(consistent)["summary"]["features"][0]
    beyond = "drilled features: no difference from what was predicted is beyond chance"
    large = "undecided: the scatter is 3.5 times the predicted one (at 1 x), which so few"
    assert entry["verdict_text"].startswith(f"{beyond}, but {large}")
    assert entry["verdicts"]["consistent"] == 48
    item = summarised(consistent.features)[0]
    text = verdict_text(replace(item, bias_tested=0), "features")
    assert text.startswith(f"{beyond} as far as it could be tested, but {large}")
    assert text.endswith("; the mean was not tested")
    # What is a finding is not undecided.
    other = replace(found, under_predicted=(True, *(False,) * (m - 1)))
    own = with_p(other, ratio, np.where(p > 0.46, 1.0, p))
    assert summarised(own)[0].undecided is None


def test_who_finds_a_difference_hears_which_command_looks_for_its_cause(two: CompareResult) -> None:
    told, ratio = "mtu close-loop looks for the cause", np.ones(len(two.features.labels))
    none = replace(decreed(two.features), ratio_scatter=ratio, p_scatter=ratio)
    assert two.lengths is not None
    base = replace(with_features(two, none), length_summaries=summarised(decreed(two.lengths)))
    assert told not in plain_text(table(base))
    for found in (
        decreed(none, biased=(3,)),
        decreed(none, under=(3,)),
        replace(none, inconsistent=(True, *(False,) * (len(ratio) - 1))),
        replace(none, ratio_scatter=3 * ratio, p_scatter=0.3 * ratio),
    ):
        assert told in plain_text(table(with_features(base, found)))
    over = replace(none, over_predicted=(True, *(False,) * (len(ratio) - 1)))
    assert told not in plain_text(table(with_features(base, over)))


def test_what_the_papers_scatter_is_of_the_parts(two: CompareResult) -> None:
    """Two repeats a part: n0 = 2, MS_between twice the variance of the parts and the CMM's."""
    item = document(two)["features"][0]["measured"]
    entry = document(two)["summary"]["features"][0]
    assert (item["n0"], entry["n0"]) == (pytest.approx(2.0), pytest.approx(2.0))
    share = np.sqrt(item["ms_between_um2"]) / item["s_part_um"]
    assert item["sqrt_ms_between_over_s_part"] == pytest.approx(share)
    assert share > np.sqrt(2)
    assert "n0 = 2.000" in entry["paper_scatter_text"]
    assert "sqrt(n0) = 1.414" in entry["paper_scatter_text"]


def test_words_for_what_was_not_tested_or_not_told_apart(two: CompareResult) -> None:
    m = len(two.features.labels)
    nothing: tuple[None, ...] = (None,) * m
    one: tuple[Verdict] = ("consistent",)
    rest = one * (m - 1)
    none = replace(
        two.features, biased=nothing, under_predicted=nothing, over_predicted=nothing,
        verdicts=nothing,
    )  # fmt: skip
    few = replace(
        none, inconsistent=(True, *(False,) * (m - 1)),
        verdicts=("inconsistent", *rest),
    )  # fmt: skip
    assert verdict_text(summarised(none)[0], "features") == "drilled features: not tested"
    text = verdict_text(summarised(few)[0], "features")
    assert "bias or scatter: too few parts to tell (1 of 48)" in text
    assert text.endswith("; the scatter was not tested")
    assert verdict_text(summarised(few)[1], "x").startswith("milled x: consistent as far as it")
    assert (verdict(none, 0), verdict(few, 0)) == ("not tested", "inconsistent")


def test_parts_that_scatter_as_a_whole_may_have_been_set_up_by_hand(two: CompareResult) -> None:
    """As most features scatter and no length does; a datum was not taken yet."""
    most, few = (decreed(two.features, under=tuple(range(n))) for n in (40, 20))
    assert two.lengths is not None
    lengths = summarised(decreed(two.lengths))
    found = replace(with_features(two, most), length_summaries=lengths)
    told = (
        "set up by hand (on the machine or the CMM), with an offset of its own. --datum offset, or"
    )
    assert told in plain_text(table(found)).replace("\n", " ")
    for other in (
        replace(with_features(two, few), length_summaries=lengths),
        replace(found, length_summaries=()),
        replace(found, length_summaries=summarised(decreed(two.lengths, under=(0,)))),
        replace(found, datum="offset"),
    ):
        assert "set up by hand" not in plain_text(table(other))


def test_parts_that_are_all_off_alike_may_have_lain_shifted_or_turned(two: CompareResult) -> None:
    """Most features along one axis, and no length; a datum was not taken yet."""
    labels = two.features.labels
    along = [i for i, label in enumerate(labels) if (label[0], label[2]) == ("drilled", "x")]
    off, half = (decreed(two.features, biased=tuple(along[:n])) for n in (13, 12))
    assert (two.lengths is not None, len(along)) == (True, 24)
    assert two.lengths is not None
    lengths = summarised(decreed(two.lengths))
    found = replace(with_features(two, off), length_summaries=lengths)
    told = "all parts lay shifted or turned (on the machine or the CMM). --datum offset, or"
    assert told in plain_text(table(found)).replace("\n", " ")
    for other in (
        replace(with_features(two, half), length_summaries=lengths),
        replace(found, length_summaries=()),
        replace(found, length_summaries=summarised(decreed(two.lengths, biased=(0,)))),
        replace(found, datum="offset"),
    ):
        assert "shifted or" not in plain_text(table(other))
    # What was used beyond what it was found on may be at fault as well.
    guess = Finding(code="outside-effect-range")
    text = plain_text(table(replace(found, warnings=(guess,)))).replace("\n", " ")
    assert "it may be that an effect is used beyond what it was found on, or that all parts" in text
    assert "takes the latter out." in text


def test_parts_that_do_not_scatter_at_all_are_told_in_words(two: CompareResult) -> None:
    over = (True, *(False,) * (len(two.features.labels) - 1))
    found = replace(decreed(two.features), over_predicted=over)
    for ratio, said in ((1e-9, "no scatter is seen where some is"), (0.02, "the scatter is 0.020")):
        item = summarised(replace(found, ratio_scatter=np.full(len(over), ratio)))[0]
        assert f"over-predicted: {said}" in verdict_text(item, "features")


def test_one_part_has_the_digits_of_what_was_predicted_of_it(two: CompareResult) -> None:
    """No u is known of one part: 11.2905 beside 10.3 ± 1.7 says more than anybody knows."""
    few = result_of(ring()[:3], lengths=False)
    side = replace(few.features.measured, u=np.full(len(few.features.labels), np.nan))
    table_ = replace(few.features.one_way, mean=np.full(len(few.features.labels), 0.0112905))
    side = replace(side, mean=table_.mean)
    one = with_features(few, replace(few.features, measured=side, one_way=table_))
    line = next(x for x in plain_text(table(one)).splitlines() if x.startswith("1 x"))
    assert " 11.3 " in line
    assert "11.29" not in line


def test_tables_fit(two: CompareResult) -> None:
    text = plain_text(table(two))
    assert max(map(len, text.splitlines())) <= 100
    assert text.index("Predicted against measured") < text.index("Lengths")
    # Of many features, those with a fault alone; of few, all.
    faults = [i for i, said in enumerate(two.features.verdicts) if said != "consistent"]
    listed = text[text.index("Features") :]
    assert sum(line.startswith(("drilled", "milled")) for line in listed.splitlines()) == len(
        faults
    )
    consistent = with_features(two, decreed(two.features))
    assert "Features" not in plain_text(table(consistent))
    assert "Features" in plain_text(table(result_of(ring()[:3])))


def test_of_many_features_those_with_a_fault_are_listed_the_clearest_first(
    two: CompareResult,
) -> None:
    count = len(two.features.labels)
    faulty = (7, 3, 20)
    p = np.ones(count)
    p[list(faulty)] = (1e-6, 0.01, 1e-3)
    decided = replace(
        decreed(two.features, biased=faulty), p_bias=p, p_scatter=np.full(count, np.nan)
    )
    text = plain_text(table(with_features(two, decided)))
    listed = text[text.index("Features") :]
    labels = [" ".join(word for word in two.features.labels[i] if word) for i in (7, 20, 3)]
    places = [listed.index(label) for label in labels]
    assert places == sorted(places)
    assert listed.count("biased") == len(faulty)
    assert "those that are not consistent, the clearest first: all are in the report" in listed
    many = replace(decided, p_bias=np.linspace(0.001, 0.04, count))
    every = decreed(many, biased=tuple(range(count)))
    text = plain_text(table(with_features(two, every)))
    assert f"{count - 40} more such" in text


def test_ratios_of_one_item_are_one_number() -> None:
    one = result_of(grid(1, 1), axes="x", lengths=False)
    line = next(x for x in plain_text(table(one)).splitlines() if x.startswith("features  "))
    (summary,) = one.feature_summaries
    found = (summary.ratio_u, summary.ratio_range, summary.paper_ratio_range)
    assert line.split()[5:] == [significant(item.least) for item in found if item is not None]


def test_arrows_are_the_errors_at_the_nominal_places_on_one_scale(two: CompareResult) -> None:
    page = figure(two)
    found = quivers(page)
    titles = [panel.get_title(loc="left") for panel, _ in found]
    assert titles == ["predicted", "drilled, measured", "milled, measured"]
    means = two.features.measured.mean
    expected = [two.features.predicted.mean[:48], means[:48], means[48:]]
    scales = []
    for (panel, item), mean in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.asarray(item.get_offsets()), two.places[:, :2])
        drawn = np.column_stack([np.asarray(item.U), np.asarray(item.V)])
        errors = 1000 * mean.reshape(2, 24).T
        scale = float(drawn[0, 0] / errors[0, 0])
        np.testing.assert_allclose(drawn, scale * errors, rtol=1e-12, atol=1e-12)
        assert panel.get_aspect() == 1.0
        assert panel.get_xlim() == found[0][0].get_xlim()
        assert panel.get_ylim() == found[0][0].get_ylim()
        scales.append(scale)
    np.testing.assert_allclose(scales, scales[0], rtol=1e-12)


def test_every_panel_of_intervals_names_its_axis(two: CompareResult) -> None:
    below = [panel for panel in figure(two).axes if "of one part" in panel.get_title(loc="left")]
    assert len(below) == 2
    assert {panel.get_xlabel() for panel in below} == {"actual minus nominal, um"}


def test_the_scale_arrow_is_as_long_as_it_says(two: CompareResult) -> None:
    page = figure(two)
    for panel, item in quivers(page):
        arrow = next(text for text in panel.texts if getattr(text, "arrow_patch", None))
        (words,) = [text.get_text() for text in panel.texts if text.get_text().endswith(" um")]
        low, high = panel.get_xlim()
        mm = arrow.xy[0] * (high - low)
        error = 1000 * two.features.predicted.mean[0]
        if panel.get_title(loc="left") == "predicted":
            assert mm / float(words.split()[0]) == pytest.approx(np.asarray(item.U)[0] / error)


def test_nothing_is_written_over_or_outside(two: CompareResult) -> None:
    page = figure(two)
    figure_bytes(page, "png")
    whole = page.bbox
    for panel in page.axes:
        texts: list[Any] = [text for text in panel.texts if text.get_text()]
        texts += [panel.xaxis.label, panel.yaxis.label, title_of(panel)]
        boxes = [text.get_window_extent() for text in texts if text.get_text()]
        for i, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[i + 1 :])
            assert whole.x0 <= box.x0
            assert box.x1 <= whole.x1
            assert whole.y0 <= box.y0
            assert box.y1 <= whole.y1
    for panel, _ in quivers(page):
        marks = panel.transData.transform(two.places[:, :2])
        names = [text for text in panel.texts if text.get_text().isdigit()]
        assert len(names) == 24
        for text in names:
            assert not any(text.get_window_extent().contains(x, y) for x, y in marks)


@pytest.mark.parametrize(
    ("result", "panels"),
    [
        (result_of(ring()), ["predicted", "measured"]),
        (result_of(np.array([[50.0, 60.0, 0.0]]), lengths=False), ["predicted", "measured"]),
        (result_of(grid(25, 20), ("bored",)), ["predicted", "bored, measured"]),
        (result_of(grid(10, 1), lengths=False), ["predicted", "measured"]),
        (result_of(ring(), axes="x"), []),
    ],
    ids=["no operation", "one feature", "500 features", "in a row", "one axis"],
)
def test_pictures_of_any_study(result: CompareResult, panels: list[str]) -> None:
    page = figure(result)
    found = quivers(page)
    assert [panel.get_title(loc="left") for panel, _ in found] == panels
    assert len(page.axes) == len(panels) + (1 if result.lengths is None else 2)
    first = figure_bytes(page, "png")
    assert first.startswith(b"\x89PNG")
    assert first == figure_bytes(figure(result), "png")
    for panel, _ in found:
        names = sum(text.get_text().isdigit() for text in panel.texts)
        assert names == (len(result.ids) if len(result.ids) <= arrows.SHOWN_IDS else 0)


def test_of_many_items_those_that_differ_most_are_drawn() -> None:
    result = result_of(ring(), lengths=False)
    result = with_features(result, decreed(result.features))
    panel = figure(result).axes[-1]
    drawn = {label.get_text() for label in panel.get_yticklabels()}
    worst = np.argsort(-np.abs(result.features.E_n))[:ITEMS]
    assert drawn == {" ".join(result.features.labels[i][1:]) for i in worst}
    assert f"(the {ITEMS} with the largest |E_n| of 48)" in panel.get_title(loc="left")


def test_of_many_items_those_with_a_fault_are_drawn_however_small_their_bias() -> None:
    """Parts that scatter too much may lie where they should in the mean."""
    found = result_of(ring(), lengths=False)
    size = np.abs(found.features.E_n)
    least, rest = np.argsort(size)[:3], np.argsort(-size)[: ITEMS - 3]
    under = tuple(least.tolist())
    panel = figure(with_features(found, decreed(found.features, under=under))).axes[-1]
    names = [" ".join(label[1:]) for label in found.features.labels]
    drawn = [names.index(label.get_text()) for label in panel.get_yticklabels()]
    assert drawn == sorted([*under, *rest.tolist()])
    assert f"(3 with a fault, {ITEMS - 3} with the largest |E_n|, of 48)" in panel.get_title(
        loc="left"
    )
    # Of more faults than there is room for, the clearest.
    p = np.random.default_rng(1).permutation(48) / 1000
    faulty = replace(decreed(found.features, biased=tuple(range(40))), p_bias=p, p_scatter=p)
    panel = figure(with_features(found, faulty)).axes[-1]
    drawn = [names.index(label.get_text()) for label in panel.get_yticklabels()]
    assert drawn == sorted(np.argsort(p[:40])[:ITEMS].tolist())
    told = f"(the {ITEMS} clearest of 40 with a fault, of 48)"
    assert told in panel.get_title(loc="left")


def test_more_operations_than_fit_are_counted() -> None:
    page = figure(result_of(ring()[:4], tuple("abcdefg")))
    assert len(quivers(page)) == 6
    titles = [part.get_suptitle() for part in page.subfigs]
    assert any("first 5 of 7 operations" in title for title in titles)


def test_a_feature_without_one_axis_is_counted() -> None:
    result = result_of(ring(), ("drilled",))
    keep = [i for i, label in enumerate(result.features.labels) if label[1:] != ("5", "y")]
    labels = [result.features.labels[i] for i in keep]
    titles = [
        panel.get_title(loc="left")
        for panel, _ in quivers(figure(replace(result, features=compared(labels, 3))))
    ]
    assert titles == [
        "predicted (without 1 of one axis)",
        "drilled, measured (without 1 of one axis)",
    ]


def test_long_names_stay_inside_their_panel() -> None:
    found = result_of(np.array([(x, y, 0) for x in (10, 140) for y in (10, 140)], dtype=float))
    names = {str(i + 1): name for i, name in enumerate(("near left", "far left", "right", "last"))}
    labels = [(o, names[name], axis) for o, name, axis in found.features.labels]
    page = figure(
        replace(
            found, ids=tuple(names.values()), features=replace(found.features, labels=tuple(labels))
        )
    )
    figure_bytes(page, "png")
    for panel, _ in quivers(page):
        written = [text for text in panel.texts if text.get_text() in names.values()]
        assert len(written) == 4
        inside = panel.get_window_extent()
        for text in written:
            box = text.get_window_extent()
            assert inside.x0 <= box.x0
            assert box.x1 <= inside.x1
            assert inside.y0 <= box.y0
            assert box.y1 <= inside.y1


def test_both_kinds_are_drawn_with_their_verdicts(two: CompareResult) -> None:
    result = with_features(two, decreed(two.features, under=(0,), biased=(0, 5)))
    lengths, features = figure(result).axes[-2:]
    assert lengths.get_title(loc="left").startswith("Lengths")
    told = f"(2 with a fault, {ITEMS // 2 - 2} with the largest |E_n|, of 96)"
    assert told in features.get_title(loc="left")
    for panel, found in ((lengths, result.lengths), (features, result.features)):
        assert found is not None
        names = [" ".join(word for word in label if word) for label in found.labels]
        drawn = [names.index(label.get_text()) for label in panel.get_yticklabels()]
        assert [text.get_text() for text in panel.texts] == [verdict(found, i) for i in drawn]
    colours = {text.get_text(): text.get_color() for text in lengths.texts}
    assert len(set(colours.values())) == len(colours) == 2


def test_operations_with_predictions_of_their_own_have_panels_of_their_own() -> None:
    found = result_of(ring()[:4], ("cold", "warm"))
    shifted = found.features.predicted.mean.copy()
    shifted[: len(shifted) // 2] += 0.004
    moved = replace(found.features, predicted=replace(found.features.predicted, mean=shifted))
    titles = [
        panel.get_title(loc="left") for panel, _ in quivers(figure(with_features(found, moved)))
    ]
    assert titles == ["cold, predicted", "cold, measured", "warm, predicted", "warm, measured"]


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_names_that_the_font_lacks_are_drawn_without_a_murmur(kind: str) -> None:
    found = result_of(ring()[:4])
    names = dict(zip(found.ids, ("\u5de6", "\u53f3", "\u4e0a", "\u4e0b"), strict=True))
    labels = tuple((o, names[name], axis) for o, name, axis in found.features.labels)
    renamed = replace(found, ids=tuple(names.values()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = figure(with_features(renamed, replace(found.features, labels=labels)))
        assert len(figure_bytes(page, kind)) > 1000
