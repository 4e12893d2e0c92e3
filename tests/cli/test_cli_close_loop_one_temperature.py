"""`mtu close-loop` on parts of one temperature, and what is foretold at another."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_runner import done, mtu
from plain_mill import MACHINE, PLACES

SCALE, ANGLE, SHIFT = 60.0, 40.0, 15.0
"""um/m, um/m and um."""
NO_WAVES = ("--exclude", "cyclic")
"""Hundreds of members, of no temperature: two fifths of a call's time."""


def study(folder: Path, T: tuple[float, float], lacks: str, name: str = "T_room_degC") -> None:
    """Twelve parts made at temperatures between two, on a machine that lacks one effect."""
    rng = np.random.default_rng(5)
    (folder / "machine.yaml").write_text(MACHINE, "utf-8")
    features = "".join(f"  h{i}: {{x_mm: {x}, y_mm: {y}}}\n" for i, (x, y) in enumerate(PLACES))
    part = "schema: mtu/part/1\nname: plate\nfeatures:\n" + features
    (folder / "part.yaml").write_text(part + "lengths:\n  - {from: h0, to: h3}\n", "utf-8")
    rows = [f"part,feature,x_mm,y_mm,{name}"]
    for number, degrees in enumerate(rng.permutation(np.linspace(*T, 12)), 1):
        for i, (x, y) in enumerate(PLACES):
            ex, ey = rng.normal(0, 1.3, 2)
            ex += SCALE * 1e-3 * (x - 200) if lacks == "scale" else 0.0
            ex += SHIFT if lacks in ("offset", "step") else 0.0
            ex += SHIFT if lacks == "step" and number > 6 else 0.0
            ex += ANGLE * 1e-3 * (y - 150) if lacks == "squareness" else 0.0
            rows.append(f"{number},h{i},{x + ex / 1e3:.5f},{y + ey / 1e3:.5f},{degrees:.2f}")
    (folder / "cmm.csv").write_text("\n".join(rows) + "\n", "utf-8")


def closed(folder: Path, *more: str) -> tuple[dict[str, Any], str]:
    """The results of the loop, which wrote m.yaml, and what it printed, in one line."""
    result = mtu(
        "close-loop", "-m", "machine.yaml", "--part", "part.yaml", "--cmm", "cmm.csv", *more,
        *NO_WAVES, "--write-machine", "m.yaml", "-o", "o.json", cwd=folder,
    )  # fmt: skip
    text = " ".join(done(result).stdout.split())
    return json.loads((folder / "o.json").read_text("utf-8"))["results"], text


def warned(folder: Path, *at: str) -> list[tuple[str, str]]:
    """Codes and words of the warnings of lengths by the machine written."""
    command = ("lengths", "-m", "m.yaml", "--part", "part.yaml", "-o", "l.json")
    done(mtu(*command, *(word for own in at for word in ("--at", own)), cwd=folder))
    told = json.loads((folder / "l.json").read_text("utf-8"))["warnings"]
    return [(w["code"], w["message"]) for w in told if "effect" in w["code"]]


@pytest.mark.parametrize("lacks", ["scale", "offset", "squareness", "step"])
def test_what_parts_of_one_temperature_show_is_that_of_it(lacks: str, tmp_path: Path) -> None:
    study(tmp_path, (26.0, 26.0), lacks)
    found, text = closed(tmp_path)
    effect, *others = found["effects"]
    assert effect["family"] == lacks
    # A constant beside a step is an offset by itself.
    assert [own["name"] for own in others] == ["offset-x"] * (lacks == "step")
    assert ("level_x" in effect["parameters"]) == (lacks in ("scale", "squareness"))
    assert effect["found_at_degC"] == {"T_room_degC": 26.0}
    said = "All this data is of T_room_degC = 26: what these effects are at 20 degC is not known."
    assert said in text
    assert "T_room_degC: [26.0, 26.0]" in (tmp_path / "m.yaml").read_text("utf-8")
    # Half a kelvin is a thermometer's matter.
    last = ["sequence=12"] if lacks == "step" else []
    assert warned(tmp_path, "T_room_degC=26.4", *last) == []
    ((code, words),) = warned(tmp_path, "T_room_degC=20", *last)
    assert code == "outside-effect-range"
    assert f"({effect['name']})" in words
    assert "have T_room_degC at 26: extrapolated to 20" in words
    ((code, words),) = warned(tmp_path, *last)
    assert code == "outside-effect-range"
    assert "have T_room_degC at 26: no value is given" in words


@pytest.mark.parametrize(
    ("T", "name"), [((20.4, 20.4), "T_room_degC"), ((26.0, 26.0), "pressure_bar")]
)
def test_at_20_degC_and_of_other_columns_nothing_is_told(
    T: tuple[float, float], name: str, tmp_path: Path
) -> None:
    study(tmp_path, T, "scale", name)
    found, text = closed(tmp_path)
    assert found["effects"][0]["found_at_degC"] == {}
    assert "All this data" not in text
    assert "within" not in (tmp_path / "m.yaml").read_text("utf-8")
    assert warned(tmp_path) == []


def test_a_hundredth_of_a_kelvin_is_no_change(tmp_path: Path) -> None:
    """A growth by that much would be of thousands of um/m/K, and as uncertain."""
    study(tmp_path, (26.0, 26.01), "scale")
    found, text = closed(tmp_path, "--detail")
    assert [effect["name"] for effect in found["effects"]] == ["scale-x"]
    assert re.search(r"All this data is of T_room_degC = 26(.01)?: ", text)
    assert "thermal-growth-x, thermal-growth-y" in text.partition("not tested: ")[2]


def test_another_temperature_that_changes_says_nothing_of_the_one_that_does_not(
    tmp_path: Path,
) -> None:
    study(tmp_path, (26.0, 26.0), "scale")
    rows = (tmp_path / "cmm.csv").read_text("utf-8").splitlines()
    spindle = np.random.default_rng(1).permutation(np.linspace(24.0, 32.0, 12)).tolist()
    made = [f"{row},{spindle[int(row.split(',')[0]) - 1]:.2f}" for row in rows[1:]]
    text = "\n".join([f"{rows[0]},T_spindle_degC", *made]) + "\n"
    (tmp_path / "cmm.csv").write_text(text, "utf-8")
    found, said = closed(tmp_path)
    assert found["effects"][0]["found_at_degC"] == {"T_room_degC": 26.0}
    assert "All this data is of T_room_degC = 26: " in said
    told = dict(warned(tmp_path, "T_room_degC=20", "T_spindle_degC=28"))
    assert "have T_room_degC at 26: extrapolated to 20" in told["outside-effect-range"]


def test_what_cannot_be_of_a_temperature_is_of_none(tmp_path: Path) -> None:
    """What is excluded, and a temperature that changes, which shows the growth."""
    study(tmp_path, (26.0, 26.0), "scale")
    families = ("thermal-growth", "thermal-drift", "thermal-squareness")
    found, _ = closed(tmp_path, *(word for own in families for word in ("--exclude", own)))
    assert found["effects"][0]["found_at_degC"] == {}
    study(tmp_path, (24.0, 28.0), "scale")
    found, text = closed(tmp_path)
    assert all(effect["found_at_degC"] == {} for effect in found["effects"])
    assert "All this data" not in text


def test_points_tell_by_their_own_column_where_an_effect_holds(tmp_path: Path) -> None:
    study(tmp_path, (26.0, 26.0), "scale")
    closed(tmp_path)
    text = (tmp_path / "cmm.csv").read_text("utf-8")
    command = ("-m", "m.yaml", "--part", "part.yaml", "--cmm", "other.csv", "-o", "c.json")

    def warned_of(own: str, *more: str) -> list[str]:
        (tmp_path / "other.csv").write_text(text.replace(",26.00", f",{own}"), "utf-8")
        done(mtu(*more[:1], *command, *more[1:], cwd=tmp_path))
        return [w["code"] for w in json.loads((tmp_path / "c.json").read_text("utf-8"))["warnings"]]

    assert "outside-effect-range" not in warned_of("26.30", "compare")
    assert "outside-effect-range" in warned_of("20.00", "compare")
    # One value for all stands in for the column of compare; of the others the column counts.
    codes = warned_of("20.00", "compare", "--at", "T_room_degC=26")
    assert "outside-effect-range" not in codes
    assert "not-used" in codes
    for name in ("correct", "close-loop"):
        few = NO_WAVES if name == "close-loop" else ()
        codes = warned_of("20.00", name, "--at", "T_room_degC=26", *few)
        assert {"not-used", "outside-effect-range"} <= set(codes), name
    (tmp_path / "c.json").unlink()
    for name in ("compare", "correct", "close-loop"):
        (tmp_path / "other.csv").write_text(text.replace(",26.00", ",-999", 1), "utf-8")
        result = mtu(name, *command, cwd=tmp_path)
        assert "row 2, column 'T_room_degC': " in done(result, 2).stderr
        assert not (tmp_path / "c.json").exists()
