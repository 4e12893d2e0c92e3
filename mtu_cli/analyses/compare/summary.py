"""The sum of a comparison, one entry an operation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.compare.verdicts import VERDICTS, Answers, Compared, Pooled, Verdict
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
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
    fault, and their figures.

    `verdicts` counts each item once, by its gravest fault; `biased`, `under_predicted`,
    `over_predicted` and `inconsistent` count every fault. `bias_tested` and
    `scatter_tested` items could be judged at all, `not_tested` ones in neither. Ratios are
    measured over predicted; `under_factor` and `over_factor` are `ratio_scatter` of the items
    under- and over-predicted, `bias_size` |bias| (mm) of the biased or inconsistent.
    `n0` and `ms_share` say what the paper's
    scatter, from MS_between, is of the parts' own: sqrt(n0) times, or somewhat more.
    `pooled` is the test of their pooled scatter, None where it was not made.
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
    inconsistent: int
    ratio_u: Range | None
    ratio_range: Range | None
    ratio_scatter: Range | None
    paper_ratio_u: Range | None
    paper_ratio_range: Range | None
    bias: Range | None
    bias_size: Range | None
    under_factor: Range | None
    over_factor: Range | None
    n0: Range | None
    ms_share: Range | None
    pooled: Pooled | None

    @property
    def pooled_fault(self) -> Verdict | None:
        """What the pooled test shows and no item by itself."""
        alone = {"under-predicted": self.under_predicted, "over-predicted": self.over_predicted}
        verdict = None if self.pooled is None else self.pooled.verdict
        return None if verdict is None or alone[verdict] else verdict


def summarised(found: Compared, kind: str = "features") -> tuple[Summary, ...]:
    """One entry an operation, in the order in which they come."""
    operations = dict.fromkeys(label[0] for label in found.labels)
    return tuple(_summary(found, kind, operation) for operation in operations)


def _summary(found: Compared, kind: str, operation: str) -> Summary:
    own = np.array([label[0] == operation for label in found.labels])
    verdicts = [v for v, inside in zip(found.verdicts, own, strict=True) if inside]
    off = _yes(found.biased) | _yes(found.inconsistent)
    tested = _known(found.biased) | _known(found.inconsistent)

    def count(flags: np.ndarray) -> int:
        return int((flags & own).sum())

    return Summary(
        kind=kind,
        operation=operation,
        items=len(verdicts),
        verdicts={name: verdicts.count(name) for name in VERDICTS},
        not_tested=verdicts.count(None),
        bias_tested=count(tested),
        scatter_tested=count(_known(found.under_predicted)),
        biased=count(_yes(found.biased)),
        under_predicted=count(_yes(found.under_predicted)),
        over_predicted=count(_yes(found.over_predicted)),
        inconsistent=count(_yes(found.inconsistent)),
        ratio_u=_range(found.ratio_u[own]),
        ratio_range=_range(found.ratio_range[own]),
        ratio_scatter=_range(found.ratio_scatter[own]),
        paper_ratio_u=_range(found.paper_ratio_u[own]),
        paper_ratio_range=_range(found.paper_ratio_range[own]),
        bias=_range(found.bias[own]),
        bias_size=_range(np.abs(found.bias[own & off])),
        under_factor=_range(found.ratio_scatter[own & _yes(found.under_predicted)]),
        over_factor=_range(found.ratio_scatter[own & _yes(found.over_predicted)]),
        n0=_range(found.one_way.n0[own]),
        ms_share=_range(found.ms_share[own]),
        pooled=next((item for item in found.pooled if item.operation == operation), None),
    )


def _yes(answers: Answers) -> np.ndarray:
    return np.array([answer is True for answer in answers])


def _known(answers: Answers) -> np.ndarray:
    return np.array([answer is not None for answer in answers])


def _range(values: FloatArray) -> Range | None:
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    return Range(
        least=float(known.min()), median=float(np.median(known)), largest=float(known.max())
    )
