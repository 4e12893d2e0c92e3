"""What close-loop writes, warns of and which gates it meets, of results that are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from cli_runner import Result, done, mtu, report
from loop_examples import BACKLASH, CLASS, CYCLIC, SCATTER, SMOOTH, effect, parameter, searched
from support import CONFIGS, DATA

from mtu_cli.analyses import close_loop
from mtu_cli.analyses.close_loop.result import CloseLoopResult, FoundEffect

UNDECLARED = CONFIGS / "undeclared"
OFFSET = effect("offset-x", parameter("shift", "um", 0.2, 0.3))
OPEN = replace(CYCLIC, searched=searched("pitch_mm", 12.5, (9.0, 9.1), (12.3, 12.7)))


KNOWN: list[CloseLoopResult] = []
"""The result of the study, found once."""


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """A call whose analysis finds given effects, which writes new.yaml and new.json."""
    real = close_loop.close_loop

    def call(*effects: FoundEffect, verdict: Any = "named") -> Result:
        def found(*args: Any, **options: Any) -> Any:
            KNOWN[:] = KNOWN or [real(*args, **options)]
            table = replace(
                KNOWN[0].tables[0],
                effects=effects,
                verdict=verdict,
                covariance=np.diag([0.15, 0.3, 0.2, 0.2, 0.4]) ** 2 * 1e-6,
            )
            return replace(KNOWN[0], verdict=verdict, tables=(table,))

        monkeypatch.setattr(close_loop, "close_loop", found)
        options = ["--write-machine", "new.yaml", "--write-components", "new.json"]
        options += ["--fail-if", "found,unexplained"]
        return mtu("close-loop", UNDECLARED, "-q", *options, cwd=tmp_path)

    return call


def test_a_smooth_effect_is_a_table_that_predictions_take(closed: Any, tmp_path: Path) -> None:
    done(closed(SMOOTH), 3)
    (written,) = yaml.safe_load((tmp_path / "new.yaml").read_text())["effects"]
    assert written["equations"] == {"Ex": "profile_x"}
    assert written["components"]["profile_x"]["at_mm"] == [0, 50, 100, 150]
    (tmp_path / "part.yaml").write_text(
        "schema: mtu/part/1\nname: p\nfeatures: {a: {x_mm: 50, y_mm: 20, z_mm: 127}}\n"
    )
    call = ("-p", tmp_path / "part.yaml", "--lbb", DATA / "undeclared" / "lbb.csv")
    old, new = (
        report("predict-points", "-m", path, *call)["results"]["points"][0]
        for path in (UNDECLARED / "machine.yaml", tmp_path / "new.yaml")
    )
    assert new["Ex_um"] - old["Ex_um"] == pytest.approx(3.0)
    assert new["var_x_um2"] - old["var_x_um2"] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("effects", "verdict", "codes", "names"),
    [
        ((BACKLASH,), "named", [], ["backlash-x"]),
        ((CLASS,), "class", ["written-class"], ["backlash-x"]),
        ((BACKLASH,), "unexplained", ["written-unexplained"], ["backlash-x"]),
        ((BACKLASH, OPEN), "named", ["effect-not-written"], ["backlash-x"]),
        ((BACKLASH, OFFSET), "named", [], ["backlash-x", "offset-x"]),
        ((OFFSET,), "named", [], ["offset-x"]),
        ((SCATTER,), "named", ["effect-not-written", "nothing-added"], []),
        ((), "unexplained", ["nothing-added"], []),
        ((), "none", ["nothing-added"], []),
    ],
)
def test_what_is_not_written_or_doubtful_is_warned_of_and_gates_are_met(
    closed: Any,
    tmp_path: Path,
    effects: tuple[FoundEffect, ...],
    verdict: str,
    codes: list[str],
    names: list[str],
) -> None:
    met = {"none": [], "unexplained": ["found", "unexplained"]}.get(verdict, ["found"])
    said = done(closed(*effects, verdict=verdict), 3 if met else 0).stderr
    gates = [line for line in said.splitlines() if line.startswith("mtu: gate ")]
    assert [line.split()[2].rstrip(":") for line in gates] == met
    told = [line for line in said.splitlines() if line not in gates]
    assert [line.rpartition("[")[2].rstrip("]") for line in told] == codes
    written = yaml.safe_load((tmp_path / "new.yaml").read_text()).get("effects", [])
    assert [item["name"] for item in written] == names
