"""Predicted against measured, on parts that the true machine makes and on ones it does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import DATA, PAPER, paper_study

from mtu_cli.analyses.compare import CompareResult, compare
from mtu_cli.files.points import Points, read_points
from mtu_cli.model.features import feature_points
from mtu_cli.model.settings import Settings
from mtu_cli.model.simulate import PartsPlan, simulate_points
from mtu_cli.reports.simulate import points_csv
from mtu_cli.stats.family import holm

STUDY = paper_study()
PARTS = 21


def made(folder: Path, seed: int, *, offset: float = 0.0, extra: float = 0.0) -> Points:
    """Points of parts that the paper's machine makes, with an error (mm) it does not declare."""
    ids, places, _ = feature_points(STUDY.part, STUDY.model)
    plan = PartsPlan(
        parts=PARTS, repeats=2, cmm_u=1e-3, part_offset=extra, reverse_every=0, minutes=0.5
    )
    found = simulate_points(STUDY.model, ids, places, plan, seed)
    path = folder / f"points-{seed}.csv"
    path.write_text(points_csv(found, ""))
    points = read_points([(path, "cmm")], STUDY.part.part.places())
    measured = points.measured.copy()
    measured[:, 0] += offset
    from dataclasses import replace

    return replace(points, measured=measured)


def compared(points: Points, datum: str = "none") -> CompareResult:
    return compare(STUDY.model, STUDY.part, points, Settings(), datum)  # type: ignore[arg-type]  # a literal


def test_false_alarms_on_parts_the_machine_makes(tmp_path: Path) -> None:
    """The family of all features, and that of all lengths, alarms in 5 % of studies at most."""
    runs = 60
    alarms = np.zeros(2)
    for seed in range(runs):
        result = compared(made(tmp_path, seed))
        for i, found in enumerate((result.features, result.lengths)):
            assert found is not None
            alarms[i] += any(verdict != "consistent" for verdict in found.verdicts)
    # Two families of tests, bias and scatter, at 5 % each.
    limit = 0.1 + 3.3 * np.sqrt(0.1 * 0.9 / runs)
    assert (alarms / runs < limit).all(), alarms


def test_an_undeclared_offset_is_a_bias_and_a_datum_takes_it_out(tmp_path: Path) -> None:
    points = made(tmp_path, 100, offset=0.02)
    result = compared(points)
    x = [v for label, v in zip(result.features.labels, result.features.verdicts, strict=True)
         if label[2] == "x"]  # fmt: skip
    assert x.count("biased") == len(x)
    bias = result.features.bias[[label[2] == "x" for label in result.features.labels]]
    assert np.mean(bias) == pytest.approx(0.02, abs=4 * 5e-3 / np.sqrt(PARTS))
    freed = compared(points, "offset")
    assert "biased" not in freed.features.verdicts


def test_scatter_beyond_the_prediction_is_under_predicted(tmp_path: Path) -> None:
    result = compared(made(tmp_path, 200, extra=0.02))
    assert set(result.features.verdicts) == {"under-predicted"}
    # A shift of the whole part leaves its lengths alone.
    assert result.lengths is not None
    assert "under-predicted" not in result.lengths.verdicts


def test_shipped_parts_against_the_papers_ratios() -> None:
    """Table 10's ratios, 4-7 drilled and 2-3 milled, within the sampling error of 21 parts."""
    files = [(DATA / "gilsinn-ling-parts" / f"{name}.csv", "cmm") for name in ("drilled", "milled")]
    result = compared(read_points(files, STUDY.part.part.places()))
    found = result.lengths
    assert found is not None
    assert PAPER.is_dir()
    width = 2 * (np.abs(found.measured_paper.mean) + 2 * found.measured_paper.u)
    own = 2 * (np.abs(found.independent.mean) + 2 * found.independent.u)
    ratio = width / own
    sampling = 1 / np.sqrt(2 * (PARTS - 1))
    drilled = np.array([label[0] == "drilled" for label in found.labels])
    assert ratio[drilled].min() > 4 * (1 - 2 * sampling)
    assert ratio[drilled].max() < 7 * (1 + 2 * sampling)
    assert ratio[~drilled].min() > 2 * (1 - 2 * sampling)
    assert ratio[~drilled].max() < 3 * (1 + 2 * sampling)
    # Components of variance: MS_between overstates the parts' scatter by about sqrt(n0) = 1.6.
    share = found.measured_paper.u / found.measured.u
    assert np.median(share) == pytest.approx(np.sqrt(2.544), rel=0.15)


def test_holm_by_hand() -> None:
    p = np.array([0.04, 0.001, 0.03, 0.5])
    assert holm(p) == pytest.approx([0.09, 0.004, 0.09, 0.5])
