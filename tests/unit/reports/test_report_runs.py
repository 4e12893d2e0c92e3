"""Which passes are one run: in the report of fit-components, and below its table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from model_examples import Segment, loaded, readings
from numpy.typing import NDArray

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import MachineFit, estimates_from_fit, fit_machine
from mtu_cli.reports.fit_components import document

MACHINE = """
components: {a: {of: x, unit: mm}, b: {of: y, unit: mm}, c: {of: x, unit: mm}}
equations: {Ex: a + c, Ey: b}
"""
P = np.linspace(0.0, 90.0, 4)
IntArray = NDArray[np.int64]


def reported(known: LoadedMachine, fit: MachineFit) -> dict[str, Any]:
    """The components of the JSON report."""
    found: dict[str, Any] = document(fit_result("m", fit, estimates_from_fit(known, fit))).record()[
        "components"
    ]
    return found


def codes_of(known: LoadedMachine, fit: MachineFit) -> set[str]:
    return {item.code for item in fit_result("m", fit, estimates_from_fit(known, fit)).warnings}


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


def test_the_report_lists_the_passes_of_every_run(tmp_path: Path) -> None:
    known = loaded(tmp_path, MACHINE)
    fit = fit_machine(known, each_its_own())
    found = reported(known, fit)
    first = {"file": 1, "pass": 3, "direction": 1}
    assert found["a"]["runs"][1] == {
        "role": "lbb", "passes": [first, {"file": 1, "pass": 4, "direction": -1}],
    }  # fmt: skip
    assert found["a"]["runs"] == found["b"]["runs"]
    numbers = [[item["pass"] for item in run["passes"]] for run in found["c"]["runs"]]
    assert numbers == [[1, 1], [2, 2], [3, 3]]


def test_passes_of_several_files_are_named_with_their_file(tmp_path: Path) -> None:
    known = loaded(tmp_path, MACHINE.replace(", c: {of: x, unit: mm}", "").replace(" + c", ""))
    there, back = ([1, 2], [1, 1]), ([1, 2], [-1, -1])
    given = [segment(name, *own, role=role) for name in "ab"
             for role, own in (("lbb", there), ("laser", back))]  # fmt: skip
    apart = readings(given)
    fit = fit_machine(known, replace(apart, roles=("lbb", "lbb")))
    found = reported(known, fit)["a"]["runs"]
    assert [item["file"] for item in found[0]["passes"]] == [1, 2]
