"""Features summed up by operation: totals by axis, maps of the mean errors, set-up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.anova.outliers import FAMILY_RATE
from mtu_cli.analyses.anova.tables import Analysed
from mtu_cli.findings import Finding, finding
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.visits import basis, without
from mtu_cli.stats.least_squares import FloatArray

FEWEST_LEFT, MOST = 6, 0.5
"""With fewer errors left over a rigid motion explains much by chance; the share it may explain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Total:
    """All features of an operation along an axis; mm and mm^2, nan where undefined.

    `mean` of the features' mean errors, their standard deviation `spread` and the `largest` of
    them (with its sign), at feature `worst`. Mean variances `part` and `repeat` by the chosen
    method, `both` where they are not separable; `repeat_share` is the CMM's share of the
    variance of one measured point (REML, whatever the method). Of `tested` features
    `differ` from part to part with the error rate held over all features. `rounding` is the
    uncertainty by which the means are worth printing.
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
    differ: int
    tested: int
    rounding: float


def totals(found: Analysed) -> tuple[Total, ...]:
    """One Total an operation and axis, operation by operation."""
    rows: dict[str, dict[str, list[int]]] = {}
    for i, (operation, _, axis) in enumerate(found.labels):
        rows.setdefault(operation, {}).setdefault(axis, []).append(i)
    return tuple(
        _total(found, operation, axis, members)
        for operation, by_axis in rows.items()
        for axis, members in by_axis.items()
    )


def _total(found: Analysed, operation: str, axis: str, members: list[int]) -> Total:
    def average(values: FloatArray) -> float:
        known = values[members][np.isfinite(values[members])]
        return float(known.mean()) if len(known) else float("nan")

    mean, F = found.one_way.mean[members], found.one_way.F[members]
    spread = float(mean.std(ddof=1)) if len(mean) > 1 else float("nan")
    part, repeat = average(found.components.part), average(found.components.repeat)
    both = average(found.both)
    by_reml = average(found.reml.part), average(found.reml.repeat)
    worst = int(np.argmax(np.abs(mean)))
    scales = [np.sqrt(part), np.sqrt(repeat), np.sqrt(both), spread]
    largest = max([s for s in scales if np.isfinite(s)], default=float("nan"))
    return Total(
        operation=operation,
        axis=axis,
        features=len(members),
        mean=float(mean.mean()),
        spread=spread,
        largest=float(mean[worst]),
        worst=found.labels[members[worst]][1],
        part=part,
        repeat=repeat,
        both=both,
        repeat_share=by_reml[1] / sum(by_reml) if sum(by_reml) > 0 else float("nan"),
        differ=int((found.p_parts[members] <= FAMILY_RATE).sum()),
        tested=int(np.isfinite(F).sum()),
        rounding=largest / float(np.sqrt(len(found.tables.parts))),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureMap:
    """Mean errors (n, 3) of the features of an operation, mm, at nominal `places` (n, 3); nan
    along z where z was not measured or is not known.
    """

    operation: str
    ids: tuple[str, ...]
    places: FloatArray
    errors: FloatArray


def maps(found: Analysed, places: dict[str, FloatArray]) -> tuple[FeatureMap, ...]:
    """The mean errors of features with errors in x and y, one map an operation."""
    means = dict(zip(found.labels, found.one_way.mean.tolist(), strict=True))
    planes: dict[str, list[str]] = {}
    for operation, name, axis in found.labels:
        if axis == "x" and (operation, name, "y") in means:
            planes.setdefault(operation, []).append(name)
    return tuple(
        FeatureMap(
            operation=operation,
            ids=tuple(ids),
            places=np.array([places[name] for name in ids]),
            errors=np.array(
                [[means.get((operation, name, axis), np.nan) for axis in AXES] for name in ids]
            ),
        )
        for operation, ids in planes.items()
    )


def set_up_warnings(found: tuple[FeatureMap, ...], rounding: float) -> list[Finding]:
    """Mean errors most of which one offset and rotation of all features explain.

    By mean squares before and after: the motion's own freedoms count. Errors that the last digit
    makes, whose variance is `rounding`, are none.
    """
    warned = []
    for item in found:
        places = np.column_stack([item.places[:, :2], np.zeros(len(item.ids))])
        errors = item.errors[:, :2]
        Q = basis(places, (0, 1), "offset,rotation")
        before = errors.ravel()
        left = len(before) - Q.shape[1]
        if left < FEWEST_LEFT or not (before**2).mean() > 3 * rounding:
            continue
        rest = float((without(Q, before[:, None]) ** 2).sum()) / left
        explained = 1 - rest / float((before**2).mean())
        if explained < MOST:
            continue
        operation = f" of {item.operation} features" if item.operation else ""
        x, y = (1e3 * value for value in errors.mean(axis=0))
        percent = min(int(100 * explained), 99)
        warned.append(
            finding("set-up-dominates", x_um=x, y_um=y, percent=percent, operation=operation)
        )
    return warned
