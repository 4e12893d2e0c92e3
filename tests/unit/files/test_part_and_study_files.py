"""Part and study files, and the JSON Schemas of all contracts."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files.part import LoadedPart, Tolerance, load_part
from mtu_cli.files.study import LoadedStudy, find_study, load_study
from mtu_cli.findings import InputError

FEATURES = (
    "features: {3: {x_mm: 10, y_mm: 10}, '9': {x_mm: 10, y_mm: 140, z_mm: 5}, "
    "a: {x_mm: 140, y_mm: 140}, b: {x_mm: 10, y_mm: 10}}\n"
)


def part(tmp_path: Path, text: str) -> LoadedPart:
    (tmp_path / "p.yaml").write_text("schema: mtu/part/1\nname: p\nz_mm: 127\n" + text)
    return load_part(tmp_path / "p.yaml")


def part_faults(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        part(tmp_path, text)
    return [str(problem) for problem in caught.value.findings]


def test_a_part(tmp_path: Path) -> None:
    text = FEATURES + (
        "lengths: [{from: 3, to: '9', tolerance_um: 30}, {id: L, from: 9, to: a}]\n"
        "orthogonality: [{id: xy, row: [9, a], column: [3, 9]}]\n"
        "circles: [{id: ring, features: [3, 9, a], calibrated_mm: {20: 180.0124, 26: 180.0137}, "
        "U_um: 1.0, temperature: T_ring_degC}, {id: r, features: [3, 9, a], calibrated_mm: 5}]\n"
        "spheres: [{id: s, features: [3, 9, a, b]}]\n"
    )
    read = part(tmp_path, text).part
    assert read.places()["3"] == (10.0, 10.0, 127.0)
    assert read.places()["9"] == (10.0, 140.0, 5.0)
    assert [(item.id, item.from_, item.to) for item in read.lengths] == [
        ("3-9", "3", "9"),
        ("L", "9", "a"),
    ]
    assert read.orthogonality[0].row == ["9", "a"]
    assert read.circles[0].calibrated_mm == {20.0: 180.0124, 26.0: 180.0137}
    assert read.circles[1].calibrated_mm == {20.0: 5.0}


def test_tolerances(tmp_path: Path) -> None:
    text = FEATURES.replace("x_mm: 10, y_mm: 10}", "x_mm: 10, y_mm: 10, position_um: 50}", 1) + (
        "lengths: [{from: 3, to: 9, tolerance_um: 30}, {from: 9, to: a, tolerance_um: [-5, 25]}]\n"
        "orthogonality: [{id: xy, row: [9, a], column: [3, 9], tolerance_arcsec: [-8, 8]}]\n"
    )
    read = part(tmp_path, text).part
    assert [read.features[name].position_um for name in "39"] == [50.0, None]
    assert [each.tolerance for each in read.lengths] == [Tolerance(-30, 30), Tolerance(-5, 25)]
    assert [each.tolerance.stated for each in read.lengths if each.tolerance] == [30, (-5, 25)]
    assert read.orthogonality[0].tolerance == Tolerance(-8, 8)


NO_TOLERANCE = "expected a number above 0, or [low, high]"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lengths: [{from: 3, to: b}]", "'b'; expected a feature at another place than '3'"),
        *((f"lengths: [{{from: 3, to: 9, tolerance_um: {value}}}]", NO_TOLERANCE)
          for value in ("[3]", "[5, -5]", "[1, .inf]")),
        ("circles: [{id: c, features: [3, 9]}]", "features: wrong value: '[3, 9]'; expected at l"),
        ("circles: [{id: c, features: [3, 9, a], calibrated_mm: {20: 1, 26: 2}}]",
         "circles[0].calibrated_mm: diameters at several temperatures"),
        ("circles: [{id: c, features: [3, 9, a], calibrated_mm: {warm: 1}}]",
         "expected keys in degC"),
        ('lengths: [{from: 3, to: 9, id: "a\\nb"}]', r"not a name: 'a\nb'; expected a t"),
    ],
)  # fmt: skip
def test_faulty_parts(tmp_path: Path, text: str, words: str) -> None:
    (found,) = part_faults(tmp_path, FEATURES + text)
    assert found.startswith("p.yaml:5: ")
    assert words in found


def test_a_faulty_feature_is_not_called_unknown(tmp_path: Path) -> None:
    text = "features: {3: {x_mm: 1}, 4: {x_mm: 1, y_mm: 2}}\nlengths: [{from: 3, to: 5}]\n"
    missing, unknown = part_faults(tmp_path, text)
    assert missing == "p.yaml:4: features.3: the key 'y_mm' is missing"
    assert "lengths[0].to: unknown feature: '5'" in unknown


def study(tmp_path: Path, text: str) -> LoadedStudy:
    (tmp_path / "mtu.yaml").write_text("schema: mtu/study/1\n" + text)
    return load_study(tmp_path / "mtu.yaml")


def test_a_study_names_files_relative_to_itself(tmp_path: Path) -> None:
    for name in ("machine.yaml", "a.csv", "b.csv"):
        (tmp_path / name).write_text("x")
    text = (
        "machine: machine.yaml\nlbb: a.csv\ncmm: [a.csv, b.csv]\ncomponents: a.csv\n"
        "settings: {seed: 3}\n"
    )
    loaded = study(tmp_path, text)
    assert loaded.files == {
        "machine": (tmp_path / "machine.yaml",),
        "lbb": (tmp_path / "a.csv",),
        "cmm": (tmp_path / "a.csv", tmp_path / "b.csv"),
        "components": (tmp_path / "a.csv",),
    }
    assert loaded.study.settings.seed == 3
    assert loaded.study.settings.coverage_factor is None


def test_the_nearest_study_above_is_found(tmp_path: Path) -> None:
    deep = tmp_path / "a" / "b"
    deep.mkdir(parents=True)
    (tmp_path / "mtu.yaml").write_text("schema: mtu/study/1\n")
    assert find_study(deep) == tmp_path.resolve() / "mtu.yaml"
    (deep / "mtu.yaml").mkdir()
    assert find_study(deep) == tmp_path.resolve() / "mtu.yaml"
    (deep / "mtu.yaml").rmdir()
    (deep / "mtu.yaml").write_text("schema: mtu/study/1\n")
    assert find_study(deep) == deep / "mtu.yaml"
