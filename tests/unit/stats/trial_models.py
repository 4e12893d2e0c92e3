"""Models of known distribution, and slow plain versions of what the engine does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from mtu_cli.stats.block_plan import BlockPlan
from mtu_cli.stats.blocks import Draws, block_generator
from mtu_cli.stats.workspace import Workspace

FloatArray = NDArray[np.float64]


Z = float(ndtri(0.975))


class Bent:
    """y = 3 + 2 z + bend (2 z)^2, whose first-order form is 3 + 2 z; all known exactly."""

    names = ("y",)

    def __init__(self, bend: float = 0.0, control: bool = True) -> None:
        self.bend, self.control = bend, control
        self.linear_mean = np.array([3.0]) if control else None
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
        return Draws(values=values, linear=z, linear_u=np.array([[2.0]]))


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
    """A sum of a t with `dof` and a unit normal; its own first-order form, scales per trial."""

    names = ("t",)
    linear_mean = np.zeros(1)

    def __init__(self, dof: float, normal: float = 0.0, variance: float | None = None) -> None:
        self.dof, self.normal = dof, normal
        self.u_exists = np.array([dof > 2.0])
        self.linear_variance = None if variance is None else np.array([variance])

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        scale = np.sqrt(self.dof / rng.chisquare(self.dof, (1, m)))
        values = scale * rng.standard_normal((1, m)) + self.normal * rng.standard_normal((1, m))
        u = np.sqrt(scale**2 + self.normal**2)
        return Draws(values=values, linear=values, linear_u=u)


def plain_blocks(
    model: Bent, seed: int, trials: int, probability: float = 0.95
) -> tuple[list[FloatArray], list[FloatArray]]:
    plan = BlockPlan.fixed(trials, probability)
    values, linear = [], []
    for block in range(plan.blocks or 0):
        draws = model.draw(block_generator(seed, block), plan.trials_in(block))
        values.append(draws.values[0].copy())
        if draws.linear is not None:
            linear.append(draws.linear[0].copy())
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
