"""Which passes are one run: in the report of fit-components, and below its table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from model_examples import Segment, loaded, readings

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import estimates_from_fit, fit_machine

MACHINE = """
components: {a: {of: x, unit: mm}, b: {of: y, unit: mm}, c: {of: x, unit: mm}}
equations: {Ex: a + c, Ey: b}
"""
P = np.linspace(0.0, 90.0, 4)


def segment(name: str, numbers: list[int], ways: list[int], role: str = "lbb") -> Segment:
    """One component in passes of these numbers and directions."""
    rng = np.random.default_rng(7)
    each = (len(numbers), len(P))
    return Segment(
        name=name,
        position=np.tile(P, len(numbers)),
        error=(rng.normal(size=(len(numbers), 1)) + 0.1 * rng.standard_normal(each)).ravel(),
        passes=np.repeat(numbers, len(P)),
        direction=np.repeat(ways, len(P)),
        role=role,
    )


def each_its_own() -> Readings:
    """a, b: six passes of one direction each; c: three passes that run both ways."""
    turns, ways = [1, 2, 3, 4, 5, 6], [1, -1, 1, -1, 1, -1]
    both = segment("c", [1, 1, 2, 2, 3, 3], ways)
    return readings([segment("a", turns, ways), segment("b", turns, ways), both])


def test_the_report_counts_the_runs(tmp_path: Path) -> None:
    known = loaded(tmp_path, MACHINE)
    fit = fit_machine(known, each_its_own())
    result = fit_result("m", fit, estimates_from_fit(known, fit))
    assert [item.runs_read for item in result.components.values()] == [3, 3, 3]
