"""The trials of simulate and sweep: what those of an output say, and how far each one goes.

Has an output its digits? Each for itself (JCGM 101:2008, 7.9.4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import Finding, counted, finding
from mtu_cli.model.graph.places import Output, noises
from mtu_cli.model.graph.transitions import chance_places, may_jump
from mtu_cli.model.graph.trials import (
    Evaluation,
    FirstOrder,
    GraphTrials,
    MeasurementGraph,
    evaluation,
    first_order,
)
from mtu_cli.model.settings import PROBABILITY, Settings
from mtu_cli.stats.coverage import few_blocks_factor, numerical_tolerance
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.monte_carlo import MonteCarloResult, monte_carlo
from mtu_cli.stats.streams import stream
from mtu_cli.stats.validation import CONVERGED_TO, Validation

MARGIN = 1.1
"""More trials than the standard errors of a first look ask for: these are estimates too."""
OUTSIDE = 0.5 * (1.0 - PROBABILITY)
"""Chance beyond either end of the interval."""
PILOT = 4096
"""Trials that tell which outputs follow their first-order form."""
LINEAR = 0.5
"""Share of u that the first-order u must have for the adaptive count to wait for clause 8."""
ROUNDING = 1e-13
"""Scatter below this share of the dimensions is rounding: the output does not vary."""
DRAWN = 2**16
"""Trials kept for the histogram."""
TURNS = 4
"""Runs after the first look that a jump may take."""
LOOK = 2**16
"""Trials of the first look at all outputs together, at most."""


def ratios(run: MonteCarloResult, digits: int, *, ends: bool) -> FloatArray:
    """Twice the largest standard error of each output (n,) over its numerical tolerance.

    Of mean and u and, with `ends`, of both ends of the interval: 1 or below is what 7.9.4 wants
    for `digits` significant digits of u. Twice is for many blocks, Student's t for fewer
    (`few_blocks_factor`). An output without any error has 0.
    """
    errors = [run.se_mean, run.se_u]
    if ends:
        errors += [run.se_low, run.se_high]
    twice = 2.0 * few_blocks_factor(run.blocks) * np.max(errors, axis=0)
    tolerance = np.array([numerical_tolerance(float(u), digits) for u in run.u])
    found = np.full(len(twice), np.inf)
    np.divide(twice, tolerance, out=found, where=tolerance > 0.0)
    return np.where(twice > 0.0, found, 0.0)


def chance_error(chance: float, trials: int) -> float:
    """Standard error of a chance: sqrt(p (1 - p)/n), and 1/(n + 2) where that is less.

    The latter is about the standard deviation of p, all values of it being equally likely
    before, where none or all of n trials hit.
    """
    plain = math.sqrt(max(chance * (1.0 - chance), 0.0) / trials)
    return max(plain, 1.0 / (trials + 2))


def chance_u_error(chance: float, trials: int) -> float:
    """Standard error of u = sqrt(p (1 - p)): |du/dp| times that of p, |1 - 2 p|/(2 sqrt n).

    At p = 1/2 that is 0, and u is less by the square of the error of p, whose root mean square of
    sqrt 3 p (1 - p)/n is left.
    """
    first = abs(1.0 - 2.0 * chance) / (2.0 * math.sqrt(trials))
    return max(first, math.sqrt(3.0) / 4.0 / trials)


def chance_intervals(chance: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Symmetric and shortest interval of what is 1 with a chance p and else 0, for PROBABILITY P.

    The smallest v with F(v) >= (1 - P)/2 and F(v) >= (1 + P)/2 (JCGM 101:2008, 7.7.1, for a G that
    has jumps); one value alone where its share is P or more.
    """
    symmetric = float(1.0 - chance < OUTSIDE), float(1.0 - chance < 1.0 - OUTSIDE)
    return symmetric, (float(chance >= PROBABILITY), float(1.0 - chance < PROBABILITY))


def chance_end_errors(chance: float, trials: int) -> tuple[float, float]:
    """Standard errors of both ends of the symmetric interval: 0 where two of those of the chance
    leave the end at its value, nan where they do not. It is one or the other, nothing between.
    """
    reach = 2.0 * chance_error(chance, trials)
    low, high = (abs(chance - at) > reach for at in (1.0 - OUTSIDE, OUTSIDE))
    return 0.0 if low else math.nan, 0.0 if high else math.nan


def chance_trials(chance: float, digits: int, *, ends: bool) -> float:
    """Trials n after which a chance p is as sure as 7.9.4 wants it for `digits` digits of its
    u = sqrt(p (1 - p)), whose tolerance is delta:

        2 se(p) = 2 sqrt(p (1 - p)/n) <= delta,    2 se(u) = |1 - 2 p|/sqrt n <= delta

    and, with `ends`, two se(p) between p and where an end of the interval goes from 0 to 1.
    Infinite where no trial was different from the others: no digit of u is known.
    """
    variance = chance * (1.0 - chance)
    if variance <= 0.0:
        return math.inf
    delta = numerical_tolerance(math.sqrt(variance), digits)
    wanted = max(4.0 * variance, (1.0 - 2.0 * chance) ** 2) / delta**2
    gap = min(abs(chance - OUTSIDE), abs(1.0 - chance - OUTSIDE))
    if not ends:
        return wanted
    return max(wanted, 4.0 * variance / gap**2) if gap > 0.0 else math.inf


def not_converged(trials: int, digits: int, what: str) -> Finding:
    """The warning of so many trials; `what`: of which places, or how far they have come."""
    goal = f"{counted(digits, 'significant digit')} of u (JCGM 101, 7.9.4), {what}"
    return finding("not-converged", trials=trials, goal=goal)


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """The Monte Carlo's own standard errors, in the unit of the output; nan where the trials do
    not tell one.
    """

    mean: float
    u: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Trials:
    """What became of one output: its row `at` in a `run`; of a fixed one, its value as `mean` and
    no run. `ratio`: 1 or less where it has its digits. `chance`: it is 0 or 1, and its mean the
    share of 1. `still`: it may vary, and did not in any trial.
    """

    mean: float
    u: float
    interval: tuple[float, float]
    shortest: tuple[float, float]
    errors: Errors
    count: int = 0
    ratio: float = 0.0
    chance: bool = False
    still: bool = False
    run: MonteCarloResult | None = None
    at: int = 0

    @classmethod
    def fixed(cls, value: float) -> Trials:
        """Of what does not vary."""
        both, none = (value, value), Errors(mean=0.0, u=0.0, low=0.0, high=0.0)
        return cls(mean=value, u=0.0, interval=both, shortest=both, errors=none)

    @classmethod
    def of(
        cls, run: MonteCarloResult, at: int, ratio: float, *, chance: bool, still: bool
    ) -> Trials:
        """The errors of a chance follow from it, and are never 0; of another jump that no trial
        saw nothing is known.
        """
        mean, n = float(run.mean[at]), run.trials
        symmetric = float(run.low[at]), float(run.high[at])
        shortest = float(run.shortest_low[at]), float(run.shortest_high[at])
        each = (run.se_mean, run.se_u, run.se_low, run.se_high)
        errors = [math.nan if still else float(item[at]) for item in each]
        if chance:
            symmetric, shortest = chance_intervals(mean)
            errors = [chance_error(mean, n), chance_u_error(mean, n), *chance_end_errors(mean, n)]
        return cls(
            mean=mean,
            u=float(run.u[at]),
            interval=symmetric,
            shortest=shortest,
            errors=Errors(**dict(zip(("mean", "u", "low", "high"), errors, strict=True))),
            count=n,
            ratio=ratio,
            chance=chance,
            still=still,
            run=run,
            at=at,
        )

    @property
    def converged(self) -> bool:
        """Whether mean, u and interval are sure to the digits of u asked for."""
        return self.ratio <= 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How far the trials of one output go at most, a chance to `chances` where that is enough for
    it, and whether the interval's ends count.
    """

    most: int
    ends: bool
    chances: int = 0


SIMULATED = Effort(most=2_500_000, ends=True, chances=4_500_000)
"""A chance of 1 in 10 000 to 1 in 100 takes 4 million trials to two digits of its u."""
SWEPT = Effort(most=2**18, ends=False)
"""Of a point of the grid, whose mean and u are what is asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """What is known of n outputs before their trials, (n,) each: `fixed` ones do not vary, `bent`
    ones hardly follow their first-order form, `chance` ones are 0 or 1.
    """

    fixed: NDArray[np.bool_]
    bent: NDArray[np.bool_]
    chance: NDArray[np.bool_]


def survey(graph: MeasurementGraph, whole: Evaluation, linear: FirstOrder, seed: int) -> Survey:
    """What goes through a step may vary in so few trials that a pilot sees none of them: it counts
    as varying, whatever the pilot says.
    """
    model = GraphTrials(whole, linear)
    u = model.draw(stream(seed, 1), PILOT).values.std(axis=1)
    jumps = np.array([_may_jump(graph, item) for item in whole.outputs], dtype=bool)
    fixed = (u <= ROUNDING * whole.sizes) & (linear.u == 0.0) & ~jumps
    bent = ~fixed & ~((linear.u >= LINEAR * u) & (linear.u > 0.0))
    chances = chance_places(item.step for item in whole.steps)
    chance = np.array([item.place in chances for item in whole.outputs], dtype=bool)
    return Survey(fixed=fixed, bent=bent, chance=chance & ~fixed)


def _may_jump(graph: MeasurementGraph, output: Output) -> bool:
    """Whether a random input reaches the output through the equation language's step."""
    start, steps = graph.needed([output])
    return bool(noises(graph.graph, start)) and may_jump(item.step for item in steps)


class TrialRuns:
    """The trials of the outputs of an evaluation, to first order `linear`, under given settings.

    With a given count all are run together. Else a first look at all of them together tells how
    many trials each needs. Those that have their digits by it are done. The others go on without
    them: until they have theirs, or to the most that the effort allows, which is said of them
    alone. What follows its first-order form goes on to the fifth of the tolerance at which clause
    8 can judge it (JCGM 101:2008, 8.2), where that is within reach; of what hardly does, the
    verdict is known or of no interest, and no control variate helps. What a chance needs follows
    from the chance. What jumps is not done while no trial of it was different: it goes on.
    """

    def __init__(
        self,
        graph: MeasurementGraph,
        whole: Evaluation,
        linear: FirstOrder,
        settings: Settings,
        effort: Effort,
    ) -> None:
        self.graph, self.outputs, self.linear = graph, whole.outputs, linear
        self.known = survey(graph, whole, linear, settings.seed)
        self.settings, self.effort = settings, effort
        self.found: dict[int, Trials] = {}

    def run(self) -> list[Trials]:
        """The trials of every output."""
        varying = [int(i) for i in np.flatnonzero(~self.known.fixed)]
        count = self.settings.trials
        if varying and count is not None:
            self._together(varying, CONVERGED_TO, trials=count)
        elif varying:
            self._adaptive(varying)
        nominal = map(float, self.linear.nominal)
        return [self.found.get(i) or Trials.fixed(value) for i, value in enumerate(nominal)]

    def _adaptive(self, varying: Sequence[int]) -> None:
        most = self.effort.most
        self._together(varying, CONVERGED_TO, most=min(LOOK, most))
        self._jumps(varying)
        plain = [i for i in varying if not (self.known.chance[i] or self.found[i].still)]
        if any(not self.found[i].converged for i in plain):
            self._together([i for i in plain if self._goes_on(i)], 1.0, most=most)
        undecided = [i for i in plain if self._judgeable(i)]
        if undecided:
            self._together(undecided, CONVERGED_TO, most=most)

    def _goes_on(self, i: int) -> bool:
        return not self.found[i].converged or self._judgeable(i)

    def _judgeable(self, i: int) -> bool:
        """Whether clause 8 is still open, and its fifth of the tolerance within reach."""
        item = self.found[i]
        if self.known.bent[i] or not self.effort.ends or not item.converged:
            return False
        # The ratio falls as the root of the trials.
        wanted = MARGIN * item.count * (item.ratio / CONVERGED_TO) ** 2
        open_ = item.ratio > CONVERGED_TO and not self.verdict(i).settled
        return open_ and item.count < wanted <= self.effort.most

    def verdict(self, i: int) -> Validation:
        """Clause 8 for an output with a first-order u."""
        item, linear = self.found[i], self.linear
        assert item.run is not None
        return self.settings.validate(
            float(linear.nominal[i]), float(linear.u[i]), np.inf, item.run, item.at
        )

    def _jumps(self, varying: Sequence[int]) -> None:
        """Chances that are still unsure, and what has not jumped yet, all to the count that the
        least sure of them needs and may take: by the chance as it is known so far, which is why it
        may take more than one turn. What needs more than it may take goes on to `most`.
        """
        most = self.effort.most
        limit = max(most, self.effort.chances)
        for _ in range(TURNS):
            jumps = [i for i in varying if self.known.chance[i] or self.found[i].still]
            short = [i for i in jumps if not self.found[i].converged]
            wanted = [MARGIN * self._wanted(self.found[i]) for i in short]
            goal = max((int(item) if item <= limit else most for item in wanted), default=0)
            if goal <= max((self.found[i].count for i in short), default=0):
                return
            self._together(short, 1.0, trials=goal)

    def _wanted(self, item: Trials) -> float:
        """Trials that a jump needs."""
        if item.still:
            return np.inf
        return chance_trials(item.mean, self.settings.digits, ends=self.effort.ends)

    def _together(
        self, members: Sequence[int], fraction: float, *, trials: int | None = None, most: int = 0
    ) -> None:
        chance = self.known.chance[list(members)]
        part = evaluation(self.graph, [self.outputs[i] for i in members])
        run = monte_carlo(
            GraphTrials(part, _without(first_order(part), chance)),
            seed=self.settings.seed,
            trials=trials,
            max_trials=trials or most,
            probability=PROBABILITY,
            digits=self.settings.digits,
            tolerance_fraction=fraction,
            threads=self.settings.threads,
            keep=DRAWN,
            progress=self.settings.progress,
        )
        found = ratios(run, self.settings.digits, ends=self.effort.ends)
        small = run.u <= ROUNDING * part.sizes
        for at, i in enumerate(members):
            still = bool(small[at] and self.linear.u[i] == 0.0)
            now = Trials.of(run, at, float(found[at]), chance=bool(chance[at]), still=still)
            if now.chance or now.still:
                now = replace(now, ratio=(self._wanted(now) / now.count) ** 0.5)
            if self._tells_more(now, self.found.get(i)):
                self.found[i] = now

    @staticmethod
    def _tells_more(now: Trials, before: Trials | None) -> bool:
        """Whether a run is better than the one before: an adaptive count that sees no jump ends."""
        if before is None or before.count < now.count:
            return True
        return not before.converged and (before.still or not now.still)


def _without(linear: FirstOrder, chance: NDArray[np.bool_]) -> FirstOrder:
    """The first order without that of chances: the mean of 0 and 1 stays the share of 1."""
    kept = ~chance
    return replace(linear, gradient=linear.gradient * kept[:, None], u=linear.u * kept)
