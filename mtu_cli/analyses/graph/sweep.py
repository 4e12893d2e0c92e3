"""How does the uncertainty of a place follow that of probing, and the number of probings?"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.graph.surface import Formula, fit_formula
from mtu_cli.analyses.graph.trial_runs import run_trials, survey
from mtu_cli.analyses.graph.varied import REPEATS, probed_with, unrelated
from mtu_cli.errors import fault
from mtu_cli.files.graph_contract import LARGEST_U_UM, MAX_REPEATS
from mtu_cli.model.graph.first_order import first_order
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, evaluation
from mtu_cli.model.graph.outputs import Output
from mtu_cli.model.settings import Settings

PARAMETERS = ("axis_um", "probe_um", "perpendicular_um", REPEATS)
LARGEST_GRID = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class GridPoint:
    """One setting and what came of it, in the unit of the output. `formula_u` and
    `error_percent` (formula less Monte Carlo) are nan where no formula could be fitted.
    """

    at: dict[str, float]
    mean: float
    u: float
    se_u: float
    interval: tuple[float, float]
    first_order_u: float
    trials: int
    converged: bool
    formula_u: float
    error_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """The grid of one output, and the formula fitted to it, or why there is none. `without`: what
    is varied, and the output does not depend on.
    """

    output: Output
    varied: dict[str, tuple[float, ...]]
    grid: tuple[GridPoint, ...]
    without: tuple[str, ...]
    formula: Formula | None
    no_formula: str | None = None

    @property
    def converged(self) -> bool:
        """Whether the trials of all grid points did."""
        return all(item.converged for item in self.grid)


def sweep_graph(
    graph: MeasurementGraph,
    settings: Settings,
    of: str,
    varied: Mapping[str, Sequence[float]],
) -> Sweep:
    """Runs the Monte Carlo at every combination of the values in `varied`, and fits a formula.

    `varied`: values of axis_um, probe_um and perpendicular_um of the graph (what a transition
    states otherwise stays), and of repeats, at every measurement. Every combination has random
    numbers of its own: common ones would hide the Monte Carlo's error in the coefficients.

    Raises InputError for a place with several coordinates, or values out of range.
    """
    outputs = graph.outputs([of])
    if len(outputs) != 1:
        names = ", ".join(str(item) for item in outputs)
        raise fault("--of names several coordinates", value=of, expected=f"one of: {names}")
    _check(varied)
    found = []
    for number, values in enumerate(itertools.product(*varied.values())):
        at = dict(zip(varied, map(float, values), strict=True))
        part = graph.with_probing(probed_with(graph.graph, at))
        found.append(_point(part, outputs[0], replace(settings, seed=_seed(settings, number)), at))
    without = unrelated(graph, outputs[0], varied, settings.seed)
    grid, formula = _fitted(found, varied, without, outputs[0])
    return Sweep(
        output=outputs[0],
        varied={name: tuple(map(float, values)) for name, values in varied.items()},
        grid=grid,
        without=without,
        formula=None if isinstance(formula, str) else formula,
        no_formula=formula if isinstance(formula, str) else None,
    )


def _fitted(
    found: Sequence[GridPoint],
    varied: Mapping[str, Sequence[float]],
    without: Sequence[str],
    output: Output,
) -> tuple[tuple[GridPoint, ...], Formula | str]:
    """The grid with the formula's values beside it, and the formula or why there is none."""
    of = [name for name in varied if name not in without]
    if not of:
        return tuple(found), f"{output} does not depend on {', '.join(without)}"
    formula = fit_formula(
        {name: np.array([item.at[name] for item in found]) for name in of},
        np.array([item.u for item in found]),
        np.array([item.se_u for item in found]),
        np.array([item.first_order_u for item in found]),
        output.unit,
    )
    if isinstance(formula, str):
        return tuple(found), formula
    both = zip(found, formula.u, formula.error_percent, strict=True)
    grid = (
        replace(item, formula_u=float(u), error_percent=float(error)) for item, u, error in both
    )
    return tuple(grid), formula


def _check(varied: Mapping[str, Sequence[float]]) -> None:
    for name, values in varied.items():
        largest = MAX_REPEATS if name == REPEATS else LARGEST_U_UM
        least = 1 if name == REPEATS else 0
        for value in values:
            whole = name != REPEATS or float(value).is_integer()
            if not (least <= value <= largest and whole):
                kind = "whole numbers" if name == REPEATS else "numbers"
                expected = f"{kind} from {least} to {largest:g}"
                raise fault(f"--vary {name} out of range", value=f"{value:g}", expected=expected)
    count = math.prod(len(values) for values in varied.values())
    if count > LARGEST_GRID:
        raise fault("the grid is too large", value=str(count), expected=f"at most {LARGEST_GRID}")


def _seed(settings: Settings, number: int) -> int:
    state = np.random.SeedSequence(settings.seed, spawn_key=(1 << 20, number)).generate_state(2)
    return int(state[0]) << 32 | int(state[1])


def _point(
    graph: MeasurementGraph, output: Output, settings: Settings, at: dict[str, float]
) -> GridPoint:
    part = evaluation(graph, [output])
    linear = first_order(part)
    _, bent = survey(graph, part, linear, settings.seed)
    run = run_trials(graph, [output], settings, bent=bool(bent[0]))
    return GridPoint(
        at=at,
        mean=float(run.mean[0]),
        u=float(run.u[0]),
        se_u=float(run.se_u[0]),
        interval=(float(run.low[0]), float(run.high[0])),
        first_order_u=float(linear.u[0]),
        trials=run.trials,
        converged=run.converged,
        formula_u=math.nan,
        error_percent=math.nan,
    )
