"""The set of models: from nothing by additions, drops and swaps, each through the gate.

A model is a tuple of members of candidates and of named random functions. Its evidence is the
marginal likelihood with the prior of its candidates. Classes, rivals and posteriors are read from
the models that were met (Occam's window, Madigan & Raftery 1994).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mtu_cli.analyses.close_loop.gate import Gate
from mtu_cli.analyses.close_loop.likelihood import Columns
from mtu_cli.analyses.close_loop.strata import PADDING
from mtu_cli.files.effects import SCATTERS
from mtu_cli.stats.least_squares import FloatArray

BEAM = 3
SHARE = 0.98
"""Posterior of a class."""
WINDOW = 20.0
"""Times less likely than the best, down to which a model counts (Madigan & Raftery 1994)."""
CLOSE = 25.0
"""Of the log evidence: a candidate further than this from the best needs no finer members."""
ODDS = 3.0
"""Prior odds of a nameless effect against one of the library."""
ROUNDS = 4

Item = int
"""A member of a candidate (from 0 on), or a random function (below 0)."""
Model = tuple[Item, ...]
Scatter = tuple[str, float, float]
"""Name of a scatter effect, its p, and how many times the rest's its deviation is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One effect of a model: its item, family-wise p, gain in log evidence over the model without
    it, its class with posteriors, and whether a nameless effect is credible or likelier.
    """

    item: Item
    name: str
    p: float
    gain: float
    posterior: float
    credible: tuple[tuple[str, Item, float], ...]
    nameless: bool
    overtaken: bool


class ModelSet:
    """Models of one table and what they say."""

    def __init__(self, gate: Gate, *, alpha: float, most: int) -> None:
        self.gate, self.likelihood, self.design = gate, gate.likelihood, gate.design
        self.alpha, self.most = alpha, most
        kernels = self.likelihood.kernels
        self.named = [item for item, kernel in kernels.items() if kernel.name]
        self.nameless = [item for item, kernel in kernels.items() if not kernel.name]
        self.names = [c.name for c in self.design.candidates]
        self.names += [kernels[item].name for item in self.named]
        self.stopped = False
        self._smooth: dict[tuple[int, ...], Columns] = {}
        self._values: dict[Model, float] = {}
        self._added: dict[Model, tuple[FloatArray, list[Item]]] = {}

    # What a model is.

    def place(self, item: Item) -> int:
        """Index of an item's candidate among `names`."""
        if item >= 0:
            return self.design.members[item].candidate
        return len(self.design.candidates) + self.named.index(item)

    def members(self, model: Model) -> tuple[int, ...]:
        """The mean effects of a model."""
        return tuple(item for item in model if item >= 0)

    def columns(self, model: Model) -> Columns:
        """The columns of a model, and the directions of its random functions."""
        result = self.likelihood.closure(model)
        for item in sorted(item for item in model if item < 0):
            key = (*result, item)
            if key not in self._smooth:
                fit = self.likelihood.fit(result)
                self._smooth[key] = self.likelihood.smooth(fit, self.likelihood.kernels[item])
            result += self._smooth[key]
        return result

    def value(self, model: Model) -> float:
        """Log marginal likelihood of a model, in the units of its additions."""
        model = tuple(sorted(model))
        if model not in self._values:
            columns = self.likelihood.closure(model)
            gains = self._gains(columns, [item for item in model if item < 0])
            self._values[model] = float(self.likelihood.evidence(columns)[0]) + sum(gains)
        return self._values[model]

    def _gains(self, columns: Columns, kernels: Sequence[Item]) -> list[float]:
        """Log Bayes factors of random functions given a model of these columns."""
        if not kernels:
            return []
        like, fit = self.likelihood, self.likelihood.fit(columns)
        return [like.kernel_gain(fit, like.kernels[item])[0] for item in kernels]

    # Additions.

    def additions(self, model: Model) -> tuple[FloatArray, list[Item]]:
        """Log marginal likelihood of a model with each candidate added, averaged over the
        candidate's members, and the likeliest item of each. Where a grid is coarse against the
        data, finer members share the prior of its best one.
        """
        model = tuple(sorted(model))
        if model in self._added:
            return self._added[model]
        design, like = self.design, self.likelihood
        columns = like.closure(model)
        smooth = self.columns(model)[len(columns) :]
        value = self.value(model)
        base = value - float(like.evidence(columns, smooth)[0])
        with np.errstate(divide="ignore"):
            logs = base + np.log(design.prior)
        logs += like.evidence(columns, smooth, design.closures)
        total = np.full(len(self.names), -np.inf)
        best = [0] * len(self.names)
        owned = {c: np.flatnonzero(design.owner == c) for c in np.unique(design.owner).tolist()}
        for c, at in owned.items():
            total[c], best[c] = np.logaddexp.reduce(logs[at]), int(at[np.argmax(logs[at])])
        present = {self.place(item) for item in model}
        for c in np.flatnonzero(total > total.max(initial=-np.inf) - CLOSE).tolist():
            m = best[c]
            if c not in present and (fine := design.around(m)):
                share = np.log(design.members[m].prior / len(fine))
                finer = like.evidence(columns, smooth, design.closures_of(fine)) + base + share
                rest = logs[owned[c][owned[c] != m]]
                total[c] = np.logaddexp.reduce(np.concatenate([rest, finer]))
                best[c] = fine[int(np.argmax(finer))]
        first = len(design.candidates)
        total[first:] = value + np.array(self._gains(columns, self.named))
        best[first:] = self.named
        self._added[model] = total, best
        return total, best

    def without_name(self, model: Model) -> FloatArray:
        """Log marginal likelihood, with their odds, of nameless random functions given a model."""
        gains = self._gains(self.likelihood.closure(model), self.nameless)
        return self.value(model) + np.array(gains) + np.log(ODDS)

    def _choices(self, model: Model) -> tuple[FloatArray, list[Item], FloatArray]:
        """The additions to a model that are not in it yet (-inf of those that are), and the p of
        each in the gate; 1 of what is not tested.
        """
        p = self.gate(self.columns(model))
        total, best = self.additions(model)
        total = total.copy()
        total[[self.place(item) for item in model]] = -np.inf
        return total, list(best), np.array([p.get(name, 1.0) for name in self.names])

    def _entrants(self, model: Model) -> list[Item]:
        """Items that pass the gate given a model, the likeliest first; unless it is empty only
        those that make it likelier, their prior counted: each of them is one more test.
        """
        total, best, p = self._choices(model)
        least = self.value(model) + np.log(len(self.names)) if model else -np.inf
        order = np.argsort(-total, kind="stable")
        return [best[i] for i in order if total[i] > least and p[i] <= self.alpha]

    # Search.

    def search(self) -> Model:
        """The likeliest model that only effects which pass the gate lead to: forward from the
        first few, each model refined by drop and swap.
        """
        stack: list[tuple[Model, Model]] = [((item,), ()) for item in self._entrants(())[:BEAM]]
        history: set[Model] = set()
        ends: set[Model] = set()
        while stack:
            model, before = stack.pop(0)
            model = self._refine(model)
            key = tuple(sorted(model))
            if key in history:
                # What was added leads back: the model before has no further effect.
                ends |= {before} & history
                continue
            history.add(key)
            items = self._entrants(model)[:1]
            if items and len(model) >= self.most:
                self.stopped, items = True, []
            stack += [((*model, item), key) for item in items]
            if not items:
                ends.add(key)
        prior = float(np.log(len(self.names)))
        return max(sorted(ends), key=lambda x: self.value(x) - prior * len(x), default=())

    def _refine(self, model: Model) -> Model:
        """Drops what no longer passes the gate and swaps single effects for the likeliest that
        passes in their place, until nothing improves.
        """
        for _ in range(ROUNDS):
            for item in model:
                rest = tuple(x for x in model if x != item)
                total, best, p = self._choices(rest)
                total[p > self.alpha] = -np.inf
                c = int(np.argmax(total))
                if not np.isfinite(total[c]):
                    model = rest
                    break
                if total[c] > total[self.place(item)] + 1e-9 or best[c] != item:
                    model = tuple(best[c] if x == item else x for x in model)
                    break
            else:
                break
        return model

    # What a model says.

    def entries(self, model: Model) -> tuple[Model, tuple[Entry, ...]]:
        """The effects of a model, the strongest first; without those that are margins of others."""
        low = {i for m in self.members(model) for i in self.design.members[m].low}
        model = tuple(
            item for item in model if item < 0 or not set(self.design.members[item].terms) <= low
        )
        result = []
        for item in model:
            rest = tuple(x for x in model if x != item)
            total, best, p = self._choices(rest)
            smooth, without, c = self.without_name(rest), self.value(rest), self.place(item)
            # What is less likely than no effect explains nothing.
            total[(total < without) & (np.arange(len(total)) != c)] = -np.inf
            # One that holds the effect as a margin says more than it: it has to pass by itself.
            terms = set(self.design.members[item].terms) if item >= 0 else {PADDING}
            for i in np.flatnonzero(np.isfinite(total)):
                low = set(self.design.members[best[i]].low if best[i] >= 0 else ())
                if terms <= low and p[i] > self.alpha:
                    total[i] = -np.inf
            logs = np.concatenate([total, smooth])
            posterior = np.exp(logs - np.logaddexp.reduce(logs))
            order = np.argsort(-posterior, kind="stable").tolist()
            count = 1 + int(np.searchsorted(np.cumsum(posterior[order]), SHARE))
            best[c], rivals = item, [i for i in order[:count] if i < len(self.names) and i != c]
            result.append(
                Entry(
                    item=item,
                    name=self.names[c],
                    p=float(p[c]),
                    gain=float(total[c] - without),
                    posterior=float(posterior[c]),
                    credible=tuple(
                        (self.names[i], best[i], float(posterior[i])) for i in (c, *rivals)
                    ),
                    nameless=bool(posterior[len(self.names) :].sum() > 1 - SHARE),
                    overtaken=bool(len(smooth) and smooth.max() > total[c]),
                )
            )
        return model, tuple(sorted(result, key=lambda entry: -entry.gain))

    def nameless_wins(self, model: Model) -> bool:
        """Whether a nameless effect in the place of several of a model's is likelier than it."""
        prior, value = np.log(len(self.names)), self.value(model)
        return any(
            self.without_name(rest).max(initial=-np.inf)
            > value + (1 + len(rest) - len(model)) * prior
            for n in range(len(model) - 1)
            for rest in combinations(model, n)
        )

    def scatter(self, model: Model, motion: Sequence[Scatter]) -> list[Scatter]:
        """Those of `motion`, and further ones that pass given a model, one after another."""
        result, columns = list(motion), self.columns(model)
        while True:
            p = self.gate(columns, tuple(name for name, _, _ in result))
            hits = [(p[name], name) for name in SCATTERS if p.get(name, 1.0) <= self.alpha]
            if not hits:
                return result
            value, name = min(hits)
            result.append((name, value, self.gate.ratios[tuple(sorted(columns))][name]))
