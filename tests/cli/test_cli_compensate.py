"""The installed `mtu compensate`: writing, reading, verification, and calls that it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_runner import done, mtu, refused, report
from support import CONFIGS

from mtu_cli.formats.control import CONTROLLERS

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
    dy_y = "components: {dy_y: {of: y, unit: um, coefficients: [0, 1]}}\nequations: {Ey: dy_y}\n"
    (tmp_path / "m.yaml").write_text(f"schema: mtu/machine/1\nname: m\n{dy_y}", "utf-8")
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
        (("--for", "acs", "--component", "pos_x", "--reference", "nan"), "from -1e+06"),
        (("--for", "acs", "--component", "pos_x", "--from", "0"), "the other two"),
        (("--for", "acs", "--component", "pos_x", "--direction", "both"), "one column"),
        (("--for", "acs", "--component", "pos_x", "--set", "zonne=1"), "did you mean 'zone'"),
        (("--for", "pmac", "--component", "pos_x", *STEP), "--set counts_per_mm="),
        (("--for", "siemens-enc", "--component", "pos_x"), "--step"),
        (("--for", "acs", "--component", "pos_x", "--feed", "-1"), "above 0"),
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


ROTARY_MACHINE = """
schema: mtu/machine/1
name: table
axes: {x: {travel_mm: [0, 400]}}
components: {dx: {of: x, unit: um}, ccc: {unit: arcsec}}
equations: {Ex: dx + y*ccc}
"""


def test_a_rotary_axis(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(ROTARY_MACHINE, "utf-8")
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
