"""How does the uncertainty of a place follow that of probing, and the number of probings?"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.graph.surface import Formula, fit_formula
from mtu_cli.analyses.graph.trials import SWEPT, TrialRuns, not_converged
from mtu_cli.files.graph_contract import LARGEST_U_UM, MAX_REPEATS, Graph
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.graph.places import Output, read
from mtu_cli.model.graph.transitions import chance_places, may_jump
from mtu_cli.model.graph.trials import GraphTrials, MeasurementGraph, evaluation, first_order
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.streams import stream
from mtu_cli.stats.workspace import Workspace

REPEATS = "repeats"
TRIED = 256
"""Trials that tell whether an output follows what is varied."""
SAME = 1e-9
"""Share of u below which the same trials under another uncertainty have the same values."""
PARAMETERS = ("axis_um", "probe_um", "perpendicular_um", REPEATS)
LARGEST_GRID = 10_000
UNLIKELY = 0.01
"""Below this probability the formula's errors are not the Monte Carlo's alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridPoint:
    """One setting and what came of it, in the unit of the output. `deviation`: mean less nominal.
    `converged`: mean and u, which `se_mean` and `se_u` are the standard errors of. `formula_u` and
    `error_percent` (formula less Monte Carlo) are nan where no formula could be fitted.
    """

    at: dict[str, float]
    mean: float
    deviation: float
    se_mean: float
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
    """The grid of one output, and the formula fitted to it, or why there is none. `nominal`: the
    output's. `chance`: it is 0 or 1, and its means are chances. `without`: what is varied, and the
    output does not depend on. `digits`: those of u that were asked for.
    """

    output: Output
    nominal: float
    chance: bool
    digits: int
    varied: dict[str, tuple[float, ...]]
    grid: tuple[GridPoint, ...]
    without: tuple[str, ...]
    formula: Formula | None
    no_formula: str | None = None

    @property
    def converged(self) -> bool:
        """Whether the trials of all grid points did."""
        return all(item.converged for item in self.grid)

    @property
    def largest_error(self) -> float:
        """Of the grid points that have not converged: the largest standard error of a chance, or of
        u as a share of u; nan where there is none, or u is 0 at all of them.
        """
        short = [item for item in self.grid if not item.converged]
        if self.chance:
            return max((item.se_mean for item in short), default=math.nan)
        return max((item.se_u / item.u for item in short if item.u > 0.0), default=math.nan)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """What is varied for nothing; grid points that have not converged; no formula, one that
        the Monte Carlo contradicts, one whose error is not estimable.
        """
        found, noted = self.formula, []
        if self.without and (found is not None or self.chance):
            noted.append(finding("unrelated", output=str(self.output), names=self.without))
        short = [item for item in self.grid if not item.converged]
        if short:
            where = f"at {len(short)} of {len(self.grid)} points of the grid"
            most = max(item.trials for item in short)
            noted.append(not_converged(most, self.digits, f"{self._known_to()}; {where}"))
        if found is None and not self.chance:
            noted.append(finding("no-formula", reason=self.no_formula))
        if found is not None and found.p < UNLIKELY and found.max_error_percent > 1.0:
            reason = f"the one reported is up to {found.max_error_percent:.2g} % off, more than "
            reason += f"the scatter of the Monte Carlo explains (p {found.p:.2g})"
            noted.append(finding("no-formula", reason=reason))
        if found is not None and math.isnan(found.own_max_percent):
            reason = "the first-order uncertainty is 0, or a small part of u"
            what = {"quantity": "the error of the formula", "names": [str(self.output)]}
            noted.append(finding("not-estimable", **what, reason=reason))
        return tuple(noted)

    def _known_to(self) -> str:
        if self.chance:
            return f"the standard error of a chance is up to {self.largest_error:.2g}"
        if math.isnan(self.largest_error):
            return "no trial made it jump, and none rules out that it may"
        return f"the standard error of u is up to {100 * self.largest_error:.2g} %"


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
    output = _one_output(graph, of)
    _check(varied)
    points = [
        dict(zip(varied, map(float, values), strict=True))
        for values in itertools.product(*varied.values())
    ]
    found = []
    for number, at in enumerate(points):
        part = graph.with_probing(probed_with(graph.graph, at))
        found.append(_point(part, output, _settings_at(settings, number, len(points)), at))
    without = unrelated(graph, output, varied, settings.seed)
    chance = output.place in chance_places(item.step for item in graph.computed)
    grid, formula = _fitted(found, varied, without, output, chance)
    return Sweep(
        output=output,
        nominal=float(read(graph.nominal, [output], graph.nominal)[0, 0]),
        chance=chance,
        digits=settings.digits,
        varied={name: tuple(map(float, values)) for name, values in varied.items()},
        grid=grid,
        without=without,
        formula=None if isinstance(formula, str) else formula,
        no_formula=formula if isinstance(formula, str) else None,
    )


def _one_output(graph: MeasurementGraph, of: str) -> Output:
    outputs = graph.outputs([of])
    if len(outputs) != 1:
        names, reason = ", ".join(map(str, outputs)), "the place has several coordinates"
        raise error("not-applicable", reason=reason, value=of, expected=f"one of: {names}")
    return outputs[0]


def _settings_at(settings: Settings, number: int, count: int) -> Settings:
    """Those of one of the points: it tells how many of all are done."""
    tell = settings.progress
    return replace(
        settings,
        seed=_seed(settings, number),
        progress=None if tell is None else lambda done, total: tell(number, count),
    )


def _fitted(
    found: Sequence[GridPoint],
    varied: Mapping[str, Sequence[float]],
    without: Sequence[str],
    output: Output,
    chance: bool,
) -> tuple[tuple[GridPoint, ...], Formula | str]:
    """The grid with the formula's values beside it, and the formula or why there is none."""
    of = [name for name in varied if name not in without]
    if not of:
        return tuple(found), f"{output} does not depend on {', '.join(without)}"
    if chance:
        return tuple(found), f"{output} is 0 or 1: its mean is a chance, its u no uncertainty"
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
                path = f"--vary {name}"
                raise error("out-of-range", path=path, value=f"{value:g}", expected=expected)
    count = math.prod(len(values) for values in varied.values())
    if count > LARGEST_GRID:
        expected = f"at most {LARGEST_GRID} combinations"
        raise error("out-of-range", path="--vary", value=str(count), expected=expected)


def _seed(settings: Settings, number: int) -> int:
    state = np.random.SeedSequence(settings.seed, spawn_key=(1 << 20, number)).generate_state(2)
    return int(state[0]) << 32 | int(state[1])


def _point(
    graph: MeasurementGraph, output: Output, settings: Settings, at: dict[str, float]
) -> GridPoint:
    part = evaluation(graph, [output])
    linear = first_order(part)
    (trials,) = TrialRuns(graph, part, linear, settings, SWEPT).run()
    return GridPoint(
        at=at,
        mean=trials.mean,
        deviation=trials.mean - float(linear.nominal[0]),
        se_mean=trials.errors.mean,
        u=trials.u,
        se_u=trials.errors.u,
        interval=trials.interval,
        first_order_u=float(linear.u[0]),
        trials=trials.count,
        converged=trials.converged,
        formula_u=math.nan,
        error_percent=math.nan,
    )


def probed_with(graph: Graph, at: Mapping[str, float]) -> Graph:
    """The graph with other uncertainties of probing, um, and another number of probings."""
    probing = {name: value for name, value in at.items() if name != REPEATS}
    changes: dict[str, object] = {"uncertainty": graph.uncertainty.model_copy(update=probing)}
    if REPEATS in at:
        changes["repeats"] = int(at[REPEATS])
        changes["transitions"] = [
            item.model_copy(update={"repeats": None}) for item in graph.transitions
        ]
    return graph.model_copy(update=changes)


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
    found = []
    for name, value in largest.items():
        other = 4.0 if name == REPEATS else value / 2
        if value > 0 and _alike(before, _trials(graph, output, {**largest, name: other}, seed)):
            found.append(name)
    return tuple(found)


def _alike(before: FloatArray, after: FloatArray) -> bool:
    scatter = before.std(axis=1, keepdims=True)
    return bool(np.all(np.abs(after - before) <= SAME * scatter))


def _trials(
    graph: MeasurementGraph, output: Output, at: Mapping[str, float], seed: int
) -> FloatArray:
    """Values (1, m) of the output or, of one behind a step, (k, m) of the random inputs."""
    part = evaluation(graph.with_probing(probed_with(graph.graph, at)), [output])
    if may_jump(item.step for item in part.steps):
        work = Workspace()
        return part.inputs.scaled(part.inputs.draw(stream(seed, 2), TRIED, work))
    return GraphTrials(part, first_order(part)).draw(stream(seed, 2), TRIED).values
