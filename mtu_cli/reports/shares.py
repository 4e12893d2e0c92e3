"""What a standard uncertainty consists of: in the report, and as a table."""

from __future__ import annotations

from collections.abc import Sequence

from mtu_cli.model.variance import Shares
from mtu_cli.reports.document import finite
from mtu_cli.reports.numbers import MISSING, fixed
from mtu_cli.reports.tables import Column, Sheet

TITLE = "What u consists of"


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
    items: Sequence[tuple[str, str, Shares | None]],
    more: Sequence[str] = (),
) -> list[Sheet]:
    """One row an item (name, its u, shares), in percent of u^2; no sheet without any share.

    `title` heads the column of u; `more` are notes.
    """
    known = [shares for _, _, shares in items if shares is not None]
    if not known:
        return []
    notes = [
        "coefficients: what the readings leave open, alike for all parts; passes: drift between "
        "passes, which the points of one part share; repeatability: of each visit alone"
    ]
    if any(shares.passes < 0 for shares in known):
        notes.append(
            "below 0: passes differ by less than their repeatability makes them; if that is "
            "chance, u is too small"
        )
    natures = ("coefficients", "passes", "repeatability")
    notes += more
    columns = [
        Column(title="\n", text=True, folds=True),
        Column(title=title),
        *(Column(title=f"{nature}\n% of u^2") for nature in natures),
    ]
    rows = [[f"u({name})", size, *_cells(shares)] for name, size, shares in items]
    return [Sheet(title=TITLE, columns=columns, rows=rows, notes=notes)]


def _cells(shares: Shares | None) -> list[str]:
    if shares is None:
        return [MISSING] * 3
    values = (shares.coefficients, shares.passes, shares.repeatability)
    return [fixed(100 * value, 1) for value in values]
