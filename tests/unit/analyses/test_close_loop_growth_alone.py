"""A growth without its drift: where it is counted from, and where the axis may be fixed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from close_loop_examples import effect, on_table, result
from loop_tables import residuals

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint
from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.growth_alone import growths_alone
from mtu_cli.close_loop_sealed.analyses.loop.one_table import loop_on
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.model.effect_library import candidates, effect_library
from mtu_cli.close_loop_sealed.reports.close_loop_held import growth_alone_notes

T = "T_spindle_degC"
FIXED = -20.0


@cache
def grown(seed: int, part: float) -> TableResult:
    """X grows by 40 um/m/K from x = -20 mm, in parts that differ as wholes by `part` um."""
    rng = np.random.default_rng(seed)
    P, H = 14, 12
    table = residuals(np.zeros((P, H, 2)))
    warm = 21 + 5 * np.abs(np.sin(1.3 * np.arange(P)))[:, None] + np.zeros((P, H))
    errors = rng.normal(size=(P, H, 2)) + part * rng.normal(size=(P, 1, 2))
    errors[..., 0] += 0.04 * (table.places[..., 0] - FIXED) * (warm - 20)
    own = replace(table, errors=errors * 1e-3, covariates={T: warm}, travel={"x": (-400.0, 400.0)})
    library = effect_library()
    chosen = [c for c in candidates(own, library) if c.name in CHOSEN]
    return loop_on(own, chosen, library, alpha=0.05, most=4, seed=1).result


CHOSEN = ("offset-x", "scale-x", "thermal-growth-x", "thermal-drift-x")


def named(item: TableResult) -> set[str]:
    return {found.name for found in item.effects}


def test_beside_a_drift_that_does_not_pass_the_fixed_point_holds_the_truth() -> None:
    items = [grown(seed, 16.0) for seed in range(5)]
    alone = [i for i in items if named(i) & {"thermal-growth-x", "thermal-drift-x"} == GROWTH]
    assert len(alone) >= 3
    inside = 0
    for item in alone:
        (point,) = item.growths_alone
        assert point.drift == ()
        assert item.effects[point.growth[0]].name == "thermal-growth-x"
        assert point.counted_from == pytest.approx(float(item.table.places[..., 0].mean()))
        ends = point.interval
        inside += ends is None or ends[0] < FIXED < ends[1]
    # A 95 % interval: of five one may miss.
    assert inside >= len(alone) - 1


GROWTH = {"thermal-growth-x"}


def test_where_the_drift_was_found_it_tells_the_fixed_point_itself() -> None:
    item = grown(1, 0.05)
    assert named(item) >= {"thermal-growth-x", "thermal-drift-x"}
    assert item.growths_alone == ()
    assert item.fixed_points


def test_a_growth_that_is_one_of_a_class_is_told_with_the_class() -> None:
    item = next(i for i in (grown(seed, 16.0) for seed in range(5)) if i.growths_alone)
    several = [replace(found, class_names=(found.name, "scale-x")) for found in item.effects]
    told = cast(Described, SimpleNamespace(prepared=SimpleNamespace(table=item.table)))
    assert growths_alone(told, several, ()) == ()


LEVEL = (("level", "um", 4.2, 0.75),)


def note(*beside: FoundEffect, **changed: object) -> str:
    growth = effect(
        "thermal-growth-x",
        covariate=T,
        parameters=(("growth", "um/m/K", 3.82, 0.21), *(() if beside else LEVEL)),
        equations={"Ex": f"growth*(x - 234)*({T} - 20){'' if beside else ' + level'}"},
    )
    own = {"at": 24.0, "u": 60.0, "interval": (-116.0, 156.0), "told": True, **changed}
    point = FixedPoint(
        axis="x",
        covariate=T,
        growth=(0,),
        drift=(),
        counted_from=234.0,
        **own,  # type: ignore[arg-type]
    )
    whole = (growth, *beside)
    (item,) = result(replace(on_table("named", whole), growths_alone=(point,))).tables
    (text,) = growth_alone_notes(item)
    return text


def test_the_note_says_what_the_growth_is_counted_from_and_what_is_not_known() -> None:
    text = note()
    assert "thermal-growth-x is counted from x = 234.0 mm, and its level is the mean error" in text
    assert "the fixed point is not known from these data" in text
    assert text.endswith("it may lie at x = 24 ± 60 mm (95 %: [-116, 156])")


def test_an_offset_that_was_found_is_the_error_at_that_place() -> None:
    offset = effect(
        "offset-x",
        kind="offset",
        parameters=(("shift", "um", 4.2, 0.75),),
        equations={"Ex": "shift"},
    )
    assert "and offset-x is the mean error there over these T_spindle_degC;" in note(offset)


def test_a_place_wider_than_the_travel_is_not_told() -> None:
    assert note(told=False).endswith("the fixed point is not known from these data")
    assert "nan" not in note(at=np.nan, u=np.nan, interval=None, told=False)
