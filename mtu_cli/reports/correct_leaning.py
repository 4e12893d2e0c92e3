"""What correct says of circles whose points lie at different heights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.correct.leaning import Leaning
from mtu_cli.errors import Warned, listed
from mtu_cli.findings import Finding
from mtu_cli.reports.numbers import significant
from mtu_cli.units import UM


def heights_differ(leaning: Sequence[Leaning]) -> list[Finding]:
    """A warning for each direction that heights differ along."""
    found = []
    for axis in dict.fromkeys(own.axis for own in leaning):
        items = [own for own in leaning if own.axis == axis]
        worst = max(items, key=lambda own: own.larger)
        where = "the bore, which is inclined" if axis is None else axis
        # Without z a circle is that of x and y: of another direction it is none.
        without = ", or leave z_mm out of the points" if axis == "z" else ""
        mend = f"touch it at one height{without}"
        text = (
            f"the points of {listed(map(_label, items))} lie at different heights along {where} "
            f"({_label(worst)}: the plane through them leans by "
            f"{significant(float(np.degrees(worst.angle)))} degrees): a bore that does not lean is "
            f"oval in it, and {significant(worst.larger / UM)} um larger: {mend}"
        )
        found.append(Warned(code="heights-differ", message=text))
    return found


def _label(own: Leaning) -> str:
    return f"{own.operation} {own.id}".strip()
