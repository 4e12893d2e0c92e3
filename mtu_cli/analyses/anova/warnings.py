"""What an analysis of variance has to warn of: figures that the data cannot give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova.parts import FEWEST_PARTS
from mtu_cli.analyses.anova.tables import Analysed, Method
from mtu_cli.errors import Warned
from mtu_cli.findings import Finding
from mtu_cli.model.features import FEW_DOF
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.outlying_points import outlying
from mtu_cli.stats.anova import BoolArray

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart
    from mtu_cli.files.points import Points

MOST_NAMED = 6
KINDS = {"feature": "features and axes", "length": "lengths", "angle": "right angles"}

Condition = Callable[[Analysed], BoolArray]
CONDITIONS: dict[str, tuple[Condition, str]] = {
    "one-part": (
        lambda found: found.one_way.df_between < 1,
        "there is one part only, so nothing can be said of the scatter from part to part, nor "
        "of a future part",
    ),
    "no-repeats": (
        lambda found: found.one_way.df_within < 1,
        "no part was measured twice: nothing can be said of the CMM's scatter. The scatter from "
        "part to part, and of a future part, holds it",
    ),
    "zero-variance": (
        lambda found: (found.one_way.df_within > 0) & (found.one_way.ms_within == 0),
        "all repeats are equal, so that F and p cannot be had",
    ),
    "negative-variance": (
        lambda found: (found.components.part_estimate < 0) & (found.method == "anova"),
        "the part-to-part variance is estimated below zero; 0 is used for uncertainties",
    ),
    "few-degrees-of-freedom": (
        lambda found: found.dof_future < FEW_DOF,
        "fewer than 3 degrees of freedom are behind u of a future part: U = k u is too small; "
        "use the 95 % interval (interval95_future)",
    ),
}
PAPER = (
    "--method paper takes MS_between for the part-to-part variance, without an interval, and "
    "leaves it out of the uncertainties, as Gilsinn & Ling 2004 do, eqs. (29)-(34)"
)


def anova_warnings(kinds: Sequence[Analysed], method: Method, points: Points) -> list[Finding]:
    """Every figure that is missing has its reason here, for each kind of table by name, features
    first; and every reading of the `points` that pulls them.
    """
    found = []
    for code, (condition, text) in CONDITIONS.items():
        met = [(item, condition(item)) for item in kinds]
        if all(rows.all() for _, rows in met):
            found.append(Warned(code=code, message=text))
            continue
        found += [
            Warned(code=code, message=f"{_some(item, rows)}: {text}")
            for item, rows in met
            if rows.any()
        ]
    if method == "paper":
        found.append(Warned(code="paper-method", message=PAPER))
    tables = kinds[0].tables
    empty = [w for item in kinds for w in _empty(item)]
    # What pulls all figures comes before what cannot be had.
    return [*outlying(tables, points).warnings, *found, *empty, *_few(tables)]


def _some(item: Analysed, rows: BoolArray) -> str:
    count, total = int(rows.sum()), len(rows)
    name = KINDS[item.kind]
    return f"all {name}" if count == total else f"{count} of {total} {name}"


def _empty(item: Analysed) -> list[Finding]:
    tables = item.tables
    empty = ~tables.cells.present
    if not empty.any():
        return []
    table, part = (int(index) for index in np.argwhere(empty)[0])
    name = " ".join(word for word in tables.labels[table] if word)
    what = "measurements" if item.kind == "feature" else KINDS[item.kind]
    text = (
        f"{int(empty.sum())} of {empty.size} {what} by part are missing (first: part "
        f"{tables.parts[part]!r} was not measured at {name}); the rest is analysed with unequal "
        "counts"
    )
    return [Warned(code="empty-cells", message=text)]


def _few(tables: MeasuredTables) -> list[Finding]:
    if len(tables.parts) >= FEWEST_PARTS or len(tables.parts) < 2:
        return []
    text = f"{len(tables.parts)} parts are too few to say which stands out; {FEWEST_PARTS} are"
    return [Warned(code="few-parts", message=f"{text} needed")]


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
        lost = [entry.id for entry in entries if entry.id not in known]
        if lost:
            more = f" and {len(lost) - MOST_NAMED} more" if len(lost) > MOST_NAMED else ""
            text = (
                f"{what} {', '.join(lost[:MOST_NAMED])}{more} is left out: no measurement of a "
                "part, in one operation, has all of its features"
            )
            found.append(Warned(code="not-measured", message=text))
    return found
