"""`mtu simulate`: its files, drift tests, parts measured at several temperatures, its faults."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_runner import TRUTH, done, listing, mtu, prepared, refused
from support import (
    CONFIGS,
    DATA,
)

RING = CONFIGS / "valdes-ring"
MACHINE = """\
schema: mtu/machine/1
name: m
axes: {y: {travel_mm: [0, 300]}}
components:
  a:
    of: y
    unit: um
    coefficients: [1, 0.01]
    thermal: {gradients: {T_a_degC: 2.0, T_b_degC: -1.0}}
  t:
    unit: arcsec
    coefficients: [3]
    thermal: {gradients: {T_b_degC: 0.5}}
constants: {arm: 100}
equations: {Ex: a, Ey: arm*t}
"""
PART = """\
schema: mtu/part/1
name: p
features:
  a: {x_mm: 90, y_mm: 0, z_mm: 0}
  b: {x_mm: -90, y_mm: 0, z_mm: 0}
  c: {x_mm: 54, y_mm: 72, z_mm: 0}
circles:
  - {id: ring, features: [a, b, c], calibrated_mm: {20: 180, 26: 180.006}, temperature: T_r_degC}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "machine.yaml").write_text(MACHINE)
    (tmp_path / "part.yaml").write_text(PART)
    return tmp_path


def simulate(folder: Path, *words: object) -> None:
    done(mtu("simulate", "-m", "machine.yaml", "-p", "part.yaml", *words, cwd=folder))


def table(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, comment="#")


@pytest.mark.parametrize(
    ("study", "files"),
    [
        ("valdes-ring", {"laser.csv", "drift.csv", "ring.csv"}),
        ("laser-mill", {"x.rtl", "y.rtl", "cmm.csv", "x-after.rtl"}),
    ],
)
def test_shipped_data_are_made_again_byte_for_byte(
    study: str, files: set[str], tmp_path: Path
) -> None:
    """The options are the file's own: the Makefile's target `data` in its header."""
    text = (CONFIGS.parent / "Makefile").read_text().replace("\\\n", " ")
    text = text.replace("$(VR)", str(RING)).replace("$(LM)", str(CONFIGS / "laser-mill"))
    for line in text.splitlines():
        if "simulate" in line and f"{study}/truth" in line:
            words = shlex.split(line.replace(f"data/{study}/", ""))
            done(mtu(*words[1:], cwd=tmp_path))
    for name, content in listing(tmp_path).items():
        assert content == (DATA / study / name).read_bytes(), name
    assert set(listing(tmp_path)) == files


def test_a_run_file_holds_what_the_csv_does(tmp_path: Path) -> None:
    call = ("simulate", "-m", TRUTH, "--positions", "0:140:8", "--seed", 3)
    done(mtu(*call, "--write-lbb", "lbb.csv", cwd=tmp_path))
    lbb = table(tmp_path / "lbb.csv")
    for name, unit in (("dx_x", 1), ("ez_x", 1e3)):
        file = "run.rtl" if name == "dx_x" else "run.rta"
        done(mtu(*call, "--laser-component", name, "--write-laser", file, cwd=tmp_path))
        done(mtu("import", file, "--as", "readings", "--component", name, "-o", "r.csv",
                 cwd=tmp_path))  # fmt: skip
        read, own = table(tmp_path / "r.csv"), lbb[lbb["component"] == name]
        assert np.allclose(read["error"] * unit, own["error"], rtol=0, atol=1e-3)
        for column in ("position_mm", "pass", "direction"):
            assert (read[column].to_numpy() == own[column].to_numpy()).all()


def test_parts_take_the_rooms_in_turn_and_have_the_drift_of_their_temperatures(
    folder: Path,
) -> None:
    simulate(folder, "--write-cmm", "p.csv", "--cmm-room", 20, "--cmm-room", 26, "--parts", 4,
             "--repeats", 1, "--cmm-u-um", 0, "--sensor-noise-degC", 0,
             "--covariate", "T_r_degC: 20")  # fmt: skip
    found = table(folder / "p.csv")
    a, b = found["T_a_degC"] - 20, found["T_b_degC"] - 20
    nominal = found["feature"].map({"a": 90.0, "b": -90.0, "c": 54.0})
    y = found["feature"].map({"a": 0.0, "b": 0.0, "c": 72.0})
    Ex = 1e-3 * (1 + 0.01 * y + 2 * a - b)
    # Coordinates are written to 1 nm.
    assert (found["x_mm"] - nominal).to_numpy() == pytest.approx(Ex.to_numpy(), abs=1e-6)
    warm = a.groupby(found["part"]).mean()
    assert warm[[1, 3]].abs().max() < 0.6
    assert warm[[2, 4]].min() > 4


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--twin", "T_c_degC: T_q_degC"), "--twin: unknown sensor"),
        (("--twin", "T_b_degC: T_a_degC"), "--twin: not the name of a further sensor"),
        (("--seed", "-1"), "--seed: out of range: '-1'; expected a number of at least 0"),
        (("--drift-positions", "a: 0 301"), "a: out of range: '301 mm of y'"),
        (("--settled-drift", "aa: 3"), "thermal model: 'aa'; did you mean 'a'?"),
    ],
)
def test_options_that_cannot_be(folder: Path, words: tuple[str, ...], message: str) -> None:
    call = ("simulate", "-m", "machine.yaml", "-p", "part.yaml", "--write-drift", "d.csv")
    assert message in refused(folder, *call, *words)


def test_what_the_truth_cannot_make(tmp_path: Path) -> None:
    for words, message in (
        (["--write-drift", "d.csv"], "has a thermal model"),
        (["--write-laser", "x.rtl"], "what the laser reads is missing"),
        (["--write-laser", "x.rtl", "--laser-component", "dxx"], "did you mean"),
        (["--write-laser", "x.rta", "--laser-component", "dx_x"], "a .rta file holds mrad"),
        (["--write-laser", "x.csv", "--laser-component", "dx_x"], "ends in .rtl or .rta"),
    ):
        call = ("simulate", "-m", TRUTH, "--positions", "0:140:8", *words)
        assert message in refused(tmp_path, *call)


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A copy of the small study."""
    return prepared(tmp_path / "work")


SIMULATE = ["simulate", "--write-lbb", "out-lbb.csv", "--write-cmm", "out-cmm.csv"]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["--positions", "0:inf:8"], "--positions: not a finite number: 'inf'"),
        (["--positions", "100:0:3"], "--positions: out of range: '100:0:3'; expected LOW below"),
        (["--positions", "0:100:1"], "'0:100:1'; expected a COUNT from 2 to 10000"),
        (["--effect", "0.004*dir_x"], "--effect: not NAME: EQUATION: '0.004*dir_x'"),
        (["--effect", "Ez: 0.004"], "--effect: unknown equation: 'Ez'; expected one of: Ex, Ey"),
        (
            ["--covariate", "x_mm: 1"],
            "--covariate: not the name of a further column: 'x_mm'; expected another name",
        ),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_faulty_simulations(call: list[str], words: str, work: Path) -> None:
    assert words in refused(work, *SIMULATE, *call)


def test_a_study_has_no_truth_to_simulate_without_readings(work: Path) -> None:
    message = refused(work, *SIMULATE, "-m", TRUTH)
    assert message.startswith("mtu: the range along x, y is missing")


def test_a_laser_needs_the_positions_of_its_axis_alone(tmp_path: Path) -> None:
    known = "unit: um, coefficients: [1, 0.01], s_repeat: 0.3"
    (tmp_path / "m.yaml").write_text(
        "schema: mtu/machine/1\nname: m\n"
        "axes: {x: {travel_mm: [0, 400]}, y: {travel_mm: [0, 300]}}\n"
        f"components: {{a: {{of: x, {known}}}, b: {{of: y, {known}}}}}\n"
        "equations: {Ex: a, Ey: b}\n"
    )
    call = ["simulate", "-m", "m.yaml", "--write-laser", "a.rtl", "--laser-component", "a"]
    for positions in ("x=0:400:11", "0:350:8"):
        done(mtu(*call, "--positions", positions, cwd=tmp_path))
    words = "the range along x is missing; expected --positions LOW:HIGH:COUNT, or a part (-p)"
    assert words in done(mtu(*call, cwd=tmp_path), 2).stderr
