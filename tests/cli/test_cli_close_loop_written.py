"""What close-loop writes, warns of and which gates it meets, of results that are known."""

from __future__ import annotations

import json
from collections.abc import Sequence
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
READINGS = DATA / "undeclared" / "lbb.csv"
OFFSET = effect("offset-x", parameter("shift", "um", 0.2, 0.3))
OPEN = replace(CYCLIC, searched=searched("pitch_mm", 12.5, (9.0, 9.1), (12.3, 12.7)))


JOINT = np.array([[0.09, 0.02, 0.001], [0.02, 0.25, 0.03], [0.001, 0.03, 0.04]])
"""Of the parameters of what was found, in their units."""
FACTORS = np.array([1e-3, np.pi / 648000, 1e-6])
LOST = effect(
    "backlash-x",
    parameter("lost_motion", "um", 2.0, 0.3),
    equations={"Ex": "lost_motion*dir_x"},
    covariance=JOINT[:1, :1] * 1e-6,
)
TURN = effect(
    "turn",
    parameter("angle", "arcsec", 3.0, 0.5),
    parameter("scale", "um/m", 7.0, 0.2),
    covariance=(JOINT * np.outer(FACTORS, FACTORS))[1:, 1:],
    equations={"Ex": "-angle*(y - 40) + scale*(x - 50)", "Ey": "angle*(x - 50)"},
    rows=(1, 2),
)
WRITE = ("--write-machine", "new.yaml", "--write-components", "new.json")
PLACES = np.array([[50.0, 20.0], [120.0, 130.0]])

KNOWN: list[CloseLoopResult] = []
"""The result of the study, found once."""


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """A call whose analysis finds given effects, which writes new.yaml and new.json."""
    real = close_loop.close_loop

    def call(*effects: FoundEffect, verdict: Any = "named", more: Sequence[str] = ()) -> Result:
        def found(*args: Any, **options: Any) -> Any:
            KNOWN[:] = KNOWN or [real(*args, **options)]
            table = replace(
                KNOWN[0].tables[0],
                effects=effects,
                verdict=verdict,
                covariance=JOINT * np.outer(FACTORS, FACTORS),
            )
            return replace(KNOWN[0], verdict=verdict, tables=(table,))

        monkeypatch.setattr(close_loop, "close_loop", found)
        options = [*(more or WRITE), "--fail-if", "found,unexplained"]
        return mtu("close-loop", UNDECLARED, "-q", *options, cwd=tmp_path)

    return call


def predicted(folder: Path, *call: object) -> Any:
    """Results of predictions at two places."""
    features = "".join(f"  p{x:g}: {{x_mm: {x}, y_mm: {y}, z_mm: 127}}\n" for x, y in PLACES)
    (folder / "part.yaml").write_text(f"schema: mtu/part/1\nname: p\nfeatures:\n{features}")
    call = ("predict-points", "-p", "part.yaml", *call, "--covariance")
    return report(*call, cwd=folder)["results"]


def test_a_smooth_effect_is_a_table_that_predictions_take(closed: Any, tmp_path: Path) -> None:
    done(closed(SMOOTH), 3)
    (written,) = yaml.safe_load((tmp_path / "new.yaml").read_text())["effects"]
    assert written["equations"] == {"Ex": "profile_x"}
    assert written["components"]["profile_x"]["at_mm"] == [0, 50, 100, 150]
    old, new = (
        predicted(tmp_path, "-m", path, "--lbb", READINGS)["points"][0]
        for path in (UNDECLARED / "machine.yaml", "new.yaml")
    )
    assert new["Ex_um"] - old["Ex_um"] == pytest.approx(3.0)
    assert new["var_x_um2"] - old["var_x_um2"] == pytest.approx(0.2)


def test_the_files_hold_the_joint_covariance_and_a_second_round_keeps_it(
    closed: Any, tmp_path: Path
) -> None:
    done(closed(LOST, TURN), 3)
    old = predicted(tmp_path, "-m", UNDECLARED / "machine.yaml", "--lbb", READINGS)
    x, y = PLACES.T
    J = np.zeros((4, 3))
    J[0::2, 0], J[0::2, 1], J[0::2, 2] = 1, -(y - 40) * np.pi / 648, (x - 50) * 1e-3
    J[1::2, 1] = (x - 50) * np.pi / 648
    # The machine file alone knows no covariance between effects.
    apart = np.block([[JOINT[:1, :1], np.zeros((1, 2))], [np.zeros((2, 1)), JOINT[1:, 1:]]])
    for files, C in ((("-c", "new.json"), JOINT), (("--lbb", READINGS), apart)):
        new = predicted(tmp_path, "-m", "new.yaml", *files, "--at", "dir_x=1")
        more = np.array(new["covariance_um2"]) - old["covariance_um2"]
        assert more == pytest.approx(J @ C @ J.T, rel=1e-6, abs=1e-9)
    again = ("-m", "new.yaml", "-c", "new.json", "--write-machine", "third.yaml")
    done(closed(LOST, more=(*again, "--write-components", "third.json")), 3)
    first = (tmp_path / "new.yaml").read_bytes()
    assert (tmp_path / "third.yaml").read_bytes().startswith(first)
    effects = json.loads((tmp_path / "third.json").read_text())["results"]["effects"]
    assert effects["parameters"][-2:] == ["turn.scale", "backlash-x-2.lost_motion"]
    assert np.array(effects["covariance"])[:3, :3] == pytest.approx(JOINT)
    assert np.array(effects["covariance"])[3] == pytest.approx([0, 0, 0, 0.09])


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
