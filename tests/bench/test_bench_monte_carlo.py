"""Time of the Monte Carlo against one thread of numpy drawing the same normals."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]  # no stubs published

from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.monte_carlo import monte_carlo
from mtu_cli.stats.threads import available_threads
from mtu_cli.stats.workspace import Workspace

FloatArray = NDArray[np.float64]
HOLES = 13
CHUNK = 8192


class RowColumnAngle:
    """Angle between a row and a column of seven holes, the corner hole in both (mm, rad).

    y = b0 + b1 x over the row, x = b0 + b1 y over the column, dth = -b1(column) - b1(row)
    (Gilsinn & Ling 2004, eq. (23)-(28)). Hole errors are jointly normal with `covariance`
    (26, 26), x of all holes first.
    """

    names = ("angle",)

    def __init__(self, covariance: FloatArray) -> None:
        along = np.linspace(0.0, 180.0, 7)
        x = np.concatenate([along, np.full(6, 180.0)])
        y = np.concatenate([np.zeros(7), along[1:]])
        row, column = np.arange(7), np.arange(6, 13)
        self.row_x = (x[row] - x[row].mean())[:, np.newaxis]
        self.column_y = (y[column] - y[column].mean())[:, np.newaxis]
        factor = np.linalg.cholesky(covariance)
        centred = np.eye(7) - 1.0 / 7.0
        slope_row = self.row_x[:, 0] / (self.row_x**2).sum()
        slope_column = self.column_y[:, 0] / (self.column_y**2).sum()
        first_order = -slope_row @ factor[HOLES + row] - slope_column @ factor[column]
        # Centring and the first-order form are rows of the factor: one product does them all.
        self.factor = np.vstack(
            [
                centred @ factor[row],
                centred @ factor[HOLES + row],
                centred @ factor[column],
                centred @ factor[HOLES + column],
                first_order[np.newaxis],
            ]
        )
        self.linear_mean = np.zeros(1)
        self.linear_u = np.linalg.norm(first_order)
        self.linear_variance = np.full(1, self.linear_u**2)
        self.work = Workspace()

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        return np.asarray(self.linear_u * ndtri(probability)[np.newaxis])

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        z = self.work.array("z", (self.factor.shape[1], m))
        rng.standard_normal(out=z)
        e = np.matmul(self.factor, z, out=self.work.array("e", (29, m)))
        sums = self.work.array("sums", (4, m))
        e[0:7] += self.row_x
        e[21:28] += self.column_y
        np.einsum("ij,ij->j", e[0:7], e[7:14], out=sums[0])
        np.einsum("ij,ij->j", e[0:7], e[0:7], out=sums[1])
        np.einsum("ij,ij->j", e[21:28], e[14:21], out=sums[2])
        np.einsum("ij,ij->j", e[21:28], e[21:28], out=sums[3])
        np.divide(sums[0::2], sums[1::2], out=sums[0::2])
        angle = np.add(sums[0:1], sums[2:3], out=sums[1:2])
        np.negative(angle, out=angle)
        return Draws(values=angle, linear=e[28:29])


def hole_covariance() -> FloatArray:
    """Repeatability of 5 um and a machine state shared by all holes, in mm^2."""
    shared = np.random.default_rng(3).normal(size=(2 * HOLES, 6)) * 2e-3
    return np.asarray(25e-6 * np.eye(2 * HOLES) + shared @ shared.T)


def seconds_drawing(trials: int) -> float:
    z = np.empty((2 * HOLES, CHUNK))
    rng = np.random.Generator(np.random.SFC64(1))
    start = time.perf_counter()
    for _ in range(trials // CHUNK):
        rng.standard_normal(out=z)
    return time.perf_counter() - start


@pytest.mark.parametrize("trials", [1_000_000, 4_000_000])
def test_no_slower_than_drawing_the_normals(benchmark: Any, trials: int) -> None:
    model = RowColumnAngle(hole_covariance())
    monte_carlo(model, seed=1, trials=100_000)
    with threadpool_limits(1):
        reference = min(seconds_drawing(trials) for _ in range(3))
    benchmark.pedantic(lambda: monte_carlo(model, seed=1, trials=trials), rounds=3, warmup_rounds=1)
    ratio = benchmark.stats.stats.min / reference
    benchmark.extra_info["ratio_to_drawing"] = ratio
    if available_threads() >= 2:
        assert ratio <= 1.0


def test_adaptive_count_to_a_fifth_of_the_tolerance(benchmark: Any) -> None:
    model = RowColumnAngle(hole_covariance())
    result = benchmark(lambda: monte_carlo(model, seed=1, tolerance_fraction=0.2))
    assert result.converged
    assert result.trials <= 200_000
