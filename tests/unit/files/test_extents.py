"""Features farther apart than a machine can reach."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.extents import check_part_extent, check_points_extent
from mtu_cli.files.part import load_part
from mtu_cli.files.points import read_points

TRAVELS = {"x": (0.0, 400.0), "y": (150.0, -150.0)}


def told(tmp_path: Path, *places: tuple[float, float]) -> list[str]:
    """Each problem up to its value, of features A, B, ... at these places."""
    features = [f"  {chr(65 + i)}: {{x_mm: {x}, y_mm: {y}}}" for i, (x, y) in enumerate(places)]
    lines = ["schema: mtu/part/1", "name: p", "z_mm: 7000", "features:", *features]
    (tmp_path / "p.yaml").write_text("\n".join(lines) + "\n")
    part = load_part(tmp_path / "p.yaml")
    problems = []
    try:
        check_part_extent(part, TRAVELS)
    except InputError as error:
        problems = list(error.findings)
    assert all(problem.line is not None for problem in problems)
    return [f"{problem.path} {problem.text}" for problem in problems]


@pytest.mark.parametrize("x", [0.0, 400.0, 800.0, -800.0])
def test_up_to_twice_the_travel_they_may_be_apart(x: float, tmp_path: Path) -> None:
    """Wherever the part's frame is; of z no travel is known."""
    assert told(tmp_path, (5000, 0), (5000 + x, 600)) == []


def test_all_that_are_far_from_the_others_are_told(tmp_path: Path) -> None:
    places = [(0, 0), (100, 0), (100, 80), (10000, 0), (20000, 0), (0, -601)]
    x = "all cover 20000 mm in x, the machine travels 400 mm"
    assert told(tmp_path, *places) == [
        f"features.D.x_mm feature 'D' is far from the others: {x}",
        f"features.E.x_mm feature 'E' is far from the others: {x}",
        "features.F.y_mm feature 'F' is far from the others: all cover 681 mm in y, the machine "
        "travels 300 mm",
    ]


@pytest.mark.parametrize("row", [0, 4, 8])
def test_the_place_of_one_row_alone_may_be_wrong(row: int, tmp_path: Path) -> None:
    """Nominal places are a column of every row; that they are not alike is another matter."""
    lines = ["part,feature,nominal_x_mm,nominal_y_mm,x_mm,y_mm"]
    for i in range(9):
        x = 100_000 if i == row else 10 * (i % 3)
        lines.append(f"{i // 3},{'abc'[i % 3]},{x},0,{x},0")
    (tmp_path / "cmm.csv").write_text("\n".join(lines) + "\n")
    points = read_points([(tmp_path / "cmm.csv", "cmm")], None)
    with pytest.raises(InputError) as caught:
        check_points_extent(points, TRAVELS)
    (problem,) = caught.value.findings
    assert (problem.row, problem.column) == (row + 2, "nominal_x_mm")
    assert "far from the others" in problem.text


@pytest.mark.parametrize("many", [1, 2, 4])
def test_of_two_groups_neither_is_the_one_that_is_wrong(many: int, tmp_path: Path) -> None:
    """Features 10 mm apart are not far from the others."""
    places = [(end + 10 * i, 0.0) for end in (0, 9000) for i in range(many)]
    found = told(tmp_path, *places)
    assert len(found) == 2
    assert all("is at one end" in one for one in found)


@pytest.mark.parametrize("places", [((0, 0), (801, 0)), ((0, 0), (400, 0), (801, 0))])
def test_of_two_ends_neither_is_the_one_that_is_wrong(
    places: tuple[tuple[float, float], ...], tmp_path: Path
) -> None:
    last = chr(64 + len(places))
    x = "is at one end: all cover 801 mm in x, the machine travels 400 mm"
    assert told(tmp_path, *places) == [
        f"features.A.x_mm feature 'A' {x}",
        f"features.{last}.x_mm feature '{last}' {x}",
    ]
