"""The analysis of measured parts: uncertainties, methods, outliers, capability, warnings."""

from dataclasses import replace
from pathlib import Path

import measured_examples
import numpy as np
import pytest
from measured_examples import points, study, with_measured
from scipy.stats import ncx2
from support import codes

from mtu_cli.analyses.anova import AnovaResult, analyse_variance
from mtu_cli.analyses.anova.tables import Method, noncentrality, radial_quantile
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import Points
from mtu_cli.model.settings import Settings
from mtu_cli.stats import outliers

SETTINGS = Settings()


def analysed(found: Points, method: Method = "reml") -> AnovaResult:
    return analyse_variance(found, None, method, SETTINGS)


UNEVEN = (6, 6, 1, 1, 1, 1, 1, 2)
STUDIES, HOLES = 45, 20
"""Studies of many holes, for each of them is drawn anew: 1800 values along x and y."""


@pytest.fixture
def many_holes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A study has `HOLES` of them, and rows that stand out are not what is looked at."""
    places = {f"h{i}": (40.0 * (i % 5), 30.0 * (i // 5)) for i in range(HOLES)}
    monkeypatch.setattr(measured_examples, "PLACES", places)
    monkeypatch.setattr(outliers, "ROTATIONS", 19)


def uneven(seed: int, s_part: float, s_repeat: float) -> Points:
    """Eight parts with unequal repeats, and a ninth that is measured once: the future one."""
    rng = np.random.default_rng(seed)
    rows = []
    for p, repeats in enumerate((*UNEVEN, 1)):
        for name in measured_examples.PLACES:
            made = s_part * rng.standard_normal(2)
            rows += [(f"P{p}", name, r, *(made + s_repeat * rng.standard_normal(2)))
                     for r in range(repeats)]  # fmt: skip
    return points(rows)


@pytest.mark.usefixtures("many_holes")
@pytest.mark.parametrize(("s_part", "s_repeat"), [(0.01, 0.004), (0.002, 0.008)])
def test_uncertainties_of_mean_and_future_part_hold(s_part: float, s_repeat: float) -> None:
    """Over many studies the mean scatters by u_mean and a further part about it by u_future.

    With very unequal repeats: the mean of all readings leans on the parts measured often.
    """
    means, future, u2_future = [], [], []
    N = sum(UNEVEN)
    expected = s_part**2 * sum(n * n for n in UNEVEN) / N**2 + s_repeat**2 / N
    for seed in range(STUDIES):
        found = uneven(seed, s_part, s_repeat)
        one = analysed(found.where(found.part < 8)).features
        means.append(one.one_way.mean)
        u2_future.append(one.u_future**2)
        last = found.measured[found.part == 8] - found.nominal[found.part == 8]
        future.append(last[:, :2].T.ravel() - one.one_way.mean)
    # 1800 values, independent: four standard errors.
    rel = 4 / np.sqrt(2 * np.size(means))
    assert np.sqrt(np.mean(np.square(means))) == pytest.approx(np.sqrt(expected), rel=rel)
    if s_part > s_repeat:
        # The ninth part's measurement has the CMM's scatter in it, which a future part has not.
        seen = np.mean(np.square(future)) - s_repeat**2
        rel = 4 * np.sqrt(2 / np.size(future)) * (1 + (s_repeat / s_part) ** 2)
        assert seen == pytest.approx(s_part**2 + expected, rel=rel)
        assert np.mean(u2_future) == pytest.approx(s_part**2 + expected, rel=rel)


@pytest.mark.usefixtures("many_holes")
@pytest.mark.parametrize("s_part", [0.003, 0.01, 0.03])
def test_a_future_part_lies_in_its_interval(s_part: float) -> None:
    """With five parts, 95 % and not much less; more where the CMM hides the parts' scatter."""
    inside = []
    for seed in range(STUDIES):
        low, high = analysed(study(5, 2, seed, s_part, 0.01)).features.interval_future.T
        made = s_part * np.random.default_rng(seed + 10_000).standard_normal(2 * HOLES)
        inside += ((low <= made) & (made <= high)).tolist()
    assert np.mean(inside) >= 0.95 - 3 * np.sqrt(0.05 * 0.95 / len(inside))


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
    assert np.isnan(results["paper"].interval).all()
    np.testing.assert_array_equal(results["paper"].dof_future, 21)
    assert analysed(found, "paper").totals[0].part == pytest.approx(table.ms_between[:3].mean())
    assert codes(analysed(study(21, 2, 2))) == []


def test_a_shifted_part_and_a_shifted_feature_are_named() -> None:
    found = study(21, 2, 4)
    measured = found.measured.copy()
    measured[found.part == 6, 0] += 0.06
    result = analysed(with_measured(found, measured))
    assert result.unusual is not None
    (item,) = result.unusual
    assert (item.part, item.where[2]) == ("P6", "x")
    assert item.deviation == pytest.approx(0.06, rel=0.3)
    assert item.p <= 0.01
    measured = found.measured.copy()
    measured[(found.part == 3) & (found.feature == 1), 1] += 0.12
    result = analysed(with_measured(found, measured))
    assert result.unusual is not None
    (item,) = result.unusual
    assert (item.part, item.singles[0]) == ("P3", ("", "b", "y"))
    labels = result.features.tables.labels
    assert result.features.unusual[labels.index(("", "b", "y"))] == ("P3",)


def test_no_repeats_one_part_and_empty_cells() -> None:
    no_repeats = analysed(study(8, 1, 1))
    assert codes(no_repeats) == ["no-repeats"]
    one = no_repeats.features
    assert np.isnan([*one.components.part, *one.components.repeat, *one.one_way.F]).all()
    np.testing.assert_allclose(one.u_mean, np.sqrt(one.one_way.ms_between / 8))
    np.testing.assert_array_equal(one.both, one.one_way.ms_between)
    assert no_repeats.totals[0].both == pytest.approx(one.both[:3].mean())
    one_part = analysed(study(1, 3, 1))
    assert codes(one_part) == ["few-parts"]
    assert np.isnan(one_part.features.u_mean).all()
    assert np.isfinite(one_part.features.components.repeat).all()
    assert one_part.unusual is None
    assert codes(analysed(study(1, 1, 1))) == ["few-parts", "no-repeats"]
    three = analysed(study(3, 2, 1))
    assert codes(three) == ["few-degrees-of-freedom", "few-parts"]
    assert three.unusual is None
    # The t quantile for 2 degrees of freedom is 4.303.
    features = analysed(study(3, 1, 1)).features
    half = (features.interval_future[:, 1] - features.interval_future[:, 0]) / 2
    np.testing.assert_allclose(half, 4.303 * features.u_future, rtol=1e-4)
    found = study(8, 2, 1)
    gaps = analysed(found.where(~((found.part == 2) & (found.feature == 1))))
    assert codes(gaps) == ["missing-values"]
    assert (gaps.warnings[0].facts["part"], gaps.warnings[0].facts["label"]) == ("P2", "b x")
    assert gaps.features.one_way.parts.tolist().count(7) == 2
    # No part is due at a machine that did not make it.
    nested = replace(found, operations=("A", "B"), operation=found.part % 2)
    assert "missing-values" not in codes(analysed(nested))


def missing(points_read: Points, part: LoadedPart | None = None) -> list[tuple[str, str]]:
    """What is missing of how many, and the first of it."""
    result = analyse_variance(points_read, part, "reml", SETTINGS)
    gaps = [each.facts for each in result.warnings if each.code == "missing-values"]
    return [(each["what"], each["names"][0]) for each in gaps]


def test_parts_are_due_where_most_parts_of_their_operation_are(tmp_path: Path) -> None:
    """Crossed with another one, and of a kind that a part has nothing of; nested ones are not."""
    drilled, milled = study(6, 2, 1), study(6, 2, 2)
    of = np.repeat([0, 1], len(drilled.part))
    rows = np.tile(np.arange(len(drilled.part)), 2)
    both = replace(drilled.where(rows), operations=("drilled", "milled"), operation=of,
                   measured=np.concatenate([drilled.measured, milled.measured]))  # fmt: skip
    assert missing(both) == []
    gap = both.where(~((both.part == 3) & (both.operation == 1)))
    assert missing(gap) == [("6 of 72 measurements by part", "first: part 'P3' at milled a x")]
    # Milled is a single control part of another machine, or a selection.
    for few in ((0,), (0, 1)):
        selected = both.where((both.operation == 0) | np.isin(both.part, few))
        assert missing(selected) == []
    path = tmp_path / "part.yaml"
    path.write_text(measured_examples.PART.replace(", {from: c, to: a}", ""), "utf-8")
    no_b = drilled.where(~((drilled.part == 3) & (drilled.feature == 1)))
    found = missing(no_b, load_part(path))
    assert ("1 of 6 lengths by part", "first: part 'P3' at a-b") in found


def test_set_up_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """One offset and turn of all features is taken out by a datum."""
    places = {f"h{i}": (40.0 * (i % 4), 30.0 * (i // 4)) for i in range(12)}
    monkeypatch.setattr(measured_examples, "PLACES", places)
    found = study(1, 1, 3, 0.003, 0.0)
    turn = np.column_stack([-found.nominal[:, 1], found.nominal[:, 0], np.zeros(len(found))])
    moved = with_measured(found, found.measured + 5e-4 * turn + np.array([0.05, -0.03, 0.0]))
    loose = analyse_variance(moved, None, "reml", SETTINGS, "offset,rotation")
    # 24 errors less three freedoms of 3 um each are left, to four standard errors.
    rms = np.sqrt((loose.features.one_way.mean**2).sum() / 21)
    assert rms == pytest.approx(0.003, rel=4 / np.sqrt(2 * 21))


def test_no_outlier_and_no_u_is_made_of_rounding() -> None:
    """Parts far more alike than the last digit, one of which is rounded the other way; and errors
    of which the datum leaves nothing but the rounding of the arithmetic.
    """
    alike = study(12, 2, 1, 1e-6, 1e-6)
    coarse = with_measured(alike, np.round(alike.measured, 3))
    measured = coarse.measured.copy()
    measured[coarse.part == 4, 0] += 1e-3
    measured[coarse.part == 5, 1] += 1e-3
    result = analysed(with_measured(coarse, measured))
    assert result.unusual == ()
    # One last digit of the mean, once for all readings.
    one = result.features.u_mean
    assert (one >= 1e-3 / np.sqrt(12)).all()
    assert (one < 1.5 * 1e-3 / np.sqrt(12)).all()
    left = points([(f"P{p}", "a", 0, 0.01 * p, 0.02 * p) for p in range(8)])
    result = analyse_variance(left, None, "reml", SETTINGS, "offset")
    assert result.unusual == ()
    assert (result.features.one_way.F[np.isfinite(result.features.one_way.F)] < 10).all()


TOLERANCED = """\
schema: mtu/part/1
name: toleranced
features: {a: {x_mm: 10, y_mm: 20}, b: {x_mm: 110, y_mm: 21}}
lengths: [{from: a, to: b, tolerance_um: 20}]
"""


def lengths_of(folder: Path, errors: list[float], sequence: list[int] | None = None) -> AnovaResult:
    """Parts whose length a-b is off by these, um, in the order of the sequence."""
    path = folder / "part.yaml"
    path.write_text(TOLERANCED)
    rows = [(f"P{p}", name, 0, 1e-3 * error * (name == "b"), 0.0)
            for p, error in enumerate(errors) for name in "ab"]  # fmt: skip
    found = points(rows)
    order = np.array(sequence or range(1, len(errors) + 1))
    return analyse_variance(
        replace(found, sequence=order[found.part]), load_part(path), "reml", SETTINGS
    )


def test_capability_of_a_length(tmp_path: Path) -> None:
    """Against a plain calculation; the intervals of Montgomery, Introduction to Statistical Quality
    Control, example 8.4 (n = 20, Cp 1.29: 0.89 to 1.69) and a large-sample one of Bissell (1990).
    """
    rng = np.random.default_rng(1)
    values = rng.standard_normal(20)
    values = 4.0 + (20 / 3 / 1.29) * (values - values.mean()) / values.std(ddof=1)
    (item,) = lengths_of(tmp_path, values.tolist()).capabilities
    assert (item.kind, item.id, item.low, item.high) == ("length", "a-b", -0.02, 0.02)
    assert item.pp == pytest.approx(1.29, rel=1e-4)
    assert item.pp_interval == pytest.approx((0.89, 1.69), abs=0.01)
    assert item.ppk == pytest.approx(16 / (20 / 1.29), rel=1e-4)
    half = 1.96 * np.sqrt(1 / (9 * 20) + item.ppk**2 / (2 * 19))
    assert item.ppk_interval == pytest.approx((item.ppk - half, item.ppk + half), abs=0.03)
    moving = np.abs(np.diff(values)).mean() / 1.128
    assert (item.cp, item.cpk) == pytest.approx((20 / (3 * moving), 16 / (3 * moving)), rel=1e-4)


def test_capability_far_off_its_limits_is_calculated(tmp_path: Path) -> None:
    """Where t is large its noncentrality goes on as sqrt(chi^2/dof): the series of the distribution
    would hardly end.
    """
    for dof in (2, 9, 299):
        near, far = (noncentrality(dof, 0.975, t) / t for t in (-999.9, -1000.1))
        assert near == pytest.approx(far, rel=5e-4)
        assert noncentrality(dof, 0.025, -4e6) > noncentrality(dof, 0.975, -4e6)
    (item,) = lengths_of(tmp_path, [150e3 + i for i in range(8)]).capabilities
    low, high = item.ppk_interval
    assert low < item.ppk < high < 0


def test_capability_of_a_position_and_an_angle(tmp_path: Path) -> None:
    """A zone of 0.1 mm about the place; s of 10 um along both axes: 50/34.4 of a centred hole."""
    text = measured_examples.PART.replace("y_mm: 20}", "y_mm: 20, position_um: 100}")
    text = text.replace("{id: xy, ", "{id: xy, tolerance_arcsec: [-60, 30], ")
    (tmp_path / "part.yaml").write_text(text)
    found = study(2000, 1, 5)
    result = analyse_variance(found, load_part(tmp_path / "part.yaml"), "reml", SETTINGS)
    item, angle = result.capabilities
    assert (item.kind, item.id, angle.kind, angle.id) == ("position", "a", "angle", "xy")
    assert item.ppk == pytest.approx(0.05 / (0.01 * np.sqrt(-2 * np.log(0.0027))), rel=0.05)
    assert np.isnan([item.pp, item.cp, item.cpk, *item.ppk_interval]).all()
    radial = np.hypot(*(found.measured - found.nominal)[found.feature == 0, :2].T)
    np.testing.assert_allclose(item.values, radial)
    arcsec = np.pi / 648000
    assert (angle.low, angle.high) == pytest.approx((-60 * arcsec, 30 * arcsec))
    assert angle.ppk == pytest.approx((angle.high - angle.mean) / (3 * angle.s))


@pytest.mark.parametrize("size", [0.0, 2.0])
def test_the_quantile_of_a_radial_error(size: float) -> None:
    """Equal variances: sqrt of a noncentral chi-squared; unequal ones against samples."""
    centre = np.array([size, 0.0])
    expected = np.sqrt(ncx2.ppf(0.9973, 2, max(size**2, 1e-12)))
    assert radial_quantile(centre, np.eye(2), 0.9973) == pytest.approx(expected, rel=1e-6)
    C = np.array([[1.0, 0.6], [0.6, 0.5]])
    drawn = np.random.default_rng(1).multivariate_normal(centre, C, 400_000)
    within = np.mean(np.hypot(*drawn.T) <= radial_quantile(centre, C, 0.9973))
    assert within == pytest.approx(0.9973, abs=4 * np.sqrt(0.0027 / 400_000))
