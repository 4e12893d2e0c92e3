"""Checks of measured points: what is named, and what chance and a coarse digit may do."""

import numpy as np
import pytest
from measured_examples import PLACES, points, study, with_measured

from checks.damage import NAMELESS
from mtu_cli import checks
from mtu_cli.files.readings import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding


def found_of(table: Points, datum: Datum = "none") -> list[Finding]:
    return checks.run("points", checks.PointsData(table, datum=datum))


def codes(table: Points, datum: Datum = "none") -> list[str]:
    return [each.code for each in found_of(table, datum)]


def only(table: Points) -> Finding:
    (finding,) = found_of(table)
    return finding


def test_what_no_mistake_explains() -> None:
    sound = study(6, 2, 3)
    finding = only(with_measured(sound, sound.measured**2))
    assert (finding.code, finding.severity, finding.row) == ("far-from-nominal", "warning", 2)
    assert finding.facts["looks"].startswith(NAMELESS)
    own = np.isin(sound.part, [2, 4])
    finding = only(with_measured(sound, np.where(own[:, None], 1e3, 1) * sound.measured))
    assert (finding.code, finding.facts["what"]) == ("far-from-nominal", "part 'P2', 'P4'")
    assert finding.facts["rows"] == tuple(sound.row[own].tolist())


def test_parts_put_down_by_hand_are_no_mistake_where_the_datum_says_so() -> None:
    sound = study(6, 2, 3)
    put = np.random.default_rng(5).normal(0.0, 4.0, (6, 3))[sound.part]
    moved = with_measured(sound, sound.measured + put)
    assert codes(moved, "offset") == []
    assert set(codes(moved)) == {"far-from-nominal"}
    inches = with_measured(sound, (sound.measured + put) / 25.4)
    assert "unit-of-points" in codes(inches, "offset")


def test_a_repeat_off_the_other_within_the_scatter_of_the_parts() -> None:
    """Parts scatter by 20 um, repeats by 0.1 um: 10 um hide among the parts."""
    draw = np.random.default_rng(8)
    rows = [
        (f"P{p}", name, repeat, *(hole + draw.normal(scale=1e-4, size=2)))
        for p in range(10)
        for name in PLACES
        for hole in [draw.normal(scale=0.02, size=2)]
        for repeat in (1, 2)
    ]
    sound = points(rows)
    assert found_of(sound) == []
    measured = sound.measured.copy()
    measured[11, 0] += 0.01
    finding = only(with_measured(sound, measured))
    assert (finding.code, finding.facts["beside"]) == ("outlying-value", "its other repeats")
    assert finding.row in (12, 13)


@pytest.mark.parametrize(
    ("digits", "shift", "scatter", "repeats"),
    [(2, 0.0, 3e-3, 5), (2, 3e-3, 2e-4, 1), (3, 1e-3, 1e-4, 1)],
    ids=["repeats agree", "parts shift as a whole", "finer digit"],
)
def test_sound_parts_of_a_coarse_digit_are_rarely_copies(
    digits: int, shift: float, scatter: float, repeats: int
) -> None:
    """Twenty parts that agree by rounding, whose values are not independent of each other."""
    alarms = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        own = {name: rng.uniform(-0.03, 0.03, 2) for name in PLACES}
        rows = []
        for p in range(20):
            whole = rng.normal(scale=shift, size=2)
            for name, error in own.items():
                hole = error + whole + rng.normal(scale=scatter, size=2)
                for repeat in range(1, repeats + 1):
                    noise = rng.normal(scale=scatter / 10, size=2)
                    rows.append((f"P{p}", name, repeat, *(hole + noise)))
        fine = points(rows)
        alarms += "copied-values" in codes(with_measured(fine, np.round(fine.measured, digits)))
    assert alarms <= 2, alarms
