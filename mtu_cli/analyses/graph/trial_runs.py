"""The Monte Carlo runs of simulate and sweep: which outputs vary, and how far each one goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.analyses.graph.convergence import MARGIN, chance_trials, ratios, wanted_trials
from mtu_cli.analyses.graph.trials import Trials
from mtu_cli.model.graph.chances import chance_places, may_jump
from mtu_cli.model.graph.first_order import FirstOrder, first_order
from mtu_cli.model.graph.inputs import noises
from mtu_cli.model.graph.measurement_graph import Evaluation, MeasurementGraph, evaluation
from mtu_cli.model.graph.outputs import Output
from mtu_cli.model.graph.trials import GraphTrials
from mtu_cli.model.settings import PROBABILITY, Settings
from mtu_cli.stats.monte_carlo import monte_carlo
from mtu_cli.stats.streams import stream
from mtu_cli.stats.validation import CONVERGED_TO, Validation

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

    def run(self) -> dict[int, Trials]:
        """The trials of every output that is not fixed, by its number."""
        varying = [int(i) for i in np.flatnonzero(~self.known.fixed)]
        if not varying:
            return {}
        count, most = self.settings.trials, self.effort.most
        if count is not None:
            self._together(varying, CONVERGED_TO, trials=count)
            return self.found
        self._together(varying, CONVERGED_TO, most=min(LOOK, most))
        self._jumps(varying)
        plain = [i for i in varying if not (self.known.chance[i] or self.found[i].still)]
        if any(not self.found[i].converged for i in plain):
            self._together([i for i in plain if self._goes_on(i)], 1.0, most=most)
        undecided = [i for i in plain if self._judgeable(i)]
        if undecided:
            self._together(undecided, CONVERGED_TO, most=most)
        return self.found

    def _goes_on(self, i: int) -> bool:
        return not self.found[i].converged or self._judgeable(i)

    def _judgeable(self, i: int) -> bool:
        """Whether clause 8 is still open, and its fifth of the tolerance within reach."""
        item = self.found[i]
        if self.known.bent[i] or not self.effort.ends or not item.converged:
            return False
        wanted = wanted_trials(item.run.trials, item.ratio, CONVERGED_TO)
        open_ = item.ratio > CONVERGED_TO and not self.verdict(i).settled
        return open_ and item.run.trials < wanted <= self.effort.most

    def verdict(self, i: int) -> Validation:
        """Clause 8 for an output with a first-order u."""
        item, linear = self.found[i], self.linear
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
            if goal <= max((self.found[i].run.trials for i in short), default=0):
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
            now = Trials(
                run=run,
                at=at,
                ratio=float(found[at]),
                chance=bool(chance[at]),
                still=bool(small[at] and self.linear.u[i] == 0.0),
            )
            if now.chance or now.still:
                now = replace(now, ratio=(self._wanted(now) / run.trials) ** 0.5)
            if self._tells_more(now, self.found.get(i)):
                self.found[i] = now

    @staticmethod
    def _tells_more(now: Trials, before: Trials | None) -> bool:
        """Whether a run is better than the one before: an adaptive count that sees no jump ends."""
        if before is None or before.run.trials < now.run.trials:
            return True
        return not before.converged and (before.still or not now.still)


def _without(linear: FirstOrder, chance: NDArray[np.bool_]) -> FirstOrder:
    """The first order without that of chances: the mean of 0 and 1 stays the share of 1."""
    kept = ~chance
    return replace(linear, gradient=linear.gradient * kept[:, None], u=linear.u * kept)
