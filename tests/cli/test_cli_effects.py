"""Machines with effects in every command, and the files that close-loop adds to its report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_runner import prepared
from loop_examples import effect, on_table, parameter, result, searched
from model_examples import run_command
from support import read_components, written_effect

from mtu_cli.analyses.close_loop.result import FoundEffect
from mtu_cli.cli import close_loop
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.files.extend_machine import extended_machine
from mtu_cli.files.machine import load_machine
from mtu_cli.model.settings import Settings

EFFECTS = [
    written_effect(
        name="backlash-x",
        parameters={"lost_motion": (4.0, 0.3, "um")},
        equations={"Ex": "lost_motion*dir_x"},
    ),
    written_effect(
        name="trend-y",
        parameters={"slope": (0.5, 0.1, "um")},
        equations={"Ey": "slope*(tool_parts - 3)"},
    ),
]
PREDICTIONS = ("predict-points", "lengths", "orthogonality")
AT = ("--at", "dir_x=1", "--at", "tool_parts=5")
PLACES = {"A": (0, 0), "B": (100, 0), "C": (200, 0), "D": (0, 80), "E": (0, 160)}


def cmm() -> str:
    """Five parts whose holes are where they should be, half of them after a reversal."""
    rows = ["part,feature,x_mm,y_mm,dir_x,tool_parts"]
    for part in range(5):
        for i, (name, (x, y)) in enumerate(PLACES.items()):
            moved = 0.002 * ((part * i) % 3) + 0.0007 * part
            rows.append(f"{part},{name},{x + moved:.4f},{y - moved:.4f},{(-1) ** i},{part}")
    return "\n".join(rows) + "\n"


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """The small study, whose machine has two effects; the machine as it was beside it."""
    folder = prepared(tmp_path / "work")
    (folder / "before.yaml").write_bytes((folder / "machine.yaml").read_bytes())
    content = extended_machine(load_machine(folder / "machine.yaml"), EFFECTS).content
    (folder / "machine.yaml").write_bytes(content)
    (folder / "cmm.csv").write_text(cmm())
    return folder


@pytest.mark.parametrize("command", PREDICTIONS)
def test_predictions_take_the_covariates(
    command: str, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, report, told = run_command(monkeypatch, work, command, *AT)
    assert code == 0
    assert report["settings"]["at"] == {"dir_x": 1.0, "tool_parts": 5.0}
    # One direction for both ends of a length takes the reversal out of it: not without a word.
    assert ("[one-direction]" in told) == (command != "predict-points")


JOINT = np.array([[0.09, 0.02, 0.001], [0.02, 0.25, 0.03], [0.001, 0.03, 0.04]])
"""Of the parameters of what was found, in their units."""
FACTORS = np.array([1e-3, np.pi / 648000, 1e-6])
BACKLASH = effect(
    "backlash-x",
    parameter("lost_motion", "um", 2.0, 0.3),
    covariate="dir_x",
    equations={"Ex": "lost_motion*dir_x"},
    classes=(("backlash-x", 0.6), ("trend-x", 0.3)),
    rows=(0,),
)
TURN = effect(
    "turn",
    parameter("angle", "arcsec", 3.0, 0.5),
    parameter("scale", "um/m", 7.0, 0.2),
    covariance=JOINT[1:, 1:] * np.outer(FACTORS, FACTORS)[1:, 1:],
    equations={"Ex": "-angle*(y - 40) + scale*(x - 50)", "Ey": "angle*(x - 50)"},
    searched=searched("pitch_mm", 10.0, (9.5, 10.5)),
    rows=(1, 2),
)
FOUND = [BACKLASH, TURN]
APART = [replace(item, rows=()) for item in FOUND]


def inputs_of(work: Path, monkeypatch: pytest.MonkeyPatch, **values: Any) -> Inputs:
    monkeypatch.chdir(work)
    paths = {
        name: [Path(item) for item in value] if isinstance(value, list) else Path(value)
        for name, value in values.items()
    }
    return Inputs(Options("close-loop", paths))


def made(inputs: Inputs, effects: Sequence[FoundEffect], *components: str) -> list[str]:
    """Writes what is asked for as if `effects` were found, each in the readings of one of some
    components or all in points, and gives the codes of the warnings.
    """
    tables, earlier, _ = close_loop._tables(inputs, "none")
    by_name = {table.component: table for table in tables}
    covariance = JOINT * np.outer(FACTORS, FACTORS)
    points = on_table(*effects, table=replace(tables[0], component=None), covariance=covariance)
    items = [
        on_table(own, table=by_name[component])
        for own, component in zip(effects, components, strict=False)
    ]
    found = result(*items or [points])
    files, warnings = close_loop._written(inputs, earlier, Settings(), found)
    for path, content in files.items():
        path.write_bytes(content)
    return [warning.code for warning in warnings]


WRITE = {"write_machine": "new.yaml", "write_components": "new.json"}


@pytest.mark.parametrize("source", ["readings", "report", "machine file"])
def test_the_files_of_close_loop_predict_with_the_joint_covariance(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = prepared(tmp_path / "work")
    (work / "cmm.csv").write_text(cmm())
    given: dict[str, Any] = {"machine": "machine.yaml", "part": "part.yaml", "cmm": ["cmm.csv"]}
    call = ["-p", "part.yaml", "--covariance"]
    if source == "readings":
        given["lbb"] = ["lbb.csv"]
        call += ["--lbb", "lbb.csv"]
    elif source == "report":
        run_command(monkeypatch, work, "fit-components", "-m", "machine.yaml", "--lbb", "lbb.csv")
        (work / "report.json").rename(work / "c.json")
        given["components"] = ["c.json"]
        call += ["-c", "c.json"]
    else:
        text = (work / "machine.yaml").read_text()
        for name in ("dx_x: {", "ez_x: {", "dy_y: {"):
            text = text.replace(name, name + "coefficients: [1, 0.01], s_repeat: 0.5, ")
        text = text.replace("axy: {", "axy: {coefficients: [2], covariance: [[0.3]], ")
        (work / "machine.yaml").write_text(text)
    _, old, _ = run_command(monkeypatch, work, "predict-points", "-m", "machine.yaml", *call)
    inputs = inputs_of(work, monkeypatch, **given, **WRITE)
    assert len(inputs.points.parts) == 5
    assert made(inputs, FOUND) == ["written-class"]
    entry, turn = load_machine(work / "new.yaml").machine.effects
    assert entry.seen == {"dir_x": [-1.0, 1.0]}
    assert turn.seen == {"y": [0.0, 160.0], "x": [0.0, 200.0]}
    assert [item["path"] for item in entry.found["files"]] == ["cmm.csv"]
    assert entry.found["class"] == ["backlash-x", "trend-x"]
    call = ["predict-points", "-m", "new.yaml", *call[:3], "--at", "dir_x=1"]
    code, new, told = run_command(monkeypatch, work, *call, "-c", "new.json")
    assert code == 0, told
    if source == "readings":
        readings = ("-m", "machine.yaml", "--lbb", "lbb.csv")
        _, fit, _ = run_command(monkeypatch, work, "fit-components", *readings)
        report = json.loads((work / "new.json").read_text())
        effects = report["results"].pop("effects")
        assert (report["schema"], report["results"]) == (fit["schema"], fit["results"])
        assert effects["parameters"] == ["backlash-x.lost_motion", "turn.angle", "turn.scale"]
        assert effects["units"] == ["um", "arcsec", "um/m"]
        assert effects["values"] == pytest.approx([2, 3, 7])
    x, y = np.array([PLACES[name] for name in PLACES]).T
    J = np.zeros((10, 3))
    J[0::2, 0], J[0::2, 1], J[0::2, 2] = 1, -(y - 40) * np.pi / 648, (x - 50) * 1e-3
    J[1::2, 1] = (x - 50) * np.pi / 648
    more = np.array(new["results"]["covariance_um2"]) - old["results"]["covariance_um2"]
    assert more == pytest.approx(J @ JOINT @ J.T, rel=1e-6, abs=1e-9)
    alone = JOINT.copy()
    alone[0, 1:] = alone[1:, 0] = 0
    if source != "machine file":
        call += ["--lbb", "lbb.csv"]
    _, single, _ = run_command(monkeypatch, work, *call)
    more = np.array(single["results"]["covariance_um2"]) - old["results"]["covariance_um2"]
    assert more == pytest.approx(J @ alone @ J.T, rel=1e-6, abs=1e-9)


def test_a_second_round_keeps_what_the_first_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = prepared(tmp_path / "work")
    first = inputs_of(work, monkeypatch, machine="machine.yaml", lbb=["lbb.csv"], **WRITE)
    made(first, FOUND)
    given = {"machine": "new.yaml", "components": ["new.json"]}
    targets = {"write_machine": "third.yaml", "write_components": "third.json"}
    made(inputs_of(work, monkeypatch, **given, **targets, lbb=["lbb.csv"]), APART[:1])
    assert (work / "third.yaml").read_bytes().startswith((work / "new.yaml").read_bytes())
    effects = read_components(work / "third.json").effects
    assert effects is not None
    assert effects.parameters[-2:] == ["turn.scale", "backlash-x-2.lost_motion"]
    assert np.array(effects.covariance)[:3, :3] == pytest.approx(JOINT)
    assert np.array(effects.covariance)[3] == pytest.approx([0, 0, 0, 0.09])
