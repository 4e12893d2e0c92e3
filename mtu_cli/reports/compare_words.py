"""The comparison in words: a sentence for each operation."""

from __future__ import annotations

from mtu_cli.analyses.compare import Compared, CompareResult, Range, Summary
from mtu_cli.reports.numbers import p_value, significant, span
from mtu_cli.units import UM

NOTHING = 1e-6
"""A ratio of scatter that rounding alone makes."""


def verdict_text(item: Summary, kind: str) -> str:
    """Such as "drilled features: under-predicted: the scatter is 3.1 to 4.7 times the predicted
    one (48 of 48)", every fault that was found with its size.

    Nothing is called consistent whose scatter is undecided.
    """
    name = f"{item.operation} {kind}" if item.operation else kind
    found = (_under(item), _biased(item), _unclear(item), _over(item), _at_once(item))
    faults = [text for text in found if text]
    left = [text for text in (_undecided(item),) if text]
    if item.not_tested == item.items:
        return f"{name}: not tested"
    untested = _untested(item)
    if not faults and left:
        far = " as far as it could be tested" if untested else ""
        said = f"{name}: no difference from what was predicted is beyond chance{far}, but "
        return said + "; ".join([*left, *untested])
    if not faults:
        faults = ["consistent as far as it could be tested"]
        if not untested:
            told = "no difference from what was predicted is beyond chance, all items counted"
            return f"{name}: consistent: {told}"
    return f"{name}: {'; '.join([*faults, *left, *untested])}"


def set_up_text(result: CompareResult) -> str | None:
    """What the set-up of parts looks like: features scatter, or are off, and no length does."""
    lengths = {item.operation: item for item in result.length_summaries}
    if result.datum != "none":
        return None
    for item in result.feature_summaries:
        beside = lengths.get(item.operation)
        if beside is None:
            continue
        by_hand = item.under_predicted * 2 > item.items and beside.scatter_tested
        if by_hand and not beside.under_predicted:
            return (
                "Features scatter and lengths do not: it may be that each part was set up by hand "
                "(on the machine or the CMM), with an offset of its own. --datum offset, or "
                "--datum offset,rotation, takes that out."
            )
        if beside.bias_tested and not beside.biased and _most_are_off(result, item.operation):
            guessed = any(own.code == "outside-effect-range" for own in result.warnings)
            beyond = "an effect is used beyond what it was found on, or that " if guessed else ""
            return (
                f"Features are off and lengths are not: it may be that {beyond}all parts lay "
                "shifted or turned (on the machine or the CMM). --datum offset, or --datum "
                f"offset,rotation, takes {'the latter' if guessed else 'that'} out."
            )
    return None


def _most_are_off(result: CompareResult, operation: str) -> bool:
    """Whether most features of an operation are biased along any axis."""
    found = result.features
    for axis in {label[2] for label in found.labels}:
        own = [
            off
            for label, off in zip(found.labels, found.biased, strict=True)
            if (label[0], label[2]) == (operation, axis)
        ]
        if sum(off is True for off in own) * 2 > len(own) > 1:
            return True
    return False


def cause_text(result: CompareResult) -> str | None:
    """Which command looks for the cause of what parts do that was not predicted."""
    summaries = (*result.feature_summaries, *result.length_summaries)
    if any(
        item.biased
        or item.under_predicted
        or item.inconsistent
        or item.undecided
        or (item.at_once is not None and item.at_once.verdict == "under-predicted")
        for item in summaries
    ):
        return "mtu close-loop looks for the cause in the same files: it names what they can prove."
    return None


def _under(item: Summary) -> str | None:
    if not item.under_predicted:
        return None
    count = _share(item.under_predicted, item)
    if item.under_factor is None:
        return f"under-predicted: parts scatter where no scatter is predicted ({count})"
    times = _times(item.under_factor)
    return f"under-predicted: the scatter is {times} times the predicted one ({count})"


def _biased(item: Summary) -> str | None:
    if not item.biased:
        return None
    return f"biased: the mean is off by {_size(item)} ({_share(item.biased, item)})"


def _unclear(item: Summary) -> str | None:
    if not item.inconsistent:
        return None
    count = _share(item.inconsistent, item)
    return (
        f"inconsistent: the mean is off by {_size(item)}, bias or scatter: too few parts to tell "
        f"({count})"
    )


def _over(item: Summary) -> str | None:
    if not item.over_predicted:
        return None
    count = _share(item.over_predicted, item)
    if item.over_factor is not None and item.over_factor.largest < NOTHING:
        return f"over-predicted: no scatter is seen where some is predicted ({count})"
    times = "less than" if item.over_factor is None else f"{_times(item.over_factor)} times"
    return f"over-predicted: the scatter is {times} the predicted one ({count})"


def _at_once(item: Summary) -> str | None:
    """The scatter of all that show none by themselves."""
    found = item.at_once
    if found is None or found.others is None:
        return None
    others = found.others
    which = "them" if others.items == item.items else f"the {others.items} others"
    return (
        f"{found.verdict} all together: none of {which} shows it by itself, but their scatter is "
        f"{significant(others.ratio)} times the predicted one (p {p_value(others.p)})"
    )


def _undecided(item: Summary) -> str | None:
    """Scatter that is large, but not beyond what chance makes of few passes and parts."""
    found = item.undecided
    if found is None:
        return None
    where = " ".join(word for word in found.largest[1:] if word)
    at = f"at {where}" if found.items == 1 else f"{_share(found.items, item)}, most at {where}"
    return (
        f"undecided: the scatter is {_times(found.factor)} times the predicted one ({at}), which "
        f"so few passes and parts cannot tell from chance (p = {p_value(found.p)})"
    )


def _untested(item: Summary) -> list[str]:
    if not item.scatter_tested:
        return ["the scatter was not tested"]
    return [] if item.bias_tested else ["the mean was not tested"]


def _size(item: Summary) -> str:
    return "some" if item.bias_size is None else f"{_times(item.bias_size, UM)} um"


def _share(count: int, item: Summary) -> str:
    return f"{count} of {item.items}"


def _times(found: Range, unit: float = 1.0) -> str:
    return span(significant(found.least / unit), significant(found.largest / unit))


def paper_scatter(item: Summary) -> str | None:
    """What the paper's scatter, from MS_between, is of the parts' own."""
    if item.ms_share is None or item.n0 is None:
        return None
    n0 = item.n0.median
    return (
        f"MS_between = s_repeat^2 + n0 s_part^2 with n0 = {significant(n0, 4)}: the paper's "
        f"scatter, its root, is {_three(item.ms_share)} times the part-to-part component "
        f"(sqrt(n0) = {significant(n0**0.5, 4)})"
    )


def _three(found: Range) -> str:
    return span(significant(found.least, 3), significant(found.largest, 3))


def verdict(found: Compared, i: int) -> str:
    """Every fault of an item, or the verdict that stands for none."""
    faults = [
        name
        for name, answers in (
            ("biased", found.biased),
            ("under-predicted", found.under_predicted),
            ("over-predicted", found.over_predicted),
            ("inconsistent", found.inconsistent),
        )
        if answers[i]
    ]
    return ", ".join(faults) or found.verdicts[i] or "not tested"
