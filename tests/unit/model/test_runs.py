"""Runs there and back: who is a run, and what the two passes of one share, to the prediction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_trials import Drift, machine, read_machine
from model_examples import Segment, loaded, readings
from numpy.typing import NDArray
from reading_examples import only

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.close_loop_sealed.model.reading_tables import reading_tables
from mtu_cli.files.reports_read import components_from
from mtu_cli.files.source import Source
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report, fit_machine
from mtu_cli.model.fit_warnings import scatter_warnings
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.passes import fellows, runs_of, ways
from mtu_cli.model.prediction import predict
from mtu_cli.reports.fit_components import document

FloatArray = NDArray[np.float64]

P = np.linspace(0.0, 90.0, 4)
RUNS = 5
COLUMNS = ("position", "error", "passes", "direction")
MACHINE = """
components: {a: {of: x, unit: mm}, b: {of: y, unit: mm}}
equations: {Ex: a, Ey: b}
"""


def there_and_back(seed: int, *, one_way: bool = False, shared: float = 3.0) -> list[Segment]:
    """Two components in the same runs: level and slope of each run, of each pass, and noise."""
    rng = np.random.default_rng(seed)
    found = []
    for name in "ab":
        line = shared * rng.normal(size=(RUNS, 1, 2)) + rng.normal(size=(RUNS, 2, 2))
        line[..., 1] *= 0.01
        error = line[..., :1] + line[..., 1:] * (P - P.mean())
        error = error + 0.5 * rng.standard_normal(error.shape) + [[2.0], [0.0]]
        number = np.arange(2 * RUNS) if one_way else np.repeat(np.arange(RUNS), 2)
        found.append(
            Segment(
                name=name,
                position=np.tile(P, 2 * RUNS),
                error=error.ravel(),
                passes=np.repeat(number + 1, len(P)),
                direction=np.tile(np.repeat([1, -1], len(P)), RUNS),
            )
        )
    return found


def test_passes_of_one_number_are_a_run() -> None:
    keys = np.array([[0, 1], [0, 2], [1, 1]])
    code = np.array([0, 0, 1, 1, 2, 2])
    sign = np.array([1, -1, 1, -1, 1, -1])
    way = ways(code, sign, 3)
    assert way.tolist() == [0, 0, 0]
    assert runs_of(keys, np.arange(3), way).tolist() == [0, 1, 2]


def test_passes_that_each_run_one_way_are_paired_in_their_order() -> None:
    """All there before all back: the n-th of each of a file; what is over stays alone."""
    keys = np.array([[0, 1], [0, 2], [0, 3], [0, 4], [0, 5], [1, 1], [1, 2]])
    sign = np.array([1, 1, 1, -1, -1, -1, 1])
    way = ways(np.arange(7), sign, 7)
    assert way.tolist() == sign.tolist()
    assert runs_of(keys, np.arange(7), way).tolist() == [0, 1, 2, 0, 1, 3, 3]
    # The other way round in time: 5 4 back, 3 2 1 there.
    assert runs_of(keys, np.arange(7)[::-1], way).tolist() == [3, 2, 1, 2, 1, 0, 0]
    # Of a pass without a direction, or both, nothing is told: not of its file either.
    half = np.array([1, -1, 0, 1, -1, -1, 1])
    assert runs_of(keys, np.arange(7), half).tolist() == [0, 1, 2, 3, 4, 5, 5]


def test_a_pass_that_is_missing_leaves_its_fellow_alone(tmp_path: Path) -> None:
    """1 there, 2 back, 3 there, (4 is lost), 5 there, 6 back: neighbours are runs, 3 is none."""
    keys = np.array([[0, 1], [0, 2], [0, 3], [0, 5], [0, 6]])
    way = np.array([1, -1, 1, 1, -1])
    assert runs_of(keys, np.arange(5), way).tolist() == [0, 0, 1, 2, 2]
    known = loaded(tmp_path, MACHINE)
    given = [
        replace(item, **{key: getattr(item, key)[item.passes != 4] for key in COLUMNS})
        for item in there_and_back(1, one_way=True)
    ]
    fit = fit_machine(known, readings(given)).components["a"].instruments[0].fit
    assert fit.pairs.tolist() == [[0, 1], [3, 4], [5, 6], [7, 8]]


@pytest.mark.parametrize("lost", range(1, 13))
def test_one_pass_that_is_lost_parts_no_others(lost: int) -> None:
    """There and back in turns, two and three blocks of all there before all back: each pass but
    the fellow of the lost one keeps its own.
    """
    number = np.delete(np.arange(1, 13), lost - 1)
    place = number - 1
    for way, fellow in (
        (1 - 2 * (place % 2), (place ^ 1)),
        (np.where(place < 6, 1, -1), (place + 6) % 12),
        (1 - 2 * (place // 3 % 2), place // 6 * 6 + (place % 6 + 3) % 6),
    ):
        wanted = {frozenset((a, b)) for a, b in zip(place, fellow, strict=True) if b != lost - 1}
        found = {frozenset(place[list(pair)].tolist()) for pair in fellows(number, way)}
        assert found == wanted
        # A count of each direction's own.
        if (place < 6).all() or (way[place < 6] > 0).all():
            own = np.where(place < 6, place, place - 6)
            assert {frozenset(place[list(p)].tolist()) for p in fellows(own, way)} == wanted


@pytest.mark.parametrize("lost", [(1, 4), (2, 3), (5, 6), (6, 7), (4, 9), (3, 12), (2, 4, 6)])
def test_passes_that_are_lost_in_turns_part_no_others(lost: tuple[int, ...]) -> None:
    number = np.setdiff1d(np.arange(1, 13), lost)
    way = np.where(number % 2 == 1, 1, -1)
    wanted = [(n, n + 1) for n in range(1, 13, 2) if not {n, n + 1} & set(lost)]
    assert [(number[i], number[j]) for i, j in fellows(number, way)] == wanted


@pytest.mark.parametrize(
    ("there", "back"),
    [
        ([1, 2, 3, 4, 5], [5, 4, 3, 2, 1]),
        ([4, 1, 5, 3, 2], [2, 5, 1, 4, 3]),
        ([1, 3, 4, 5], [1, 2, 4, 5]),
        ([2, 3, 4, 5], [1, 2, 3, 4]),
    ],
)
def test_passes_of_one_number_are_fellows_in_any_order(there: list[int], back: list[int]) -> None:
    number = np.array(there + back)
    way = np.repeat([1, -1], [len(there), len(back)])
    found = {(int(number[i]), int(number[j])) for i, j in fellows(number, way)}
    assert found == {(n, n) for n in set(there) & set(back)}


def told(text: str) -> list[str]:
    """Pairs that are found in a sequence such as 1+ 2-."""
    words = text.split()
    number = np.array([int(word[:-1]) for word in words])
    way = np.array([1 if word[-1] == "+" else -1 for word in words])
    return sorted(f"{words[i]}{words[j]}" for i, j in fellows(number, way))


@pytest.mark.parametrize(
    ("passes", "pairs"),
    [
        ("1+ 2- 3+ 4- 1- 2+ 3- 4+", "1+2- 3+4- 1-2+ 3-4+"),
        ("1+ 2- 3+ 4- 4+ 5- 6+ 7-", "1+2- 3+4- 4+5- 6+7-"),
        ("1+ 2- 3+ 4- 5+ 6- 1- 2+", "1+2- 3+4- 5+6- 1-2+"),
        ("1+ 2+ 3+ 4+ 5+ 5- 6- 7- 8- 9-", "1+5- 2+6- 3+7- 4+8- 5+9-"),
        # The next day begins where the machine stands.
        ("1+ 2- 3+ 1- 2+ 3-", "1+2- 1-2+"),
        ("1+ 2- 3+ 4- 5+ 1- 2+ 3- 4+ 5-", "1+2- 3+4- 1-2+ 3-4+"),
    ],
)
def test_a_number_that_coincides_by_chance_decides_nothing(passes: str, pairs: str) -> None:
    assert told(passes) == sorted(pairs.split())


@pytest.mark.parametrize(
    ("passes", "pairs"),
    [
        ("5+ 1- 6+ 2- 7+ 3-", "5+1- 6+2- 7+3-"),
        ("1+ 2+ 3+ 6- 5- 4-", "1+6- 2+5- 3+4-"),
        ("1+ 2+ 4- 3- 5+ 6+ 8- 7-", "1+4- 2+3- 5+8- 6+7-"),
        ("1+ 2- 2+ 1-", "1+1- 2-2+"),
        # A programme, and the same driven the other way.
        ("1+ 2+ 3+ 4- 1- 2- 3- 4+", "1+1- 2+2- 3+3- 4-4+"),
        ("1+ 2- 3- 1- 2+ 3+", "1+1- 2-2+ 3-3+"),
        ("1+ 2+ 3- 1- 2- 3+", "1+1- 2+2- 3-3+"),
    ],
)
def test_one_day_that_counts_in_its_own_way(passes: str, pairs: str) -> None:
    assert told(passes) == sorted(pairs.split())


def test_days_whose_way_back_counts_down() -> None:
    day = "1+ 2+ 3+ 4+ 4- 3- 2- 1-"
    assert told(f"{day} {day}") == sorted(2 * ["1+1-", "2+2-", "3+3-", "4+4-"])
    # One is lost on the way back.
    assert told(f"{day} 1+ 2+ 3+ 4+ 4- 2- 1-") == sorted([*2 * ["1+1-", "2+2-", "4+4-"], "3+3-"])


@pytest.mark.parametrize("order", ["there back there back", "there there back back", "turns"])
@pytest.mark.parametrize("lost", range(20))
def test_days_that_count_anew_are_apart(order: str, lost: int) -> None:
    """Two days of five runs, in files of a direction or in turns; one pass is lost."""
    day, run, back = (item.ravel() for item in np.indices((2, 5, 2)))
    keys = {
        "there back there back": (run, back, day),
        "there there back back": (run, day, back),
        "turns": (back, run, day),
    }
    sequence = np.delete(np.lexsort(keys[order]), lost)
    pairs = fellows(run[sequence] + 1, 1 - 2 * back[sequence])
    gone = {(int(day[i]), int(run[i])) for i in np.setdiff1d(np.arange(20), sequence)}
    found = [{(int(day[i]), int(run[i])) for i in sequence[list(pair)]} for pair in pairs]
    assert sorted(map(sorted, found)) == [
        [(d, r)] for d in (0, 1) for r in range(5) if (d, r) not in gone
    ]


@pytest.mark.parametrize(
    ("way", "wanted"),
    [
        # Counted anew where one is lost: neighbours of one orientation, or blocks.
        ("+--+-+-", [(0, 1), (3, 4), (5, 6)]),
        ("-+-+", [(0, 1), (2, 3)]),
        ("++--++--", [(0, 2), (1, 3), (4, 6), (5, 7)]),
        ("+++---", [(0, 3), (1, 4), (2, 5)]),
        ("++++", []),
    ],
)
def test_passes_counted_anew_are_neighbours_or_blocks(
    way: str, wanted: list[tuple[int, int]]
) -> None:
    signs = np.array([1 if sign == "+" else -1 for sign in way])
    for begin in (0, 1, 7):
        assert fellows(np.arange(begin, begin + len(way)), signs) == wanted
    # Of numbers that do not ascend only the sequence is used.
    assert fellows(np.arange(len(way))[::-1].copy(), signs) == wanted


def test_components_are_joint_only_where_their_runs_are_the_same(tmp_path: Path) -> None:
    """Passes of the same numbers, ways and times: a's are the runs 1/2, 3/4 and 5/6; b's first
    stands in another file, alone.
    """
    known = loaded(tmp_path, MACHINE)
    given = []
    for item in there_and_back(1, one_way=True):
        kept = item.passes <= 6 if item.passes is not None else slice(0)
        cut = {key: getattr(item, key)[kept] for key in COLUMNS}
        given.append(replace(item, **cut, time=np.arange(6.0 * len(P))))
    both = readings(given)
    fit = fit_machine(known, both)
    assert [group.components for group in fit.joint] == [("a", "b")]
    other = (both.code == 1) & (both.pass_number == 1)
    apart = replace(
        both,
        file_index=1 - other.astype(np.int64),
        sources=both.sources * 2,
        roles=both.roles * 2,
    )
    fit = fit_machine(known, apart)
    pairs = {name: item.instruments[0].fit.pairs.tolist() for name, item in fit.components.items()}
    assert pairs == {"a": [[0, 1], [2, 3], [4, 5]], "b": [[2, 3], [4, 5]]}
    assert fit.joint == ()


def test_one_run_alone_has_two_passes(tmp_path: Path) -> None:
    """They differ by what a run's do, a line each: one degree of freedom, and a word of it."""
    known = loaded(tmp_path, MACHINE)
    given = [
        replace(item, **{key: getattr(item, key)[item.passes == 1] for key in COLUMNS})
        for item in there_and_back(1)
    ]
    fit = fit_machine(known, readings(given))
    found = fit.components["a"]
    assert found.instruments[0].fit.separated
    assert (found.estimate.pass_dof, found.estimate.half_differences) == (1, None)
    codes = [item.code for item in scatter_warnings(fit)]
    assert codes == ["no-scatter-known"]
    assert not scatter_warnings(fit_machine(known, readings(there_and_back(1))))


def test_runs_that_differ_by_the_same_are_read_back(tmp_path: Path) -> None:
    """A coarse display: reverse is forward and a constant in every run, S_h but rounding."""
    known = loaded(tmp_path, MACHINE)
    given = []
    for item in there_and_back(5):
        lines = np.round(item.error.reshape(RUNS, 2, len(P)), 1)
        lines[:, 1] = lines[:, 0] - 0.3
        given.append(replace(item, error=lines.ravel()))
    fit = fit_machine(known, readings(given))
    results = document(fit_result("m", fit, estimates_from_fit(known, fit))).record()
    source = Source(role="components", path=tmp_path, shown="c.json", sha256="", rows=0)
    report = components_from(source, {"schema": "mtu/fit-components/1", "results": results})
    assert fit.components["a"].estimate.half_differences is not None
    found = report.components["a"].half_difference_mean_square
    assert found is not None
    np.testing.assert_allclose(found, 0, atol=1e-12)
    for damaged, told in (([[None, 0], [0, 0]], "wrong value: 'null'"), ([[1.0]], "not 2 x 2")):
        results["components"]["a"]["half_difference_mean_square"] = damaged
        with pytest.raises(InputError, match=told):
            components_from(source, {"schema": "mtu/fit-components/1", "results": results})


@pytest.mark.parametrize("one_way", [False, True], ids=["one number", "a number each"])
def test_a_prediction_by_hand(tmp_path: Path, one_way: bool) -> None:
    """g'((1 + 1/P) S_m + S_h)g + s^2 (1 - M), S_m and S_h from the passes' lines by numpy."""
    known = loaded(tmp_path, MACHINE)
    given = there_and_back(1, one_way=one_way)
    fit = fit_machine(known, readings(given))
    model = build_model(known, estimates_from_fit(known, fit))
    x, y = 30.0, 70.0
    m, h, visits = [], [], []
    for item, at in zip(given, (x, y), strict=True):
        by_pass = item.error.reshape(2 * RUNS, len(P))
        own = np.polyfit(P, by_pass.T, 1)[::-1]
        rest = by_pass - (own[0][:, None] + own[1][:, None] * P)
        s2 = np.sum(rest**2) / (2 * RUNS * (len(P) - 2))
        line = (own[0] + own[1] * at).reshape(RUNS, 2)
        m.append(line.mean(axis=1))
        h.append((line[:, 0] - line[:, 1]) / 2)
        M = 1 / len(P) + (at - P.mean()) ** 2 / np.sum((P - P.mean()) ** 2)
        visits.append(s2 * (1 - M))
    S_m, S_h = np.cov(m), np.cov(h)
    found = predict(model, ["p"], np.array([[x, y, 0.0]]))
    assert found.mean == pytest.approx([m[0].mean(), m[1].mean()])
    wanted = (1 + 1 / RUNS) * S_m + S_h + np.diag(visits)
    assert found.covariance == pytest.approx(wanted, rel=1e-9)
    variance = found.variance(np.eye(2))
    assert variance.total == pytest.approx(np.diag(wanted))
    nu = 2 * RUNS * (len(P) - 2)
    for i in range(2):
        of_runs, of_ways = (1 + 1 / RUNS) * S_m[i, i], S_h[i, i]
        spread = (of_runs**2 + of_ways**2) / (RUNS - 1) + visits[i] ** 2 / nu
        assert variance.dof[i] == pytest.approx(wanted[i, i] ** 2 / spread)
    assert variance.coefficients == pytest.approx(np.diag(S_m) / RUNS)
    # Of both components: the two mean squares are of the same runs, the visits of each its own.
    a = np.array([1.0, -2.0])
    both = found.variance(a[None])
    assert both.total == pytest.approx([a @ wanted @ a])
    spread = (((1 + 1 / RUNS) * a @ S_m @ a) ** 2 + (a @ S_h @ a) ** 2) / (RUNS - 1)
    spread += np.sum((a**2 * visits) ** 2) / nu
    assert both.dof == pytest.approx([(a @ wanted @ a) ** 2 / spread])
    # The mean over future parts is known by the runs alone.
    squares = variance.squares
    assert squares.of_mean[0] == pytest.approx(np.diag(S_m) / RUNS)
    assert np.abs(squares.of_mean[1:]).max() < 1e-12
    assert fit.joint[0].pass_dof == RUNS - 1


def test_a_setup_of_its_own_makes_a_pass_no_part_of_a_run(tmp_path: Path) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(6), Drift(10.0, there_and_back=True))
    labels = np.array(["there", "back"], object)[(given.direction < 0).astype(int)]
    for setups, dof in (({}, 4), ({"setup": labels}, 8)):
        fit = fit_machine(known, replace(given, covariates=setups))
        for name, item in fit.components.items():
            assert item.estimate.pass_dof == (4 if name == "axy" else dof)
            assert (item.estimate.half_differences is not None) == (dof == 4 and name != "axy")


def test_the_report_carries_what_runs_tell(tmp_path: Path) -> None:
    """Read back, it gives the same prediction, its squares and their degrees of freedom."""
    known = loaded(tmp_path, MACHINE.replace("of: y, unit: mm", "of: y, unit: um, degree: 2"))
    fit = fit_machine(known, readings(there_and_back(2)))
    own = estimates_from_fit(known, fit)
    results = document(fit_result("m", fit, own)).record()
    source = Source(role="components", path=tmp_path, shown="c.json", sha256="", rows=0)
    report = components_from(source, {"schema": "mtu/fit-components/1", "results": results})
    place, A = np.array([[30.0, 70.0, 0.0]]), np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -2.0]])
    first, second = (
        predict(build_model(known, estimates), ["p"], place).variance(A)
        for estimates in (own, estimates_from_report(known, report))
    )
    assert second.total == pytest.approx(first.total, rel=1e-9)
    assert second.dof == pytest.approx(first.dof, rel=1e-9)
    np.testing.assert_allclose(second.squares.of_part, first.squares.of_part, rtol=1e-7, atol=1e-15)


@pytest.mark.parametrize("shared", [3.0, 0.0])
def test_further_readings_share_what_these_did(tmp_path: Path, shared: float) -> None:
    """The table's factor: D within a direction, of the two of a run K where it is positive."""
    known = loaded(tmp_path, MACHINE)
    fit = fit_machine(known, readings(there_and_back(3, shared=shared)))
    estimate = fit.components["a"].estimate
    one = Estimates(components={"a": estimate})
    table = only(reading_tables(known, one, readings(there_and_back(4)[:1])))
    X = np.column_stack([np.ones(2 * len(P)), table.places[0, :, 0]])
    way = table.covariates["dir_x"][0]
    same = way[:, None] == way
    R = table.of_part[0, :, 0]
    found = R @ R.T
    np.testing.assert_allclose(found[same], (X @ estimate.pass_covariance @ X.T)[same], rtol=1e-6)
    lines = np.polyfit(P, there_and_back(3, shared=shared)[0].error.reshape(-1, len(P)).T, 1)[::-1]
    there, back = lines[:, 0::2], lines[:, 1::2]
    K = np.cov(there, back)[:2, 2:]
    K = (K + K.T) / 2
    # K at position 0 as the coefficients are, less what is negative of it in their uncertainties.
    u = np.sqrt(np.diag(estimate.covariance))
    size, vectors = np.linalg.eigh(K / np.outer(u, u))
    assert (size.min() > 0) == bool(shared)
    root = u[:, None] * vectors * np.sqrt(size.clip(0))
    K = root @ root.T
    np.testing.assert_allclose(
        found[~same], (X @ K @ X.T)[~same], rtol=1e-6, atol=1e-9 * found.max()
    )


def test_a_number_that_stands_twice_in_a_direction_is_of_several_days() -> None:
    assert told("1+ 1+ 1- 2-") == ["1+1-"]
