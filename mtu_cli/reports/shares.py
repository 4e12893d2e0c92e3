"""What a standard uncertainty consists of: in the report, and as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mtu_cli.model.variance import Shares
from mtu_cli.reports.document import finite
from mtu_cli.reports.numbers import MISSING, fixed, significant
from mtu_cli.reports.tables import Column, Sheet

TITLE = "What u consists of"
NATURES = ("coefficients", "passes", "repeatability")
MEANT = (
    "coefficients: what the readings leave open, alike for all parts; passes: drift between "
    "passes, which the points of one part share; repeatability: of each visit alone",
    "u is of one part to come; of the mean over many parts only the share of the coefficients "
    "counts",
)
BELOW_0 = (
    "below 0: passes differ by less than their repeatability makes them; if that may be chance, "
    "take the u without passes for one part to come"
)


def shares_fields(shares: Shares | None) -> dict[str, float | None] | None:
    """`shares` beside an uncertainty, 1 in all; None where it has none."""
    if shares is None:
        return None
    return {
        "coefficients": finite(shares.coefficients),
        "passes": finite(shares.passes),
        "repeatability": finite(shares.repeatability),
    }


def shares_sheets(
    title: str,
    unit: str,
    items: Sequence[tuple[str, float, Shares | None]],
    digits: int,
    more: Sequence[str] = (),
) -> list[Sheet]:
    """One row an item (name, its u in `unit`, shares), in percent of u^2; no sheet without any
    share.

    `title` heads the column of u; `more` are notes. Where the share of the passes is below 0, u
    without it stands beside.
    """
    known = [shares for _, _, shares in items if shares is not None]
    if not known:
        return []
    safer = any(shares.passes < 0 for shares in known)
    columns = [
        Column(title="\n", text=True, folds=True),
        Column(title=f"{title}\n{unit}"),
        *(Column(title=f"{nature}\n% of u^2") for nature in NATURES),
        *([Column(title=f"u without\npasses, {unit}")] if safer else []),
    ]
    rows = [
        [
            f"u({name})",
            significant(u, digits),
            *_cells(shares),
            *([significant(_without_passes(u, shares), digits)] if safer else []),
        ]
        for name, u, shares in items
    ]
    notes = [*MEANT, *([BELOW_0] if safer else []), *more]
    return [Sheet(title=TITLE, columns=columns, rows=rows, notes=notes)]


def _without_passes(u: float, shares: Shares | None) -> float | None:
    """u of an item whose passes take off it, had they not; None of one whose passes do not."""
    if shares is None or not shares.passes < 0:
        return None
    return u * math.sqrt(shares.coefficients + shares.repeatability)


def _cells(shares: Shares | None) -> list[str]:
    if shares is None:
        return [MISSING] * 3
    values = (shares.coefficients, shares.passes, shares.repeatability)
    return [fixed(100 * value, 1) for value in values]
