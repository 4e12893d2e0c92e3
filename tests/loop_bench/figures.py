"""The measures of the bar, as figures with 95 % intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from loop_bench.cells import TELLABLE, Record

Limits = tuple[float, float]
"""Lowest and highest value that holds."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """`value` with its 95 % interval, of `count` data sets; `reach` and `beyond` are the limits
    of the bar, None where it has none. `percent`: a share.
    """

    value: float
    low: float
    high: float
    count: int
    percent: bool = True
    reach: Limits | None = None
    beyond: Limits | None = None

    def holds(self) -> str:
        """`open` where the interval reaches over the limit."""
        if self.reach is None and self.beyond is None:
            return ""
        if not self.count:
            return "-"
        for name, limits in (("beyond", self.beyond), ("reached", self.reach)):
            if limits is not None and limits[0] <= self.value <= limits[1]:
                return name
        nearest = self.reach or self.beyond
        touches = nearest is not None and self.low <= nearest[1] and self.high >= nearest[0]
        return "missed, open" if touches else "MISSED"


def binomial(hits: int, count: int) -> Limits:
    """95 % interval of Clopper and Pearson, Biometrika 26 (1934) 404."""
    low = float(betaincinv(hits, count - hits + 1, 0.025)) if hits else 0.0
    high = float(betaincinv(hits + 1, count - hits, 0.975)) if hits < count else 1.0
    return low, high


def share(of: Iterable[bool], reach: Limits | None = None, beyond: Limits | None = None) -> Figure:
    """The share of what is true."""
    found = [bool(item) for item in of]
    hits, count = sum(found), len(found)
    low, high = binomial(hits, count) if count else (0.0, 1.0)
    value = hits / count if count else np.nan
    return Figure(value=value, low=low, high=high, count=count, reach=reach, beyond=beyond)


def names_right(record: Record, name: str | None) -> bool:
    """Whether a name is that of a truth, or of what is the same on this data."""
    return name is not None and any(
        name == truth or name in aliases
        for truth, aliases in zip(record["truths"], record["aliases"], strict=True)
    )


def detected(records: Sequence[Record]) -> list[Record]:
    return [record for record in records if record["names"]]


def right_first(record: Record) -> bool:
    return bool(record["names"]) and names_right(record, record["names"][0])


def class_holds(record: Record) -> bool:
    return any(names_right(record, name) for name in record["first_class"])


def lone_wrong(record: Record) -> bool:
    return bool(record["lone"]) and not right_first(record)


def flagged(record: Record) -> bool:
    return bool(record["fired"]) or bool(record["nameless"])


def named(record: Record) -> list[str]:
    """Without offsets: true effects have no mean here, which those in the library may have."""
    return [name for name in record["names"] if not name.startswith("offset-")]


def exact_pair(record: Record) -> bool:
    """Each of the two named once, and nothing else."""
    names = named(record)
    truths = list(zip(record["truths"], record["aliases"], strict=True))
    orders = (truths, truths[::-1])
    return len(names) == len(truths) and any(
        all(name == t or name in also for name, (t, also) in zip(names, order, strict=True))
        for order in orders
    )


def class_size(records: Sequence[Record], reach: Limits, beyond: Limits) -> Figure:
    """Mean over the families of their mean class size; its error by the spread within them."""
    means, variances, count = [], [], 0
    for own in by_family(detected(records)).values():
        sizes = np.array([len(record["first_class"]) for record in own], float)
        means.append(float(sizes.mean()))
        variances.append(float(sizes.var(ddof=1)) / len(sizes) if len(sizes) > 1 else 0.0)
        count += len(sizes)
    if not means:
        return Figure(value=np.nan, low=0, high=np.inf, count=0, percent=False)
    value, u = float(np.mean(means)), float(np.sqrt(np.sum(variances)) / len(means))
    return Figure(
        value=value, low=value - 1.96 * u, high=value + 1.96 * u, count=count, percent=False,
        reach=reach, beyond=beyond,
    )  # fmt: skip


def by_family(records: Sequence[Record]) -> dict[str, list[Record]]:
    found: dict[str, list[Record]] = {}
    for record in records:
        found.setdefault("+".join(record["families"]), []).append(record)
    return found


def oracle_share(
    records: Sequence[Record],
    reach: Limits | None = None,
    beyond: Limits | None = None,
    of: str = "",
    *,
    oracle: str = "oracle",
    reported: bool = False,
) -> Figure:
    """Sum of the engine's held-out gains over that of the oracle's; interval by the ratio's
    linearised variance. `oracle` names the record of the oracle; `reported`: as a command
    reports, which says before = after where the machine gets no equation.
    """
    pairs = np.array(
        [
            (
                (record["before" + of] - record["after" + of])
                * (not reported or record["written"]),
                record["before" + of] - record[oracle + of],
            )
            for record in records
            if "after" + of in record and oracle + of in record
        ]
    )
    if len(pairs) < 2:
        return Figure(value=np.nan, low=0, high=np.inf, count=len(pairs), percent=False)
    gain, best = pairs.sum(axis=0)
    value = float(gain / best)
    left = pairs[:, 0] - value * pairs[:, 1]
    u = float(np.sqrt(len(pairs)) * left.std(ddof=1) / best)
    return Figure(
        value=value, low=value - 1.96 * u, high=value + 1.96 * u, count=len(pairs), percent=False,
        reach=reach, beyond=beyond,
    )  # fmt: skip


def median(
    values: Sequence[float], reach: Limits | None = None, beyond: Limits | None = None
) -> Figure:
    """With the 5th and 95th percentile."""
    if not values:
        return Figure(value=np.nan, low=np.nan, high=np.nan, count=0, percent=False)
    low, middle, high = (float(value) for value in np.quantile(values, [0.05, 0.5, 0.95]))
    return Figure(
        value=middle, low=low, high=high, count=len(values), percent=False,
        reach=reach, beyond=beyond,
    )  # fmt: skip


def tellable(record: Record) -> bool:
    return record["d"] is not None and record["d"] >= TELLABLE


def where(records: Sequence[Record], which: Callable[[Record], bool]) -> list[Record]:
    return [record for record in records if which(record)]
