"""`mtu iso230` as it is called: files, limits, an earlier test, a plan, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_runner import done, mtu, report
from positioning_examples import EXPECTED, published, write_readings

BUDGET = "schema: mtu/study/1\nbudget: {device_U_um_per_m: 20, E_VE_um: 0.5}\n"


@pytest.fixture
def laser(tmp_path: Path) -> Path:
    (tmp_path / "budget.yaml").write_text(BUDGET, "utf-8")
    return write_readings(tmp_path / "laser.csv", *published(3))


def test_a_laser_file_alone_gives_the_published_figures(laser: Path, tmp_path: Path) -> None:
    found = report("iso230", "--laser", laser)["results"]["axes"]["dx_x"]
    for name, value in EXPECTED[3].items():
        assert found[name]["value"] == pytest.approx(value, abs=1e-4)
        assert found[name]["u"] is None
        assert found[name]["u_sampling"] > 0
    assert (found["unit"], found["runs"]) == ("um", {"forward": 5, "reverse": 5})
    assert found["at_target"][2]["R"] == pytest.approx(14.0442, abs=1e-4)
    assert found["vdi3441"]["P"] == pytest.approx(27.1707, abs=1e-4)
    pictures = ("--plot", tmp_path / "a.png", "--report", tmp_path / "a.html")
    said = done(mtu("iso230", "--laser", laser, "--standard", "vdi3441", *pictures)).stdout
    assert said.startswith("dx_x: P 27.2")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "a.html").read_text("utf-8")
    assert "At the targets\naxis  target" in said


def test_a_matrix_without_a_unit_is_in_that_of_the_component(tmp_path: Path) -> None:
    targets, readings = published(3)
    head = "target," + ",".join(f"{run} {way}" for way in ("fwd", "rev") for run in range(1, 6))
    rows = np.column_stack([targets, *readings]).round(5).astype(str)
    (tmp_path / "w.csv").write_text("\n".join([head, *map(",".join, rows), ""]), "utf-8")
    components = "components: {dx_x: {of: x, unit: um}}\nequations: {Ex: dx_x}\n"
    (tmp_path / "m.yaml").write_text(f"schema: mtu/machine/1\nname: m\n{components}", "utf-8")
    call = ("iso230", "--laser", "dx_x=w.csv")
    found = report(*call, "-m", "m.yaml", cwd=tmp_path)["results"]["axes"]["dx_x"]
    assert found["A"]["value"] == pytest.approx(EXPECTED[3]["A"], abs=1e-4)
    assert "the unit of the readings is missing" in done(mtu(*call, cwd=tmp_path), 2).stderr


def test_limits_meet_their_gate(laser: Path) -> None:
    call = ("iso230", "--laser", laser, "--fail-if", "nonconforming")
    budget = ("--budget", laser.with_name("budget.yaml"))
    met = done(mtu(*call, *budget, "--limit", "A=10", "--limit", "dx_x.B=40"), 3)
    assert "gate nonconforming: beyond the limit by ISO 14253-1: A of dx_x" in met.stderr
    assert "ISO 14253-1" in met.stdout
    assert max(map(len, met.stdout.splitlines())) <= 100
    done(mtu(*call, *budget, "--limit", "A=40"))
    assert "[not-proven]" in done(mtu(*call, *budget, "--limit", "A=22")).stderr
    assert "the gate nonconforming is undefined" in done(mtu(*call), 2).stderr
    assert "[no-uncertainty]" in done(mtu(*call, "--limit", "R=50")).stderr
    # Of the other standard they are limits of its own figures.
    vdi = ("--standard", "vdi3441", "--limit")
    assert "P of dx_x 27.17 um" in done(mtu(*call, *vdi, "P=20"), 3).stderr
    assert "unknown figure" in done(mtu(*call, *vdi, "A=20"), 2).stderr


def test_outlying_runs_are_reported_and_stay(tmp_path: Path) -> None:
    laser = write_readings(tmp_path / "laser.csv", *published(1))
    said = done(mtu("iso230", "--laser", laser, "--fail-if", "suspicious"), 3)
    assert said.stderr.count("[outlying-value]") == 1
    assert "(rows 2, 7)" in said.stderr
    assert "A 205" in said.stdout


def test_an_earlier_test_is_compared(laser: Path, tmp_path: Path) -> None:
    targets, readings = published(3)
    earlier = readings + np.array([30.0, 0.0])[:, None, None]
    before = write_readings(tmp_path / "before.csv", targets, earlier)
    said = done(mtu("iso230", "--laser", laser, "--before", before, "-o", tmp_path / "o.json"))
    assert "Changed since the earlier test: " in said.stdout
    made = json.loads((tmp_path / "o.json").read_text("utf-8"))
    found = made["results"]["axes"]["dx_x"]["before"]
    assert (found["B"]["differs"], found["R_forward"]["differs"]) == (True, False)
    assert [x["role"] for x in made["inputs"]] == ["laser", "before"]
    other = write_readings(tmp_path / "other.csv", targets, earlier, "dy_y")
    refused = done(mtu("iso230", "--laser", laser, "--before", other), 2).stderr
    assert "none of these axes" in refused


def test_rotary_axes_and_angles_have_their_units(tmp_path: Path) -> None:
    rows = [
        f"ec_c,{45 * i},{run},{way},{(i * run) % 3 + (way == '-')},arcsec"
        for i in range(8)
        for run in range(1, 6)
        for way in "+-"
    ]
    header = "component,position_deg,pass,direction,error,unit"
    (tmp_path / "c.csv").write_text("\n".join([header, *rows]), "utf-8")
    found = report("iso230", "--laser", tmp_path / "c.csv")["results"]["axes"]["ec_c"]
    assert (found["unit"], found["targets_mm"]) == ("arcsec", None)
    assert found["targets_deg"] == [45.0 * i for i in range(8)]
    assert found["B_mean"]["value"] == pytest.approx(-1.0)


def test_a_plan_needs_no_readings(tmp_path: Path) -> None:
    call = ("iso230", "--plan", 500, "--pitch", 10)
    done(mtu(*call, "--report", "plan.html", cwd=tmp_path))
    plan = report(*call)["results"]["plan"]
    assert len(plan["targets_mm"]) == 5
    assert all(0.5 < x % 10 < 9.5 for x in plan["targets_mm"])


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("--standard iso", "unknown standard"),
        ("--limit Q=5", "unknown figure"),
        ("--limit A", "NAME=VALUE"),
        ("--limit A=-5", "a number above 0"),
        ("--budget none.yaml", "no such file"),
        ("--plan 500 --pitch 10 --plot p.png", "not drawn"),
        ("--plan 500", "--plan without --pitch"),
        ("--plan -1 --pitch 1", "out of range"),
        ("--plan 10 --pitch 20", "below --plan"),
    ],
)
def test_slips_of_a_call_are_one_message(words: str, text: str, laser: Path) -> None:
    called = mtu("iso230", "--laser", laser, *words.split(), cwd=laser.parent)
    assert text in done(called, 2).stderr


def test_faulty_files_are_one_message(laser: Path, tmp_path: Path) -> None:
    mixed = laser.read_text("utf-8").replace(",um\n", ",arcsec\n", 1)
    cases = {
        mixed: "dx_x is a length (mm), not an angle or ratio (rad)",
        "component,error,unit\naxy,3,arcsec\n": "no component was read at targets",
    }
    for content, expected in cases.items():
        (tmp_path / "a.csv").write_text(content, "utf-8")
        said = done(mtu("iso230", "--laser", tmp_path / "a.csv"), 2).stderr
        assert said.count("\n") == 1
        assert expected in said
    budget = tmp_path / "budget.yaml"
    budget.write_text("schema: mtu/study/1\nbudget: {T_mean_degC: 23}\n", "utf-8")
    said = done(mtu("iso230", "--laser", laser, "--budget", budget), 2).stderr
    assert "'alpha_um_per_m_K' is missing" in said
    assert "'already_at_20' is missing" in said
