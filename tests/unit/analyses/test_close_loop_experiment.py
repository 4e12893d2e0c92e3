"""The follow-up that tells a class apart: which one, how far, and whether it then does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loop_bench.days import shop_table
from separation_examples import (
    found_as,
    index,
    members_of,
    prepared_of,
    with_effect,
)
from shop_day import ShopDay, measure

from mtu_cli.close_loop_sealed.analyses.loop import rivalry
from mtu_cli.close_loop_sealed.analyses.loop.classes import experiments
from mtu_cli.close_loop_sealed.analyses.loop.experiment import Choice, choice
from mtu_cli.close_loop_sealed.analyses.loop.follow_up import Travel
from mtu_cli.close_loop_sealed.analyses.loop.prepare import prepare
from mtu_cli.close_loop_sealed.model.effect_library import candidates, effect_library


def chosen(names: list[str], family: str, travel: Travel | None = None) -> Choice:
    prepared, _ = with_effect("A", 3, family, 1.0)
    prepared = replace(prepared, table=replace(prepared.table, travel=travel or {}))
    (found,) = experiments(*found_as(prepared, names))
    return found


CLASSES = [
    (["backlash-y", "abbe-y"], "backlash-y", ("reverse", "height")),
    (["abbe-y", "backlash-y"], "abbe-y", ("reverse", "height")),
    (["warm-up-x", "trend-x"], "warm-up-x", ("cold", "new-tool")),
    (["trend-x", "warm-up-x"], "trend-x", ("cold", "new-tool")),
    (["scale-x", "cyclic-x"], "scale-x", ("shift-x", "stagger-x")),
    (["thermal-drift-y", "warm-up-y"], "thermal-drift-y", ("day-warmer", "day-colder")),
]


@pytest.mark.parametrize(("names", "family", "wanted"), CLASSES)
def test_the_follow_up_is_the_one_that_a_machinist_would_choose(
    names: list[str], family: str, wanted: tuple[str, ...]
) -> None:
    found = chosen(names, family)
    assert found.experiment is not None
    d = dict(found.separations)
    assert max(d, key=d.__getitem__) in wanted
    # Beyond what the data tell already; within 5 % of d^2 the easier one is taken.
    known = found.experiment.now_d**2
    gained, most = found.experiment.further_d**2, max(d.values()) ** 2 - known
    assert most / gained < 1.05 + 1e-9
    assert gained > d["more"] ** 2 - known >= -1e-6
    # In all, both together.
    assert found.experiment.predicted_d in d.values()
    assert found.experiment.predicted_d**2 == pytest.approx(known + gained)


def test_what_cannot_help_is_not_offered() -> None:
    offered = {name for name, _ in chosen(["backlash-y", "abbe-y"], "backlash-y").separations}
    assert offered == {"more", "reverse", "height"}


def test_the_words_are_those_of_the_library_where_they_fit() -> None:
    reverse = chosen(["abbe-y", "backlash-y"], "backlash-y").experiment
    # A travel that leaves no room for more than a quarter of the pitch.
    shift = chosen(["scale-x", "cyclic-x"], "scale-x", {"x": (4.9, 145.1)}).experiment
    day = chosen(["thermal-drift-y", "warm-up-y"], "thermal-drift-y").experiment
    assert reverse is not None
    assert shift is not None
    assert day is not None
    text = "reverse the program's direction on half of the parts (predicted for 6 more parts)"
    assert reverse.do == text
    # Of scale the library says half of the travel, of cyclic what was found to be best.
    start = "shift the fixture along x by a quarter of the pitch ("
    assert shift.do.startswith(start)
    assert shift.do.endswith(" mm; predicted for 6 more parts)")
    assert day.do.startswith("repeat the run on a day that is 5 K ")


def test_few_members_of_a_rival_tell_as_much_as_all(monkeypatch: pytest.MonkeyPatch) -> None:
    few = chosen(["scale-x", "cyclic-x"], "scale-x")
    monkeypatch.setattr(rivalry, "NEAREST", 10_000)
    monkeypatch.setattr(rivalry, "FEW", 10_000)
    everything = chosen(["scale-x", "cyclic-x"], "scale-x")
    for (_, d), (_, whole) in zip(few.separations, everything.separations, strict=True):
        assert d == pytest.approx(whole, rel=1e-9)


def test_effects_that_no_follow_up_tells_apart_have_no_experiment(tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(
        "schema: mtu/effects/1\n"
        "effects:\n"
        "  - family: pull\n"
        "    says: a pull along {a}\n"
        "    parameters: {pull: um/m}\n"
        "    equations:\n"
        "      E{a}: 2*pull*({a} - {a0})\n"
    )
    day = ShopDay("A", 5)
    table = shop_table(day, measure(day, np.random.default_rng(1)))
    prepared = prepare(table, candidates(table, effect_library([own])), table.pass_dof)
    (found,) = experiments(*found_as(prepared, ["scale-x", "pull-x"]))
    assert found.experiment is None
    assert found.reason is not None
    assert "the same" in found.reason
    assert {name for name, _ in found.separations} == {"more", "shift-x", "stagger-x"}


def test_a_lone_effect_is_told_from_its_aliases() -> None:
    """The class of one has rivals: what describes the same columns on these points."""
    found = chosen(["backlash-y"], "backlash-y")
    assert found.experiment is not None
    assert found.experiment.now_d < 1e-3 * found.experiment.predicted_d


def test_effects_on_scatter_alone_and_offsets_have_no_experiment() -> None:
    prepared, _ = with_effect("A", 3, "backlash-y", 1.0)
    (own,) = members_of(prepared, "backlash-y")
    i, offset = index(prepared, "backlash-y"), index(prepared, "offset-y")
    arguments = {i: np.array([1e-3]), offset: np.array([1e-3])}, {i: 0.5, offset: 0.5}
    assert choice(prepared, *arguments, {i: own, offset: -1}).experiment is None


def test_what_another_effect_explains_separates_nothing() -> None:
    """The raised face lies to one side in y: beside a squareness less of its lever is left."""
    prepared, _ = with_effect("A", 3, "scale-x", 1.0)
    own, other = index(prepared, "scale-x"), index(prepared, "abbe-x")
    best = {own: members_of(prepared, "scale-x")[0], other: members_of(prepared, "abbe-x")[0]}
    arguments = {i: np.array([1e-4]) for i in best}, dict.fromkeys(best, 0.5), best
    square = next(
        m
        for m in members_of(prepared, "squareness-xy")
        if set(prepared.members[m].equations) == {"Ex"}
    )
    free = choice(prepared, *arguments).experiment
    beside = choice(prepared, *arguments, beside=[square]).experiment
    nothing = choice(prepared, *arguments, beside=list(best.values()))
    assert free is not None
    assert beside is not None
    assert 0 < beside.now_d < 0.95 * free.now_d
    assert dict(nothing.separations)["more"] == pytest.approx(0.0, abs=1e-4)


def test_a_table_with_gaps_and_free_parts_is_looked_at_as_it_is() -> None:
    prepared, _ = with_effect("A", 3, "backlash-y", 1.0)
    whole = prepared.table
    gone = np.random.default_rng(1).random(whole.there.shape) < 0.1
    errors = np.where(gone[:, :, None], np.nan, whole.errors)
    gaps = replace(whole, errors=errors, repeats=np.where(gone, 0, whole.repeats))
    free = replace(whole, datum="offset", errors=whole.errors - whole.errors.mean(axis=1)[:, None])
    for table in (gaps, free):
        (found,) = experiments(*found_as(prepared_of(table), ["backlash-y", "abbe-y"]))
        (complete,) = experiments(*found_as(prepared, ["backlash-y", "abbe-y"]))
        assert found.experiment is not None
        assert complete.experiment is not None
        assert found.experiment.do == complete.experiment.do
        ratio = found.experiment.predicted_d / complete.experiment.predicted_d
        # A tenth of the cells is a twentieth of d; the fitted effect differs by its own error.
        assert 0.8 < ratio < 1.2


def test_a_single_part_is_made_once_more() -> None:
    day = ShopDay("A", 3, 2)
    errors = measure(day, np.random.default_rng(2))
    errors[..., 1] += 5.0 * day.covariates["dir_y"]
    day.covariates = {name: v[:1] for name, v in day.covariates.items()}
    day.P, day.parts = 1, day.parts[:1]
    prepared = prepared_of(shop_table(day, errors[:1]))
    (found,) = experiments(*found_as(prepared, ["backlash-y", "abbe-y"]))
    assert found.experiment is not None
    assert found.experiment.do.endswith("(predicted for 1 more part)")
    assert found.experiment.predicted_d > 2.0 > found.experiment.now_d
