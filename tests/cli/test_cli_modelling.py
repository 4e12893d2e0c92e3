"""What a call's files are taken for, whatever is asked for first."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_runner import prepared

from mtu_cli.cli.analyse import fit_components as fitting
from mtu_cli.cli.emit import execute
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import modelled
from mtu_cli.cli.options import Options


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the small study, as the working folder."""
    folder = prepared(tmp_path / "work")
    monkeypatch.chdir(folder)
    return folder


def edited(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def drifting(path: Path) -> None:
    """Six passes of dx_x there and back in place of its own, 10 um further each."""
    lines = [x for x in path.read_text().splitlines() if x[:4] not in ("dx_x", "# --", "# Sy")]
    for number in range(1, 7):
        for way, sign in (("forward", 1), ("reverse", -1)):
            for place in (0, 50, 100, 150, 200):
                error = 10 * number + 0.1 * sign * (place * number % 7)
                lines.append(f"dx_x,{place},{number},{way},{error},um")
    path.write_text("\n".join(lines) + "\n")


def told(code: str, **files: object) -> list[str]:
    """What lengths, or any prediction, says of a code."""
    inputs = Inputs(Options("lengths", {"machine": Path("machine.yaml"), **files}))
    return [item.message for item in modelled(inputs).warnings if item.code == code]


def test_what_limits_u_comes_with_predictions_too(work: Path) -> None:
    """From readings and from a report of their fit alike, of what the equations use."""
    readings, report = {"lbb": [Path("lbb.csv")]}, {"components": [Path("c.json")]}
    assert told("passes-drift", **readings) == []
    drifting(work / "lbb.csv")
    own = {"machine": Path("machine.yaml"), **readings, "out": Path("c.json"), "quiet": True}
    execute(Options("fit-components", own), fitting)
    (drift,) = told("passes-drift", **readings)
    assert drift.startswith("dx_x drifts by ")
    assert told("reported", **report) == [f"c.json: {drift}"]
    # A report that says it twice.
    document = json.loads((work / "c.json").read_text())
    (work / "c.json").write_text(
        json.dumps(document | {"warnings": 2 * document["warnings"] + [{"code": 1}]})
    )
    assert told("reported", **report) == [f"c.json: {drift}"]
    edited(work / "machine.yaml", "Ex: dx_x - y*axy", "Ex: -y*axy")
    assert told("passes-drift", **readings) == []


def test_coefficients_that_readings_beat_are_not_asked_for_their_uncertainty(work: Path) -> None:
    readings = {"lbb": [Path("lbb.csv")]}
    edited(work / "machine.yaml", "axy: {unit: urad,", "axy: {unit: urad, coefficients: [5],")
    assert told("no-uncertainty", **readings) == []
    lines = (work / "lbb.csv").read_text().splitlines()
    (work / "lbb.csv").write_text("\n".join(x for x in lines if not x.startswith("axy")) + "\n")
    (asked,) = told("no-uncertainty", **readings)
    assert "components.axy" in asked
