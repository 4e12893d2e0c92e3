"""Axes: `mtu iso230`, `mtu circular`, and tables of controls by `mtu compensate`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from circle_examples import Causes, csv_text, made
from cli_runner import HERE, done, machine_file, mtu, refused, report
from made_files import B5R
from positioning_examples import EXPECTED, published, write_readings
from support import CONFIGS

from mtu_cli.files.reports_read import ComponentsReport, read_report
from mtu_cli.formats.control import CONTROLLERS

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
    machine_file(tmp_path, "{dx_x: {of: x, unit: um}}", "{Ex: dx_x}")
    call = ("iso230", "--laser", "dx_x=w.csv")
    found = report(*call, "-m", "m.yaml", cwd=tmp_path)["results"]["axes"]["dx_x"]
    assert found["A"]["value"] == pytest.approx(EXPECTED[3]["A"], abs=1e-4)
    assert "the unit of the readings is missing" in done(mtu(*call, cwd=tmp_path), 2).stderr


def test_what_a_positioning_test_lacks_of_the_standard_is_warned_of(tmp_path: Path) -> None:
    """Three targets and four runs where it asks for five of each, all zeroed at the first one."""
    targets, readings = published(3)
    few = readings[:, :3, :4] * (np.arange(3) > 0)[:, None]
    laser = write_readings(tmp_path / "few.csv", targets[:3], few)
    document = report("iso230", "--laser", laser)
    texts = [x["message"] for x in document["warnings"] if x["code"] == "test-conditions"]
    assert ["3 targets over 20 mm" in texts[0], "4 runs at a target" in texts[1]] == [True, True]
    assert all("ISO 230-2" in text for text in texts)
    axis = document["results"]["axes"]["dx_x"]
    assert axis["at_target"][0]["R"] is None
    assert axis["at_target"][1]["R"] > 0
    (gap,) = (x for x in document["warnings"] if x["code"] == "not-estimable")
    assert "R at 15 mm" in gap["message"]


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


def test_an_earlier_test_is_compared(laser: Path, tmp_path: Path) -> None:
    targets, readings = published(3)
    earlier = readings + np.array([30.0, 0.0])[:, None, None]
    before = write_readings(tmp_path / "before.csv", targets, earlier)
    said = done(mtu("iso230", "--laser", laser, "--before", before, "-o", tmp_path / "o.json"))
    assert "Changed since the earlier test: " in said.stdout
    made = json.loads((tmp_path / "o.json").read_text("utf-8"))
    found = made["results"]["axes"]["dx_x"]
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
        mixed: "dx_x is an angle or ratio (rad), not a length (mm)",
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


# `mtu circular` as it is called: columns or options, files handed on, and what is refused.


SHIPPED = HERE / "circular-traces.csv"
TRAVELS = "axes: {x: {travel_mm: [0, 500]}, y: {travel_mm: [0, 500]}}"


def found(*words: object) -> dict[str, Any]:
    rows = report("circular", *words)["results"]["diagnosis"]
    return {row["name"]: row["value"] for row in rows}


def test_a_file_is_diagnosed_and_drawn(tmp_path: Path) -> None:
    made_again = csv_text(made(Causes(), n=180, s=0.0003, phi=0.8, seed=1))
    assert SHIPPED.read_text("utf-8") == made_again
    said = done(mtu("circular", SHIPPED, "--plot", tmp_path / "a.png", "-o", tmp_path / "a.json"))
    assert max(map(len, said.stdout.splitlines())) <= 100
    assert said.stdout.startswith("G ")
    rows = json.loads((tmp_path / "a.json").read_text("utf-8"))["results"]["diagnosis"]
    expected = Causes().expected()
    assert {row["name"] for row in rows} == set(expected)
    for row in rows:
        assert abs(row["value"] - expected[row["name"]]) < 4 * row["u"]
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_options_say_what_columns_do_not(tmp_path: Path) -> None:
    """Two files without columns are the same test, in any order."""
    whole, files = made(Causes(), n=360), []
    head, names, *lines = csv_text(whole, "").splitlines()
    for i, trace in enumerate(whole.traces):
        files.append(tmp_path / f"{trace.direction}.csv")
        own = lines[360 * i : 360 * (i + 1)]
        if i:  # A column of one file goes before the option.
            names, own = f"{names},radius_mm", [f"{line},150" for line in own]
        files[-1].write_text("\n".join([head, names, *own]), "utf-8")
    options = ("--radius", 150, "--feed", 2000, "--plane", "xy")
    known = found(*files, "--direction", "ccw,cw", *options)
    assert known == pytest.approx(Causes().expected(), abs=0.02)
    turned = found(*reversed(files), "--direction", "cw,ccw", *options)
    assert turned == pytest.approx(known, abs=1e-6)
    without = found(*files, "--direction", "ccw,cw", "--radius", 150)
    assert without["servo-mismatch"] is None


def test_squareness_and_lost_motion_are_handed_on(tmp_path: Path) -> None:
    target = tmp_path / "c.json"
    done(mtu("circular", SHIPPED, "-q", "--write-components", target))
    handed = read_report(target)
    assert isinstance(handed, ComponentsReport)
    (value,) = handed.components["axy"].coefficients
    values = found(SHIPPED)
    # Positive above 90 degrees: minus the lean of the second axis towards the first.
    assert value == pytest.approx(-values["squareness"] * 0.206264806, rel=1e-6)
    reversal = handed.document["results"]["reversal"]
    assert reversal["x"]["mean"] == pytest.approx(-values["backlash-a"])
    assert reversal["y"]["mean"] == pytest.approx(-values["backlash-b"])
    machine_file(tmp_path, "{axy: {unit: arcsec}}", "{Ex: -y*axy, Ey: 0}\n" + TRAVELS)
    grid = done(mtu("predict-points", "-m", tmp_path / "m.yaml", "-c", target, "--grid", 2))
    assert "Ex" in grid.stdout


@pytest.mark.parametrize(
    ("columns", "words", "text"),
    [
        ("direction", "", "the nominal radius is missing"),
        ("radius_mm", "", "the direction is missing"),
        ("radius_mm", "--direction up", "unknown direction"),
        ("radius_mm", "--direction cw,ccw", "2 values"),
        ("radius_mm direction", "--feed -1", "out of range"),
        ("radius_mm direction", "--plane XX", "unknown plane"),
        ("radius_mm direction plane", "--plane YZ", "contradicts --plane YZ: 'XY'"),
        ("radius_mm direction", "--write-components {}/c.json", "the plane is missing"),
    ],
)
def test_what_is_not_stated_is_asked_for(
    columns: str, words: str, text: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.csv"
    file.write_text(csv_text(made(Causes(), n=60), columns), "utf-8")
    said = done(mtu("circular", file, *words.format(tmp_path).split()), 2).stderr
    assert text in said
    assert said.count("\n") == 1
    assert not (tmp_path / "c.json").exists()


def test_bad_cells_are_reported_at_once(tmp_path: Path) -> None:
    file, lines = tmp_path / "a.csv", csv_text(made(Causes(), n=60)).splitlines()
    for row, old, new in ((5, ",ccw,", ",up,"), (9, ",XY,", ",XX,"), (11, ",150,", ",,")):
        lines[row] = lines[row].replace(old, new)
    file.write_text("\n".join(lines), "utf-8")
    said = done(mtu("circular", file), 2).stderr
    for text in ("row 6, column 'direction'", "row 10, column 'plane'", "row 12, column 'radius"):
        assert text in said


HEADER = "angle_deg,deviation_um,direction,radius_mm\n"
NARROW = "".join(f"{i * 0.1:.1f},1,ccw,150\n" for i in range(40))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (csv_text(made(Causes(), n=60)).replace(",150,", ",100,", 1), "one in all traces"),
        (csv_text(made(Causes(), n=60)).replace(",XY,", ",YZ,", 1), "one in all traces"),
        (csv_text(made(Causes(), n=60)).replace(",2000,", ",0,", 1), "mm/min above 0"),
        (csv_text(made(Causes(), n=12)), "a trace of 12 samples"),
        (HEADER + NARROW, "away from the reversals"),
    ],
)
def test_traces_that_make_no_test(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text, "utf-8")
    assert said in done(mtu("circular", tmp_path / "a.csv"), 2).stderr


def test_what_a_ballbar_states_is_shown(tmp_path: Path) -> None:
    """Features in the instrument's own unit and sign."""
    stated = tmp_path / "ball.b5r"
    stated.write_text(B5R, "utf-8")
    results = report("circular", stated)["results"]
    assert results["plane"] == "XY"
    rows = {row["feature"]: row for row in results["instrument"]}
    assert (rows["AF_CIRCULARITY"]["value"], rows["AF_CIRCULARITY"]["unit"]) == (8.4, "um")
    assert "2 features stated by the instrument (XY)" in done(mtu("circular", stated)).stdout
    refusals = {
        "a trace is missing": ("--write-components", tmp_path / "c.json"),
        "not drawn": ("--plot", tmp_path / "a.png"),
        "TEST_PLANE: contradicts --plane YZ: 'XY'": ("--plane", "yz"),
        "--pitch: 3 values": ("--pitch", "1,2,3"),
    }
    for text, words in refusals.items():
        assert text in done(mtu("circular", stated, *words), 2).stderr
    (tmp_path / "cut.b5r").write_text(B5R[:90], "utf-8")
    assert "FEATURE" in done(mtu("circular", tmp_path / "cut.b5r"), 2).stderr


def test_cyclic_terms_need_a_pitch() -> None:
    assert not any("cyclic" in name for name in found(SHIPPED))
    known = found(SHIPPED, "--pitch", "40,50")
    assert sum("cyclic" in name for name in known) == 4
    assert "3 values" in done(mtu("circular", SHIPPED, "--pitch", "1,2,3"), 2).stderr


# The installed `mtu compensate`: writing, reading, verification, and calls that it refuses.


RING, MILL = CONFIGS / "valdes-ring", CONFIGS / "laser-mill"
CALL = ("compensate", RING, "--component", "pos_x")
STEP = ("--from", "0", "--to", "500", "--step", "50")
MACHINE = """
schema: mtu/machine/1
name: known
axes: {x: {travel_mm: [0, 400]}}
components:
  dx: {of: x, unit: um, coefficients: [1.0, 0.02], covariance: [[0.04, 0], [0, 1.0e-6]]}
  dy: {of: x, unit: um, coefficients: [0.0, 0.01], s_repeat: 0.2}
  axy: {unit: arcsec, coefficients: [12.0], u_future: 0.5}
equations: {Ex: dx - y*axy, Ey: dy}
effects:
  - name: backlash-x
    parameters: {b: {value: 3.0, u: 0.2, unit: um}}
    equations: {Ex: b*dir_x}
  - name: scale-x
    parameters: {k: {value: 10.0, u: 0.5, unit: um/m}}
    equations: {Ex: k*x}
  - name: tilt
    parameters: {k: {value: 10.0, u: 0.5, unit: um/m}}
    equations: {Ex: k*(x + y)}
"""


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_control_is_written_and_read(name: str, tmp_path: Path) -> None:
    more = ["--set", "counts_per_mm=2000"] if name == "pmac" else []
    equal = () if name == "heidenhain" else STEP
    done(mtu(*CALL, "--for", name, *equal, *more, "--to-file", "t.x", "-q", cwd=tmp_path))
    more += ["--set", "type=0"] if name == "linuxcnc" else []
    found = report("compensate", "--for", name, "--read", "t.x", *more, cwd=tmp_path)["results"]
    assert len(found["points"]) >= 8
    last = found["points"][-1]["forward"]
    assert last == pytest.approx(-19.5, abs=0.4)
    assert (tmp_path / "t.x.txt").exists() != bool(CONTROLLERS[name].comment)


def test_the_report_predicts_and_lists_moves(tmp_path: Path) -> None:
    found = report(*CALL, "--for", "beckhoff", "--to-nc", "v.nc", cwd=tmp_path)["results"]
    assert found["before"]["E"] == pytest.approx(19.6576, abs=1e-3)
    differences = [point["forward"] - point["reverse"] for point in found["points"]]
    assert found["backlash_varies"]["range_um"] == pytest.approx(np.ptp(differences), rel=1e-9)
    assert 0 < found["backlash_varies"]["p"] < 1
    low, high = found["predicted_after"]["E"]["interval95"]
    assert 0.1 < low < found["predicted_after"]["E"]["median"] < high < 5
    for move in found["verification"]["moves"]:
        change = move["expect_without_um"] - move["expect_with_um"]
        assert move["expect_wrong_sign_um"] - move["expect_without_um"] == pytest.approx(change)
    program = (tmp_path / "v.nc").read_text("utf-8")
    assert program.count("F1000") == 12
    assert program.index("X-10.0000") < program.index("X500.0000") < program.index("X510.0000")


def test_one_value_for_both_directions_leaves_the_reversal_to_the_control() -> None:
    said = "A reversal of 0.590 um (forward less reverse) is left to the control."
    for control, left in (("siemens-enc", True), ("heidenhain", False)):
        text = done(mtu("compensate", MILL, "--component", "dx_x", "--for", control)).stdout
        assert (said in " ".join(text.split())) is left
        # Of one column it is zero at the reference.
        assert ("; zero at 0 mm" in text.replace("\n", " ")) is left


@pytest.mark.parametrize(
    ("control", "line"),
    [("siemens-enc", "$AA_ENC_COMP[0,0,Y1]="), ("siemens-cec", "$AN_CEC_OUTPUT_AXIS[0]=(AX2)")],
)
def test_the_axis_is_that_of_the_component(control: str, line: str, tmp_path: Path) -> None:
    machine_file(tmp_path, "{dy_y: {of: y, unit: um, coefficients: [0, 1]}}", "{Ey: dy_y}")
    call = ("compensate", "-m", "m.yaml", "--component", "dy_y", "--from", 0, "--to", 20)
    done(mtu(*call, "--step", 10, "--for", control, "--to-file", "t", cwd=tmp_path))
    assert line in (tmp_path / "t").read_text("utf-8")


def test_what_is_beside_a_table_says_how_it_was_written(tmp_path: Path) -> None:
    done(mtu(*CALL, "--for", "linuxcnc", "--to-file", "x.comp", "-q", cwd=tmp_path))
    assert "This table: type=0 unit=mm." in (tmp_path / "x.comp.txt").read_text("utf-8")
    asked = mtu("compensate", "--read", "x.comp", "--for", "linuxcnc", cwd=tmp_path)
    assert "expected --set type=0 or 1" in done(asked, 2).stderr


def test_verification_by_the_instruments_own_file() -> None:
    """It reads the component of the call, unless a name says otherwise."""
    runs = CONFIGS.parent / "data" / "laser-mill"
    call = ("compensate", MILL, "--component", "dx_x", "--for", "linuxcnc", "--verify")
    for name, verdict in (("x-after.rtl", "worked"), ("x.rtl", "no-effect")):
        found = report(*call, runs / name)["results"]["verification"]
        assert found["verdict"] == verdict
        assert None not in [move["measured_um"] for move in found["moves"]]
    refusal = done(mtu(*call, f"dy_y={runs / 'x.rtl'}"), 2).stderr
    assert "--verify holds readings of dy_y, not of dx_x" in refusal
    assert "x.rtl: --verify" in refusal


def test_what_the_loop_found_is_compensated_from_the_machine_file(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(MACHINE, "utf-8")
    names = [x for name in ("dx", "backlash-x", "scale-x") for x in ("--component", name)]
    call = ("compensate", "-m", "m.yaml", "--for", "table")
    found = report(*call, *names, cwd=tmp_path)["results"]
    assert len(found["points"]) == 11
    for point in found["points"]:
        mean = 1.0 + 0.03 * point["position_mm"]
        assert point["forward"] == pytest.approx(mean + 3, abs=1e-9)
        assert point["reverse"] == pytest.approx(mean - 3, abs=1e-9)
    assert found["backlash_um"] == pytest.approx(6)
    assert found["backlash_varies"] == {"F": None, "p": None, "range_um": pytest.approx(0)}
    assert "depends on x, y" in refused(tmp_path, *call, "--component", "tilt")
    done(mtu("compensate", "-m", "m.yaml", "--for", "isg-csv", "--component", "dy", "--to-file",
             "dy.csv", "-q", cwd=tmp_path))  # fmt: skip
    assert "X EYX" in (tmp_path / "dy.csv").read_text("utf-8")
    across = ("compensate", "-m", "m.yaml", "--for", "acs", "--component", "dy")
    assert "an error in y along x" in refused(tmp_path, *across)
    skew = ("compensate", "-m", "m.yaml", "--for", "klipper", "--component", "axy")
    done(mtu(*skew, "--to-file", "skew.cfg", cwd=tmp_path))
    read = report("compensate", "--for", "klipper", "--read", "skew.cfg", cwd=tmp_path)
    assert read["results"]["angle_arcsec"] == pytest.approx(12, abs=0.01)


def test_readings_count_in_any_order_of_the_names(tmp_path: Path) -> None:
    """What the machine file states of the component that was read is not taken for it."""
    readings = "component,position_mm,pass,direction,error,unit\n" + "".join(
        f"dx,{x},{run},{way},{0.1 * x + 0.2 * run},um\n"
        for run in (1, 2, 3)
        for way in ("forward", "reverse")
        for x in range(0, 101, 10)
    )
    (tmp_path / "m.yaml").write_text(MACHINE, "utf-8")
    (tmp_path / "x.csv").write_text(readings, "utf-8")
    call = ("compensate", "-m", "m.yaml", "--laser", "x.csv", "--for", "table")
    one, other = (
        report(*call, *(x for name in names for x in ("--component", name)), cwd=tmp_path)
        for names in (("dx", "backlash-x"), ("backlash-x", "dx"))
    )
    assert one["results"] == other["results"]
    steep = [point["forward"] for point in one["results"]["points"]]
    assert steep[-1] - steep[0] == pytest.approx(10)
    twice = ("--component", "dx", "--component", "dx")
    assert "those of one are compensated" in refused(tmp_path, *call, *twice)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--component", "pos_x"), "--for CONTROLLER"),
        (("--for", "linuxnc", "--component", "pos_x"), "did you mean 'linuxcnc'"),
        (("--for", "acs"), "--component NAME"),
        (("--for", "acs", "--read", "x", "--to-file", "y"), "a call for each"),
        (("--for", "klipper", "--read", "x", "--to-file", "y"), "a call for each"),
        (("--for", "acs", "--component", "pos_x", "--reference", "nan"), "from -1e+06"),
        (("--for", "acs", "--component", "pos_x", "--from", "0"), "of --to and --step is missing"),
        (("--for", "acs", "--component", "pos_x", "--direction", "both"), "one column"),
        (("--for", "acs", "--component", "pos_x", "--set", "zonne=1"), "did you mean 'zone'"),
        (("--for", "pmac", "--component", "pos_x", *STEP), "--set counts_per_mm="),
        (("--for", "siemens-enc", "--component", "pos_x"), "--step"),
        (("--for", "acs", "--component", "pos_x", "--feed", "-1"), "from 0.001"),
        (("--for", "klipper", "--component", "pos_x"), "no angle between two axes"),
    ],
)
def test_calls_that_are_refused(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    assert said in refused(tmp_path, "compensate", RING, *words)


def test_what_stands_beside_a_table_overwrites_nothing(tmp_path: Path) -> None:
    """LinuxCNC: the sign stands in FILE.txt, checked as the table itself."""
    laser = RING.parent.parent / "data" / "valdes-ring" / "laser.csv"
    (tmp_path / "t.comp.txt").write_bytes(laser.read_bytes())
    call = ("compensate", "-m", RING / "machine.yaml", "--laser", "t.comp.txt", "--component",
            "pos_x", "--for", "linuxcnc", "--to-file", "t.comp")  # fmt: skip
    assert "t.comp.txt: not overwritten" in refused(tmp_path, *call)
    assert not (tmp_path / "t.comp").exists()
    twice = (*CALL, "--for", "linuxcnc", "--to-file", "a.nc", "--to-nc", "a.nc.txt")
    assert "appears twice" in refused(tmp_path, *twice)


def test_a_table_is_of_the_temperature_at_which_it_was_read(laser: Path, tmp_path: Path) -> None:
    machine_file(tmp_path, "{dx_x: {of: x, unit: um}}", "{Ex: dx_x}")
    budget = "{device_U_um_per_m: 1, T_mean_degC: 22.5, alpha_um_per_m_K: 11, already_at_20: false}"
    lines = "schema: mtu/study/1", "machine: m.yaml", f"laser: [{laser.name}]", f"budget: {budget}"
    (tmp_path / "mtu.yaml").write_text("\n".join(lines) + "\n", "utf-8")
    call = ("compensate", "--component", "dx_x", "--for", "table", "-q")
    said = done(mtu(*call, cwd=tmp_path)).stderr
    assert "the table holds the errors as they were read, at 22.5 degC [not-used]" in said
    (tmp_path / "mtu.yaml").write_text("\n".join(lines[:3]) + "\n", "utf-8")
    assert "not-used" not in done(mtu(*call, cwd=tmp_path)).stderr


def test_a_rotary_axis(tmp_path: Path) -> None:
    machine_file(tmp_path, "{dx: {of: x, unit: um}, ccc: {unit: arcsec}}", "{Ex: dx + y*ccc}")
    rows = ["component,position_deg,pass,direction,error,unit"]
    for run in (1, 2, 3):
        for way in (1, -1):
            for at in range(0, 360, 45):
                error = 5 * np.sin(np.radians(at)) + way + 0.1 * ((7 * run + at // 45) % 3)
                rows.append(f"ccc,{at},{run},{way},{error:.4f},arcsec")
    (tmp_path / "l.csv").write_text("\n".join([*rows, ""]), "utf-8")
    call = ("compensate", "-m", "m.yaml", "--laser", "l.csv", "--component", "ccc", "--for")
    found = report(*call, "isg-csv", "--to-file", "c.csv", "--to-nc", "v.nc", cwd=tmp_path)
    assert "C ECC" in (tmp_path / "c.csv").read_text("utf-8")
    program = (tmp_path / "v.nc").read_text("utf-8")
    assert "G1 C315.0000 F1000" in program
    assert "1000 deg/min" in program
    (move, *_) = found["results"]["verification"]["moves"]
    assert (move["command_deg"], move["command_mm"]) == (0.0, None)
    assert move["expect_without_arcsec"] == pytest.approx(1.1, abs=0.2)
    for control in ("siemens-enc", "siemens-cec", "table"):
        own = report(*call, control, "--to-file", "c.spf", "--verify", "l.csv", cwd=tmp_path)
        assert own["results"]["verification"]["verdict"] == "no-effect"
        read = report("compensate", "--for", control, "--read", "c.spf", cwd=tmp_path)
        (first, *_, last) = read["results"]["points"]
        assert (first["position_deg"], last["position_deg"]) == (0.0, 315.0)
        assert last["forward"] == pytest.approx(-3.6, abs=1.3)
    assert "holds lengths" in refused(tmp_path, *call, "heidenhain")
