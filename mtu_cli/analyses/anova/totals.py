"""Tables of features summed up by operation and axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.anova import Components, OneWay
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Total:
    """All features of an operation along an axis; mm and mm^2, nan where it cannot be had.

    `mean` of the features' mean errors, their standard deviation `spread` and the `largest` of
    them (with its sign); mean
    variances `part` and `repeat` (REML), `both` where they cannot be told apart; `significant`
    of `tested` features have F above its critical value.
    """

    operation: str
    axis: str
    features: int
    mean: float
    spread: float
    largest: float
    part: float
    repeat: float
    both: float
    significant: int
    tested: int

    @property
    def repeat_share(self) -> float:
        """The CMM's share of the variance of one measured point."""
        total = self.part + self.repeat
        return self.repeat / total if total > 0 else float("nan")


def totals_of(tables: MeasuredTables, table: OneWay, reml: Components) -> tuple[Total, ...]:
    """One Total an operation and axis, operation by operation."""
    rows: dict[tuple[str, str], list[int]] = {}
    for i, (operation, _, axis) in enumerate(tables.labels):
        rows.setdefault((operation, axis), []).append(i)
    operations = list(dict.fromkeys(operation for operation, _ in rows))
    found = []
    for operation, axis in sorted(rows, key=lambda key: operations.index(key[0])):
        own = rows[operation, axis]
        mean, F, critical = table.mean[own], table.F[own], table.F_critical_95[own]
        found.append(
            Total(
                operation=operation,
                axis=axis,
                features=len(own),
                mean=float(mean.mean()),
                spread=float(mean.std(ddof=1)) if len(mean) > 1 else float("nan"),
                largest=float(mean[np.argmax(np.abs(mean))]),
                part=_mean(reml.part[own]),
                repeat=_mean(reml.repeat[own]),
                both=_mean(table.ms_between[own]),
                significant=int((critical < F).sum()),
                tested=int(np.isfinite(F).sum()),
            )
        )
    return tuple(found)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
