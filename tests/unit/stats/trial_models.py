"""Models of known distribution, and slow plain versions of what the engine does."""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtri

from mtu_cli.stats.blocks import BlockPlan, Draws, Workspace, batch_generator
from mtu_cli.stats.distributions import Distribution, sum_quantile
from mtu_cli.stats.least_squares import FloatArray

Z = float(ndtri(0.975))


class Bent:
    """y = 3 + 2 z + bend (2 z)^2, whose first-order form is 3 + 2 z; all known exactly."""

    names = ("y",)

    def __init__(self, bend: float = 0.0, control: bool = True) -> None:
        self.bend, self.control = bend, control
        self.linear_mean = np.array([3.0]) if control else None
        self.linear_variance = np.array([4.0])
        self.work = Workspace()
        self.exact = {
            "mean": 3.0 + 4.0 * bend,
            "u": np.sqrt(4.0 + 2.0 * (4.0 * bend) ** 2),
            "low": 3.0 - 2.0 * Z + bend * 4.0 * Z**2,
            "high": 3.0 + 2.0 * Z + bend * 4.0 * Z**2,
        }

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        z = self.work.array("z", (1, m))
        rng.standard_normal(out=z)
        z *= 2.0
        values = self.work.array("values", (1, m))
        np.multiply(z, z, out=values)
        values *= self.bend
        values += z
        values += 3.0
        z += 3.0
        if not self.control:
            return Draws(values=values)
        return Draws(values=values, linear=z)

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        return np.asarray(2.0 * ndtri(probability)[np.newaxis])


class Smooth(Bent):
    smooth = True


class Other:
    """Any formula, without a first-order form."""

    linear_mean = None

    def __init__(
        self, formula: Callable[[np.random.Generator, int], FloatArray], names: tuple[str, ...]
    ) -> None:
        self.formula, self.names = formula, names

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        return Draws(values=self.formula(rng, m))


class ScaledT:
    """A t with `dof`, its own first-order form."""

    names = ("t",)
    linear_mean = np.zeros(1)

    def __init__(self, dof: float) -> None:
        self.dof = dof
        self.u_exists = np.array([dof > 2.0])
        t = Distribution(kind="t", u=1.0, dof=dof)
        self.linear_variance = np.array([t.drawn_variance])
        self.quantile = sum_quantile([(1.0, t)])

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        values = rng.standard_t(self.dof, (1, m))
        return Draws(values=values, linear=values)

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        assert self.quantile is not None
        return self.quantile(probability)[np.newaxis]


def plain_blocks(
    model: Bent, seed: int, trials: int, probability: float = 0.95
) -> tuple[list[FloatArray], list[FloatArray]]:
    plan = BlockPlan.of(model, trials, trials, probability)
    values, linear = [], []
    for batch in plan.batches(0, plan.blocks or 0):
        m = len(batch) * plan.trials_in(batch.start)
        draws = model.draw(batch_generator(seed, batch), m)
        values += np.split(draws.values[0].copy(), len(batch))
        if draws.linear is not None:
            linear += np.split(draws.linear[0].copy(), len(batch))
    return values, linear


def slow_end(sample: FloatArray, a: float) -> float:
    """Quantile at rank a (m + 1), less the second-order bias of an ordered value."""
    if a > 0.5:
        return -slow_end(-sample, 1.0 - a)
    m, ordered = len(sample), np.sort(sample)
    probabilities = np.arange(1, m + 1) / (m + 1)
    h = a / 4
    y = np.interp([a - 2 * h, a - h, a, a + h, a + 2 * h], probabilities, ordered)
    bend = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) @ y / (12 * h**2)
    return float(y[2] - a * (1 - a) / (2 * (m + 2)) * bend)
