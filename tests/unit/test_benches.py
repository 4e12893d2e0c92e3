"""The bench of close-loop: its sets go through the command, and what it counts is what it says."""

import doctest
import json
import math
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loop_bench import compare, judge, records
from loop_bench.command import judged, rounded
from loop_bench.figures import ratio, share
from loop_bench.records import Record, read
from loop_bench.rows import ROWS, table
from loop_bench.sets import KINDS, drawn
from shop_day import NOISES, Noise, ShopDay, measure
from shop_day.day import Floats
from shop_day.noise import REPEATS, SIG_CMM, SIG_HOLE, SIG_PART, SIG_PROCESS
from support import leaves

import mtu_cli
from mtu_cli.units import ANGLE, ARCSEC, LENGTH, UM, UNITS, internal

RECORDS = Path(__file__).parents[1] / "loop_bench" / "records.jsonl.gz"
EACH = ("null-normal", "laser-1", "missing-1", "hidden-scale",
        "equal-scale", "profile-10", "reversal")  # fmt: skip
"""A kind for each way of drawing."""


@pytest.mark.parametrize("name", EACH)
def test_the_command_takes_each_kind_of_set(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What is held out takes most of the time.
    monkeypatch.setattr("mtu_cli.analyses.close_loop.FOLDS", (2, 2))
    _, made = drawn(next(kind for kind in KINDS if kind.name == name), 1, 1, tmp_path)
    report = judged(made, tmp_path, 1)
    assert report["code"] == 0, report
    assert report["verdict"] in ("none", "named", "class", "unexplained")
    for ask in report.get("predicted", []):
        assert all(np.isfinite([row[0], *row[2:5]]).all() for row in ask["rows"]), ask


def test_the_sets_are_those_of_the_records(tmp_path: Path) -> None:
    """Two of each kind: names, sizes, rivals and the oracle's gain on the drawn errors, by all of
    which a comparison with the records would say nothing if they had changed.
    """
    stored: dict[str, list[Record]] = {}
    for own in read(RECORDS):
        stored.setdefault(own["kind"], []).append(own)
    rng = np.random.default_rng(1)
    for kind in KINDS:
        for own in rng.choice(np.array(stored[kind.name]), 2, replace=False):
            folder = tmp_path / f"{kind.name}-{own['index']}"
            folder.mkdir()
            turn, made = drawn(kind, own["base"], own["index"], folder)
            assert turn.design == own["design"]
            found, there = leaves(rounded(made.truth())), leaves(own["truth"])
            assert found.keys() == there.keys()
            for name, value in there.items():
                near = pytest.approx(value, rel=1e-4) if isinstance(value, float) else value
                assert found[name] == near, name


def test_a_run_that_was_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out.jsonl"
    for most in ("2", "1"):
        asked = ["loop_bench", str(out), "--only", "reversal", "--most", most]
        monkeypatch.setattr("sys.argv", asked)
        records.main()
        with out.open("a") as lines:
            lines.write('{"kind": "rever')
    assert [own["index"] for own in read(out)] == [0, 1, 2]


def stated(
    verdict: str, *effects: dict[str, Any], true: tuple[str | None, ...] = (), **more: Any
) -> Record:
    blank = {"family": "", "parameters": {}, "searched": {}, "equations": ["Ex"]}
    report = {"code": 0, "verdict": verdict, "effects": [blank | own for own in effects],
              "unexplained": verdict == "unexplained", "seconds": 1.0}  # fmt: skip
    truth = {"names": list(true), "families": [name or "field" for name in true],
             "aliases": [["abbe-y"] if name == "backlash-y" else [] for name in true],
             "d": [9.0 for _ in true], "sizes": {}, "searched": {}, "covariate": None,
             "oracle": None}  # fmt: skip
    own = {"kind": "library-1", "base": 1, "index": 0, "noise": "normal", "design": "A"}
    return own | {"report": report, "truth": truth} | more


X, Y = {"name": "backlash-x"}, {"name": "backlash-y"}


def test_names_are_right_by_truth_alias_and_kind() -> None:
    assert judge.right_first(stated("named", X, true=("backlash-x",)))
    assert judge.right_first(stated("class", {"name": "abbe-y"}, true=("backlash-y",)))
    assert not judge.right_first(stated("named", X, true=("backlash-y",)))
    smooth = {"name": "profile-x"}
    assert judge.right_first(stated("named", smooth, true=("curvature-x",), kind="misshapen-1"))
    assert not judge.right_first(stated("named", smooth, true=("curvature-x",)))
    scales = ({"name": "scale-x"}, {"name": "scale-y"})
    assert judge.exact(stated("named", *scales, true=("scale",)))
    assert not judge.right_first(stated("named", scales[0], true=("scale",)))


def test_what_is_claimed() -> None:
    wrong = stated("named", X, true=("backlash-y",))
    assert judge.lone_wrong(wrong)
    assert judge.named_wrong(wrong)
    rivals = X | {"class": ["backlash-x", "backlash-y"]}
    several = stated("class", rivals, true=("backlash-y",))
    assert not judge.lone_wrong(several)
    assert judge.class_holds(several)
    assert judge.flagged(stated("class", X | {"class": ["backlash-x", "unnamed-drift-x"]}))
    assert judge.flagged(stated("unexplained"))
    assert not judge.flagged(stated("named", X))


@pytest.mark.parametrize(("low", "holds"), [(1.0, True), (2.5, False)])
def test_sizes_are_judged_where_they_mean_the_same(low: float, holds: bool) -> None:
    size = X | {"family": "backlash", "parameters": {"lost_motion": [2.6, 0.1, low, 3.0]}}
    one = stated("named", size, true=("backlash-x",))
    one["truth"]["sizes"] = {"backlash-x": {"lost_motion": 2.0}}
    assert list(judge.sizes_hold(one)) == [holds]
    step = {"name": "step-x", "family": "step", "parameters": {"jump": [1, 1, 0, 2]}}
    other = stated("named", step | {"searched": {"at": [5.5, [4.5, 6.5]]}}, true=("step-x",))
    other["truth"] |= {"sizes": {"step-x": {"jump": 1.0}}, "searched": {"at": 6.5}}
    assert list(judge.sizes_hold(other)) == []
    assert list(judge.searched_hold(other)) == [True]


def test_a_comparison_lists_what_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = [stated("named", X, true=("backlash-x",), index=i) for i in range(3)]
    after = [stated("named", X, true=("backlash-x",), index=0),
             stated("named", Y, true=("backlash-x",), index=1),
             stated("unexplained", X, true=("backlash-x",), index=2)]  # fmt: skip
    for name, stored in (("old", before), ("new", after)):
        lines = "".join(json.dumps(own) + "\n" for own in stored)
        (tmp_path / name).write_text(lines)
    pairs = compare.paired(tmp_path / "old", tmp_path / "new")
    ways = [compare.way(pair) for pair in pairs]
    assert ways == ["right as before", "became wrong", "became wrong"]
    listed = list(compare.changes(pairs))
    assert listed[0] == "library-1: 2 of 3 changed: 2 became wrong"
    assert "backlash-x: named backlash-x -> named backlash-y" in listed[1]


def test_figures_are_those_of_the_counts() -> None:
    # Clopper and Pearson: 8 of 10 is 44.4 to 97.5 %.
    own = share([True] * 8 + [False] * 2)
    assert (own.value, own.low, own.high) == pytest.approx((0.8, 0.4439, 0.9748), abs=1e-4)
    assert own.holds((0.9, 1), None) == "holds"
    assert share([False] * 50).holds((0.9, 1), None) == "MISSED"
    rng = np.random.default_rng(1)
    drawn_pairs = [[(g * h, g) for g, h in rng.uniform(1, 2, (40, 2))] for _ in range(400)]
    covered = [own.low <= 1.5 <= own.high for own in map(ratio, drawn_pairs)]
    assert 0.9 < np.mean(covered) < 0.98
    assert len(list(table([stated("named", X, true=("backlash-x",))]))) < len(ROWS)


# The simulator that close-loop is judged with: its noise. That its effects and draws are those of
# the stored records is a test of the loop's bench.


def strata(errors: Floats) -> list[float]:
    """Mean squares (part, hole, interaction) of one axis (P, H), with loops."""
    P, H = errors.shape
    mean = errors.mean()
    rows, cols = errors.mean(axis=1), errors.mean(axis=0)
    part = sum(H * (row - mean) ** 2 for row in rows) / (P - 1)
    hole = sum(P * (col - mean) ** 2 for col in cols) / (H - 1)
    rest = sum((errors[p, h] - rows[p] - cols[h] + mean) ** 2 for p in range(P) for h in range(H))
    return [part, hole, rest / ((P - 1) * (H - 1))]


@pytest.mark.parametrize("noise", NOISES)
def test_variances_by_stratum(noise: Noise) -> None:
    """Expected mean squares within four of their own standard errors over independent days."""
    day, days = ShopDay("A", 0), 60
    data = [measure(day, np.random.default_rng(100 + s), noise=noise) for s in range(days)]
    each = np.array([np.mean([strata(e[..., a]) for a in (0, 1)], axis=0) for e in data])
    cell = SIG_PROCESS**2 + SIG_CMM**2 / REPEATS
    cell *= {"noisy-axis": 2.5, "noisy-operation": 1.75}.get(noise, 1.0)
    # An outlier's mean square is (20^2 + 20*60 + 60^2)/3, on one cell in a hundred.
    cell += 0.01 * (20**2 + 20 * 60 + 60**2) / 3 if noise == "outliers" else 0.0
    hole = 1.5 if noise == "hole-errors" else SIG_HOLE
    wanted = np.array([cell + 24 * SIG_PART**2, cell + 21 * hole**2, cell])
    error = each.std(axis=0, ddof=1) / np.sqrt(days)
    assert np.all(np.abs(each.mean(axis=0) - wanted) < 4 * error)
    # The test can tell: the standard errors are small beside what the kinds of noise differ by.
    assert np.all(error < [0.08 * wanted[0], 0.08 * wanted[1], 0.04 * wanted[2]])


# The examples in docstrings run.


ROOT = Path(mtu_cli.__file__).parent
WITH_EXAMPLES = sorted(
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
    for path in ROOT.rglob("*.py")
    if ">>> " in path.read_text("utf-8")
)


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_run(name: str) -> None:
    found = doctest.testmod(import_module(name))
    assert found.attempted
    assert not found.failed


# Units of readings against their definitions, and 1 arcsec over 1 m, which is 4.848 um.


SIZES = {
    "um": (LENGTH, 1e-3), "mm": (LENGTH, 1.0), "nm": (LENGTH, 1e-6), "rad": (ANGLE, 1.0),
    "deg": (ANGLE, math.radians(1)), "arcsec": (ANGLE, math.radians(1) / 3600),
    "mrad": (ANGLE, 1e-3), "urad": (ANGLE, 1e-6), "um/m": (ANGLE, 1e-6),
}  # fmt: skip


def test_lengths_in_mm_and_angles_in_rad() -> None:
    found = {name: (unit.dimension, unit.to_internal) for name, unit in UNITS.items()}
    assert found.keys() == SIZES.keys()
    for name, (dimension, size) in SIZES.items():
        assert found[name][0] == dimension
        assert found[name][1] == pytest.approx(size, rel=1e-15)
    assert pytest.approx(4.848, abs=5e-4) == ARCSEC * 1000 / UM
    words = [internal(dimension).text() for dimension in (LENGTH, ANGLE, 2, -1)]
    assert words == ["a length (mm)", "an angle or ratio (rad)", "mm^2", "mm^-1"]
