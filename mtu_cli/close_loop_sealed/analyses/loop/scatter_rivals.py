"""Which candidates of its class a scatter could be mistaken for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns
from mtu_cli.stats.least_squares import FloatArray

SHARED = 0.05
"""Of a column's squares, what it must have where a scatter is looked for to be a rival of it."""
ROTATION, OPERATIONS = "rotation-scatter", "operation-scatter"


def apart_from(prepared: Prepared, step: Step) -> tuple[int, ...]:
    """The candidates in the credible set of a scatter that no data could show as that scatter.

    A scatter of turns or of growths is judged by one direction of every part, one of operations by
    what is left beside parts and columns. A mean error, a straight line that all parts share, a
    shift of whole parts have nothing there: as likely as the scatter, they are other findings and
    no readings of it. Nor are other scatters: a turn and a growth are orthogonal.
    """
    scan = prepared.scan
    if step.index < scan.tested:
        return ()
    name = scan.names[step.index]
    return tuple(
        index
        for index in step.credible
        if index != step.index
        and not (
            index < len(scan.columns)
            and any(
                share >= SHARED for m in scan.columns[index] for share in _shares(prepared, name, m)
            )
        )
    )


def _shares(prepared: Prepared, name: str, member: MemberColumns) -> Iterator[float]:
    """Of each column's squares the share in the coordinates that a scatter is judged by."""
    scan = prepared.scan
    strata = scan.frame.strata
    direction = scan.directions[0 if name == ROTATION else 1]
    for column in member:
        whole = sum(float(values @ values) for values in column.values())
        along: FloatArray = np.zeros(strata.shape[0] - 1)
        within = 0.0
        for index, values in column.items():
            stratum = strata.all[index]
            if stratum.kind == "line":
                along += direction[stratum.axis, stratum.line] * values
            elif stratum.kind == "interaction":
                within += float(values @ values)
        own = within if name == OPERATIONS else float(along @ along)
        yield own / whole if whole > 0 else 0.0
