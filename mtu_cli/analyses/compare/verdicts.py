"""Verdicts on all items of a study, as one family of tests."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mtu_cli.analyses.compare.evidence import FEWEST_PARTS, Evidence
from mtu_cli.analyses.compare.together import Jointly, Together
from mtu_cli.stats.family import holm
from mtu_cli.stats.least_squares import FloatArray

Verdict = Literal["consistent", "biased", "under-predicted", "over-predicted", "inconsistent"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
FAMILY_RATE = 0.05
JOINT_SHARE = 0.2
"""Of that rate what the tests of all features of an operation at once may take."""

Answers = tuple[bool | None, ...]
"""One an item; None where it was not tested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AllAtOnce:
    """The scatter of the `items` of an operation together: `ratio`, measured over predicted, and
    `p`, adjusted over the study. `verdict` is None where it is as predicted.

    `others` is what the same test says of those that show no fault by themselves, None where these
    do not scatter that way or are fewer than two.
    """

    operation: str
    items: int
    ratio: float
    p: float
    verdict: Verdict | None
    others: Jointly | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared(Evidence):
    """The evidence with its verdicts; `p_bias` and `p_scatter` are adjusted over the study.

    `biased`, `under_predicted`, `over_predicted` are tested each on its own, and `inconsistent`
    takes the place of `biased` where parts are too few to tell a bias from their scatter. The
    verdict names the gravest: under-predicted (no statement of uncertainty holds), biased (a
    correction would mend it), inconsistent (one of the two), over-predicted (more was feared
    than came), consistent; None where nothing was tested. `withheld` items are those whose
    scatter was measured, but against predictions of so few degrees of freedom that no scatter
    would be found too large. `unlikely` is scatter of which chance makes as much at less than one
    item of a clean study, by Bonferroni. `at_once` has an entry for every operation whose features
    could be tested together; lengths, which are made of features, have none.
    """

    biased: Answers
    under_predicted: Answers
    over_predicted: Answers
    inconsistent: Answers
    withheld: tuple[bool, ...]
    unlikely: tuple[bool, ...]
    verdicts: tuple[Verdict | None, ...]
    at_once: tuple[AllAtOnce, ...] = ()


def judged(features: Evidence, lengths: Evidence | None) -> tuple[Compared, Compared | None]:
    """Verdicts at a family-wise rate of 5 % over bias and scatter of features and lengths.

    Scatter tests without a chance of finding anything, whatever is measured, are no part of
    the family. Those of all features of an operation at once have JOINT_SHARE of the rate to
    themselves (weighted Bonferroni): among a hundred others they would see no more than these.
    """
    kinds = [features] if lengths is None else [features, lengths]
    p_bias = np.concatenate([kind.p_bias for kind in kinds])
    p_scatter = np.concatenate([kind.p_scatter for kind in kinds])
    hopeless = np.concatenate([kind.p_hopeless for kind in kinds])
    tests = np.isfinite(p_bias).sum() + np.isfinite(p_scatter).sum()
    withheld = np.isfinite(p_scatter) & (hopeless > FAMILY_RATE / max(tests, 1))
    p_scatter = np.where(withheld, np.nan, p_scatter)
    share = JOINT_SHARE if _tests_at_once(features) else 0.0
    adjusted = holm(np.concatenate([p_bias, p_scatter]))
    unlikely = adjusted[len(p_bias) :] < 1.0
    bias, scatter = np.split(np.minimum(adjusted / (1 - share), 1.0), 2)
    n = len(features.labels)
    found = _judged(features, bias[:n], scatter[:n], withheld[:n], unlikely[:n])
    found = replace(found, at_once=_at_once(found))
    if lengths is None:
        return found, None
    return found, _judged(lengths, bias[n:], scatter[n:], withheld[n:], unlikely[n:])


def _judged(
    kind: Evidence,
    p_bias: FloatArray,
    p_scatter: FloatArray,
    withheld: np.ndarray,
    unlikely: np.ndarray,
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
        unlikely=tuple(unlikely.tolist()),
        verdicts=tuple(map(_gravest, biased, under, over, unclear)),
    )


def _tests_at_once(kind: Evidence) -> dict[str, Jointly]:
    """Of all items of each operation, those tests that have a chance of finding anything."""
    every = {own.operation: own.of_all for own in kind.together}
    known = {operation: own for operation, own in every.items() if own is not None}
    least = JOINT_SHARE * FAMILY_RATE / max(len(known), 1)
    return {operation: own for operation, own in known.items() if own.p_hopeless <= least}


def _at_once(found: Compared) -> tuple[AllAtOnce, ...]:
    tests = _tests_at_once(found)
    adjusted = np.minimum(holm(np.array([own.p for own in tests.values()])) / JOINT_SHARE, 1.0)
    entries = []
    for (operation, test), p in zip(tests.items(), adjusted, strict=True):
        own = next(item for item in found.together if item.operation == operation)
        verdict = _way(test) if p <= FAMILY_RATE else None
        others = None if verdict is None else _of_others(own, _faultless(found)[own.own])
        if others is not None:
            # To leave out what was found makes the rest less: no more is claimed than is there.
            others = replace(others, p=min(others.p * len(tests) / JOINT_SHARE, 1.0))
            if others.p > FAMILY_RATE or _way(others) != verdict:
                others = None
        entries.append(
            AllAtOnce(
                operation=operation,
                items=test.items,
                ratio=test.ratio,
                p=float(p),
                verdict=verdict,
                others=others,
            )
        )
    return tuple(entries)


def _of_others(own: Together, chosen: NDArray[np.bool_]) -> Jointly | None:
    return own.of_all if chosen.all() else own.test(chosen)


def _way(test: Jointly) -> Verdict:
    return "under-predicted" if test.ratio > 1 else "over-predicted"


def _faultless(found: Compared) -> NDArray[np.bool_]:
    """Items (items,) whose scatter shows no fault by itself."""
    faults = zip(found.under_predicted, found.over_predicted, strict=True)
    return np.array([not any(own) for own in faults], bool)


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
