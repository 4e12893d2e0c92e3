"""Features summed up by operation, and what the data cannot tell or look wrong about."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mtu_cli.analyses.anova.outliers import FAMILY_RATE, FEWEST_PARTS
from mtu_cli.analyses.anova.tables import Analysed, Label, Method
from mtu_cli.findings import Finding, finding
from mtu_cli.model.features import BELOW_THREE, FEW_DOF
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.visits import basis, without
from mtu_cli.stats.least_squares import BoolArray, FloatArray

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


def set_up_warnings(
    found: Analysed, places: dict[str, FloatArray], rounding: float
) -> list[Finding]:
    """Mean errors in the plane most of which one offset and rotation of all features explain.

    By mean squares before and after: the motion's own freedoms count. Errors that the last digit
    makes, whose variance is `rounding`, are none; `places` (3,) mm of the features.
    """
    means = dict(zip(found.labels, found.one_way.mean.tolist(), strict=True))
    planes: dict[str, list[str]] = {}
    for operation, name, axis in found.labels:
        if axis == "x" and (operation, name, "y") in means:
            planes.setdefault(operation, []).append(name)
    warned = []
    for operation, names in planes.items():
        flat = np.array([[*places[name][:2], 0.0] for name in names])
        errors = np.array([[means[operation, name, axis] for axis in "xy"] for name in names])
        Q, before = basis(flat, (0, 1), "offset,rotation"), errors.ravel()
        left = len(before) - Q.shape[1]
        if left < FEWEST_LEFT or not (before**2).mean() > 3 * rounding:
            continue
        rest = float((without(Q, before[:, None]) ** 2).sum()) / left
        explained = 1 - rest / float((before**2).mean())
        if explained < MOST:
            continue
        x, y = (1e3 * value for value in errors.mean(axis=0))
        of = f" of {operation} features" if operation else ""
        facts = {"percent": min(int(100 * explained), 99), "operation": of}
        warned.append(finding("set-up-dominates", x_um=x, y_um=y, **facts))
    return warned


KINDS = {"feature": "features and axes", "length": "lengths", "angle": "right angles"}

Condition = Callable[[Analysed], BoolArray]
CONDITIONS: dict[str, tuple[Condition, dict[str, Any]]] = {
    "few-parts": (
        lambda found: found.one_way.df_between < 1,
        {
            "parts": 1,
            "consequence": "no scatter from part to part, nor of a future part, can be known",
        },
    ),
    "no-repeats": (
        lambda found: found.one_way.df_within < 1,
        {"consequence": "the scatter from part to part contains that of the CMM"},
    ),
    "not-estimable": (
        lambda found: (found.one_way.df_within > 0) & (found.one_way.ms_within == 0),
        {"quantity": "F and p", "reason": "all repeats are equal"},
    ),
    "negative-variance": (
        lambda found: (found.components.part_estimate < 0) & (found.method == "anova"),
        {"what": "part-to-part", "consequence": "0 is used for uncertainties"},
    ),
    "few-degrees-of-freedom": (lambda found: found.dof_future < FEW_DOF, {"how": BELOW_THREE}),
}


def anova_warnings(kinds: Sequence[Analysed], method: Method) -> list[Finding]:
    """Every figure that is missing has its reason here, for each kind of table by name, features
    first.
    """
    result = []
    for code, (condition, facts) in CONDITIONS.items():
        met = [(KINDS[kind.kind], condition(kind)) for kind in kinds]
        items = [some(rows, name) for name, rows in met if rows.any()]
        names = [f"u of a future part ({each})" for each in items]
        if all(rows.all() for _, rows in met):
            items, names = ["all"], ["u of a future part"]
        result += [
            finding(code, items=each, names=[name], **facts)
            for each, name in zip(items, names, strict=True)
        ]
    if method == "paper":
        result.append(finding("paper-method"))
    for kind in kinds:
        what = "measurements" if kind.kind == "feature" else KINDS[kind.kind]
        result += missing_cells(kind.tables, ~kind.tables.cells.present, what)
    parts = len(kinds[0].tables.parts)
    if 2 <= parts < FEWEST_PARTS:
        consequence = f"{FEWEST_PARTS} are needed to find outliers among them"
        result.append(finding("few-parts", parts=parts, items="all", consequence=consequence))
    return result


def some(rows: BoolArray, name: str) -> str:
    """How many of all, such as "2 of 6 features and axes"."""
    count, total = int(rows.sum()), len(rows)
    return f"all {name}" if count == total else f"{count} of {total} {name}"


def missing_cells(tables: MeasuredTables, empty: BoolArray, what: str) -> list[Finding]:
    """Parts that were not measured everywhere: `empty` (tables, parts)."""
    if not empty.any():
        return []
    table, part = (int(index) for index in np.argwhere(empty)[0])
    name = " ".join(word for word in tables.labels[table] if word)
    return [
        finding(
            "missing-values",
            what=f"{int(empty.sum())} of {empty.size} {what} by part",
            names=[f"first: part {tables.parts[part]!r} at {name}"],
            consequence="the rest is analysed with unequal counts",
            part=tables.parts[part],
            label=name,
        )
    ]


def missing_entries(what: str, entries: Iterable[Any], labels: Iterable[Label]) -> list[Finding]:
    """Lengths or angles of the part file that no measurement of a part has all features of."""
    known = {label[1] for label in labels}
    lost = [f"{what} {entry.id}" for entry in entries if entry.id not in known]
    reason = "no measurement of a part, in one operation, has all of its features"
    return [finding("not-measured", names=lost, reason=reason)] if lost else []
