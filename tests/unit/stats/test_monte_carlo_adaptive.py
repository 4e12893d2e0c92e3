"""The adaptive count, faults, memory and clause 8."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from trial_models import Bent, Other, Z

from mtu_cli.findings import InputError
from mtu_cli.stats.monte_carlo import monte_carlo
from mtu_cli.stats.validation import clause8

FloatArray = NDArray[np.float64]


def test_adaptive_count_reaches_the_tolerance() -> None:
    result = monte_carlo(Bent(0.05, control=False), seed=1, tolerance_fraction=0.5)
    assert result.converged
    # u = 2.0: delta = 0.05, half of it asked for.
    for name in ("mean", "u", "low", "high"):
        assert 2.0 * getattr(result, f"se_{name}")[0] <= 0.025
    # The plain end needs about (2 * 2.67 * 2 / 0.025)^2 = 1.8e5 trials.
    assert 60_000 < result.trials < 500_000


def test_twenty_blocks_are_judged_by_students_t() -> None:
    """JCGM 101:2008, 7.9.4, takes two standard errors; of 20 blocks t(19) = 2.09 and not 1.96."""
    plain = Bent(control=False)
    first = monte_carlo(plain, seed=1, tolerance_fraction=5.0)
    assert (first.blocks, first.trials) == (20, 40_960)
    largest = max(getattr(first, f"se_{name}")[0] for name in ("mean", "u", "low", "high"))
    published = 2.0 * largest / 0.05
    wanted = published * stats.t.ppf(0.975, 19) / stats.norm.ppf(0.975)
    enough = monte_carlo(plain, seed=1, tolerance_fraction=1.0001 * wanted)
    assert (enough.trials, enough.converged) == (40_960, True)
    assert enough.se_low[0] == first.se_low[0]
    more = monte_carlo(plain, seed=1, tolerance_fraction=0.9999 * wanted)
    assert more.trials > 40_960
    assert published < 0.9999 * wanted


def test_largest_count_ends_an_adaptive_run() -> None:
    result = monte_carlo(Bent(control=False), seed=1, digits=4, max_trials=100_000)
    assert not result.converged
    assert 90_000 < result.trials <= 100_000
    small = monte_carlo(Bent(control=False), seed=1, digits=4, max_trials=5_000)
    assert not small.converged
    assert small.trials == 5_000


def test_an_output_without_scatter_converges() -> None:
    model = Other(lambda rng, m: np.full((1, m), 0.1), ("constant",))
    result = monte_carlo(model, seed=1)
    assert result.converged
    assert [result.low[0], result.high[0]] == pytest.approx([0.1, 0.1])
    assert result.u[0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("trials", [1000, 40_000, None])
def test_values_that_are_not_finite_are_counted(bad: float, trials: int | None) -> None:
    def formula(rng: np.random.Generator, m: int) -> FloatArray:
        values = rng.standard_normal((2, m))
        values[1, :7] = bad
        return values

    with pytest.raises(InputError, match=r"'worse' has no finite value in 7 of") as raised:
        monte_carlo(Other(formula, ("good", "worse")), seed=1, trials=trials)
    assert "good" not in str(raised.value)


def resident_mib() -> float:
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024.0


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc")
def test_memory_does_not_grow_with_the_count() -> None:
    model = Bent(0.01)
    monte_carlo(model, seed=1, trials=300_000)
    before, highest = resident_mib(), [0.0]

    def watch(done: int, total: int | None) -> None:
        if done % 97 == 0 or done == total:
            highest[0] = max(highest[0], resident_mib())

    result = monte_carlo(model, seed=1, trials=10_000_000, progress=watch)
    assert result.trials == 10_000_000
    # One array of all trials would be 76 MiB.
    assert highest[0] - before < 20.0


def test_clause8_passes_fails_and_abstains() -> None:
    sure = monte_carlo(Bent(0.0), seed=1, tolerance_fraction=0.2)
    assert clause8(3.0, 2.0, Z, sure).passed is True
    wrong = clause8(3.2, 2.0, Z, sure)
    assert wrong.passed is False
    assert wrong.d_low == pytest.approx(0.2, abs=1e-6)
    assert wrong.tolerance == pytest.approx(0.05)
    unsure = monte_carlo(Bent(0.0, control=False), seed=1, trials=20_000)
    assert clause8(3.0, 2.0, Z, unsure).passed is None
    # So far off that even these few trials can tell.
    assert clause8(8.0, 2.0, Z, unsure).passed is False


def test_clause8_passes_what_is_far_below_the_tolerance_before_its_fifth_is_reached() -> None:
    short = monte_carlo(Bent(0.0, control=False), seed=1, trials=500_000)
    twice = 2.0 * max(float(short.se_low[0]), float(short.se_high[0]))
    sure = clause8(3.0, 2.0, Z, short)
    assert 0.2 * sure.tolerance < twice < sure.tolerance
    assert max(sure.d_low, sure.d_high) + twice < sure.tolerance
    assert sure.passed is True
    # An adaptive run goes on to the fifth all the same.
    assert not sure.settled
    # A difference within those two standard errors of the tolerance is still open.
    near = sure.tolerance - 0.5 * twice
    assert clause8(3.0 + near, 2.0, Z, short).passed is None
