"""What is told of a searched value that these places cannot tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from close_loop_examples import effect, on_component, on_table
from effect_tables import table

from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.gross import Gross
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, Judged, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.warnings import loop_warnings
from mtu_cli.close_loop_sealed.model_slice import VisitScatter
from mtu_cli.units import UM


def wave(**changed: object) -> FoundEffect:
    return effect(
        "cyclic-x",
        parameters=(("sine", "um", 4.0, 0.3), ("cosine", "um", 0.5, 0.3)),
        equations={"Ex": "sine*sin(2*pi*x/27.4) + cosine*cos(2*pi*x/27.4)"},
        searched={"pitch_mm": (27.4, 12.1, 28.9)},
        **changed,
    )


def told(found: FoundEffect, places: int) -> list[str]:
    x = np.linspace(0.0, 300.0, places)
    at = np.stack([np.repeat(x, 3), np.tile([0.0, 50.0, 100.0], places), np.zeros(3 * places)], 1)
    item = replace(on_table("named", (found,)), table=table(H=3 * places, places=at))
    return [w.message for w in loop_warnings([item], 9) if w.code == "not-separable"]


def test_other_values_that_are_the_same_here_are_told_nearest_first() -> None:
    (text,) = told(wave(alike=(12.1, 17.9)), 9)
    assert "pitch_mm may as well be 17.9, 12.1 as 27.4" in text


@pytest.mark.parametrize(("places", "warned"), [(4, True), (6, True), (7, False), (9, False)])
def test_few_places_tell_a_pitch_hardly(places: int, warned: bool) -> None:
    # Sine, cosine, level and pitch take four of them; three more judge the fit.
    found = told(wave(), places)
    assert len(found) == warned
    assert all(f"{places} different places along x" in text for text in found)


def test_what_is_not_searched_needs_no_places() -> None:
    assert told(effect("scale-x", equations={"Ex": "lost_motion*x"}), 2) == []


def test_columns_that_no_equation_can_name_are_told() -> None:
    base = on_table("none")
    load = np.ones((len(base.table.parts), 1))

    def messages(*names: str) -> list[str]:
        given = {**base.table.covariates, **dict.fromkeys(names, load)}
        own = replace(base, table=replace(base.table, covariates=given))
        return [w.message for w in loop_warnings([own], 9) if w.code == "column-not-used"]

    assert messages("load") == []
    (text,) = messages("spindle load", "load", "Zeit [min]")
    assert "not used: 'spindle load', 'Zeit [min]', since an equation cannot name them" in text
    # Reading the points has told of it already, with the name that makes it a sensor.
    assert messages("Spindle temp") == []


def test_a_search_that_stopped_is_told_where_more_would_pass() -> None:
    full = on_table("named", tuple(effect(name) for name in ("scale-x", "scale-y")))

    def messages(most: int, stopped: bool) -> list[str]:
        own = replace(full, stopped=stopped)
        return [w.message for w in loop_warnings([own], most) if w.code == "max-effects"]

    assert messages(2, stopped=False) == []
    assert messages(2, stopped=True) == [
        "the search stopped at 2 causes, and more would pass (--max-effects)"
    ]
    assert " 1 cause," in messages(1, stopped=True)[0]


def test_passes_far_apart_are_told_where_their_scatter_was_not_known() -> None:
    known = on_component(verdict="none")
    base = replace(known, table=replace(known.table, scatter_known=False))
    level = np.array([12.0, -12.0, 4.0, -4.0, 8.0, -8.0])[:, None, None] * UM

    def messages(of: TableResult) -> list[str]:
        return [w.message for w in loop_warnings([of], 9) if w.code == "passes-apart"]

    def apart(text: str) -> float:
        return float(text.removeprefix("the passes of dx_x stand ").split()[0])

    assert messages(base) == []
    far = replace(base.table, errors=base.table.errors + level)
    (text,) = messages(replace(base, table=far))
    # sqrt(448 / 5 um^2) = 9.5 um of the levels alone; the floor of the example is 3.6 um.
    assert apart(text) == pytest.approx(9.5, abs=1.0)
    assert "single readings scatter by 3.6 um" in text
    # The level of each direction scatters by itself: against each other they are as far.
    assert far.covariates["dir_x"].shape[0] == 1
    opposite = replace(
        base.table, errors=base.table.errors + level * far.covariates["dir_x"][..., None]
    )
    (turned,) = messages(replace(base, table=opposite))
    assert apart(turned) == pytest.approx(9.5, abs=1.0)
    # Three quarters of a pass were not read.
    gap = far.errors.copy()
    gap[2, 3:] = np.nan
    short = replace(far, errors=gap, repeats=np.where(np.isfinite(gap[..., 0]), 3, 0))
    assert apart(messages(replace(base, table=short))[0]) == pytest.approx(9.5, abs=1.0)
    assert messages(replace(base, table=replace(far, scatter_known=True))) == []
    # What an effect explains of it is not scatter.
    assert messages(replace(base, table=far, explained=base.explained + level)) == []


def test_an_outlying_reading_is_told_with_its_direction_in_words() -> None:
    base = on_component(verdict="none")
    gross = Gross(part="2", feature="150 -", deviation=(0.02,), score=9.0)
    found = loop_warnings([replace(base, gross=(gross,))], 9)
    (text,) = [w.message for w in found if w.code == "outliers-set-aside"]
    assert text.endswith("position 150 in reverse of pass 2")


@pytest.mark.parametrize(
    ("noise_um", "dof", "warned"),
    [
        # 3 um of the machine and 4/sqrt(3) um of three repeats by the CMM: 3.8 um together.
        (7.5, np.inf, False),
        (7.7, np.inf, True),
        # s_repeat from 3 readings is a third of its true size more often than 1 in 200.
        (9.0, 3.0, False),
        (9.0, 40.0, True),
    ],
)
def test_scatter_of_entries_is_held_against_machine_and_cmm(
    noise_um: float, dof: float, warned: bool
) -> None:
    base = on_table("none", floor=1e-3 * noise_um)
    visit = VisitScatter(variance=np.full(2, 9e-6), dof=dof)
    table = replace(base.table, repeat_variance=np.full(2, 16e-6), visit=visit)
    found = loop_warnings([replace(base, table=table)], 9)
    told = [w.message for w in found if w.code == "scatter-not-predicted"]
    assert len(told) == warned
    if warned:
        sizes = f"by {noise_um:.2g} um, of which the machine's repeatability is 3 and the CMM's 2.3"
        assert sizes in told[0]
    once = replace(table, repeat_dof=0, repeat_variance=np.full(2, np.nan))
    silent = loop_warnings([replace(base, table=once)], 9)
    assert "scatter-not-predicted" not in {w.code for w in silent}


@pytest.mark.parametrize(
    ("name", "posterior", "p", "found", "warned"),
    [
        ("squareness-xy", 0.99, 0.15, True, True),
        ("squareness-xy", 0.9, 0.15, True, False),
        ("squareness-xy", 0.99, 0.01, True, False),
        # What was found itself, what no mean is of, and where nothing was found.
        ("offset-x", 0.99, 0.15, True, False),
        ("scale-scatter", 0.99, 0.15, True, False),
        ("squareness-xy", 0.99, 0.15, False, False),
    ],
)
def test_what_fits_better_and_does_not_pass_is_told(
    name: str, posterior: float, p: float, found: bool, warned: bool
) -> None:
    judged = Judged(
        name=name,
        family=name.removesuffix("-xy"),
        component=None,
        p_familywise=p,
        log_bayes_factor=10.0,
        posterior=posterior,
        minimum_detectable=None,
        unavailable=None,
    )
    base = on_table("named", (effect("offset-x"),)) if found else on_table("none")
    given = loop_warnings([replace(base, candidates=(judged,))], 9)
    texts = [w.message for w in given if w.code == "likelier-not-passed"]
    assert len(texts) == warned
    assert all(f"{name} fits better than all that was found (posterior 99 %" in t for t in texts)


@pytest.mark.parametrize(("p", "warned"), [(1e-4, True), (2e-3, False), (None, False)])
def test_a_growth_of_one_axis_alone_is_told(p: float | None, warned: bool) -> None:
    size = ScatterSize(
        parameter=("s", "um/m", 2e-5, 3e-6), by_axis=(("x", 3e-5), ("y", 4e-6)), p_alike=p
    )
    found = loop_warnings([on_table("named", (replace(effect("scale-scatter"), scatter=size),))], 9)
    told = [w.message for w in found if w.code == "axes-unlike"]
    assert len(told) == warned
    if warned:
        assert told[0].startswith(
            "scale-scatter: X 30, Y 4 um/m, more than scatter makes it (p <0.001)"
        )
    assert [text.endswith("and this name is a hint only") for text in told] == [True] * warned


@pytest.mark.parametrize(("ratio", "warned"), [(1.9, False), (2.1, True)])
def test_a_growth_that_is_larger_by_little_along_one_axis_is_not(
    ratio: float, warned: bool
) -> None:
    even = ScatterSize(
        parameter=("s", "um/m", 2e-5, 3e-6), by_axis=(("x", ratio * 1e-5), ("y", 1e-5)), p_alike=0.0
    )
    found = loop_warnings([on_table("named", (replace(effect("scale-scatter"), scatter=even),))], 9)
    assert ("axes-unlike" in {w.code for w in found}) == warned
