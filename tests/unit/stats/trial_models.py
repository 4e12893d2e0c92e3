"""Models of known distribution, and slow plain versions of what the engine does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import ndtr, ndtri

from mtu_cli.stats.block_plan import BlockPlan
from mtu_cli.stats.blocks import Draws, block_generator
from mtu_cli.stats.workspace import Workspace

FloatArray = NDArray[np.float64]


Z = float(ndtri(0.975))
COPIES = 8


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


class Smooth(Bent):
    smooth = True


class Grown:
    """y = (exp(a z) - 1)/a with the first-order form z."""

    names = ("y",)
    linear_mean = np.zeros(1)
    smooth = True

    def __init__(self, a: float) -> None:
        self.a = a
        square = np.exp(a * a)
        self.exact = {
            "mean": (np.sqrt(square) - 1) / a,
            "u": np.sqrt((square - 1) * square) / a,
            "low": np.expm1(-a * Z) / a,
            "high": np.expm1(a * Z) / a,
        }

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        z = rng.standard_normal((1, m))
        return Draws(values=np.expm1(self.a * z) / self.a, linear=z, linear_u=np.ones((1, 1)))


class Twice:
    """`Bent` by 0.05 and by 0.1; the latter turns back at z = -2.5, near its lower end."""

    names = ("y", "more")
    linear_mean = np.full(2, 3.0)
    smooth = True

    def __init__(self) -> None:
        once, more = Bent(0.05).exact, Bent(0.1).exact
        z = optimize.brentq(lambda z: ndtr(z) - ndtr(-5.0 - z) - 0.025, -2.5, 0.0)
        more["low"] = 3.0 + 2.0 * z + 0.4 * z * z
        self.exact = {
            name: np.array([once[name], more[name]]) for name in ("mean", "u", "low", "high")
        }

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        e = 2.0 * rng.standard_normal((1, m))
        linear = np.repeat(3.0 + e, 2, axis=0)
        return Draws(
            values=linear + np.array([[0.05], [0.1]]) * e * e,
            linear=linear,
            linear_u=np.full((2, 1), 2.0),
        )


class Copies:
    """`COPIES` of a model with trials of their own, the outputs of one run: that costs little more
    than of one, and each is judged by itself.
    """

    smooth = True

    def __init__(self, model: Smooth | Grown | Twice) -> None:
        self.model = model
        self.names = tuple(f"{name} {i}" for name in model.names for i in range(COPIES))
        assert model.linear_mean is not None
        self.linear_mean = np.repeat(model.linear_mean, COPIES)
        self.exact = {name: np.repeat(exact, COPIES) for name, exact in model.exact.items()}

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        all_of_them = self.model.draw(rng, COPIES * m)
        assert all_of_them.linear is not None
        assert all_of_them.linear_u is not None
        return Draws(
            values=all_of_them.values.reshape(-1, m),
            linear=all_of_them.linear.reshape(-1, m),
            linear_u=np.repeat(all_of_them.linear_u, COPIES, axis=0),
        )


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
