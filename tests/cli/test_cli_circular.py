"""`mtu circular` as it is called: columns or options, files handed on, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from circle_examples import Causes, csv_text, made
from cli_runner import HERE, done, mtu, report
from made_files import B5R

from mtu_cli.files.reports_read import ComponentsReport, read_report

SHIPPED = HERE / "circular-traces.csv"


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
    used = tmp_path / "machine.yaml"
    used.write_text(
        "schema: mtu/machine/1\nname: square\naxes: {x: {travel_mm: [0, 500]}, y: {travel_mm: "
        "[0, 500]}}\ncomponents: {axy: {unit: arcsec}}\nequations: {Ex: -y*axy, Ey: 0}\n",
        "utf-8",
    )
    grid = done(mtu("predict-points", "-m", used, "-c", target, "--grid", 2))
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
