"""uncertainties: first order only."""

from __future__ import annotations

from uncertainties import ufloat

from peers_bench.problem import Inputs, angle
from peers_bench.tools import FirstOrder, MonteCarlo


def first_order(inputs: Inputs) -> tuple[float, float]:
    y = angle([ufloat(x, u) for x, u in zip(inputs.mean, inputs.u, strict=True)])
    return float(y.n), float(y.s)


MONTE_CARLO: dict[str, MonteCarlo] = {}
FIRST_ORDER: dict[str, FirstOrder] = {"": first_order}
