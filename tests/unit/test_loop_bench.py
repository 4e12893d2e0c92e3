"""The bench of close-loop: its sets go through the command, and what it counts is what it says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loop_bench import compare, judge, records
from loop_bench.command import judged, rounded
from loop_bench.figures import ratio, share
from loop_bench.records import Record, read
from loop_bench.rows import ROWS, table
from loop_bench.sets import KINDS, Kind, drawn
from support import leaves

RECORDS = Path(__file__).parents[1] / "loop_bench" / "records.jsonl.gz"
EACH = ("null-normal", "laser-1", "missing-1", "hidden-scale",
        "equal-scale", "profile-10", "reversal")  # fmt: skip
"""A kind for each way of drawing."""


def kind_of(name: str) -> Kind:
    return next(kind for kind in KINDS if kind.name == name)


@pytest.mark.parametrize("name", EACH)
def test_the_command_takes_each_kind_of_set(name: str, tmp_path: Path) -> None:
    _, made = drawn(kind_of(name), 1, 1, tmp_path)
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
    """A record by hand."""
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
