"""The passes of readings: their sequence in time and who is a run, whatever files they stand in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import Segment, loaded, readings
from numpy.typing import NDArray

from mtu_cli.files.readings import Readings
from mtu_cli.files.source import Source
from mtu_cli.model.fit import fit_machine
from mtu_cli.model.passes import passes_of
from mtu_cli.model.reading_residuals import reading_layout

IntArray = NDArray[np.int64]

P = np.linspace(0.0, 90.0, 4)
RUNS = 5
MACHINE = """
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
    known, given = loaded(tmp_path, MACHINE), one_way_passes()
    one = fit_machine(known, given).components["a"].estimate
    split = in_files(given, file, clock=clock)
    several = fit_machine(known, split).components["a"].estimate
    assert one.pass_dof == RUNS - 1
    assert several.pass_dof == one.pass_dof
    np.testing.assert_allclose(several.covariance, one.covariance, rtol=1e-9)
    layout = reading_layout(split, np.arange(len(WAY)), "x", "a")
    assert layout.parts == tuple(f"{2 * i + 1}/{2 * i + 2}" for i in range(RUNS))


@pytest.mark.parametrize("apart", [0.0, 1000.0])
def test_files_whose_times_overlap_have_clocks_of_their_own(apart: float) -> None:
    """The second file is given first; only a common clock can tell."""
    late = (NUMBER > 4).astype(np.int64)
    given = in_files(one_way_passes(), 1 - late)
    first = given.file_index == 0
    own = given.time_min - np.where(first, 16.0, 0.0) + np.where(first, apart, 0.0)
    given = replace(given, time_min=own)
    _, found = passes_of(
        given, np.arange(len(WAY)), given.pass_number, given.direction.astype(np.int64)
    )
    assert found.timed == bool(apart)
    numbers = [found.keys[g][1] for g in np.argsort(found.order)]
    assert numbers == (
        [1, 2, 3, 4, 5, 6, 7, 8, 9, 10] if apart else [5, 6, 7, 8, 9, 10, 1, 2, 3, 4]
    )


def test_passes_of_other_set_ups_are_rows_of_their_own() -> None:
    """One number both ways, turned round on the table between them: two passes, told apart."""
    given = one_way_passes()
    labels = np.array(["there", "back"], object)[(WAY < 0).astype(int)]
    given = replace(given, pass_number=(NUMBER + 1) // 2, covariates={"setup": labels})
    layout = reading_layout(given, np.arange(len(WAY)), "x", "a")
    assert layout.parts == tuple(f"{i} {way}" for i in range(1, RUNS + 1) for way in "+-")
