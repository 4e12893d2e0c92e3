"""Runs there and back: who is a run, and what the two passes of one share, to the prediction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import Segment, loaded, readings
from numpy.typing import NDArray

from mtu_cli.files.readings import Readings
from mtu_cli.files.source import Source
from mtu_cli.model.fit import component_readings, estimates_from_fit, fit_machine
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.passes import pairs_of_passes
from mtu_cli.model.prediction import predict
from mtu_cli.model.residuals import reading_cells

P = np.linspace(0.0, 90.0, 4)
RUNS = 5
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


def told(text: str) -> list[str]:
    """Pairs that are found in a sequence such as 1+ 2-."""
    words = text.split()
    number = np.array([int(word[:-1]) for word in words])
    way = np.array([1 if word[-1] == "+" else -1 for word in words])
    return [f"{words[i]}{words[j]}" for i, j in pairs_of_passes(number, way)]


@pytest.mark.parametrize(
    ("passes", "pairs"),
    [
        ("1+ 2- 3+ 4- 5+", "1+2- 3+4-"),
        ("0+ 1- 2+ 3-", "0+1- 2+3-"),
        ("1- 2+ 3- 4+", "2+1- 4+3-"),
        ("1+ 2- 3+ 5+ 6-", "1+2- 5+6-"),
        # Two counts, up or down, or of any order.
        ("1+ 2+ 3+ 1- 2- 3-", "1+1- 2+2- 3+3-"),
        ("1+ 2+ 3+ 3- 2- 1-", "1+1- 2+2- 3+3-"),
        ("1+ 3+ 4+ 5+ 1- 2- 4- 5-", "1+1- 4+4- 5+5-"),
        ("2+ 3+ 4+ 5+ 1- 2- 3- 4-", "2+2- 3+3- 4+4-"),
        ("5+ 1- 6+ 2- 7+ 3-", "5+1- 6+2- 7+3-"),
        # Numbers that stand twice: files of several days.
        ("1+ 1+ 1- 2-", "1+1- 1+2-"),
        ("1+ 2+ 1+ 2+ 1- 2- 1- 2-", "1+1- 2+2- 1+1- 2+2-"),
        ("1+ 2+", ""),
    ],
)
def test_passes_that_each_run_one_way_are_paired(passes: str, pairs: str) -> None:
    assert told(passes) == pairs.split()


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


# The passes of readings: their sequence in time and who is a run, whatever files they stand in.


IntArray = NDArray[np.int64]

ONE_AXIS = """
components: {a: {of: x, unit: mm}}
equations: {Ex: a}
"""
NUMBER = np.repeat(np.arange(1, 2 * RUNS + 1), len(P))
WAY = np.tile(np.repeat([1, -1], len(P)), RUNS)


def one_way_passes() -> Readings:
    """Passes 1 there, 2 back, 3 there ... of one axis, which runs share their scatter."""
    rng = np.random.default_rng(3)
    level = 3 * rng.normal(size=(RUNS, 1, 1)) + rng.normal(size=(RUNS, 2, 1))
    error = (level + 0.5 * rng.normal(size=(RUNS, 2, len(P)))).ravel()
    return readings(
        [
            Segment(
                name="a",
                position=np.tile(P, 2 * RUNS),
                error=error,
                passes=NUMBER,
                direction=WAY,
                time=np.arange(len(error), dtype=np.float64),
            )
        ]
    )


def in_files(given: Readings, file: IntArray, *, clock: bool = True) -> Readings:
    """The readings, each in the file that `file` (n,) numbers; without times less the clock."""
    order = np.argsort(file, kind="stable")
    count = int(file.max()) + 1
    sources = tuple(
        Source(role="lbb", path=Path(f"{i}.csv"), shown=f"{i}.csv", sha256="", rows=None)
        for i in range(count)
    )
    arrays = ("code", "position_mm", "error", "pass_number", "has_pass", "direction", "time_min")
    found = replace(
        given,
        **{name: getattr(given, name)[order] for name in arrays},
        file_index=file[order],
        sources=sources,
        roles=("lbb",) * count,
    )
    return found if clock else replace(found, time_min=np.full(len(order), np.nan))


FILES = {
    "one a direction": (WAY < 0).astype(np.int64),
    "one a pass": NUMBER - 1,
    "one a pass, there before back": np.where(WAY > 0, NUMBER // 2, RUNS + NUMBER // 2 - 1),
}


@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("file", FILES.values(), ids=FILES)
def test_runs_are_the_same_whatever_files_their_passes_stand_in(
    tmp_path: Path, file: IntArray, clock: bool
) -> None:
    known, given = loaded(tmp_path, ONE_AXIS), one_way_passes()
    one = fit_machine(known, given).components["a"].estimate
    split = in_files(given, file, clock=clock)
    several = fit_machine(known, split).components["a"].estimate
    assert one.pass_dof == RUNS - 1
    assert several.pass_dof == one.pass_dof
    np.testing.assert_allclose(several.covariance, one.covariance, rtol=1e-9)
    seen = component_readings(known, split, "a", np.arange(len(WAY)))
    cells = reading_cells(split, seen, "a")
    assert cells.parts == tuple(f"{2 * i + 1}/{2 * i + 2}" for i in range(RUNS))
