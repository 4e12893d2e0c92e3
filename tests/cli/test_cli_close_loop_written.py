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
from mtu_cli.cli.close_loop import joint

UNDECLARED = CONFIGS / "undeclared"
OFFSET = effect("offset-x", parameter("shift", "um", 0.2, 0.3))
OPEN = replace(CYCLIC, searched=searched("pitch_mm", 12.5, (9.0, 9.1), (12.3, 12.7)))


KNOWN: list[CloseLoopResult] = []
"""The result of the study, found once."""


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """A call whose analysis finds given effects, which writes new.yaml and new.json."""
    real = close_loop.close_loop

    def call(*effects: FoundEffect, verdict: Any = "named", gates: str = "") -> Result:
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
        options += ["--fail-if", gates] if gates else []
        return mtu("close-loop", UNDECLARED, "-q", *options, cwd=tmp_path)

    return call


def test_a_smooth_effect_is_a_table_that_predictions_take(closed: Any, tmp_path: Path) -> None:
    done(closed(SMOOTH))
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


def test_effects_of_a_table_keep_their_covariance() -> None:
    class Item:
        covariance = np.arange(25.0).reshape(5, 5) + np.arange(25.0).reshape(5, 5).T

    later = replace(CYCLIC, rows=(2, 3, 4))
    item: Any = Item()
    found = joint([(BACKLASH, item), (SMOOTH, item), (later, item)])
    assert found[:2, :2] == pytest.approx(BACKLASH.covariance)
    assert found[2:, 2:] == pytest.approx(CYCLIC.covariance)
    assert found[:2, 2:] == pytest.approx(Item.covariance[:2, 2:])
    assert (found == found.T).all()


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
        ((), "none", ["nothing-added"], []),
    ],
)
def test_what_is_not_written_or_doubtful_is_warned_of(
    closed: Any,
    tmp_path: Path,
    effects: tuple[FoundEffect, ...],
    verdict: str,
    codes: list[str],
    names: list[str],
) -> None:
    said = done(closed(*effects, verdict=verdict)).stderr
    assert [line.rpartition("[")[2].rstrip("]") for line in said.splitlines()] == codes
    written = yaml.safe_load((tmp_path / "new.yaml").read_text()).get("effects", [])
    assert [item["name"] for item in written] == names


@pytest.mark.parametrize(
    ("effects", "verdict", "met"),
    [
        ((), "none", []),
        ((BACKLASH,), "named", ["found"]),
        ((CLASS,), "class", ["found"]),
        ((), "unexplained", ["found", "unexplained"]),
    ],
)
def test_the_gates(closed: Any, effects: Any, verdict: str, met: list[str]) -> None:
    said = done(closed(*effects, verdict=verdict, gates="found,unexplained"), 3 if met else 0)
    lines = [x for x in said.stderr.splitlines() if x.startswith("mtu: gate ")]
    assert [line.split()[2].rstrip(":") for line in lines] == met
