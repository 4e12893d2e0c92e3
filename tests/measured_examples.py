"""Measured points made in memory, for the tests of what is done with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from made_tables import made_points

from mtu_cli.analyses.anova import AnovaResult, analyse_variance
from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.files.readings import Points
from mtu_cli.model.settings import Settings
from mtu_cli.stats.coverage import FAMILY_RATE
from mtu_cli.stats.least_squares import FloatArray

PLACES = {"a": (10.0, 20.0), "b": (110.0, 21.0), "c": (12.0, 220.0)}

PART = """\
schema: mtu/part/1
name: three holes
features: {a: {x_mm: 10, y_mm: 20}, b: {x_mm: 110, y_mm: 21}, c: {x_mm: 12, y_mm: 220}}
lengths: [{from: a, to: b}, {from: c, to: a}]
orthogonality: [{id: xy, row: [a, b], column: [a, c]}]
"""


def part_file(folder: Path) -> LoadedPart:
    path = folder / "part.yaml"
    path.write_text(PART)
    return load_part(path)


def points(
    rows: list[tuple[str, str, int, float, float]], operations: list[str] | None = None
) -> Points:
    """Points from (part, feature, repeat, error x, error y); errors in mm, repeat -1 unknown."""
    features = list(dict.fromkeys(row[1] for row in rows))
    place = np.array([[*PLACES[str(row[1])], np.nan] for row in rows])
    error = np.array([[row[3], row[4], np.nan] for row in rows])
    return made_points(
        [row[0] for row in rows],
        np.array([features.index(row[1]) for row in rows]),
        features,
        place + error,
        place,
        repeat=[row[2] for row in rows],
        operation=operations,
    )


def study(
    parts: int, repeats: int, seed: int, s_part: float = 0.01, s_repeat: float = 0.001
) -> Points:
    """A clean study of the holes in `PLACES`."""
    rng = np.random.default_rng(seed)
    rows = []
    for p in range(parts):
        for name in PLACES:
            x, y = s_part * rng.standard_normal(2)
            rows += [
                (f"P{p}", name, r, x + s_repeat * rng.standard_normal(),
                 y + s_repeat * rng.standard_normal())
                for r in range(repeats)
            ]  # fmt: skip
    return points(rows)


def with_measured(found: Points, measured: FloatArray) -> Points:
    return replace(found, measured=measured)


def alarms_of(result: AnovaResult) -> list[str]:
    """All that an analysis of clean parts should not say."""
    return [
        *(f"part {item.part}" for item in result.unusual or ()),
        *(f"trend {item.where}" for item in result.trends if item.p <= FAMILY_RATE),
        *(item.code for item in result.warnings),
    ]


def planted_and_clean(part: LoadedPart, runs: int) -> tuple[float, float]:
    """Shares of studies in which a part 4 sigma off along x is named, and of clean ones with any
    alarm; 21 parts measured twice, lengths and right angles among the tables.
    """
    found = alarms = 0
    for seed in range(runs):
        clean = study(21, 2, seed, 0.01, 0.001)
        result = analyse_variance(clean, part, "reml", Settings(seed=seed))
        alarms += bool(alarms_of(result))
        measured = clean.measured.copy()
        measured[clean.part == seed % 21, 0] += 0.04
        result = analyse_variance(with_measured(clean, measured), part, "reml", Settings(seed=seed))
        found += f"P{seed % 21}" in [item.part for item in result.unusual or ()]
    return found / runs, alarms / runs
