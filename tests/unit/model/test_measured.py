"""Measured points as tables of errors, lengths and angles, and what cannot be."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_examples import PART, PLACES, part_file, points, study, with_measured

from mtu_cli.errors import InputError
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.points import Points
from mtu_cli.model.datum import Datum
from mtu_cli.model.measured import (
    angle_tables,
    feature_tables,
    length_tables,
    length_warnings,
    only_features,
    visits_of,
)
from mtu_cli.model.measured_checks import check_measured, not_measured, refuse_mistaken


def test_feature_tables_are_errors_by_part() -> None:
    found = feature_tables(
        points([("p", "a", 1, 0.01, -0.02), ("q", "a", 1, 0.03, 0.0), ("p", "a", 2, 0.03, -0.04)])
    )
    assert found.labels == (("", "a", "x"), ("", "a", "y"))
    assert found.cells.n.tolist() == [[2, 1], [2, 1]]
    mean = found.cells.origin[:, None] + found.cells.mean
    np.testing.assert_allclose(mean, [[0.02, 0.03], [-0.03, 0.0]], atol=1e-13)
    np.testing.assert_allclose(found.cells.within, [0.0002, 0.0002], rtol=1e-9)


def test_operations_are_apart_and_an_untold_one_too() -> None:
    rows = [("p", "a", 1, 0.01, 0.0), ("p", "a", 1, 0.05, 0.0), ("q", "a", 1, 0.09, 0.0)]
    found = points(rows, ["drilled", "milled", "milled"])
    tables = feature_tables(found)
    assert [label[0] for label in tables.labels] == ["drilled", "milled"] * 2
    assert tables.cells.n[:2].tolist() == [[1, 0], [1, 1]]
    untold = feature_tables(replace(found, operation=np.array([0, 1, -1])))
    assert [label[0] for label in untold.labels[:3]] == ["drilled", "milled", ""]


def test_a_repeat_that_stands_twice() -> None:
    rows = [("p", "a", 1, 0.0, 0.0), ("p", "b", 1, 0.0, 0.0), ("p", "a", 1, 0.1, 0.0)]
    with pytest.raises(InputError, match="row 4, column 'feature': the feature stands twice"):
        feature_tables(points(rows))
    with pytest.raises(InputError, match="row 4"):
        visits_of(points(rows))
    # Without numbers, rows of a cell are its repeats.
    unnumbered = [(part, name, -1, x, y) for part, name, _, x, y in rows]
    assert feature_tables(points(unnumbered)).cells.n.max() == 2
    assert len(visits_of(points(unnumbered)).part) == 2


def test_large_repeat_numbers() -> None:
    rows = [("p", "a", 10**12, 0.0, 0.0), ("p", "a", 7, 0.1, 0.0), ("q", "a", 10**12, 0.0, 0.1)]
    assert feature_tables(points(rows)).cells.n[0].tolist() == [2, 1]
    with pytest.raises(InputError, match="twice"):
        feature_tables(points([*rows, ("q", "a", 10**12, 0.2, 0.0)]))


def test_lengths_are_distances(tmp_path: Path) -> None:
    found = study(4, 2, 1)
    visits = visits_of(found)
    tables = length_tables(found, visits, part_file(tmp_path))
    assert tables is not None
    assert [label[1] for label in tables.labels] == ["a-b", "c-a"]
    for i, (start, end) in enumerate((("a", "b"), ("c", "a"))):
        for p in range(4):
            lengths = []
            for r in range(2):
                rows = [
                    k
                    for name in (start, end)
                    for k in range(len(found))
                    if (found.part[k], found.repeat[k]) == (p, r)
                    and found.features[found.feature[k]] == name
                ]
                one, two = found.measured[rows, :2]
                lengths.append(math.dist(one, two) - math.dist(PLACES[start], PLACES[end]))
            mean = tables.cells.origin[i] + tables.cells.mean[i, p]
            assert mean == pytest.approx(np.mean(lengths), abs=1e-12)


def test_a_turned_part_has_no_error_of_length_or_angle(tmp_path: Path) -> None:
    """A rotation of the whole part changes every point and nothing that counts."""
    found = study(4, 1, 1, 0.0, 0.0)
    # Slopes instead of angles (eqs. (24)-(26)) turn by 1 + slope^2: the two lines' differ little.
    angle = 1e-5
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    measured = found.measured.copy()
    measured[:, :2] = measured[:, :2] @ turn.T
    turned = with_measured(found, measured)
    visits, part = visits_of(turned), part_file(tmp_path)
    lengths, angles = length_tables(turned, visits, part), angle_tables(turned, visits, part)
    assert lengths is not None
    assert angles is not None
    np.testing.assert_allclose(lengths.cells.origin[:, None] + lengths.cells.mean, 0, atol=1e-12)
    np.testing.assert_allclose(angles.cells.origin, 0, atol=1e-9)


def test_angle_is_that_of_equations_24_to_26(tmp_path: Path) -> None:
    found = study(3, 1, 5)
    angles = angle_tables(found, visits_of(found), part_file(tmp_path))
    assert angles is not None
    for p in range(3):
        place = {
            found.features[found.feature[k]]: found.measured[k, :2]
            for k in range(len(found))
            if found.part[k] == p
        }
        along, across = place["b"] - place["a"], place["c"] - place["a"]
        row, column = along[1] / along[0], across[0] / across[1]
        value = angles.cells.origin[0] + angles.cells.mean[0, p]
        # By design the row rises by 1 in 100 and the column leans by 2 in 200.
        assert value == pytest.approx(-column - row + 0.02, rel=1e-9)


def test_perfect_parts_have_no_error_of_angle(tmp_path: Path) -> None:
    """Rows and columns that are not quite square by design have no error for it."""
    found = study(3, 1, 5, 0.0, 0.0)
    angles = angle_tables(found, visits_of(found), part_file(tmp_path))
    assert angles is not None
    np.testing.assert_allclose(angles.cells.origin, 0, atol=1e-15)


def test_a_row_off_its_axis_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.yaml"
    path.write_text(PART.replace("row: [a, b], column: [a, c]", "row: [a, c], column: [a, b]"))
    found = study(3, 1, 5)
    with pytest.raises(InputError, match=r"the row of 'xy' runs 89.4 degrees off x"):
        angle_tables(found, visits_of(found), load_part(path))


def in_space(found: Points, part: LoadedPart, z: float) -> tuple[Points, LoadedPart]:
    """The same study with hole b `z` higher by design, measured `z` + 0.003 higher."""
    raised = part.part.features["b"].model_copy(update={"z_mm": z})
    features = {**part.part.features, "b": raised}
    features |= {n: part.part.features[n].model_copy(update={"z_mm": 0.0}) for n in "ac"}
    nominal, measured = found.nominal.copy(), found.measured.copy()
    high = found.feature == found.features.index("b")
    nominal[:, 2] = np.where(high, z, 0.0)
    measured[:, 2] = np.where(high, z + 0.003, 0.0)
    changed = replace(part, part=part.part.model_copy(update={"features": features}))
    return replace(found, nominal=nominal, measured=measured), changed


def test_lengths_use_the_axes_that_were_measured_at_every_end(tmp_path: Path) -> None:
    found, part = in_space(study(2, 1, 1, 0.0, 0.0), part_file(tmp_path), 50.0)
    tables = length_tables(found, visits_of(found), part)
    assert tables is not None
    long = math.hypot(100, 1, 50.003) - math.hypot(100, 1, 50)
    np.testing.assert_allclose(tables.cells.origin, [long, 0], atol=1e-12)
    assert length_warnings(found, part) == []
    measured = found.measured.copy()
    measured[0, 2] = np.nan
    partly = with_measured(found, measured)
    flat = length_tables(partly, visits_of(partly), part)
    assert flat is not None
    # Not one part in space and the other in the plane.
    np.testing.assert_allclose(flat.cells.origin[:, None] + flat.cells.mean, 0, atol=1e-12)
    (warning,) = length_warnings(partly, part)
    assert warning.code == "length-without-z"
    assert warning.message.startswith("length a-b runs along z")


def test_what_was_not_measured_is_left_out(tmp_path: Path) -> None:
    part = part_file(tmp_path)
    found = points([("p", "a", 1, 0.0, 0.0), ("p", "b", 1, 0.0, 0.0), ("q", "a", 1, 0.0, 0.0)])
    lengths = length_tables(found, visits_of(found), part)
    assert lengths is not None
    assert lengths.labels == (("", "a-b", ""),)
    assert lengths.cells.n.tolist() == [[1, 0]]
    assert angle_tables(found, visits_of(found), part) is None
    alone = only_features(found, ["c"])
    assert len(alone) == 0
    few = only_features(found, ["b", "nobody"])
    assert (few.features, few.row.tolist()) == (("b",), [3])


def codes(found: list[object]) -> list[str]:
    return [item.code for item in found]  # type: ignore[attr-defined]  # warnings


def test_a_clean_study_is_not_suspected() -> None:
    assert check_measured(study(21, 2, 3)) == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda xyz: xyz[:, [1, 0, 2]], "x and y swapped"),
        (lambda xyz: -xyz, "a sign the other way round"),
        (lambda xyz: xyz * [-1, 1, 1], "sign of x"),
        (lambda xyz: xyz * [1, -1, 1], "sign of y"),
        (lambda xyz: xyz / 25.4, "inches taken for mm"),
        (lambda xyz: xyz / [25.4, 1, 1], "x alone in inches"),
        (lambda xyz: xyz / [1, 25.4, 1], "y alone in inches"),
        (lambda xyz: xyz * [1000, 1, 1], "x alone in um"),
        (lambda xyz: xyz * 1000, "um taken for mm"),
        (lambda xyz: xyz / 1000, "metres taken for mm"),
        (lambda xyz: xyz + np.array([3.0, -70.0, 0.0]), "origin that differs by"),
        (lambda xyz: xyz**2, "unit, sign or swap mistake"),
    ],
)
def test_mistakes_are_named(change: object, word: str) -> None:
    found = study(6, 2, 3)
    wrong = with_measured(found, change(found.measured))  # type: ignore[operator]  # a lambda
    (warning,) = check_measured(wrong)
    assert warning.code == "error-of-millimetres"
    assert word in warning.message
    assert "36 of 36 points" in warning.message or word == "x and y swapped"


def test_mistakes_of_most_points_are_refused_where_a_machine_would_be_written() -> None:
    found = study(6, 2, 3)
    refuse_mistaken(found)
    with pytest.raises(InputError, match=r"36 of 36 points .*um taken for mm"):
        refuse_mistaken(with_measured(found, found.measured * 1000))
    some = found.measured.copy()
    some[:18] += 70
    refuse_mistaken(with_measured(found, some))
    some[:18] = found.measured[:18]
    some[:19] = found.measured[:19] * 1000
    with pytest.raises(InputError, match=r"cmm.csv, row 2: 19 of 36"):
        refuse_mistaken(with_measured(found, some))


def test_parts_put_down_by_hand_are_no_mistake_of_units() -> None:
    """Refused like one, with the option that takes their place out; with it they are welcome."""
    found = study(6, 2, 3)
    put = np.random.default_rng(5).normal(0.0, 4.0, (6, 3))[found.part]
    apart = with_measured(found, found.measured + put)
    with pytest.raises(InputError, match="put down by hand: --datum offset, or --datum off"):
        refuse_mistaken(apart, "none")
    with pytest.raises(InputError, match=r"in the frame of the nominal ones$"):
        refuse_mistaken(apart)
    refuse_mistaken(apart, "offset")
    assert check_measured(apart, "offset") == []
    assert [item.code for item in check_measured(apart)] == ["error-of-millimetres"]
    with pytest.raises(InputError, match=r"inches taken for mm; expected [^;]*$"):
        refuse_mistaken(with_measured(found, found.measured / 25.4), "none")


def test_an_axis_of_the_machine_that_was_not_measured_is_told() -> None:
    found = study(6, 2, 3)
    flat = with_measured(found, found.measured * [1, 1, np.nan])
    (warning,) = not_measured(("x", "y", "z"), flat)
    assert warning.code == "axis-not-measured"
    assert "no z_mm" in warning.message
    assert not not_measured(("x", "y"), flat)


def test_mixed_units_are_named_for_the_rows_that_have_them() -> None:
    found = study(6, 2, 3)
    measured = found.measured.copy()
    measured[found.part == 2] /= 25.4
    (warning,) = check_measured(with_measured(found, measured))
    assert "6 of 36 points" in warning.message
    assert "row 14" in warning.message
    assert "inches" in warning.message


@pytest.mark.parametrize(
    ("factor", "axes", "unit"),
    [
        (1000, [0, 1], "um taken for mm"),
        (1000, [0], "um taken for mm"),
        (1e-3, [0, 1], "metres taken for mm"),
        (1 / 25.4, [0, 1], "inches taken for mm"),
        (25.4, [1], "mm taken for inches"),
    ],
)
def test_parts_in_another_unit_than_the_others_are_refused(
    factor: float, axes: list[int], unit: str
) -> None:
    found = study(6, 2, 3)
    measured = found.measured.copy()
    rows = np.flatnonzero(np.isin(found.part, [2, 4]))
    for axis in axes:
        measured[rows, axis] *= factor
    datums: tuple[Datum | None, ...] = (None, "offset")
    for datum in datums:
        with pytest.raises(InputError) as caught:
            refuse_mistaken(with_measured(found, measured), datum)
        (problem,) = caught.value.findings
        assert (problem.file, problem.row) == ("cmm.csv", 14)
        assert "parts 'P2', 'P4' do not fit the other parts, of which there are 4" in problem.text
        assert str(problem.expected).endswith(f"this looks like {unit}")


def test_parts_that_lie_elsewhere_or_have_a_slip_are_not_refused() -> None:
    found = study(6, 2, 3)
    own = found.part == 2
    for changed in (found.measured + 240.0, -found.measured, found.measured[:, [1, 0, 2]]):
        refuse_mistaken(with_measured(found, np.where(own[:, None], changed, found.measured)))
    one = found.measured.copy()
    one[np.flatnonzero(own)[0], 0] *= 10
    refuse_mistaken(with_measured(found, one))


@pytest.mark.parametrize("factor", [1.0, 1000.0])
def test_errors_in_the_columns_of_coordinates_are_named(factor: float) -> None:
    found = study(6, 2, 3)
    errors = factor * (found.measured - found.nominal)
    with pytest.raises(InputError, match="these look like errors, not like the coordinates"):
        refuse_mistaken(with_measured(found, errors))


def test_single_points_are_told_by_row_and_column() -> None:
    """One mistyped point is no origin that differs; nor are some features of every part."""
    found = study(6, 2, 3)
    measured = found.measured.copy()
    measured[7, 0] *= 10
    (warning,) = check_measured(with_measured(found, measured))
    assert warning.message.startswith("1 of 36 points is more than 0.5 mm from its nominal: cmm.cs")
    told = f"row 9, column 'x_mm': {measured[7, 0]:.9g} where about {found.nominal[7, 0]:g} is exp"
    assert told in warning.message
    assert "the other points are within 0.0" in warning.message
    assert "origin" not in warning.message
    measured = found.measured.copy()
    measured[found.feature == 1, 1] += 10.0
    (warning,) = check_measured(with_measured(found, measured))
    name = found.features[1]
    assert f"in column 'y_mm', all by +10 mm, of feature '{name}' in every part" in warning.message
    measured = found.measured + np.where(found.part[:, None] == 2, [0.0, 10.0, 0.0], 0.0)
    (warning,) = check_measured(with_measured(found, measured))
    assert "of part 'P2' this looks like an origin that differs by" in warning.message


def test_a_part_measured_under_two_names() -> None:
    found = study(5, 2, 3)
    measured = found.measured.copy()
    measured[found.part == 4] = measured[found.part == 1]
    copied = with_measured(found, measured)
    with pytest.raises(InputError, match=r"part 'P4' has the same values as part 'P1'"):
        check_measured(copied)
    order = np.random.default_rng(1).permutation(len(found))
    shuffled = replace(
        copied,
        **{
            name: getattr(copied, name)[order]
            for name in (
                "part",
                "feature",
                "operation",
                "measured",
                "nominal",
                "repeat",
                "row",
                "sequence",
            )
        },
    )
    with pytest.raises(InputError, match="same values"):
        check_measured(shuffled)
    measured[np.flatnonzero(found.part == 4)[0], 0] += 1e-6
    assert check_measured(with_measured(found, measured)) == []


def test_coarse_values_may_agree_by_chance() -> None:
    """Perfect parts, or one feature to 0.01 mm, are no copies: a word of warning at most."""
    rows = [(f"P{p}", name, 1, 0.0, 0.0) for p in range(3) for name in PLACES]
    warning, *others = check_measured(points(rows))
    assert warning.code == "parts-alike"
    # That they are perfect is told of each axis.
    assert [item.code for item in others] == ["axis-on-nominal"] * 2
    assert "2 parts have" in warning.message
    assert "'P1' as 'P0', 'P2' as 'P0': were" in warning.message
    warning, *_ = check_measured(points([row for row in rows if row[0] != "P2"]))
    assert "part 'P1' has the same values as part 'P0': was it" in warning.message
    rows = [(f"P{p}", name, 1, 0.0, 0.0) for p in range(12) for name in PLACES]
    warning, *_ = check_measured(points(rows))
    assert "11 parts have" in warning.message
    assert "'P6' as 'P0' and 5 more: were" in warning.message
    rows = [(f"P{p}", "a", 1, 0.01 * (p % 2), 0.0) for p in range(9)]
    (told,) = check_measured(points(rows))
    assert told.message.startswith("y_mm is on its nominal in all of 9 values")


def test_an_axis_without_nominal_and_a_moved_nominal() -> None:
    found = study(4, 1, 2)
    measured = found.measured.copy()
    measured[:, 2] = 1.0
    (warning,) = check_measured(with_measured(found, measured))
    assert warning.code == "axis-left-out"
    nominal = found.nominal.copy()
    nominal[5, 1] += 0.001
    (warning,) = check_measured(replace(found, nominal=nominal))
    assert warning.code == "nominals-differ"
    assert "'c'" in warning.message
    assert "row 7" in warning.message


def test_a_negative_repeat_is_no_repeat() -> None:
    found = study(4, 2, 2)
    repeat = found.repeat.copy()
    repeat[3] = -1
    with pytest.raises(InputError, match="row 5, column 'repeat': a negative repeat: '-1'"):
        check_measured(replace(found, repeat=repeat))
    # A file without the column has -1 in all of its rows.
    assert check_measured(replace(found, repeat=np.full(len(found), -1))) == []


def test_a_part_has_one_number_of_sequence() -> None:
    found = study(4, 2, 2)
    sequence = found.sequence.copy()
    sequence[9] = 77
    with pytest.raises(InputError, match="row 11, column 'sequence': part 'P1' has two numbers"):
        check_measured(replace(found, sequence=sequence))
    rows = [(f"P{p}", n, 1, 0.001 * p, 0.002 * p) for n in "ab" for p in range(3)]
    by_operation = points(rows, ["drilled"] * 3 + ["milled"] * 3)
    order = np.array([1, 2, 3, 3, 1, 2])
    assert "sequence" not in str(check_measured(replace(by_operation, sequence=order)))


def test_a_coordinate_of_kilometres() -> None:
    found = study(4, 1, 2)
    measured = found.measured.copy()
    measured[4, 1] = 1e12
    with pytest.raises(InputError, match="row 6, column 'y_mm': too large: '1e"):
        check_measured(with_measured(found, measured))


def doubled(found: Points, repeat: int) -> Points:
    """Every row a second time, with repeats as they are and then -1 or as they are."""
    names = ("part", "feature", "operation", "measured", "nominal", "time_min", "sequence",
             "direction")  # fmt: skip
    twice: dict[str, Any] = {name: np.concatenate([getattr(found, name)] * 2) for name in names}
    n = len(found)
    second = np.full(n, -1)
    return replace(
        found,
        **twice,
        repeat=np.concatenate([np.full(n, -1) if repeat < 0 else found.repeat, second]),
        file_index=np.repeat([0, 1], n),
        row=np.tile(found.row, 2),
        sources=(found.sources[0], found.sources[0]),
    )


@pytest.mark.parametrize("repeat", [-1, 1])
def test_every_row_twice(repeat: int) -> None:
    """Whether the first file numbers its repeats or not."""
    (warning,) = check_measured(doubled(study(5, 2, 3), repeat))
    assert warning.code == "rows-stand-twice"
    assert "60 of 60 points" in warning.message
    assert "cmm.csv, row 2 and cmm.csv, row 2" in warning.message
    single = replace(study(5, 2, 3), repeat=np.full(30, -1))
    assert check_measured(single) == []


def test_names_that_look_alike() -> None:
    found = replace(study(3, 1, 1), parts=("sn001", "SN001", "sn 002"), features=("a", "A ", "c"))
    first, second = check_measured(found)
    assert {first.code, second.code} == {"names-alike"}
    assert "'sn001' and 'SN001'; did you mean the same?" in first.message
    assert second.message.startswith("features whose names")


def test_parts_that_differ_by_less_than_the_last_digit_are_no_copies() -> None:
    """A CMM that rounds to 0.01 mm, parts within 1.5 um: some of ten agree in all features.

    To the last digit of a CMM that shows more, they are copies.
    """
    rng = np.random.default_rng(4)
    own = {name: rng.uniform(-0.03, 0.03, 2) for name in PLACES}
    rows = [
        (f"P{p}", name, repeat, *(error + rng.normal(scale=1.5e-3, size=2)))
        for p in range(10)
        for name, error in own.items()
        for repeat in (1, 2)
    ]
    fine = points(rows)
    coarse = with_measured(fine, np.round(fine.measured, 2))
    (warning,) = check_measured(coarse)
    assert warning.code == "parts-alike"
    measured = fine.measured.copy()
    measured[fine.part == 7] = measured[fine.part == 2]
    with pytest.raises(InputError, match=r"part 'P7' has the same values as part 'P2'"):
        check_measured(with_measured(fine, measured))


@pytest.mark.parametrize(
    ("digits", "shift", "scatter", "repeats"),
    [(2, 0.0, 3e-3, 5), (2, 3e-3, 2e-4, 1), (3, 1e-3, 1e-4, 1)],
    ids=["repeats agree", "parts shift as a whole", "finer digit"],
)
@pytest.mark.parametrize("seed", range(8))
def test_honest_parts_of_a_coarse_digit_are_never_refused(
    seed: int, digits: int, shift: float, scatter: float, repeats: int
) -> None:
    """Twenty parts: equal ones by rounding, whose rows are not independent of each other."""
    rng = np.random.default_rng(seed)
    own = {name: rng.uniform(-0.03, 0.03, 2) for name in PLACES}
    rows = []
    for p in range(20):
        whole = rng.normal(scale=shift, size=2)
        for name, error in own.items():
            hole = error + whole + rng.normal(scale=scatter, size=2)
            rows += [
                (f"P{p}", name, repeat, *(hole + rng.normal(scale=scatter / 10, size=2)))
                for repeat in range(1, repeats + 1)
            ]
    fine = points(rows)
    found = check_measured(with_measured(fine, np.round(fine.measured, digits)))
    assert {warning.code for warning in found} <= {"parts-alike"}


def test_two_equal_parts_alone_are_asked_about() -> None:
    """Nothing tells what parts differ by; of three that are compared something does."""
    rng = np.random.default_rng(5)
    rows = [("P0", name, 1, *rng.normal(scale=0.02, size=2)) for name in PLACES]
    both = [*rows, *(("P1", *row[1:]) for row in rows)]
    (warning,) = check_measured(points(both))
    assert (warning.code, "was it measured twice?" in warning.message) == ("parts-alike", True)
    third = [("P2", name, 1, *rng.normal(scale=0.02, size=2)) for name in PLACES]
    with pytest.raises(InputError, match="same values"):
        check_measured(points([*both, *third]))
