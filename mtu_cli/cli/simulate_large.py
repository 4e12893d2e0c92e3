"""Effects of `simulate` that are larger than any machine's: written as if they were in um."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.findings import Finding, finding
from mtu_cli.language import Node
from mtu_cli.model.effect_ranges import LARGE_MM, STEEP
from mtu_cli.model.simulate import PartsPlan, SimulatedPoints
from mtu_cli.model.simulate_equations import Visits, error_values
from mtu_cli.stats.least_squares import FloatArray


def large_warnings(
    plan: PartsPlan, found: SimulatedPoints, ids: Sequence[str], points: FloatArray
) -> list[Finding]:
    """Asks for the unit of every --effect and --scatter that is above `LARGE_MM` at some feature,
    and above `STEEP` of how far apart the features `ids` at `points` (n, 3) mm are.
    """
    once = found.repeat == 1
    rank = {name: i for i, name in enumerate(ids)}
    code = np.array([rank[name] for name in found.feature])[once]
    visits = Visits(
        part=1,
        ids=[ids[i] for i in code],
        points=points[code],
        values={name: values[once] for name, values in found.covariates.items()},
    )
    known = np.nan_to_num(points)
    moved = float(max(np.abs(known).max(), np.ptp(known, axis=0).max()))
    parts = np.array(found.part)[once]
    warnings = []
    for option, equations in (("--effect", plan.effects), ("--scatter", plan.scatter)):
        for axis, node in equations:
            largest, row = _largest(f"{option} E{axis}", node, visits)
            if abs(largest) > max(LARGE_MM, STEEP * moved):
                warnings.append(
                    finding(
                        "effect-too-large",
                        effect=f"{option} E{axis}",
                        value_mm=largest,
                        where=f" in part {parts[row]} at feature {visits.ids[row]!r}",
                        expected="mm, 0.003 for 3 um",
                    )
                )
    return warnings


def _largest(option: str, node: Node, visits: Visits) -> tuple[float, int]:
    """The value of largest size, mm, and its row."""
    values = error_values(option, node, visits)
    row = int(np.argmax(np.abs(values)))
    return float(values[row]), row
