"""Faults of a graph file that only calculating tells."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.contracts import Findings
from mtu_cli.files.graph_contract import Graph
from mtu_cli.files.graph_file import Rounds
from mtu_cli.model.graph.nominal import correlation_matrix, nominal_values
from mtu_cli.model.graph.outputs import Faults, place_units

NEGATIVE = -1e-9
"""An eigenvalue of correlations below this is no rounding of 0."""


def examine(graph: Graph, rounds: Rounds, findings: Findings) -> None:
    """Adds to `findings` constructions that are degenerate at nominal, formulas whose dimensions
    disagree, and correlations that contradict each other (`files.graph_file.load_graph`).
    """
    _, _, degenerate = nominal_values(graph.places, rounds)
    for index, what in degenerate:
        findings.add(("transitions", index), f"degenerate at nominal: {what}")
    faults: Faults = []
    place_units(graph, (step for fired in rounds for step in fired), faults)
    for step, error in faults:
        path = ("transitions", step.index, "formula")
        document = findings.document
        line = document.line_of(*path)
        findings.problems.append(
            error.problem(file=document.source.shown, line=line, path=path_text(path))
        )
    _check_correlations(graph, findings)


def _check_correlations(graph: Graph, findings: Findings) -> None:
    pairs = [item for item in graph.correlations if item is not None]
    names = list(dict.fromkeys(name for item in pairs for name in item[:2]))
    if len(names) > 2 and len(pairs) == len(graph.correlations):
        least = float(np.linalg.eigvalsh(correlation_matrix(graph, names))[0])
        if least < NEGATIVE:
            what = "the correlations contradict each other: their matrix is not positive"
            findings.add(("correlations",), what, value=round(least, 6))
