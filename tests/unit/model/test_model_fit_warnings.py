"""Warnings of a fit: rare on clean machines, there where something is planted."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from machine_trials import COMPONENTS, Drift, machine, read_machine
from model_examples import Segment, loaded, readings
from scipy import stats

from mtu_cli.files.readings import Readings
from mtu_cli.model.fit import (
    MachineFit,
    fit_machine,
)
from mtu_cli.model.fit_warnings import (
    fit_warnings,
    limit_warnings,
    limits_of,
)

MACHINES = 160
KINDS = ("reversal", "passes-drift", "lack-of-fit")


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> list[MachineFit]:
    known = machine(tmp_path_factory.mktemp("clean"))
    rng = np.random.default_rng(1)
    return [fit_machine(known, read_machine(rng, Drift(i % 2))) for i in range(MACHINES)]


def test_clean_machines_are_warned_of_as_rarely_as_stated(clean: list[MachineFit]) -> None:
    """A family-wise rate of 5 % a kind: no more, and not so much less as to be blind."""
    found = Counter(code for fit in clean for code in {item.code for item in fit_warnings(fit)})
    high = stats.binom(MACHINES, 0.05).ppf(1 - 1e-4)
    low = stats.binom(MACHINES, 0.05).ppf(1e-4)
    for kind in KINDS:
        assert low <= found[kind] <= high, kind
    assert set(found) <= set(KINDS)


@pytest.mark.parametrize("name", ["dx_x", "ez_y"])
def test_p_values_of_clean_machines_are_uniform(clean: list[MachineFit], name: str) -> None:
    fits = [fit.components[name].instruments[0] for fit in clean]
    for test in ("reversal", "trend", "lack_of_fit"):
        p = [getattr(item, test).p for item in fits]
        assert stats.kstest(p, "uniform").pvalue > 1e-3, test
    # Pass scatter is no fault; without drift it is not seen either.
    without = [item.scatter.p for item in fits[0::2] if item.scatter]
    assert stats.kstest(without, "uniform").pvalue > 1e-3
    with_drift = [item.scatter.p for item in fits[1::2] if item.scatter]
    assert np.median(with_drift) < 1e-3


def planted(given: Readings, name: str, what: str) -> Readings:
    """A reversal of 6 um, a drift of 4 um a pass there and back, or a bend of 6 um."""
    rows = given.code == given.components.index(name)
    size = 1e-3 if name.startswith("d") else 1e-5
    p = given.position_mm - 80
    shape = {
        "reversal": 3 * given.direction,
        "passes-drift": 2.0 * (2 * given.pass_number + (given.direction < 0)),
        "lack-of-fit": 6 * (p / 70) ** 2,
    }[what]
    return replace(given, error=given.error + np.where(rows, size * shape, 0.0))


@pytest.mark.parametrize("what", KINDS)
@pytest.mark.parametrize("name", ["dx_x", "ez_y"])
def test_what_is_planted_is_warned_of(tmp_path: Path, what: str, name: str) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(5), Drift(0.5))
    before = [item for item in fit_warnings(fit_machine(known, given)) if item.code == what]
    found = [
        item
        for item in fit_warnings(fit_machine(known, planted(given, name, what)))
        if item.code == what
    ]
    assert before == []
    assert len(found) == 1
    assert found[0].message.startswith(name)
    amount = {"reversal": "reverses by", "passes-drift": "drifts by", "lack-of-fit": "degree"}
    assert amount[what] in found[0].message


def test_scatter_that_cannot_be_split_is_warned_of(tmp_path: Path) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(7), Drift(1.0))
    rows = given.code == 0
    found = fit_warnings(fit_machine(known, replace(given, has_pass=given.has_pass & ~rows)))
    (item,) = [item for item in found if item.code == "not-separable"]
    assert "dx_x" in item.message
    assert not any(name in item.message for name in COMPONENTS if name != "dx_x")


def test_readings_without_any_scatter_are_warned_of(tmp_path: Path) -> None:
    known = machine(tmp_path)
    given = read_machine(np.random.default_rng(7), Drift(1.0))
    exact = np.where(given.code == 0, 1e-3 + 1e-5 * given.position_mm, given.error)
    found = fit_warnings(fit_machine(known, replace(given, error=exact)))
    (item,) = [item for item in found if item.code == "no-scatter-known"]
    assert "readings is unknown (dx_x): they do not scatter" in item.message


def test_instruments_that_disagree(tmp_path: Path) -> None:
    known = loaded(tmp_path, "components: {a: {of: x, unit: um}}\nequations: {Ex: a}\n")
    rng = np.random.default_rng(8)
    p = np.linspace(0, 140, 8)

    def read(role: str, shift: float) -> Segment:
        error = 1e-3 * rng.standard_normal((6, 1)) + 1e-3 * rng.standard_normal((6, 8)) + shift
        passes = np.repeat(np.arange(6), 8)
        return Segment(
            name="a", position=np.tile(p, 6), error=error.ravel(), passes=passes, role=role
        )

    def warned(shift: float) -> int:
        pairs = [readings([read("lbb", 0.0), read("laser", shift)]) for _ in range(60)]
        found = [fit_warnings(fit_machine(known, pair)) for pair in pairs]
        return sum("instruments-disagree" in {item.code for item in one} for one in found)

    assert warned(0.0) <= stats.binom(60, 0.05).ppf(1 - 1e-4)
    assert warned(9e-3) == 60


@pytest.mark.parametrize("what", KINDS)
def test_what_u_of_a_part_holds_nothing_of_is_told_with_it(tmp_path: Path, what: str) -> None:
    """A reversal and a drift of the passes are; a misfit is among the repeatability of u."""
    given = planted(read_machine(np.random.default_rng(5), Drift(0.5)), "ez_y", what)
    fit = fit_machine(machine(tmp_path), given)
    found = [item for item in fit_warnings(fit) if item.code == what]
    assert len(found) == 1
    limits = limits_of([*limit_warnings(fit), *limit_warnings(fit)], COMPONENTS)
    assert limits == ([] if what == "lack-of-fit" else found)
    assert limits_of(fit_warnings(fit), COMPONENTS) == limits
    assert limits_of(fit_warnings(fit), set(COMPONENTS) - {"ez_y"}) == []
