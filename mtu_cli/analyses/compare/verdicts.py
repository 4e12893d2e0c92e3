"""Verdicts on all items of a study, as one family of tests."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np

from mtu_cli.analyses.compare.evidence import FEWEST_PARTS, Evidence
from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray

Verdict = Literal["consistent", "biased", "under-predicted", "over-predicted", "inconsistent"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
FAMILY_RATE = 0.05

Answers = tuple[bool | None, ...]
"""One an item; None where it was not tested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared(Evidence):
    """The evidence with its verdicts; `p_bias` and `p_scatter` are adjusted over the study.

    `biased`, `under_predicted`, `over_predicted` are tested each on its own, and `inconsistent`
    takes the place of `biased` where parts are too few to tell a bias from their scatter, and
    stands beside it where single readings pull the item (`pulled`): the scatter that they make
    hides both, so that what no test finds is no consistency. The
    verdict names the gravest: under-predicted (no statement of uncertainty holds), biased (a
    correction would mend it), inconsistent (one of the two), over-predicted (more was feared
    than came), consistent; None where nothing was tested. `withheld` items are those whose
    scatter was measured, but against predictions of so few degrees of freedom that no scatter
    would be found too large.
    """

    biased: Answers
    under_predicted: Answers
    over_predicted: Answers
    inconsistent: Answers
    pulled: tuple[bool, ...]
    withheld: tuple[bool, ...]
    verdicts: tuple[Verdict | None, ...]


def judged(features: Evidence, lengths: Evidence | None) -> tuple[Compared, Compared | None]:
    """Verdicts at a family-wise rate of 5 % over bias and scatter of features and lengths.

    Scatter tests without a chance of finding anything, whatever is measured, are no part of
    the family.
    """
    kinds = [features] if lengths is None else [features, lengths]
    p_bias = np.concatenate([kind.p_bias for kind in kinds])
    p_scatter = np.concatenate([kind.p_scatter for kind in kinds])
    hopeless = np.concatenate([kind.p_hopeless for kind in kinds])
    tests = np.isfinite(p_bias).sum() + np.isfinite(p_scatter).sum()
    withheld = np.isfinite(p_scatter) & (hopeless > FAMILY_RATE / max(tests, 1))
    p_scatter = np.where(withheld, np.nan, p_scatter)
    adjusted = holm(np.concatenate([p_bias, p_scatter]))
    bias, scatter = np.split(adjusted, 2)
    n = len(features.labels)
    found = _judged(features, bias[:n], scatter[:n], withheld[:n])
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
        pulled=(False,) * len(off),
        withheld=tuple(withheld.tolist()),
        verdicts=tuple(map(_gravest, biased, under, over, unclear)),
    )


def less_pulled(found: Compared, off: FloatArray, k: float) -> Compared:
    """The same with no "consistent" where single readings hide what the tests look for.

    `off` (items,), mm: how far the readings that stand out are off the others. Beyond U = `k` u of
    what is predicted of a part they pull the item, and only more scatter is still a finding.
    """
    pulled = tuple((off > k * found.predicted.u).tolist())
    unclear = tuple(
        not u if x else o
        for x, u, o in zip(pulled, found.under_predicted, found.inconsistent, strict=True)
    )
    verdicts = map(_gravest, found.biased, found.under_predicted, found.over_predicted, unclear)
    return replace(found, pulled=pulled, inconsistent=unclear, verdicts=tuple(verdicts))


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
