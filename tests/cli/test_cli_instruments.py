"""`mtu inspect`, `mtu import`, and files of instruments read directly; the files are made."""

from __future__ import annotations

import json
from pathlib import Path

import made_files as made
import pytest
from cli_runner import done, mtu
from support import DATA

import mtu_cli

MACHINE = """schema: mtu/machine/1
name: one axis
axes: {x: {travel_mm: [-200, 200]}}
components: {dx_x: {of: x, unit: um}}
equations: {Ex: dx_x}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A machine of one axis and the files."""
    (tmp_path / "m.yaml").write_text(MACHINE)
    for name, (_, content) in made.FILES.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


def test_a_laser_run_is_fitted_as_it_came(folder: Path) -> None:
    out = folder / "direct.json"
    found = mtu("fit-components", "-m", "m.yaml", "--laser", "dx_x=x.rtl", "-o", out, cwd=folder)
    assert "x.rtl: read as rtl: 14 readings; left out: 1 material sensor" in done(found).stderr
    made_csv = mtu("import", "dx_x=x.rtl", "--as", "readings", "-o", "x.csv", cwd=folder)
    assert done(made_csv).stdout.startswith("x.rtl: read as rtl: 14 readings")
    again = folder / "csv.json"
    done(mtu("fit-components", "-m", "m.yaml", "--laser", "x.csv", "-o", again, cwd=folder))
    results = [json.loads(path.read_text())["results"] for path in (out, again)]
    assert results[0] == results[1]
    machine = mtu_cli.read_machine(folder / "m.yaml")
    read = mtu_cli.read_readings([f"dx_x={folder / 'x.rtl'}"], machine, "laser")
    assert mtu_cli.fit_components(machine, read).to_dict()["components"]["dx_x"]["n"] == 14
    assert len(mtu_cli.read_points([folder / "p.csv"])) == 3
    study = "schema: mtu/study/1\nmachine: m.yaml\nlaser: [{file: x.rtl, component: dx_x}]\n"
    (folder / "mtu.yaml").write_text(study)
    done(mtu("fit-components", "-o", again, cwd=folder))
    assert json.loads(again.read_text())["results"] == results[0]


def test_faults_name_the_line_of_the_instruments_file(folder: Path) -> None:
    found = mtu("fit-components", "-m", "m.yaml", "--laser", "dx_y=x.rtl", cwd=folder)
    told = done(found, 2).stderr
    assert "x.rtl, rows 19 to 32, column 'component': unknown component: 'dx_y'" in told
    found = mtu("fit-components", "-m", "m.yaml", "--laser", "x.rtl", cwd=folder)
    assert "the component that the file reads is missing" in done(found, 2).stderr
    found = mtu("fit-components", "-m", "m.yaml", "--laser", "dx_x=p.csv", cwd=folder)
    assert "which gives points; expected readings" in done(found, 2).stderr


def test_inspect_shows_what_a_file_is(folder: Path) -> None:
    for name, (kind, _) in made.FILES.items():
        text = done(mtu("inspect", name, "-o", "o.json", cwd=folder)).stdout
        assert text.startswith(f"{kind}: ")
        assert json.loads((folder / "o.json").read_text())["results"]["format"] == kind
    assert "2 BALLBAR/FEATURE" in done(mtu("inspect", "b.b5r", cwd=folder)).stdout
    shown = done(mtu("inspect", DATA / "undeclared" / "lbb.csv")).stdout
    assert shown.startswith("contract-csv: ")
    (folder / "a.xyz").write_text("hello\nworld\n")
    assert "fits no format" in done(mtu("inspect", "a.xyz", cwd=folder), 2).stderr


def test_import_states_what_was_left_open_and_overwrites_nothing(folder: Path) -> None:
    call = ("import", "p.csv", "--as", "points")
    found = done(mtu(*call, cwd=folder))
    assert found.stdout.splitlines()[0].startswith("part,feature,")
    assert "left out: 1 empty cells, 1 features without X or Y" in found.stderr
    assert "it is an input" in done(mtu(*call, "-o", "p.csv", cwd=folder), 2).stderr
    assert "ends in .csv" in done(mtu(*call, "-o", "p.json", cwd=folder), 2).stderr
    wrong = mtu("import", "p.csv", "--as", "point", cwd=folder)
    assert "did you mean 'points'" in done(wrong, 2).stderr
    (folder / "y.rtl").write_bytes((folder / "x.rtl").read_bytes().replace(b"0.5", b"0.6"))
    run = ("import", "--as", "readings", "--component", "dx_x", "x.rtl")
    joined = done(mtu(*run, "y.rtl", cwd=folder)).stdout
    assert {line.split(",")[2] for line in joined.splitlines()[1:]} == {"1", "2"}
    (folder / "z.rtl").write_bytes((folder / "x.rtl").read_bytes())
    assert "z.rtl: the same as x.rtl" in done(mtu(*run, "z.rtl", cwd=folder), 2).stderr


def test_import_writes_nothing_that_the_contract_does_not_read(folder: Path) -> None:
    """Rows of the instrument's file are named, and components that the machine does not have."""
    (folder / "w.csv").write_text("Ziel;Weg;M\n0;auf;0,1\n50;-;0,2\n", "utf-8")
    (folder / "w.yaml").write_text(
        "schema: mtu/import/1\nunits: {error: um}\nconstants: {component: dxx}\n"
        "columns: {position_mm: Ziel, direction: Weg, error: M}\n"
    )
    call = ("import", "w.csv", "--as", "readings", "--map", "w.yaml", "-o", "o.csv")
    refusal = done(mtu(*call, cwd=folder), 2).stderr
    assert "w.csv, row 2, column 'Weg': not a direction: 'auf'" in refusal
    assert not (folder / "o.csv").exists()
    machine = DATA.parent / "configs" / "laser-mill" / "machine.yaml"
    assert "unknown component: 'dxx'" in done(mtu(*call, "-m", machine, cwd=folder), 2).stderr
    # The study names that heading, too.
    (folder / "w.yaml").write_text((folder / "w.yaml").read_text().replace("dxx", "dx_x"))
    study = "schema: mtu/study/1\nmachine: m.yaml\nlaser: [{file: w.csv, map: w.yaml}]\n"
    (folder / "mtu.yaml").write_text(study)
    refusal = done(mtu("fit-components", cwd=folder), 2).stderr
    assert "w.csv, row 2, column 'Weg': not a direction: 'auf'" in refusal


def test_import_checks_its_files_as_the_one_csv_that_it_writes(folder: Path) -> None:
    """Equal rows of two files, and times with and without an offset."""
    rows = "Ziel;Zeit;M\n0;2024-05-03T14:30:00;0,1\n50;2024-05-03T14:31:00;0,2\n"
    (folder / "t1.csv").write_text(rows)
    (folder / "t2.csv").write_text(rows.replace(";0,1", "+02:00;0,3").replace(";0,2", "+02:00;0,4"))
    (folder / "t3.csv").write_text(rows.replace("T14", "T15"))
    (folder / "t.yaml").write_text(
        "schema: mtu/import/1\nunits: {error: um}\nconstants: {component: dx_x}\n"
        "columns: {position_mm: Ziel, time: Zeit, error: M}\n"
    )

    def imported(*names: str, exit_code: int = 2) -> str:
        call = ("import", *names, "--as", "readings", "--map", "t.yaml", "-o", "o.csv")
        return done(mtu(*call, cwd=folder), exit_code).stderr

    (folder / "t4.csv").write_text(rows + "60;2024-05-03T14:32:00;0,1\n")
    assert "t4.csv, row 3: the same as row 3 of t1.csv" in imported("t1.csv", "t4.csv")
    assert "t2.csv, column 'Zeit': contradicts the other times" in imported("t1.csv", "t2.csv")
    assert not (folder / "o.csv").exists()
    imported("t1.csv", "t3.csv", exit_code=0)
    done(mtu("fit-components", "-m", "m.yaml", "--laser", "o.csv", cwd=folder))


def test_passes_and_cycles_of_files_are_apart(folder: Path) -> None:
    """As they are where the files are read directly; days may count alike and begin with zeros."""
    days, warm_ups = ("d1.csv", "d2.csv"), ("w1.csv", "w2.csv")
    for n, (day, warm_up) in enumerate(zip(days, warm_ups, strict=True)):
        cells = [(run, at, 0.01 * at * n) for run in (0, 1) for at in (0, 50, 100)]
        (folder / day).write_text("Run;Ziel;M\n" + "".join(f"{r};{x};{e}\n" for r, x, e in cells))
        channels = [(t, (n + 1) * t / 10, 20 + t / 5) for t in (0, 10, 20)]
        lines = "".join(f"{t},{e},{T}\n" for t, e, T in channels)
        (folder / warm_up).write_text("time [min],probe [um],T spindle [degC]\n" + lines)
    (folder / "d.yaml").write_text(
        "schema: mtu/import/1\nconstants: {component: dx_x}\n"
        "columns: {pass: Run, position_mm: Ziel, error: M}\n"
    )
    (folder / "z.yaml").write_text(MACHINE.replace("of: x, ", ""))
    # The unit is that of the machine's component, which the profile names.
    call = ("import", *days, "--as", "readings", "--map", "d.yaml", "-m", "m.yaml", "-o", "d.csv")
    assert "taken in um, the component's unit" in done(mtu(*call, cwd=folder)).stdout
    rows = [line.split(",") for line in (folder / "d.csv").read_text().splitlines()]
    assert {row[rows[0].index("pass")] for row in rows[1:]} == {"0", "1", "2", "3"}
    logged = mtu("import", *warm_ups, "--as", "drift", "--component", "dx_x", cwd=folder)
    written = done(logged).stdout.splitlines()
    assert [line.split(",")[3] for line in written[1:]] == ["w1.csv"] * 3 + ["w2.csv"] * 3
    direct = [f"dx_x={folder / name}" for name in warm_ups]
    read = mtu_cli.read_readings(direct, mtu_cli.read_machine(folder / "z.yaml"), "drift")
    assert len(read.cycles) == 2


def test_a_profile_calculates_with_empty_runs_and_with_angles(folder: Path) -> None:
    """A template has runs that were not made; positions of a rotary axis are in deg."""
    (folder / "a.csv").write_text("Soll;Lauf 1;Lauf 2\n0;0,0001;\n30;30,0005;\n")
    (folder / "a.yaml").write_text(
        "schema: mtu/import/1\ncolumns: {position_deg: Soll}\nunits: {error: arcsec}\n"
        "unpivot: {into: error, columns: [Lauf 1, Lauf 2]}\nconstants: {component: ec}\n"
        "scale: {error: 3600}\nsubtract: {error: position_deg}\n"
    )
    call = ("import", "a.csv", "--as", "readings", "--map", "a.yaml")
    expected = [0.36, 1.8]
    profile = (folder / "a.yaml").read_text()
    for units in ("error: arcsec", "error: arcsec, position_deg: deg"):
        (folder / "a.yaml").write_text(profile.replace("error: arcsec", units))
        rows = [line.split(",") for line in done(mtu(*call, cwd=folder)).stdout.splitlines()]
        error, place = rows[0].index("error"), rows[0].index("position_deg")
        assert [float(row[error]) for row in rows[1:]] == pytest.approx(expected)
        assert [float(row[place]) for row in rows[1:]] == [0.0, 30.0]
