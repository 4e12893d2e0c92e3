"""Verdicts on all items of a study, as one family of tests."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from mtu_cli.analyses.compare.evidence import FEWEST_PARTS, Evidence
from mtu_cli.analyses.compare.pooled import PooledTest
from mtu_cli.stats.family import FAMILY_RATE, holm
from mtu_cli.stats.least_squares import FloatArray

Verdict = Literal["consistent", "biased", "under-predicted", "over-predicted", "inconsistent"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
JOINT_SHARE = 0.2
"""Of that rate what the pooled tests of all features of an operation may take."""

Answers = tuple[bool | None, ...]
"""One an item; None where it was not tested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pooled:
    """The pooled scatter of the `items` of an operation: `ratio`, measured over predicted, and `p`,
    adjusted over the study. `verdict` is None where it is as predicted.
    """

    operation: str
    items: int
    ratio: float
    p: float
    verdict: Verdict | None


@dataclass(frozen=True, kw_only=True)
class Compared(Evidence):
    """The evidence with its verdicts; `p_bias` and `p_scatter` are adjusted over the study.

    `biased`, `under_predicted`, `over_predicted` are tested each on its own, and `inconsistent`
    takes the place of `biased` where parts are too few to distinguish a bias from scatter. The
    verdict names the gravest: under-predicted (no statement of uncertainty holds), biased (a
    correction would mend it), inconsistent (one of the two), over-predicted (more was feared
    than came), consistent; None where nothing was tested. `withheld` items are those whose
    scatter was measured, but against predictions of so few degrees of freedom that no scatter
    would be found too large. `pooled` has an entry for every operation whose features could be
    tested as one; lengths, which are made of features, have none.
    """

    biased: Answers
    under_predicted: Answers
    over_predicted: Answers
    inconsistent: Answers
    withheld: tuple[bool, ...]
    verdicts: tuple[Verdict | None, ...]
    pooled: tuple[Pooled, ...] = ()

    @cached_property
    def stated(self) -> tuple[str, ...]:
        """Every fault of an item (items,), or the verdict where it has none."""
        names = ("biased", "under-predicted", "over-predicted", "inconsistent")
        answers = zip(
            self.biased, self.under_predicted, self.over_predicted, self.inconsistent, strict=True
        )
        faults = [[name for name, yes in zip(names, own, strict=True) if yes] for own in answers]
        return tuple(
            ", ".join(own) or verdict or "not tested"
            for own, verdict in zip(faults, self.verdicts, strict=True)
        )

    def by_interest(self) -> list[int]:
        """Items with a fault, the clearest first, then those of the largest |E_n|: parts that
        scatter too much may lie where they should in the mean.
        """
        faulty = np.array([verdict not in (None, "consistent") for verdict in self.verdicts], bool)
        p = np.nan_to_num(np.fmin(self.p_bias, self.p_scatter), nan=1.0)
        size = np.abs(np.nan_to_num(self.E_n))
        order: list[int] = np.lexsort((-size, np.where(faulty, p, 2.0))).tolist()
        return order


def judged(features: Evidence, lengths: Evidence | None) -> tuple[Compared, Compared | None]:
    """Verdicts at a family-wise rate of 5 % over bias and scatter of features and lengths.

    Scatter tests without a chance of finding anything, whatever is measured, are no part of
    the family. The pooled ones of all features of an operation have JOINT_SHARE of the rate to
    themselves (weighted Bonferroni): among a hundred others they would see no more than these.
    """
    kinds = [features] if lengths is None else [features, lengths]
    p_bias = np.concatenate([kind.p_bias for kind in kinds])
    p_scatter = np.concatenate([kind.p_scatter for kind in kinds])
    hopeless = np.concatenate([kind.p_hopeless for kind in kinds])
    tests = np.isfinite(p_bias).sum() + np.isfinite(p_scatter).sum()
    withheld = np.isfinite(p_scatter) & (hopeless > FAMILY_RATE / max(tests, 1))
    p_scatter = np.where(withheld, np.nan, p_scatter)
    share = JOINT_SHARE if _pooled_tests(features) else 0.0
    adjusted = holm(np.concatenate([p_bias, p_scatter]))
    bias, scatter = np.split(np.minimum(adjusted / (1 - share), 1.0), 2)
    n = len(features.labels)
    found = _judged(features, bias[:n], scatter[:n], withheld[:n])
    found = replace(found, pooled=_pooled(found))
    if lengths is None:
        return found, None
    return found, _judged(lengths, bias[n:], scatter[n:], withheld[n:])


def _judged(
    kind: Evidence, p_bias: FloatArray, p_scatter: FloatArray, withheld: np.ndarray
) -> Compared:
    few = kind.one_way.parts < FEWEST_PARTS
    off = [_answer(p) for p in p_bias]
    apart = [_answer(p) for p in p_scatter]
    more = kind.ratio_ms > 1
    under = [None if a is None else a and bool(m) for a, m in zip(apart, more, strict=True)]
    over = [None if a is None else a and not m for a, m in zip(apart, more, strict=True)]
    biased = [None if f else o for o, f in zip(off, few, strict=True)]
    # Parts that are known to scatter more explain a mean that is off.
    unclear = [
        o and not u if f and o is not None else None
        for o, u, f in zip(off, under, few, strict=True)
    ]
    own = {item.name: getattr(kind, item.name) for item in fields(kind)}
    return Compared(
        **own | {"p_bias": p_bias, "p_scatter": p_scatter},
        biased=tuple(biased),
        under_predicted=tuple(under),
        over_predicted=tuple(over),
        inconsistent=tuple(unclear),
        withheld=tuple(withheld.tolist()),
        verdicts=tuple(map(_gravest, biased, under, over, unclear)),
    )


def _pooled_tests(kind: Evidence) -> dict[str, PooledTest]:
    """Of all items of each operation, those tests that have a chance of finding anything."""
    every = {own.operation: own.test for own in kind.pooled_items}
    known = {operation: own for operation, own in every.items() if own is not None}
    least = JOINT_SHARE * FAMILY_RATE / max(len(known), 1)
    return {operation: own for operation, own in known.items() if own.p_hopeless <= least}


def _pooled(found: Compared) -> tuple[Pooled, ...]:
    tests = _pooled_tests(found)
    adjusted = np.minimum(holm(np.array([own.p for own in tests.values()])) / JOINT_SHARE, 1.0)
    return tuple(
        Pooled(
            operation=operation,
            items=test.items,
            ratio=test.ratio,
            p=float(p),
            verdict=_way(test) if p <= FAMILY_RATE else None,
        )
        for (operation, test), p in zip(tests.items(), adjusted, strict=True)
    )


def _way(test: PooledTest) -> Verdict:
    return "under-predicted" if test.ratio > 1 else "over-predicted"


def _answer(p: float) -> bool | None:
    return bool(p <= FAMILY_RATE) if np.isfinite(p) else None


def _gravest(
    biased: bool | None, under: bool | None, over: bool | None, inconsistent: bool | None
) -> Verdict | None:
    if under:
        return "under-predicted"
    if biased:
        return "biased"
    if inconsistent:
        return "inconsistent"
    if over:
        return "over-predicted"
    if biased is under is over is inconsistent is None:
        return None
    return "consistent"
