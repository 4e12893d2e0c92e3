"""What an analysis of variance has to warn of: figures that the data cannot give."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from mtu_cli.analyses.anova.outliers import FEWEST_PARTS
from mtu_cli.analyses.anova.tables import Analysed, Label, Method
from mtu_cli.findings import Finding, finding
from mtu_cli.model.features import BELOW_THREE, FEW_DOF
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.least_squares import BoolArray

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
    found = []
    for code, (condition, facts) in CONDITIONS.items():
        met = [(KINDS[kind.kind], condition(kind)) for kind in kinds]
        items = [some(rows, name) for name, rows in met if rows.any()]
        names = [f"u of a future part ({each})" for each in items]
        if all(rows.all() for _, rows in met):
            items, names = ["all"], ["u of a future part"]
        found += [
            finding(code, items=each, names=[name], **facts)
            for each, name in zip(items, names, strict=True)
        ]
    if method == "paper":
        found.append(finding("paper-method"))
    for kind in kinds:
        what = "measurements" if kind.kind == "feature" else KINDS[kind.kind]
        found += missing_cells(kind.tables, ~kind.tables.cells.present, what)
    parts = len(kinds[0].tables.parts)
    if 2 <= parts < FEWEST_PARTS:
        consequence = f"{FEWEST_PARTS} are needed to find outliers among them"
        found.append(finding("few-parts", parts=parts, items="all", consequence=consequence))
    return found


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
