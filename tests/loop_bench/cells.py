"""The cells of the bench: kinds of data sets, how many of each, and what is kept of one."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from shop_day import (
    FAMILIES,
    MISSHAPEN,
    NOISES,
    OUTSIDE,
    Noise,
    Truth,
    blocks,
    effect,
    interleaved,
    measure,
    misshapen_effect,
    named_by_noise,
    oracle_held_out,
    outside_effect,
)

from loop_bench.commands import commanded
from loop_bench.days import FOLDS, THIRDS, BenchDay
from loop_bench.intervals import covers
from loop_bench.judge import diagnosed, held_out_after
from loop_bench.laser_runs import RUN_FAMILIES, clean_run, laser_run

Measure = Literal[
    "null", "library", "misshapen", "outside", "pairs", "command", "laser-clean", "laser"
]
Record = dict[str, Any]
NULLS, OTHERS, COMMANDS, CLEAN_RUNS = 5000, 500, 40, 2000
SCATTERS = ("rotation-scatter", "operation-scatter")
"""Families that say nothing of the mean: nothing to gain on held-out parts."""
TELLABLE = 4.0
"""Least separation d of an effect that should be named."""
COVERED_FROM = 0.35


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Data sets of one kind, on each design."""

    measure: Measure
    count: int
    noise: Noise = "normal"
    amplitude: float = 0.0
    families: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        if self.measure == "null":
            return f"null-{self.noise}"
        only = f"-{self.families[0]}" if len(self.families) == 1 else ""
        if self.measure == "laser-clean":
            return self.measure
        return f"{self.measure}{only}-{self.amplitude:g}"


CELLS: tuple[Cell, ...] = (
    *(
        Cell(measure="library", count=OTHERS, amplitude=a, families=FAMILIES)
        for a in (0.35, 0.5, 1.0, 2.0)
    ),
    *(
        Cell(measure="misshapen", count=OTHERS, amplitude=a, families=tuple(MISSHAPEN))
        for a in (0.5, 1.0, 2.0)
    ),
    *(
        Cell(measure="outside", count=OTHERS, amplitude=1.0, families=(family,))
        for family in OUTSIDE
    ),
    Cell(measure="pairs", count=OTHERS, amplitude=1.0, families=FAMILIES),
    *(Cell(measure="null", count=NULLS, noise=noise) for noise in NOISES),
    Cell(measure="laser-clean", count=CLEAN_RUNS),
    Cell(measure="laser", count=OTHERS, amplitude=1.0, families=RUN_FAMILIES),
    Cell(measure="command", count=COMMANDS, amplitude=1.0, families=FAMILIES),
)
MAKERS: dict[Measure, Callable[..., Truth]] = {
    "library": effect,
    "command": effect,
    "misshapen": misshapen_effect,
    "outside": outside_effect,
}


def record(bench: BenchDay, cell: Cell, base: int, index: int) -> Record:
    """Data set `index` of a cell: drawn, judged, and what the table needs of it."""
    kind = ord(bench.day.kind)
    rng = np.random.default_rng([base, zlib.crc32(cell.name.encode()), kind, index])
    if cell.measure.startswith("laser"):
        # No day stands behind a run: it has one of its own.
        rng = np.random.default_rng(
            [base, zlib.crc32(cell.name.encode()), kind, bench.day.seed, index]
        )
    if cell.measure == "laser-clean":
        return {"index": index, "day": bench.day.seed, **clean_run(bench.day.kind, rng)}
    if cell.measure == "laser":
        family = cell.families[index % len(cell.families)]
        told = laser_run(bench.day.kind, rng, family)
        return {"index": index, "day": bench.day.seed, **told}
    truths = _truths(bench, cell, rng, index)
    if cell.measure == "command":
        told = {"index": index, "day": bench.day.seed, **_true(bench, truths)}
        return told | commanded(bench.day, rng, truths)
    errors = measure(bench.day, rng, truths, cell.noise)
    found = diagnosed(bench, errors)
    kept: Record = {
        "index": index,
        "day": bench.day.seed,
        "names": found.names,
        "first_class": found.classes[0] if found.classes else (),
        "fired": found.fired,
        "nameless": found.nameless,
        "ranked_first": found.ranked_first,
        "gross": found.gross,
        "ms": 1e3 * found.seconds,
    }
    if cell.measure == "null":
        allowed = named_by_noise(cell.noise)
        kept["alarm"] = found.unexplained or any(name not in allowed for name in found.names)
        return kept
    kept |= _true(bench, truths)
    kept["lone"] = found.lone()
    if cell.measure in ("outside", "pairs"):
        kept["standing"] = found.standing()
    if cell.measure == "outside":
        kept["verdict"] = found.verdict()
    if cell.measure == "library":
        kept |= _of_library(bench, cell, truths[0], errors, written=found.written)
        kept["covers"] = covers(found, truths[0]) if cell.amplitude >= COVERED_FROM else None
    return kept


def _true(bench: BenchDay, truths: Sequence[Truth]) -> Record:
    return {
        "truths": [truth.name for truth in truths],
        "families": [truth.family for truth in truths],
        "aliases": [_aliases(bench, truth) for truth in truths],
    }


def _truths(bench: BenchDay, cell: Cell, rng: np.random.Generator, index: int) -> tuple[Truth, ...]:
    if cell.measure == "null":
        return ()
    if cell.measure == "pairs":
        return _pair(bench, cell, rng)
    family = cell.families[index % len(cell.families)]
    return (MAKERS[cell.measure](bench.day, family, rng, cell.amplitude),)


def _pair(bench: BenchDay, cell: Cell, rng: np.random.Generator) -> tuple[Truth, Truth]:
    """Two families at random, of those that move a mean; drawn until either could be told."""
    families = [family for family in cell.families if family not in SCATTERS]
    while True:
        a, b = (str(family) for family in rng.choice(families, 2, replace=False))
        one, two = (effect(bench.day, family, rng, cell.amplitude) for family in (a, b))
        if all(_separation(bench, truth) >= TELLABLE for truth in (one, two)):
            return one, two


def _separation(bench: BenchDay, truth: Truth) -> float:
    signal = bench.rivals.signal(truth)
    return 0.0 if signal is None else signal.d


def _aliases(bench: BenchDay, truth: Truth) -> tuple[str, ...]:
    signal = bench.rivals.signal(truth)
    return () if signal is None else signal.aliases


def _of_library(
    bench: BenchDay, cell: Cell, truth: Truth, errors: np.ndarray, *, written: bool
) -> Record:
    signal = bench.rivals.signal(truth)
    kept: Record = {"z": None, "d": None, "rival": None}
    if signal is not None:
        kept = {"z": signal.z, "d": signal.d, "rival": signal.rival}
    if truth.family not in SCATTERS and cell.amplitude >= 0.5:
        parts = bench.day.P
        between = oracle_held_out(errors, [truth], interleaved(parts, THIRDS))
        oracle = oracle_held_out(errors, [truth], blocks(parts, FOLDS))
        always = oracle_held_out(errors, [truth], blocks(parts, FOLDS), always=True)
        kept |= {
            "before": between.before,
            "oracle": between.after,
            "after": held_out_after(bench, errors, bench.interleaved),
            "before_blocks": oracle.before,
            "oracle_blocks": oracle.after,
            "always_blocks": always.after,
            "after_blocks": held_out_after(bench, errors, bench.folds),
            "written": written,
        }
    return kept
