"""Predicted against measured: parts that the true machine makes and ones it does not, every figure
of an item by hand, and the tests behind the verdicts against draws.
"""

import math
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from compare_trials import fitted, made, study
from compare_trials import predicted as prediction
from measured_examples import PLACES, part_file, points
from measured_examples import study as three_holes
from model_examples import stated
from scipy.special import fdtrc, ndtr

from mtu_cli.analyses.compare import Compared, CompareResult, compare, compared, judged
from mtu_cli.files.readings import Points
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import only_features
from mtu_cli.reports.compare import verdict_text
from mtu_cli.stats.anova import cells_of


def codes(result: CompareResult) -> set[str]:
    return {warning.code for warning in result.warnings}


@pytest.mark.parametrize(("passes", "parts"), [(5, 21), (2, 21), (5, 1), (5, 2)])
def test_false_alarms_from_readings_to_verdict(passes: int, parts: int) -> None:
    """Truth, readings, fit, parts, comparison: 5 % of studies at most, with 8 or 2 degrees of
    freedom of the passes, and of few parts; of every third feature of the part.
    """
    _, truth, whole = study()
    own = whole.part.model_copy(update={"orthogonality": None, "features": {
        name: place for name, place in whole.part.features.items() if int(name) % 3 == 0
    }})  # fmt: skip
    part, runs, alarms = replace(whole, part=own), 40 if parts > 2 else 20, 0
    for seed in range(runs):
        points = made(truth, part, seed + 1_000_000, parts=parts)
        found = compare(fitted(passes, seed), part, points, Settings())
        kinds = [kind for kind in (found.features, found.lengths) if kind is not None]
        alarms += any(v not in ("consistent", None) for kind in kinds for v in kind.verdicts)
    assert alarms / runs < 0.05 + 3.3 * np.sqrt(0.05 * 0.95 / runs)


def test_faults_are_found_with_seven_runs_and_no_scatter_with_two() -> None:
    _, truth, part = study()
    off = made(truth, part, 1, offset=0.02)
    loose = made(truth, part, 2)
    # Each part as a whole is off, by 40 um in standard deviation.
    z = np.random.default_rng(2).standard_normal((len(loose.parts), 3))
    offsets = (0.04 * z / z.std(axis=0, ddof=1))[loose.part]
    loose = replace(loose, measured=loose.measured + offsets)
    model = fitted(7, 7)
    biased = compare(model, part, off, Settings()).features
    x = [i for i, label in enumerate(biased.labels) if label[2] == "x"]
    assert all(biased.biased[i] for i in x)
    assert not any(biased.under_predicted)
    scattered = compare(model, part, loose, Settings())
    assert all(scattered.features.under_predicted)
    # A shift of the whole part leaves its lengths alone.
    assert scattered.lengths is not None
    assert not any(scattered.lengths.under_predicted)
    few = compare(fitted(2, 7), part, loose, Settings())
    assert not any(few.features.under_predicted)


STEP = """
components:
  dx_x: {of: x, unit: um, coefficients: [1, 0.01], u_future: 1}
  dy_y: {of: y, unit: um, coefficients: [-2, 0.02], u_future: 1}
  crash: {unit: um, coefficients: [8], u_future: 0.1}
equations: {Ex: dx_x + crash*step(sequence - 5.5), Ey: dy_y}
"""


def test_an_effect_that_differs_from_part_to_part_is_taken_at_each_part(tmp_path: Path) -> None:
    """8 um from the sixth of seven parts on: 16/7 um in the mean, none at the mean sequence 4."""
    rows = [
        (str(part), name, repeat, 0.0, 0.0)
        for part in range(1, 8)
        for name in PLACES
        for repeat in (1, 2)
    ]
    found = points(rows)
    x, y = found.nominal[:, 0], found.nominal[:, 1]
    late = found.sequence >= 6
    assert late.sum() == len(late) * 2 / 7
    model = [1e-3 + 1e-5 * x + 8e-3 * late, -2e-3 + 2e-5 * y, np.zeros(len(x))]
    rng = np.random.default_rng(5)
    noise = 1e-4 * rng.standard_normal(found.measured.shape)
    measured = found.nominal + np.column_stack(model) + noise
    result = compare(
        stated(tmp_path, STEP), part_file(tmp_path), replace(found, measured=measured), Settings()
    )
    features = result.features
    for i, (_, name, axis) in enumerate(features.labels):
        if axis == "x":
            wanted = 1e-3 + 1e-5 * PLACES[name][0] + 8e-3 * 2 / 7
            assert features.predicted.mean[i] == pytest.approx(wanted)
            assert features.measured.mean[i] == pytest.approx(wanted, abs=4 * 1e-4 / np.sqrt(14))
            # The scatter that is left is the noise of the readings, not the step.
            assert features.one_way.ms_between[i] < 1e-7


SIMPLE = """
components:
  dx: {unit: um, coefficients: [0], u_future: 10}
  dy: {unit: um, coefficients: [0], u_future: 10}
equations: {Ex: dx, Ey: dy}
"""


@pytest.mark.filterwarnings("error")
def test_every_missing_figure_has_a_warning(tmp_path: Path) -> None:
    model, part = stated(tmp_path, SIMPLE), part_file(tmp_path)
    whole = three_holes(6, 2, 1)

    def told(found: Points, datum: str = "none") -> set[str]:
        return codes(compare(model, part, found, Settings(), datum))  # type: ignore[arg-type]  # a literal

    # Its lengths are predicted to have no uncertainty: the machine only shifts its parts.
    always = {"not-estimable"}
    assert told(whole) == always
    assert told(three_holes(1, 2, 1)) == always | {"few-parts"}
    assert told(three_holes(4, 2, 1)) == always | {"few-parts"}
    assert told(three_holes(6, 1, 1)) == always | {"no-repeats"}
    keep = np.arange(len(whole)) != 5
    assert told(whole.where(keep)) == always
    assert told(whole.where(keep), "offset") - told(whole, "offset") == {"missing-values"}
    assert told(only_features(whole, "ab")) == always | {"not-measured"}
    alone = compare(model, part, only_features(whole, "a"), Settings(), "offset,rotation")
    assert set(alone.features.verdicts) == {None}
    assert {"not-tested", "not-measured", "not-estimable"} <= codes(alone)


K = 2.0
DRAWS = 400_000


def tables(*parts: list[float]) -> MeasuredTables:
    """One feature whose parts have these values."""
    values = np.array([value for own in parts for value in own], dtype=float)
    cell = np.repeat(np.arange(len(parts)), [len(own) for own in parts])
    names = tuple(f"P{p}" for p in range(len(parts)))
    cells = cells_of(values, cell, 1, len(parts))
    return MeasuredTables(labels=(("", "a", "x"),), parts=names, cells=cells)


def predicted(
    mean: float = 5.0,
    coefficients: float = 9.0,
    scatter: float = 4.0,
    dof: tuple[float, float] = (3.0, 8.0),
) -> Prediction:
    """One item: the coefficients' variance and the scatter, a mean square each."""
    one = np.ones(1)
    return prediction(mean * one, coefficients * one, scatter * one, 16 * one, dof)


def evidence(measured: MeasuredTables, of: Prediction, k: float) -> Compared:
    """The one item against its prediction."""
    return compared(measured, {"": (of, np.eye(1))}, k)


def drawn(squares: list[float], dof: list[float]) -> np.ndarray:
    """Draws of the variance that mean squares tell of."""
    rng = np.random.default_rng(5)
    rows = [c * nu / rng.chisquare(nu, DRAWS) for c, nu in zip(squares, dof, strict=True)]
    total: np.ndarray = np.sum(rows, axis=0)
    return total


def same_tail(p: float, tails: np.ndarray) -> None:
    """Within four standard errors of the draws, and 0.5 % for the nodes."""
    assert p == pytest.approx(tails.mean(), abs=4 * tails.std() / np.sqrt(DRAWS) + 0.005 * p)


SIX: list[list[float]] = [[10, 12], [4, 2]] * 3
NO_REPEATS: list[list[float]] = [[11], [3]] * 4
ms, nan, root = 8 * 16 / 7, math.nan, math.sqrt
HAND: dict[str, tuple[list[list[float]], float, dict[str, float], tuple[list[float], ...]]] = {
    # Means 11 and 3 about 7, MS_between = 2 (16 + 16) = 64 with one degree of freedom, MS_within =
    # (2 + 2)/2 = 2 with two, n0 = 2, s_part^2 = 31. A future part about the measured mean: 31 +
    # (31/2 + 2/4). The bias of two parts: the predicted scatter, halved, and the CMM's.
    "two parts": (
        [[10, 12], [4, 2]],
        4.0,
        {
            "one_way.mean": 7, "one_way.ms_between": 64, "one_way.ms_within": 2, "one_way.n0": 2,
            "predicted.mean": 5, "predicted.u": root(13), "predicted.width": 2 * (5 + 2 * root(13)),
            "independent.u": 4, "independent.width": 2 * (5 + 2 * 4),
            "s_part": root(31), "measured.u": root(47), "measured.width": 2 * (7 + 2 * root(47)),
            "measured_paper.u": root(80), "measured_paper.width": 2 * (7 + 2 * root(80)),
            "bias": 2, "u_difference": root(9 + 4 / 2 + 2 / 4), "E_n": 2 / (2 * root(11.5)),
            "ratio_ms": 64 / (2 + 2 * 4), "ratio_u": root(47 / 13), "ratio_scatter": root(31 / 4),
            "ratio_range": (7 + 2 * root(47)) / (5 + 2 * root(13)), "paper_ratio_u": root(80) / 4,
            "paper_ratio_range": (7 + 2 * root(80)) / 13, "ms_share": 8 / root(31),
        },
        ([9, 2, 0.5], [3, 8, 2]),
    ),
    # MS_between = 6 x 2 x 16/5, s_part^2 = 18.2: of the mean 18.2/6 + 2/12 = 3.2, where the
    # prediction has 4/6 + 2/12. From five parts on the larger counts.
    "six parts": (
        SIX, 4.0, {"one_way.ms_between": 38.4, "u_difference": root(9 + 3.2)}, ([9, 3.2], [3, 5]),
    ),
    "six parts and more scatter predicted": (
        SIX, 60.0, {"u_difference": root(9 + 60 / 6 + 2 / 12)}, ([9, 10, 2 / 12], [3, 8, 6]),
    ),
    # MS_between, of which nothing can be split off, stands for parts and CMM.
    "no repeats": (
        NO_REPEATS,
        4.0,
        {
            "ratio_ms": ms / 4, "p_scatter": float(2 * fdtrc(7, 8, ms / 4)),
            "ratio_scatter": root(ms / 4),
            "measured.u": root(ms * (1 + 1 / 8)), "s_part": nan, "ms_share": nan,
        },
        ([9, ms / 8], [3, 7]),
    ),
    # Mean 11, u^2 = 9 + 4 + 2/2, no scatter to speak of.
    "one part": (
        [[10, 12]],
        4.0,
        {"bias": 6, "u_difference": root(14), "E_n": 6 / (2 * root(14)), "p_scatter": nan,
         "ratio_ms": nan, "ratio_u": nan, "ms_share": nan},
        ([9, 4, 1], [3, 8, 1]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", HAND)
def test_figures_by_hand(case: str) -> None:
    """Predicted: 5, C = 9 (3 degrees of freedom), D + visit = 4 or more (8)."""
    parts, scatter, figures, squares = HAND[case]
    found = evidence(tables(*parts), predicted(scatter=scatter), K)
    for name, expected in figures.items():
        value = attrgetter(name)(found)[0]
        assert value == pytest.approx(expected, rel=0.005 * ("p_" in name), nan_ok=True), name
    same_tail(found.p_bias[0], 2 * ndtr(-abs(found.bias[0]) / np.sqrt(drawn(*squares))))
    if case == "two parts":
        high = 2 * ndtr(-np.sqrt(64 / drawn([8, 2], [8, 2])))
        same_tail(found.p_scatter[0], 2 * np.minimum(high, 1.0))


@pytest.mark.filterwarnings("error")
def test_nothing_predicted() -> None:
    """Scatter and difference where none are predicted have p = 0; neither, no test at all."""
    nothing = predicted(0.0, 0.0, 0.0)
    found = evidence(tables([3.0], [4.0], [5.0]), nothing, K)
    assert (found.p_scatter[0], found.ratio_ms[0]) == (0, np.inf)
    (item,) = judged(found)
    assert item.verdicts == ("under-predicted",)
    # Repeats tell the CMM's scatter, which is what MS_between then is measured by.
    both = evidence(tables([3.0, 3.2], [4.0, 4.2], [5.0, 5.2]), nothing, K)
    assert both.p_scatter[0] == pytest.approx(2 * fdtrc(2, 3, 2 / 0.02), rel=0.005)
    still = evidence(tables([0.0], [0.0]), nothing, K)
    assert np.isnan([still.p_bias[0], still.p_scatter[0], still.E_n[0], still.ratio_u[0]]).all()
    assert judged(still)[0].verdicts == (None,)
    off = evidence(tables([1.0]), nothing, K)
    assert off.p_bias[0] == 0


def judged_of(p_bias: list[float], p_scatter: list[float], ratio: list[float]) -> Compared:
    """Items with these p values; all else is of no account."""
    m = len(p_bias)
    one = evidence(tables(*SIX), predicted(), K)
    one_way = replace(one.one_way, parts=np.full(m, 21.0))
    return replace(
        one, labels=(("", "a", "x"),) * m, one_way=one_way, p_bias=np.array(p_bias),
        p_scatter=np.array(p_scatter), ratio_ms=np.array(ratio),
    )  # fmt: skip


def test_every_fault_is_stated_and_the_gravest_named() -> None:
    few, many = 1e-9, 1.0
    p_bias, p_scatter = [few, few, many, many, few], [few, many, few, many, few]
    (found,) = judged(judged_of(p_bias, p_scatter, [9, 1, 0.1, 1, 0.1]))
    assert found.outcome == [
        "under-predicted, biased", "biased", "over-predicted", "consistent",
        "biased, over-predicted",
    ]  # fmt: skip
    assert found.verdicts == (
        "under-predicted", "biased", "over-predicted", "consistent", "biased",
    )  # fmt: skip


@pytest.mark.parametrize(("share", "verdict"), [(0.999, "biased"), (1.001, "consistent")])
def test_one_family_of_all_tests(share: float, verdict: str) -> None:
    """0.05/8: four items, two of each kind, with two tests each."""
    features = judged_of([share * 0.05 / 8, 1], [1, 1], [1, 1])
    found, others = judged(features, judged_of([1, 1], [1, 1], [1, 1]))
    assert (*found.verdicts, *others.verdicts) == (verdict, *["consistent"] * 3)


# The pooled scatter of all features: the power of its test.


def loose(points: Points, factor: float) -> Points:
    """Parts that scatter `factor` times as much about the mean of each feature."""
    measured = points.measured.copy()
    for feature in np.unique(points.feature):
        own = points.feature == feature
        mean = points.measured[own].mean(axis=0)
        for part in np.unique(points.part):
            rows = own & (points.part == part)
            measured[rows] += (factor - 1) * (points.measured[rows].mean(axis=0) - mean)
    return replace(points, measured=measured)


def study_of(seed: int, factor: float, passes: int = 10) -> CompareResult:
    _, truth, part = study()
    points = loose(made(truth, part, seed + 1_000_000), factor)
    return compare(fitted(passes, seed), part, points, Settings())


def test_scatter_that_no_feature_shows_is_found_in_all() -> None:
    """21 parts that all scatter 1.5 times: of 30 studies more than a third, where single features
    show it in a sixth at most.
    """
    results = [study_of(seed, 1.5) for seed in range(30)]
    found = [result.features.pooled[""] for result in results]
    single = [any(result.features.under_predicted) for result in results]
    assert sum(own.verdict == "under-predicted" for own in found) > 10
    assert sum(single) < 6
    ratios = np.array([own.ratio for own in found])
    # By chance of the fit, of 10 passes, too.
    assert ratios.mean() == pytest.approx(1.5, abs=4 * ratios.std() / np.sqrt(30))
    summaries = [s for result in results for s in result.features.summaries if s.pooled_fault]
    assert verdict_text(summaries[0]).startswith("features: under-predicted (pooled scatter ")
