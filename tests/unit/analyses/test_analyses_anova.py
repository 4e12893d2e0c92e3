"""The whole analysis of measured parts: uncertainties, methods, unusual parts, warnings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_examples import part_file, points, study, with_measured

from mtu_cli.analyses.anova import AnovaResult, Method, analyse_variance
from mtu_cli.files.points import Points
from mtu_cli.model.settings import Settings
from mtu_cli.stats import rotation

SETTINGS = Settings()


def analysed(found: Points, method: Method = "reml") -> AnovaResult:
    return analyse_variance(found, None, method, SETTINGS)


def codes(result: AnovaResult) -> list[str]:
    return [item.code for item in result.warnings]


def test_uncertainties_of_mean_and_future_part_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over many studies the mean scatters by u_mean and a further part about it by u_future."""
    monkeypatch.setattr(rotation, "ROTATIONS", 19)
    means, future, u_mean, u_future = [], [], [], []
    for seed in range(300):
        found = study(9, 2, seed, 0.01, 0.004)
        kept = found.part < 8
        one = analysed(_rows(found, kept)).features
        means.append(one.one_way.mean)
        u_mean.append(one.u_mean)
        u_future.append(one.u_future)
        # Eight parts were analysed; the ninth, without the CMM's share, is the future one.
        clean = np.random.default_rng(seed + 10_000).standard_normal(len(one.one_way.mean)) * 0.01
        future.append(clean - one.one_way.mean)
    for values, u in ((means, u_mean), (future, u_future)):
        rms = np.sqrt(np.mean(np.square(values)))
        expected = np.sqrt(np.mean(np.square(u)))
        # 1800 values, not all independent of each other's repeats: four standard errors.
        assert rms == pytest.approx(expected, rel=4 / np.sqrt(2 * np.size(values)))


def _rows(found: Points, kept: np.ndarray) -> Points:
    names = ("part", "feature", "operation", "measured", "nominal", "repeat", "time_min",
             "sequence", "direction", "file_index", "row")  # fmt: skip
    parts = found.parts[: int(found.part[kept].max()) + 1]
    return replace(found, parts=parts, **{name: getattr(found, name)[kept] for name in names})


def test_methods() -> None:
    found = study(21, 2, 2, 0.0, 0.002)
    results = {method: analysed(found, method).features for method in ("paper", "anova", "reml")}
    table = results["paper"].one_way
    assert (results["paper"].components.part == table.ms_between).all()
    np.testing.assert_allclose(results["paper"].u_mean, np.sqrt(table.ms_within / 42))
    np.testing.assert_allclose(results["paper"].u_future, np.sqrt(table.ms_within * (1 + 1 / 42)))
    negative = results["anova"].components.part_estimate < 0
    assert negative.any()
    np.testing.assert_array_equal(results["anova"].components.part[negative], 0)
    np.testing.assert_array_equal(results["reml"].components.part[negative], 0)
    assert "negative-variance" in codes(analysed(found, "anova"))
    assert "paper-method" in codes(analysed(found, "paper"))
    assert codes(analysed(found)) == []


def test_a_shifted_part_and_a_shifted_feature_are_named() -> None:
    found = study(21, 2, 4)
    measured = found.measured.copy()
    measured[found.part == 6, 0] += 0.06
    result = analysed(with_measured(found, measured))
    assert result.unusual is not None
    (item,) = result.unusual
    assert (item.part, item.why, item.where) == ("P6", "mean", ("", "", "x"))
    assert item.deviation == pytest.approx(0.06, rel=0.25)
    assert item.p <= 0.01
    measured = found.measured.copy()
    measured[(found.part == 3) & (found.feature == 1), 1] += 0.12
    result = analysed(with_measured(found, measured))
    assert result.unusual is not None
    (item,) = result.unusual
    assert (item.part, item.singles[0]) == ("P3", ("", "b", "y"))
    labels = result.features.tables.labels
    assert result.features.unusual[labels.index(("", "b", "y"))] == ("P3",)
    limits = result.features.limits()[labels.index(("", "b", "y"))]
    assert limits.shape == (21,)
    assert (limits > 0).all()


def test_axis_scatter_is_tested() -> None:
    found = study(21, 1, 4)
    measured = found.nominal + (found.measured - found.nominal) * np.array([1.0, 3.0, 1.0])
    ((operation, test),) = analysed(with_measured(found, measured)).axis_scatter
    assert operation == ""
    assert test.ratio > 4
    assert test.p <= 0.01
    ((_, test),) = analysed(found).axis_scatter
    assert test.p > 0.05


def test_lengths_and_angles_of_the_part_file(tmp_path: Path) -> None:
    part = part_file(tmp_path)
    found = study(12, 2, 4)
    result = analyse_variance(found, part, "reml", SETTINGS)
    assert result.lengths is not None
    assert result.angles is not None
    assert [label[1] for label in result.lengths.tables.labels] == ["a-b", "c-a"]
    # A length has the scatter of two holes.
    s = np.sqrt(result.lengths.components.part)
    assert (np.abs(s / (0.01 * np.sqrt(2)) - 1) < 4 / np.sqrt(2 * 11)).all()
    assert result.shown == ("a", "b", "c")
    few = points([("p", "a", 1, 0.0, 0.0), ("q", "a", 1, 0.001, 0.0)])
    lost = analyse_variance(few, part, "reml", SETTINGS)
    assert (lost.lengths, lost.angles) == (None, None)
    assert codes(lost).count("not-measured") == 2
    none = points([("p", "c", 1, 0.0, 0.0), ("q", "c", 1, 0.001, 0.0)])
    assert analyse_variance(none, part, "reml", SETTINGS).lengths is None


def test_no_repeats_one_part_and_empty_cells() -> None:
    no_repeats = analysed(study(8, 1, 1))
    assert codes(no_repeats) == ["no-repeats"]
    one = no_repeats.features
    assert np.isnan([*one.components.part, *one.components.repeat, *one.one_way.F]).all()
    np.testing.assert_allclose(one.u_mean, np.sqrt(one.one_way.ms_between / 8))
    one_part = analysed(study(1, 3, 1))
    assert codes(one_part) == ["one-part"]
    assert np.isnan(one_part.features.u_mean).all()
    assert np.isfinite(one_part.features.components.repeat).all()
    assert one_part.unusual is None
    three = analysed(study(3, 2, 1))
    assert codes(three) == ["few-parts"]
    assert three.unusual is None
    found = study(8, 2, 1)
    gaps = analysed(_rows(found, ~((found.part == 2) & (found.feature == 1))))
    assert codes(gaps) == ["empty-cells"]
    assert "part 'P2' was not measured at b x" in gaps.warnings[0].message
    assert gaps.features.one_way.parts.tolist().count(7) == 2


def test_repeats_without_scatter() -> None:
    found = study(8, 1, 1)
    rows = [
        (found.parts[p], found.features[f], r, *(m - n)[:2])
        for p, f, m, n in zip(found.part, found.feature, found.measured, found.nominal, strict=True)
        for r in (1, 2)
    ]
    result = analysed(points(rows))
    assert codes(result) == ["zero-variance"]
    one = result.features
    assert np.isnan(one.one_way.F).all()
    assert (one.components.repeat == 0).all()
    assert np.isfinite(one.u_future).all()
    assert (one.interval[:, 0] > 0).all()


def test_totals() -> None:
    found = study(21, 2, 3, 0.01, 0.005)
    result = analysed(found)
    x, y = result.totals
    assert (x.axis, y.axis, x.features, x.tested) == ("x", "y", 3, 3)
    rows = [0, 1, 2]
    assert x.part == pytest.approx(result.features.components.part[rows].mean())
    assert x.repeat_share == pytest.approx(x.repeat / (x.part + x.repeat))
    assert abs(x.largest) == np.abs(result.features.one_way.mean[rows]).max()
