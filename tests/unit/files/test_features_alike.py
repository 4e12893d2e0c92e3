"""Features at one nominal place: told once, where nothing says that they may be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.features_alike import part_features_alike
from mtu_cli.files.points import Place, Points, read_points

HEAD = "part,feature,x_mm,y_mm"


def read(
    tmp_path: Path, rows: list[str], head: str = HEAD, features: dict[str, Place] | None = None
) -> Points:
    path = tmp_path / "cmm.csv"
    path.write_text("\n".join([head, *rows, ""]), "utf-8")
    return read_points([(path, "cmm")], features)


def told(points: Points) -> list[str]:
    return [note.message for note in points.notes if note.code == "features-alike"]


def test_both_and_their_place_are_named(tmp_path: Path) -> None:
    places: dict[str, Place] = {"A": (1, 2, 5), "B": (1, 2, 5), "C": (3, 2, 5), "D": (3, 2, 5)}
    rows = ["P,A,1,2", "P,B,1,2.1", "P,C,3,2"]
    assert told(read(tmp_path, rows, features=places)) == [
        "cmm.csv, row 3: features at the same nominal place: 'A' and 'B' (x=1, y=2, z=5 mm); look "
        "whether one is mistyped, or there on purpose"
    ]
    head = f"{HEAD},nominal_x_mm,nominal_y_mm"
    own = ["P,A,1,2,1,2", "P,B,1,2.1,1,2", "P,C,3,2,3,2"]
    assert told(read(tmp_path, own, head)) == [
        "cmm.csv, row 3: features at the same nominal place: 'A' and 'B' (x=1, y=2 mm); look "
        "whether one is mistyped, or there on purpose, or give them a nominal z of their own"
    ]


def test_many_are_counted_once(tmp_path: Path) -> None:
    places: dict[str, Place] = {f"F{i}": (float(i // 2), 0.0, 1.0) for i in range(14)}
    rows = [f"{part},F{i},{i // 2}.0{part}{i:02},0" for part in (1, 2) for i in range(14)]
    (text,) = told(read(tmp_path, rows, features=places))
    assert "'F4' and 'F5' (x=2, y=0, z=1 mm), and 4 places more; look" in text


@pytest.mark.parametrize(
    "places",
    [{"A": (1, 2, 5), "B": (1, 2, 6)}, {"A": (1, 2, None), "B": (1, 2, 6)},
     {"A": (1, 2, 5), "B": (1, 3, 5)}],
    ids=["depth", "depth of one", "y"],
)  # fmt: skip
def test_other_coordinates_tell_features_apart(places: dict[str, Place], tmp_path: Path) -> None:
    assert not told(read(tmp_path, ["P,A,1,2", "P,B,1,2.1"], features=places))


def test_measured_depths_tell_where_no_nominal_ones_do(tmp_path: Path) -> None:
    places: dict[str, Place] = dict.fromkeys("ABC", (1, 2, None))
    rows = ["P,A,1,2,0", "P,B,1,2.1,-10", "P,C,1,2,0.01"]
    (text,) = told(read(tmp_path, rows, f"{HEAD},z_mm", places))
    assert "place: 'A' and 'C' (x=1, y=2 mm); look" in text


@pytest.mark.parametrize(
    ("head", "rows"),
    [(HEAD, ["P,A,1,2", "Q,B,1,2.1"]),
     (f"{HEAD},operation", ["P,A,1,2,drilled", "P,B,1,2.1,milled"])],
    ids=["parts", "operations"],
)  # fmt: skip
def test_features_that_never_meet_are_none_of_one_place(
    head: str, rows: list[str], tmp_path: Path
) -> None:
    places: dict[str, Place] = {"A": (1, 2, 5), "B": (1, 2, 5)}
    assert not told(read(tmp_path, rows, head, places))


def test_a_feature_of_another_part_between_hides_none(tmp_path: Path) -> None:
    places: dict[str, Place] = dict.fromkeys("ABC", (1, 2, 5))
    (text,) = told(read(tmp_path, ["P,A,1,2", "Q,B,1,2.1", "P,C,1,2.2"], features=places))
    assert "place: 'A' and 'C' (x=1" in text


def test_features_of_a_part_file_are_told_in_the_same_words() -> None:
    nominal = np.array([[1.0, 2, np.nan], [3, 2, 5], [1, 2, np.nan], [3, 2, 6], [1, 2, 0]])
    (note,) = part_features_alike("part.yaml", "ABCDE", nominal)
    assert (note.code, note.message) == (
        "features-alike",
        "part.yaml: features at the same nominal place: 'A' and 'C' (x=1, y=2 mm); look whether "
        "one is mistyped, or there on purpose, or give them a nominal z of their own",
    )
    assert not [*part_features_alike("part.yaml", "AB", nominal[:2])]


def test_one_nominal_z_is_one_place_whatever_was_measured(tmp_path: Path) -> None:
    file = tmp_path / "k.csv"
    head = "part,feature,x_mm,y_mm,z_mm,nominal_x_mm,nominal_y_mm,nominal_z_mm"
    file.write_text(f"{head}\nP1,A,1,2,0.0,1,2,5\nP1,B,1,2,0.9,1,2,5\n")
    assert [n.code for n in read_points([(file, "cmm")], None).notes] == ["features-alike"]


def test_the_order_of_files_does_not_change_what_is_told(tmp_path: Path) -> None:
    places: dict[str, Place] = dict.fromkeys("ABCD", (1, 2, 5))
    (tmp_path / "a.csv").write_text(f"{HEAD}\nP,A,1,2\nP,B,1,2.1\nP,C,1,2.2\n")
    (tmp_path / "b.csv").write_text(f"{HEAD}\nQ,C,1,2\nQ,A,1,2.1\nQ,D,1,2.2\n")
    files = [(tmp_path / name, "cmm") for name in ("a.csv", "b.csv")]
    first, second = (told(read_points(own, places)) for own in (files, files[::-1]))
    assert first == second
    assert first[0].startswith(
        "a.csv, row 3: features at the same nominal place: 'A', 'B', 'C' and"
    )
