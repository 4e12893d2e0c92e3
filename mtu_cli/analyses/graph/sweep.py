"""How does the uncertainty of a place follow that of probing, and the number of probings?"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.graph.check import one_unit
from mtu_cli.analyses.graph.simulate import (
    SimulatedCoordinate,
    known_to,
    not_converged,
    simulate_outputs,
)
from mtu_cli.analyses.graph.surface import Formula, fit_formula
from mtu_cli.files.graph_contract import LARGEST_U_UM, MAX_REPEATS
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.graph.net import MeasurementGraph
from mtu_cli.model.graph.places import Output
from mtu_cli.model.graph.trials import GraphTrials, evaluation, first_order
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream
from mtu_cli.stats.workspace import Workspace

MOST = 2**18
"""Trials of a point of the grid where the count adapts, at most."""
REPEATS = "repeats"
TRIED = 256
"""Trials that tell whether an output follows what is varied."""
SAME = 1e-9
"""Share of u below which the same trials under another uncertainty have the same values."""
PARAMETERS = ("axis_um", "probe_um", "perpendicular_um", REPEATS)
LARGEST_GRID = 10_000
UNLIKELY = 0.01
"""Below this probability the formula's errors are not the Monte Carlo's alone."""


@dataclass(frozen=True, kw_only=True)
class GridPoint(SimulatedCoordinate):
    """What came of one setting `at`. `converged`: mean and u. `formula_u` and `error_percent`
    (formula less Monte Carlo) are nan where no formula could be fitted.
    """

    at: dict[str, float]
    formula_u: float = math.nan
    error_percent: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """The grid of one output, and the formula fitted to it, or why there is none. `without`: what
    is varied, and the output does not depend on. `digits`: those of u that were asked for.
    """

    output: Output
    digits: int
    varied: dict[str, tuple[float, ...]]
    grid: tuple[GridPoint, ...]
    without: tuple[str, ...]
    formula: Formula | None
    no_formula: str | None = None

    @property
    def nominal(self) -> float:
        """Of the output, the same at all points."""
        return self.grid[0].nominal

    @property
    def chance(self) -> bool:
        """Whether it is 0 or 1, and its means are chances."""
        return all(item.chance for item in self.grid)

    @property
    def converged(self) -> bool:
        """Whether the trials of all grid points did."""
        return all(item.converged for item in self.grid)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """What is varied for nothing; grid points that have not converged; no formula, one that
        the Monte Carlo contradicts.
        """
        found, noted, of = self.formula, [], str(self.output)
        if self.without and (found is not None or self.chance):
            noted.append(finding("unrelated", output=of, names=self.without))
        short = [item for item in self.grid if not item.converged]
        if short:
            known = known_to(max(item.relative_se for item in short))
            where = f"{known}; at {len(short)} of {len(self.grid)} points of the grid"
            noted.append(not_converged(max(x.trials for x in short), self.digits, where))
        if found is None and not self.chance:
            noted.append(finding("no-formula", reason=self.no_formula))
        if found is not None and found.p < UNLIKELY and found.max_error_percent > 1.0:
            reason = f"the one reported is up to {found.max_error_percent:.2g} % off, more than "
            reason += f"the scatter of the Monte Carlo explains (p {found.p:.2g})"
            noted.append(finding("no-formula", reason=reason))
        return tuple(noted)


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
    (output,) = one_unit(graph, of, single=True)
    _check(varied)
    points = [
        dict(zip(varied, map(float, values), strict=True))
        for values in itertools.product(*varied.values())
    ]
    grid = []
    for number, at in enumerate(points):
        now = _at(settings, number, len(points))
        part = probed_with(graph, at)
        (found,) = simulate_outputs(part, [output], now, most=MOST, ends=False)
        grid.append(GridPoint(at=at, **vars(found)))
    without = unrelated(graph, output, varied, settings.seed)
    formula = _formula(grid, [name for name in varied if name not in without], output)
    if isinstance(formula, Formula):
        both = zip(grid, formula.u, formula.error_percent, strict=True)
        grid = [replace(x, formula_u=float(u), error_percent=float(e)) for x, u, e in both]
    return Sweep(
        output=output,
        digits=settings.digits,
        varied={name: tuple(map(float, values)) for name, values in varied.items()},
        grid=tuple(grid),
        without=without,
        formula=formula if isinstance(formula, Formula) else None,
        no_formula=None if isinstance(formula, Formula) else formula,
    )


def _at(settings: Settings, number: int, count: int) -> Settings:
    """Those of one of the points: it tells how many of all are done."""
    tell = settings.progress
    state = np.random.SeedSequence(settings.seed, spawn_key=(1 << 20, number)).generate_state(2)
    return replace(
        settings,
        seed=int(state[0]) << 32 | int(state[1]),
        progress=None if tell is None else lambda done, total: tell(number, count),
    )


def _formula(grid: Sequence[GridPoint], of: Sequence[str], output: Output) -> Formula | str:
    """The formula in what has an effect, or why there is none."""
    if not of:
        return f"{output} does not depend on {', '.join(grid[0].at)}"
    if all(item.chance for item in grid):
        return f"{output} is 0 or 1: its mean is a chance, its u no uncertainty"
    return fit_formula(
        {name: np.array([item.at[name] for item in grid]) for name in of},
        np.array([item.u for item in grid]),
        np.array([item.se_u for item in grid]),
        np.array([item.first_order_u for item in grid]),
        output.unit,
    )


def _check(varied: Mapping[str, Sequence[float]]) -> None:
    for name, values in varied.items():
        largest = MAX_REPEATS if name == REPEATS else LARGEST_U_UM
        least = 1 if name == REPEATS else 0
        for value in values:
            whole = name != REPEATS or float(value).is_integer()
            if not (least <= value <= largest and whole):
                kind = "whole numbers" if name == REPEATS else "numbers"
                expected = f"{kind} from {least} to {largest:g}"
                path = f"--vary {name}"
                raise error("out-of-range", path=path, value=f"{value:g}", expected=expected)
    count = math.prod(len(values) for values in varied.values())
    if count > LARGEST_GRID:
        expected = f"at most {LARGEST_GRID} combinations"
        raise error("out-of-range", path="--vary", value=str(count), expected=expected)


def probed_with(graph: MeasurementGraph, at: Mapping[str, float]) -> MeasurementGraph:
    """The same net under other uncertainties of probing, um, and another number of probings."""
    file = graph.graph
    probing = {name: value for name, value in at.items() if name != REPEATS}
    changes: dict[str, object] = {"uncertainty": file.uncertainty.model_copy(update=probing)}
    if REPEATS in at:
        changes["repeats"] = int(at[REPEATS])
        changes["transitions"] = [x.model_copy(update={"repeats": None}) for x in file.transitions]
    return replace(graph, graph=file.model_copy(update=changes))


def unrelated(
    graph: MeasurementGraph, output: Output, varied: Mapping[str, Sequence[float]], seed: int
) -> tuple[str, ...]:
    """Which of `varied` have no effect on an output.

    The same random numbers are propagated with the largest of all varied values and with half of
    one: where nothing behind the output takes it (every measurement states its own), or
    where the output does not follow those that do, its trials stay where they are. What a step
    makes may stay so by chance: there the scatter of what is behind it tells.
    """
    largest = {name: float(max(values)) for name, values in varied.items()}
    if REPEATS in largest:
        largest[REPEATS] = 1.0
    before = _trials(graph, output, largest, seed)
    scatter = SAME * before.std(axis=1, keepdims=True)
    found = []
    for name, value in largest.items():
        other = 4.0 if name == REPEATS else value / 2
        after = _trials(graph, output, {**largest, name: other}, seed)
        if value > 0 and np.all(np.abs(after - before) <= scatter):
            found.append(name)
    return tuple(found)


def _trials(
    graph: MeasurementGraph, output: Output, at: Mapping[str, float], seed: int
) -> FloatArray:
    """Values (1, m) of the output or, of one behind a step, (k, m) of the random inputs."""
    part = evaluation(probed_with(graph, at), [output])
    if any(item.step.may_jump for item in part.steps):
        return part.inputs.scaled(part.inputs.draw(stream(seed, 2), TRIED, Workspace()))
    return GraphTrials(part, first_order(part)).draw(stream(seed, 2), TRIED).values
