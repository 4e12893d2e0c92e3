"""Tables of features summed up by operation and axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.anova.parts import FAMILY_RATE
from mtu_cli.analyses.anova.tables import Analysed
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Total:
    """All features of an operation along an axis; mm and mm^2, nan where undefined.

    `mean` of the features' mean errors, their standard deviation `spread` and the `largest` of
    them (with its sign), at feature `worst`. Mean variances `part` and `repeat` by the chosen
    method, `both` where they are not separable; `repeat_share` is the CMM's share of the
    variance of one measured point (REML, whatever the method). Of `tested` features
    `significant` have F above its critical value and `differ` from part to part with the error
    rate held over all features; the mean errors of `off` are not zero, likewise. `rounding` is
    the uncertainty by which the means are worth printing.
    """

    operation: str
    axis: str
    features: int
    mean: float
    spread: float
    largest: float
    worst: str
    part: float
    repeat: float
    both: float
    repeat_share: float
    significant: int
    differ: int
    off: int
    tested: int
    rounding: float

    @property
    def s_part(self) -> float:
        """Root of the mean variance from part to part."""
        return float(np.sqrt(self.part))

    @property
    def s_both(self) -> float:
        """Root of the mean variance of parts measured once."""
        return float(np.sqrt(self.both))

    @property
    def s_repeat(self) -> float:
        """Root of the mean variance of repeats."""
        return float(np.sqrt(self.repeat))


def totals_of(found: Analysed) -> tuple[Total, ...]:
    """One Total an operation and axis, operation by operation."""
    tables = found.tables
    rows: dict[tuple[str, str], list[int]] = {}
    for i, (operation, _, axis) in enumerate(tables.labels):
        rows.setdefault((operation, axis), []).append(i)
    operations = list(dict.fromkeys(operation for operation, _ in rows))
    return tuple(
        _total(found, operation, axis, rows[operation, axis])
        for operation, axis in sorted(rows, key=lambda key: operations.index(key[0]))
    )


def _total(found: Analysed, operation: str, axis: str, own: list[int]) -> Total:
    table, components = found.one_way, found.components
    mean, F = table.mean[own], table.F[own]
    spread = float(mean.std(ddof=1)) if len(mean) > 1 else float("nan")
    part, repeat = _mean(components.part[own]), _mean(components.repeat[own])
    both = _mean(found.both[own])
    apart = _mean(found.reml.part[own]), _mean(found.reml.repeat[own])
    worst = int(np.argmax(np.abs(mean)))
    scales = [np.sqrt(v) for v in (part, repeat, both) if np.isfinite(v)]
    largest = max([*scales, *([spread] if np.isfinite(spread) else [])], default=float("nan"))
    return Total(
        operation=operation,
        axis=axis,
        features=len(own),
        mean=float(mean.mean()),
        spread=spread,
        largest=float(mean[worst]),
        worst=found.tables.labels[own[worst]][1],
        part=part,
        repeat=repeat,
        both=both,
        repeat_share=apart[1] / sum(apart) if sum(apart) > 0 else float("nan"),
        significant=int((table.F_critical_95[own] < F).sum()),
        differ=int((found.p_parts[own] <= FAMILY_RATE).sum()),
        off=int((found.p_mean[own] <= FAMILY_RATE).sum()),
        tested=int(np.isfinite(F).sum()),
        rounding=largest / float(np.sqrt(len(found.tables.parts))),
    )


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
