"""Verdicts on all items of a study, as one family of tests, and their sum by operation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal, NamedTuple, get_args

import numpy as np

from mtu_cli.analyses.compare.evidence import FEWEST_PARTS, Evidence, PooledTest
from mtu_cli.stats.family import FAMILY_RATE, holm
from mtu_cli.stats.least_squares import FloatArray

Verdict = Literal["consistent", "biased", "under-predicted", "over-predicted"]
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

    `biased`, `under_predicted`, `over_predicted` are tested each on its own; parts too few to
    measure their scatter, but known to scatter too much, are not biased. The verdict names the
    gravest: under-predicted (no statement of uncertainty holds), biased (a correction would mend
    it), over-predicted (more was feared than came), consistent; None where nothing was tested.
    `withheld` items are those whose scatter was measured, but against predictions of so few degrees
    of freedom that no scatter would be found too large. `pooled` has an entry for every operation
    whose features could be tested as one.
    """

    biased: Answers
    under_predicted: Answers
    over_predicted: Answers
    withheld: tuple[bool, ...]
    verdicts: tuple[Verdict | None, ...]
    pooled: tuple[Pooled, ...] = ()

    def stated(self, i: int) -> str:
        """Every fault of item `i`, or the verdict where it has none."""
        faults = {
            "biased": self.biased,
            "under-predicted": self.under_predicted,
            "over-predicted": self.over_predicted,
        }
        names = [name for name, answers in faults.items() if answers[i]]
        return ", ".join(names) or self.verdicts[i] or "not tested"

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
    least = JOINT_SHARE * FAMILY_RATE / max(len(features.pooled_tests), 1)
    able = {name: x for name, x in features.pooled_tests.items() if x.p_hopeless <= least}
    share = JOINT_SHARE if able else 0.0
    adjusted = holm(np.concatenate([p_bias, p_scatter]))
    bias, scatter = np.split(np.minimum(adjusted / (1 - share), 1.0), 2)
    n = len(features.labels)
    found = _judged(features, bias[:n], scatter[:n], withheld[:n])
    found = replace(found, pooled=_pooled(able))
    if lengths is None:
        return found, None
    return found, _judged(lengths, bias[n:], scatter[n:], withheld[n:])


def _judged(
    kind: Evidence, p_bias: FloatArray, p_scatter: FloatArray, withheld: np.ndarray
) -> Compared:
    off = _answers(p_bias, p_bias <= FAMILY_RATE)
    more = kind.ratio_ms > 1
    under, over = (_answers(p_scatter, (p_scatter <= FAMILY_RATE) & way) for way in (more, ~more))
    # Parts that are known to scatter more explain a mean that is off.
    few = kind.one_way.parts < FEWEST_PARTS
    biased = tuple(
        None if x is None else x and not (few[i] and under[i]) for i, x in enumerate(off)
    )
    evidence = {item.name: getattr(kind, item.name) for item in fields(kind)}
    return Compared(
        **evidence | {"p_bias": p_bias, "p_scatter": p_scatter},
        biased=biased,
        under_predicted=under,
        over_predicted=over,
        withheld=tuple(withheld.tolist()),
        verdicts=tuple(map(_gravest, biased, under, over)),
    )


def _answers(p: FloatArray, met: np.ndarray) -> Answers:
    """Whether each of the tests is met, None where there is no p."""
    return tuple(bool(m) if np.isfinite(x) else None for x, m in zip(p, met, strict=True))


def _gravest(biased: bool | None, under: bool | None, over: bool | None) -> Verdict | None:
    faults: dict[Verdict, bool | None] = {
        "under-predicted": under,
        "biased": biased,
        "over-predicted": over,
    }
    tested = any(fault is not None for fault in faults.values())
    return next((name for name, fault in faults.items() if fault), "consistent" if tested else None)


def _pooled(tests: Mapping[str, PooledTest]) -> tuple[Pooled, ...]:
    adjusted = np.minimum(holm(np.array([x.p for x in tests.values()])) / JOINT_SHARE, 1.0)
    found = []
    for (operation, test), p in zip(tests.items(), adjusted.tolist(), strict=True):
        way: Verdict = "under-predicted" if test.ratio > 1 else "over-predicted"
        verdict = way if p <= FAMILY_RATE else None
        found.append(
            Pooled(operation=operation, items=test.items, ratio=test.ratio, p=p, verdict=verdict)
        )
    return tuple(found)


class Range(NamedTuple):
    """The least, the median and the largest of the values that are known."""

    least: float
    median: float
    largest: float

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the largest."""
        return self.least, self.largest


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """The items of one operation, features or lengths (`kind`): how many have which verdict and
    fault, and the ranges of their figures.

    `verdicts` counts each item once, by its gravest fault; `biased`, `under_predicted` and
    `over_predicted` count every fault. `bias_tested` and `scatter_tested`
    items could be judged at all, `not_tested` ones in neither. `ranges` are, where any value is
    known, those of RANGES, of `under_factor` and `over_factor`, which are `ratio_scatter` of the
    items under- and over-predicted, of `bias_size`, |bias| (mm) of the biased, and
    of `n0`: the paper's scatter, from MS_between, is sqrt(n0) times the parts' own, or
    somewhat more (`ms_share`). `pooled` is the test of their pooled scatter, None where it was
    not made.
    """

    kind: str
    operation: str
    items: int
    verdicts: dict[Verdict, int]
    not_tested: int
    bias_tested: int
    scatter_tested: int
    biased: int
    under_predicted: int
    over_predicted: int
    ranges: Mapping[str, Range]
    pooled: Pooled | None

    @property
    def pooled_fault(self) -> Verdict | None:
        """What the pooled test shows and no item by itself."""
        alone = {"under-predicted": self.under_predicted, "over-predicted": self.over_predicted}
        verdict = None if self.pooled is None else self.pooled.verdict
        return None if verdict is None or alone[verdict] else verdict


RANGES = (
    *("ratio_u", "ratio_range", "ratio_scatter", "paper_ratio_u", "paper_ratio_range"),
    *("bias", "ms_share"),
)


def summarised(found: Compared, kind: str = "features") -> tuple[Summary, ...]:
    """One entry an operation, in the order in which they come."""
    operations = dict.fromkeys(label[0] for label in found.labels)
    return tuple(_summary(found, kind, operation) for operation in operations)


def _summary(found: Compared, kind: str, operation: str) -> Summary:
    rows = np.array([i for i, label in enumerate(found.labels) if label[0] == operation])
    verdicts = [found.verdicts[i] for i in rows]

    def true(answers: Answers) -> np.ndarray:
        return np.array([answers[i] is True for i in rows])

    def tested(answers: Answers) -> int:
        return sum(answers[i] is not None for i in rows)

    biased = true(found.biased)
    under, over = true(found.under_predicted), true(found.over_predicted)
    values = {name: getattr(found, name)[rows] for name in RANGES}
    scatter = values["ratio_scatter"]
    values |= {
        "n0": found.one_way.n0[rows],
        "bias_size": np.abs(values["bias"][biased]),
        "under_factor": scatter[under],
        "over_factor": scatter[over],
    }
    known = {name: each[np.isfinite(each)] for name, each in values.items()}
    return Summary(
        kind=kind,
        operation=operation,
        items=len(rows),
        verdicts={name: verdicts.count(name) for name in VERDICTS},
        not_tested=verdicts.count(None),
        bias_tested=tested(found.biased),
        scatter_tested=tested(found.under_predicted),
        biased=int(biased.sum()),
        under_predicted=int(under.sum()),
        over_predicted=int(over.sum()),
        ranges={
            name: Range(float(each.min()), float(np.median(each)), float(each.max()))
            for name, each in known.items()
            if len(each)
        },
        pooled=next((item for item in found.pooled if item.operation == operation), None),
    )
