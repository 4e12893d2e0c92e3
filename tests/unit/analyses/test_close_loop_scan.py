"""What the gate judges: offsets, scatters, and the rate with which nothing is found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from crossed_tables import Floats, Mask, half_measured, holes
from effect_tables import shop_covariates
from loop_tables import candidate, crossed, offset, prepared_with, residuals
from scipy.stats import binom, chi2

from mtu_cli.close_loop_sealed.analyses.loop.evidence import CHECKS, Evidence, evidence
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan, beside_found, calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import search
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.mean_squares import EntryNoise

SHAPE = (12, 10, 2)
RNG = np.random.default_rng(1)
SCATTERS = ("rotation-scatter", "scale-scatter", "operation-scatter")


def step(first: int) -> Floats:
    return np.asarray(np.arange(12) >= first, float)[:, None]


def library() -> tuple[Candidate, ...]:
    """Trends, steps, shapes, cells and growths along both axes; offsets and scatters."""
    found = []
    sequence: Floats = np.arange(12.0)[:, None] - 5.5
    for axis, letter in enumerate("xy"):
        own = [
            candidate(f"trend-{letter}", ({axis: sequence},)),
            candidate(f"step-{letter}", *(({axis: step(t)},) for t in range(4, 9))),
            candidate(f"shape-{letter}", ({axis: RNG.normal(size=(1, 10))},)),
            candidate(f"cells-{letter}", ({axis: RNG.normal(size=SHAPE[:2])},)),
            candidate(f"growth-{letter}", ({axis: sequence * RNG.normal(size=(1, 10))},)),
        ]
        found += [*own, offset(letter)]
    return (*found, *(candidate(name, kind="scatter") for name in SCATTERS))


LIBRARY = library()


def table_of(errors: Floats, there: Mask | None = None) -> ResidualTable:
    return residuals(
        errors,
        there=there,
        operations=("drilled", "milled"),
        operation=np.arange(10) % 2,
        covariates=shop_covariates(12, 10),
    )


def quiet(rng: np.random.Generator) -> Floats:
    """Parts and columns that differ less than single entries scatter: nothing to report."""
    return crossed(rng, SHAPE, part=0.7, column=0.5)


@cache
def ready(mask: str) -> tuple[Prepared, Gate]:
    there = {"complete": None, "holes": holes(12, 10, 0.2, 2), "half": half_measured(12, 10)}[mask]
    own = prepared_with(table_of(quiet(np.random.default_rng(3)), there), *LIBRARY)
    return own, calibrated(own.scan, 999, 4)


def looked(own: Prepared) -> Evidence:
    scan: Scan = own.scan
    return evidence(scan, scan.pack(), own.y, own.grand)


def other(errors: Floats, mask: str = "complete") -> Prepared:
    own, _ = ready(mask)
    there = own.table.there[:, :, None]
    return own.with_table(replace(own.table, errors=np.where(there, errors, np.nan)))


@pytest.mark.parametrize("mask", ["complete", "holes", "half"])
def test_tables_without_effects_alarm_as_rarely_as_stated(mask: str) -> None:
    count = 100
    rng, alarms = np.random.default_rng(5), 0
    _, gate = ready(mask)
    for _ in range(count):
        found = search(other(quiet(rng), mask), gate, alpha=0.05, most=1)
        alarms += bool(found.steps) or bool(found.fired(0.05))
    # A rate of up to 7 %, but in one case of a thousand.
    assert alarms <= binom.ppf(1 - 1e-3, count, 0.07)
    assert alarms >= binom.ppf(1e-3, count, 0.03)


def test_an_offset_is_judged_by_the_scatter_of_parts_and_columns() -> None:
    # t = mean / sqrt((MS part + MS column - MS interaction) / P H): Satterthwaite (1946).
    errors = crossed(np.random.default_rng(6), SHAPE)
    errors[:, :, 0] += 1.5
    own = prepared_with(residuals(errors, flat=True), *LIBRARY)
    found = looked(own)
    names = own.scan.names
    for axis in range(2):
        X = errors[:, :, axis]
        rest = X - X.mean(axis=0) - X.mean(axis=1, keepdims=True) + X.mean()
        squares = np.array(
            [
                10 * np.var(X.mean(axis=1), ddof=1),
                12 * np.var(X.mean(axis=0), ddof=1),
                np.sum(rest**2) / (11 * 9),
            ]
        )
        level = squares[0] + squares[1] - squares[2]
        nu = level**2 / np.sum(squares**2 / [11, 9, 99])
        t2 = X.mean() ** 2 * 120 / level
        index = names.index(f"offset-{'xy'[axis]}")
        assert found.statistics[index] == pytest.approx(nu * np.log1p(t2 / nu), rel=1e-9)
        expected = 0.5 * (nu - 1) * np.log1p(t2 / nu) - 0.5 * np.log1p(nu)
        assert found.log_bayes[index] == pytest.approx(expected, rel=1e-9)


def test_offsets_of_the_null_are_about_chi_squared() -> None:
    rng = np.random.default_rng(7)
    index = ready("complete")[0].scan.names.index("offset-x")
    T = [looked(other(crossed(rng, SHAPE))).statistics[index] for _ in range(120)]
    hits = sum(v > chi2.isf(0.05, 1) for v in T)
    assert hits <= binom.ppf(1 - 1e-3, 120, 0.08)


def scatter_p(own: Prepared) -> dict[str, float]:
    closed = np.exp(-looked(own).closed)
    return dict(zip((*SCATTERS, *CHECKS[-2:]), closed.tolist(), strict=True))


def turned(rng: np.random.Generator, growing: bool, size: float) -> Floats:
    """Parts that turn (or grow), each by itself."""
    places = ready("complete")[0].table.places[0, :, :2]
    x, y = (places - places.mean(axis=0)).T / 50.0
    shape = np.stack([x, y] if growing else [-y, x], axis=-1)
    return np.asarray(size * rng.normal(size=(12, 1, 1)) * shape)


def test_scatters_are_seen_each_by_its_name() -> None:
    rng = np.random.default_rng(8)
    noise = crossed(rng, SHAPE)
    turning = scatter_p(other(noise + turned(rng, False, 3.0)))
    growing = scatter_p(other(noise + turned(rng, True, 3.0)))
    loud = noise.copy()
    loud[:, 1::2] += 2.0 * rng.normal(size=loud[:, 1::2].shape)
    operation = scatter_p(other(loud))
    for name, found in zip(SCATTERS, (turning, growing, operation), strict=True):
        assert min(found, key=lambda key: found[key]) == name
        assert found[name] < 1e-3
        assert min(p for key, p in found.items() if key != name) > 0.01


def test_scatters_of_the_null_have_p_that_are_not_too_small() -> None:
    rng = np.random.default_rng(9)
    found = [scatter_p(other(quiet(rng))) for _ in range(120)]
    for name in SCATTERS:
        assert sum(p[name] < 0.05 for p in found) <= binom.ppf(1 - 1e-3, 120, 0.07)


def test_scatters_found_before_are_not_found_again() -> None:
    rng = np.random.default_rng(10)
    loud = crossed(rng, SHAPE) + turned(rng, False, 3.0)
    loud[:, 1::2] += 2.0 * rng.normal(size=loud[:, 1::2].shape)
    own = other(loud)
    aside = frozenset({"rotation-scatter", "operation-scatter"})
    again = evidence(own.scan, own.scan.pack(), own.y, own.grand, aside)
    p = dict(zip(SCATTERS, np.exp(-again.closed), strict=False))
    assert scatter_p(own)["rotation-scatter"] < 1e-4
    assert min(p["rotation-scatter"], p["operation-scatter"]) > 0.05


def test_the_same_seed_draws_the_same_gate() -> None:
    own, gate = ready("half")
    again = calibrated(own.scan, 999, 4)
    assert gate.null.tobytes() == again.null.tobytes()
    assert gate.largest.tobytes() == again.largest.tobytes()
    assert gate.largest.tobytes() != calibrated(own.scan, 999, 5).largest.tobytes()


def test_beside_what_was_found_the_gate_is_that_of_what_is_left() -> None:
    """Of a complete table it is the first one; else as if the rest were all that there ever was."""
    own, gate = ready("complete")
    assert beside_found(gate, own.scan, own.scan.pack()) is gate
    own, gate = ready("half")
    same = beside_found(gate, own.scan, own.scan.pack())
    assert same.null.tobytes() == gate.null.tobytes()
    # Parts scatter ten times as far as before along x: the filled-in entries have it in them.
    rng = np.random.default_rng(6)
    loud = prepared_with(
        table_of(crossed(rng, SHAPE, part=7.0, column=0.5), half_measured(12, 10)), *LIBRARY
    )
    left = own.with_null_of(loud.y)
    rest = beside_found(gate, left.scan, left.scan.pack())
    drawn = calibrated(left.scan, 999, 4)
    assert rest.null.tobytes() == drawn.null.tobytes() != gate.null.tobytes()
    assert rest.stream == gate.stream == (4, 0)


def test_how_well_the_machine_is_known_reaches_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    own, _ = ready("holes")
    given: list[tuple[object, ...]] = []
    noise = Frame.noise

    def seen(*words: Any) -> EntryNoise:
        given.append(words[5:])
        return noise(*words)

    monkeypatch.setattr(Frame, "noise", seen)
    looked(replace(own, scan=replace(own.scan, predicted_dof=4.0)))
    assert given == [(4.0,)]
