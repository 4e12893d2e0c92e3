"""Features whose mean error is an outlier, and how much of the mean errors is set-up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.anova.parts import FAMILY_RATE, Label
from mtu_cli.findings import Finding, finding
from mtu_cli.model.datum import basis, without
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.anova import OneWay
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import deviation_p

FEWEST_FEATURES = 5
"""Among fewer features none can be called an outlier."""
FEWEST_LEFT = 6
"""With fewer errors left over than this, a rigid motion explains much by chance."""
MOST = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusualFeature:
    """A feature whose mean error along an axis lies `deviation` (mm) from the mean of all
    features of the operation, the others `typical` (root mean square); family-wise `p`.
    """

    where: Label
    p: float
    deviation: float
    typical: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureMap:
    """Mean errors (n, 3) of the features of an operation, mm, at nominal `places` (n, 3); nan
    along z where z was not measured or is not known.
    """

    operation: str
    ids: tuple[str, ...]
    places: FloatArray
    errors: FloatArray


def unusual_features(tables: MeasuredTables, table: OneWay) -> tuple[UnusualFeature, ...]:
    """Mean errors too far from the other features' of the same operation and axis.

    Grubbs's statistic with the bound of Bonferroni over all features and axes: 5 % of studies
    whose features differ as normal draws do have a false alarm.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for i, (operation, _, axis) in enumerate(tables.labels):
        groups.setdefault((operation, axis), []).append(i)
    found = []
    for own in groups.values():
        n = len(own)
        away = table.mean[own] - table.mean[own].mean()
        s = float(np.sqrt((away**2).sum() / max(n - 1, 1)))
        if n < FEWEST_FEATURES or s == 0:
            continue
        p = deviation_p(away / s, np.full(n, float(n))) * len(tables.labels)
        for j in np.flatnonzero(p <= FAMILY_RATE):
            others = np.delete(table.mean[own], j)
            found.append(
                UnusualFeature(
                    where=tables.labels[own[int(j)]],
                    p=float(p[j]),
                    deviation=float(table.mean[own[int(j)]] - others.mean()),
                    typical=float(np.sqrt(((others - others.mean()) ** 2).mean())),
                )
            )
    return tuple(sorted(found, key=lambda item: item.p))


def maps(
    tables: MeasuredTables, table: OneWay, places: dict[str, FloatArray]
) -> tuple[FeatureMap, ...]:
    """The mean errors of features with errors in x and y, one map an operation."""
    index = {label: i for i, label in enumerate(tables.labels)}
    found = []
    for operation in dict.fromkeys(label[0] for label in tables.labels):
        ids = tuple(
            name
            for own, name, axis in tables.labels
            if (own, axis) == (operation, "x") and (operation, name, "y") in index
        )
        if not ids:
            continue
        rows = [[index.get((operation, name, axis), -1) for axis in AXES] for name in ids]
        errors: FloatArray = np.where(np.array(rows) < 0, np.nan, table.mean[np.array(rows)])
        found.append(
            FeatureMap(
                operation=operation,
                ids=ids,
                places=np.array([places[name] for name in ids]),
                errors=errors,
            )
        )
    return tuple(found)


def set_up_warnings(found: tuple[FeatureMap, ...]) -> list[Finding]:
    """Mean errors most of which one offset and rotation of all features explain.

    By mean squares before and after: the motion's own freedoms count.
    """
    warned = []
    for item in found:
        places = np.column_stack([item.places[:, :2], np.zeros(len(item.ids))])
        errors = item.errors[:, :2]
        Q = basis(places, (0, 1), "offset,rotation")
        before = errors.ravel()
        left = len(before) - Q.shape[1]
        if left < FEWEST_LEFT or not before.any():
            continue
        rest = float((without(Q, before[:, None]) ** 2).sum()) / left
        total = float((before**2).mean())
        if 1 - rest / total < MOST:
            continue
        share = min(int(100 * (1 - rest / total)), 99)
        operation = f" of {item.operation} features" if item.operation else ""
        x, y = (1e3 * value for value in errors.mean(axis=0))
        warned.append(
            finding("set-up-dominates", x_um=x, y_um=y, percent=share, operation=operation)
        )
    return warned
