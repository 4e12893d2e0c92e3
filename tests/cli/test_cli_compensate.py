"""The installed `mtu compensate`: writing, reading, verification, and calls that it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_runner import done, mtu, refused, report
from support import CONFIGS

from mtu_cli.formats.control import CONTROLLERS

RING = CONFIGS / "valdes-ring"
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
    again = (tmp_path / "t.x").read_bytes()
    done(mtu(*CALL, "--for", name, *equal, *more, "--to-file", "t.x", "-q", cwd=tmp_path))
    assert (tmp_path / "t.x").read_bytes() == again


def test_the_report_predicts_and_lists_moves(tmp_path: Path) -> None:
    found = report(*CALL, "--for", "beckhoff", "--to-nc", "v.nc", cwd=tmp_path)["results"]
    assert found["before"]["E"] == pytest.approx(19.6576, abs=1e-3)
    low, high = found["predicted_after"]["E"]["interval95"]
    assert 0.1 < low < found["predicted_after"]["E"]["median"] < high < 5
    for move in found["verification"]["moves"]:
        change = move["expect_without_um"] - move["expect_with_um"]
        assert move["expect_wrong_sign_um"] - move["expect_without_um"] == pytest.approx(change)
    program = (tmp_path / "v.nc").read_text("utf-8")
    assert program.index("X-10.0000") < program.index("X500.0000") < program.index("X510.0000")


def test_verification_of_readings(tmp_path: Path) -> None:
    """The first test read again: the table had no effect."""
    laser = RING.parent.parent / "data" / "valdes-ring" / "laser.csv"
    found = report(*CALL, "--for", "beckhoff", "--verify", laser, cwd=tmp_path)["results"]
    assert found["verification"]["verdict"] == "no-effect"
    assert found["verification"]["k"] == pytest.approx(1, abs=0.05)


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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--component", "pos_x"), "--for CONTROLLER"),
        (("--for", "linuxnc", "--component", "pos_x"), "did you mean 'linuxcnc'"),
        (("--for", "acs"), "--component NAME"),
        (("--for", "acs", "--component", "pos_x", "--reference", "nan"), "a finite position"),
        (("--for", "acs", "--component", "pos_x", "--from", "0"), "the other two"),
        (("--for", "acs", "--component", "pos_x", "--direction", "both"), "one column"),
        (("--for", "acs", "--component", "pos_x", "--set", "zonne=1"), "did you mean 'zone'"),
        (("--for", "pmac", "--component", "pos_x", *STEP), "--set counts_per_mm="),
        (("--for", "siemens-enc", "--component", "pos_x"), "--step"),
        (("--for", "klipper", "--component", "pos_x"), "no angle between two axes"),
    ],
)
def test_calls_that_are_refused(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    assert said in refused(tmp_path, "compensate", RING, *words)


def test_a_linuxcnc_file_with_a_comment_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.comp").write_text("# mine\n0 0 0\n50 50 50\n", "utf-8")
    call = ("compensate", "--for", "linuxcnc", "--set", "type=0", "--read", "x.comp")
    message = refused(tmp_path, *call)
    assert "x.comp:1" in message
    assert "LinuxCNC stops reading here" in message
