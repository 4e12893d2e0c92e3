"""The parts' scatter in y against x: unequal repeats, missing parts, an axis that is quiet."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
from scipy.stats import binom

from mtu_cli.analyses.anova.axis_scatter import AxisScatter, axis_scatter
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.anova import cells_of, one_way

REPEATS = (5, 5, 5, 5, *[2] * 15, 1, 1)
FEATURES = 4


def compared(
    seed: int, parts: int, s_part: tuple[float, float], s_repeat: tuple[float, float]
) -> AxisScatter:
    """Parts displaced as a whole, of unequal repeats; every seventh cell was not measured."""
    rng = np.random.default_rng([seed, parts])
    part = np.repeat(np.arange(parts), REPEATS[:parts])
    table = np.arange(2 * FEATURES)[:, None]
    cell = table * parts + part
    shift = np.array(s_part)[:, None] * rng.standard_normal((2, parts))
    noise = np.repeat(s_repeat, FEATURES)[:, None] * rng.standard_normal(cell.shape)
    values = np.repeat(shift, FEATURES, axis=0)[:, part] + noise
    there = (part + 3 * (table % FEATURES)) % 7 != 0
    cells = cells_of(values[there], cell[there], 2 * FEATURES, parts)
    labels = tuple(("", str(i % FEATURES), "xy"[i // FEATURES]) for i in range(2 * FEATURES))
    names = tuple(f"P{i}" for i in range(parts))
    (found,) = axis_scatter(MeasuredTables(labels=labels, parts=names, cells=cells), one_way(cells))
    return found


@pytest.mark.parametrize("s_repeat", [(1.0, 1.0), (0.5, 1.5)])
def test_unequal_repeats_keep_the_rate(
    s_repeat: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The package has a function of the module's name.
    module = import_module("mtu_cli.analyses.anova.axis_scatter")
    monkeypatch.setattr(module, "ratio_interval", lambda *_: (np.nan, np.nan))
    runs = 250
    alarms = sum(
        compared(seed, len(REPEATS), (1.0, 1.0), s_repeat).test.p <= 0.05 for seed in range(runs)
    )
    assert binom.ppf(1e-3, runs, 0.05) <= alarms <= binom.ppf(1 - 1e-3, runs, 0.05)


def test_an_axis_whose_parts_are_alike() -> None:
    """Three and a half um in x and none in y are told apart, whatever y's estimate is."""
    found = [compared(seed, len(REPEATS), (3.5, 0.0), (1.0, 1.4)) for seed in range(60)]
    assert all(item.apart and item.test.p <= 0.01 for item in found)
    assert all(item.interval[0] == 0 or item.interval[1] < 0.2 for item in found)
    assert 0 < sum(item.test.ratio == 0 for item in found) < 60


def test_too_few_parts_are_told() -> None:
    few = compared(0, 3, (1.0, 1.0), (1.0, 1.0))
    assert few.test.rows == 3
    assert np.isnan([few.test.p, few.test.p_familywise, *few.interval]).all()
    enough = compared(0, 5, (1.0, 1.0), (1.0, 1.0))
    assert (enough.test.rows, np.isfinite(enough.test.p)) == (5, True)
