"""What an analysis of variance has to warn of: figures that the data cannot give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.anova.parts import FEWEST_PARTS
from mtu_cli.analyses.anova.tables import Analysed, Method
from mtu_cli.findings import Finding, finding
from mtu_cli.model.features import BELOW_THREE, FEW_DOF
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.stats.anova import BoolArray

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart

NO_MEASUREMENT = "no measurement of a part, in one operation, has all of its features"
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
        met = [(item, condition(item)) for item in kinds]
        every = all(rows.all() for _, rows in met)
        items = ["all"] if every else [_some(item, rows) for item, rows in met if rows.any()]
        found += [finding(code, items=each, names=[_future(each)], **facts) for each in items]
    if method == "paper":
        found.append(finding("paper-method"))
    empty = [w for item in kinds for w in _empty(item)]
    return [*found, *empty, *_few(kinds[0].tables)]


def _some(item: Analysed, rows: BoolArray) -> str:
    count, total = int(rows.sum()), len(rows)
    name = KINDS[item.kind]
    return f"all {name}" if count == total else f"{count} of {total} {name}"


def _future(items: str) -> str:
    return "u of a future part" if items == "all" else f"u of a future part ({items})"


def _empty(item: Analysed) -> list[Finding]:
    tables = item.tables
    empty = ~tables.cells.present
    if not empty.any():
        return []
    table, part = (int(index) for index in np.argwhere(empty)[0])
    name = " ".join(word for word in tables.labels[table] if word)
    what = "measurements" if item.kind == "feature" else KINDS[item.kind]
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


def _few(tables: MeasuredTables) -> list[Finding]:
    if len(tables.parts) >= FEWEST_PARTS or len(tables.parts) < 2:
        return []
    consequence = f"{FEWEST_PARTS} are needed to find outliers among them"
    count = len(tables.parts)
    return [finding("few-parts", parts=count, items="all", consequence=consequence)]


def missing_entries(
    part: LoadedPart, lengths: MeasuredTables | None, angles: MeasuredTables | None
) -> list[Finding]:
    """Lengths and angles of the part file that no measurement of a part has all features of."""
    found = []
    for what, entries, tables in (
        ("length", part.part.lengths, lengths),
        ("right angle", part.part.orthogonality, angles),
    ):
        known = set() if tables is None else {label[1] for label in tables.labels}
        lost = [f"{what} {entry.id}" for entry in entries if entry.id not in known]
        if lost:
            found.append(finding("not-measured", names=lost, reason=NO_MEASUREMENT))
    return found
