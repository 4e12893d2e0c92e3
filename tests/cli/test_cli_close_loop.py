"""`mtu close-loop` on the shipped study whose machine has an effect that its file does not know."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from cli_runner import Listing, Result, done, listing, mtu
from support import CONFIGS, DATA

UNDECLARED = CONFIGS / "undeclared"
MACHINE = UNDECLARED / "machine.yaml"
READINGS = DATA / "undeclared" / "lbb.csv"
TRUE_UM = -4.0
"""What truth.yaml says; no command here reads it."""

KEYS = {
    "verdict", "undeclared_effect_found", "before", "after", "floor_um", "in_sample",
    "improvement_percent", "effects", "candidates", "unexplained",
}  # fmt: skip
SCORES = {"rms_um", "rms_x_um", "rms_y_um", "p95_um", "max_um", "chi2_per_dof"}
EFFECT = {
    "name", "family", "axis", "covariate", "equations", "parameters", "searched", "p_familywise",
    "log_bayes_factor", "posterior", "explained_share", "class", "aliases", "experiment",
}  # fmt: skip
CANDIDATE = {
    "name", "p_familywise", "log_bayes_factor", "posterior", "minimum_detectable_um",
}  # fmt: skip
FILES = {
    "-o": "out.json", "--csv": "out.csv", "--plot": "out.png",
    "--write-machine": "new.yaml", "--write-components": "new.json",
}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A call in a folder of its own, and what it left there."""

    folder: Path
    result: Result
    files: Listing

    @property
    def results(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.files["out.json"] or b"")["results"]
        return found

    @property
    def machine(self) -> Path:
        return self.folder / "new.yaml"


def closed(folder: Path, gate: str, code: int, env: dict[str, str] | None = None) -> Run:
    options = [word for pair in FILES.items() for word in pair]
    call = ("close-loop", UNDECLARED, *options, "--fail-if", gate)
    result = done(mtu(*call, cwd=folder, env=env), code)
    return Run(folder, result, listing(folder))


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return closed(tmp_path_factory.mktemp("first"), "found", 3)


def test_the_effect_is_named_alone(first: Run) -> None:
    results = first.results
    assert results["verdict"] == "named"
    assert results["undeclared_effect_found"] is True
    (effect,) = results["effects"]
    assert (effect["name"], effect["class"]) == ("backlash-x", ["backlash-x"])
    assert effect["equations"] == {"Ex": "lost_motion*dir_x + level_x"}
    assert effect["p_familywise"] < 0.05
    parameter = effect["parameters"]["lost_motion"]
    assert parameter["unit"] == "um"
    assert abs(parameter["value"] - TRUE_UM) < 3 * parameter["u"]
    assert parameter["u"] < 0.3
    # Where it was found: the parts were machined in both directions.
    (written,) = yaml.safe_load(first.machine.read_text())["effects"]
    assert written["seen"] == {"dir_x": [-1.0, 1.0]}
    assert not results["unexplained"]["found"]


def test_the_gain_is_held_out_and_near_the_floor(first: Run) -> None:
    """The truth leaves rms^2 less sum of effect^2 over both axes: 4^2/2."""
    results = first.results
    assert results["held_out"]["by"] == "parts"
    before, after = results["before"]["rms_um"], results["after"]["rms_um"]
    assert before**2 - after**2 == pytest.approx(TRUE_UM**2 / 2, rel=0.15)
    assert after < 1.2 * results["floor_um"]
    gain = 100 * (1 - after / before)
    assert results["improvement_percent"] == pytest.approx(gain)
    # Nothing is wrong in y; a fold in twenty may claim something small there.
    assert results["after"]["rms_y_um"] == pytest.approx(results["before"]["rms_y_um"], rel=0.02)


def test_the_report_holds_what_scripts_rely_on(first: Run) -> None:
    document = json.loads(first.files["out.json"] or b"")
    assert document["schema"] == "mtu/close-loop/1"
    results = document["results"]
    assert set(results) >= KEYS
    for scores in (results["before"], results["after"], *results["in_sample"].values()):
        assert set(scores) >= SCORES
    assert set(results["effects"][0]) >= EFFECT
    assert all(set(candidate) >= CANDIDATE for candidate in results["candidates"])
    assert set(results["unexplained"]) >= {"found", "checks", "rms_um"}
    assert all(set(check) >= {"name", "p"} for check in results["unexplained"]["checks"])


def test_the_table_says_it_first_and_in_words(first: Run) -> None:
    heading, *rest = first.result.stdout.splitlines()
    assert heading == "Undeclared effects: named"
    said = " ".join(rest[:3])
    assert re.search(r"X loses \d\.\d+ ± 0\.\d+ um at reversal \(backlash-x\)", said)
    assert "error of held-out parts falls from 3." in said
    assert max(map(len, first.result.stdout.splitlines())) <= 100
    assert "mtu: gate found: verdict named: backlash-x\n" in first.result.stderr


def test_the_same_bytes_again(first: Run, tmp_path: Path) -> None:
    """Elsewhere, in another language, with another hash seed and number of threads."""
    strange = {"PYTHONHASHSEED": "7", "LC_ALL": "de_DE.UTF-8", "OMP_NUM_THREADS": "1"}
    again = closed(tmp_path, "unexplained", 0, strange)
    assert set(first.files) == set(FILES.values())
    assert (first.files["out.png"] or b"").startswith(b"\x89PNG")
    for name in first.files:
        assert again.files[name] == first.files[name], name
    assert again.result.stdout == first.result.stdout


def test_the_extended_machine_has_nothing_left(first: Run, tmp_path: Path) -> None:
    new = tmp_path / "again.yaml"
    call = ("close-loop", UNDECLARED, "-m", first.machine, "--fail-if", "found")
    result = done(mtu(*call, "-o", "-", "--write-machine", new, "--plot", tmp_path / "p.svg"))
    results = json.loads(result.stdout)["results"]
    assert (results["verdict"], results["effects"]) == ("none", [])
    in_sample = results["in_sample"]
    assert in_sample["after"] == in_sample["before"]
    assert in_sample["before"]["rms_um"] == pytest.approx(
        first.results["in_sample"]["after"]["rms_um"], rel=1e-3
    )
    assert new.read_bytes() == first.machine.read_bytes()
    assert "nothing-added" in result.stderr
    assert (tmp_path / "p.svg").read_text("utf-8").startswith("<?xml")


def test_readings_alone_are_judged_by_component(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    said = done(mtu("close-loop", "-m", MACHINE, "--lbb", READINGS, "-q", "-o", out)).stderr
    assert "nothing-added" not in said
    results = json.loads(out.read_text("utf-8"))["results"]
    components = [item["component"] for item in results["tables"]]
    assert components == ["dx_x", "dy_x", "dy_y", "dx_y", "ex_x", "ey_x", "ez_x", "ex_y", "ey_y",
                          "ez_y", "axy"]  # fmt: skip
    assert results["verdict"] == "none"
    assert "floor_arcsec" in next(i for i in results["tables"] if i["component"] == "ez_x")


def test_the_drift_of_a_component_without_an_axis_is_written_and_read_again(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(
        "schema: mtu/machine/1\nname: m\naxes: {y: {travel_mm: [0, 500]}}\n"
        "components: {axy: {unit: arcsec}}\nequations: {Ex: -y*axy}\n"
    )
    rows = [f"axy,{k},{0.8 * k + 0.1 * (k * k % 3 + j)},arcsec" for k in range(12) for j in (0, 1)]
    (tmp_path / "l.csv").write_text("\n".join(["component,pass,error,unit", *rows]) + "\n")
    lbb = ("--lbb", "l.csv")
    done(mtu("close-loop", "-m", "m.yaml", *lbb, "--write-machine", "new.yaml", cwd=tmp_path))
    (written,) = yaml.safe_load((tmp_path / "new.yaml").read_text("utf-8"))["effects"]
    assert (written["name"], written["axis"]) == ("trend-axy", "axy")
    done(mtu("fit-components", "-m", "new.yaml", *lbb, cwd=tmp_path))
