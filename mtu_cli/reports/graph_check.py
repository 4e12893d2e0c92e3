"""The report of graph check: what a sound graph holds, and its firing order."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mtu_cli.analyses.graph.check import GraphCheck
from mtu_cli.files.graph import Step
from mtu_cli.findings import listed
from mtu_cli.reports.tables import Column, Sheet

MOST = 12
"""Places named in one cell."""


def document(result: GraphCheck) -> dict[str, Any]:
    """`results` of the report."""
    return {
        "name": result.name,
        "places": dict(result.kinds),
        "transitions": sum(map(len, result.rounds)),
        "probings": result.probings,
        "reported": list(result.reported),
        "firing_order": [
            [{"do": step.do, "in": list(step.inputs), "out": list(step.outputs)} for step in fired]
            for fired in result.rounds
        ],
    }


def table(result: GraphCheck) -> list[Sheet]:
    """One row a round of transitions."""
    columns = [
        Column(title="round"),
        Column(title="fires", text=True, folds=True),
        Column(title="makes", text=True, folds=True),
    ]
    rows = [
        [str(number), _counted(fired), listed((n for s in fired for n in s.outputs), MOST)]
        for number, fired in enumerate(result.rounds, 1)
    ]
    kinds = ", ".join(f"{count} {kind}" for kind, count in result.kinds.items())
    transitions = sum(map(len, result.rounds))
    notes = [
        f"sound: {sum(result.kinds.values())} places ({kinds}), {transitions} transitions, "
        f"{result.probings} probings",
        f"reports {listed(result.reported, MOST)}",
    ]
    return [Sheet(title=f"Graph: {result.name}", columns=columns, rows=rows, notes=notes)]


def _counted(fired: Iterable[Step]) -> str:
    counts: dict[str, int] = {}
    for step in fired:
        counts[step.do] = counts.get(step.do, 0) + 1
    return ", ".join(f"{count} x {do}" if count > 1 else do for do, count in counts.items())


def csv_rows(result: GraphCheck) -> tuple[list[str], Iterable[list[object]]]:
    """One row a transition, in firing order."""
    rows: list[list[object]] = [
        [number, step.do, " ".join(step.inputs), " ".join(step.outputs)]
        for number, fired in enumerate(result.rounds, 1)
        for step in fired
    ]
    return ["round", "do", "in", "out"], rows
