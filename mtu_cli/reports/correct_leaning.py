"""What correct says of circles whose points lie at different heights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.correct.leaning import Leaning
from mtu_cli.findings import Finding, finding
from mtu_cli.units import UM


def heights_differ(leaning: Sequence[Leaning]) -> list[Finding]:
    """A warning for each direction that heights differ along."""
    found = []
    for axis in dict.fromkeys(own.axis for own in leaning):
        items = [own for own in leaning if own.axis == axis]
        worst = max(items, key=lambda own: own.larger)
        # Without z a circle is that of x and y: of another direction it is none.
        without = ", or no column z_mm" if axis == "z" else ""
        found.append(
            finding(
                "heights-differ",
                names=list(dict.fromkeys(map(_label, items))),
                axis="the axis of the inclined bore" if axis is None else axis,
                worst=_label(worst),
                angle_deg=float(np.degrees(worst.angle)),
                larger_um=worst.larger / UM,
                expected=f"points at one height{without}",
            )
        )
    return found


def _label(own: Leaning) -> str:
    return f"{own.operation} {own.id}".strip()
