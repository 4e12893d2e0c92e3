"""Faults of a graph file that only calculating tells."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.contract_errors import path_text
from mtu_cli.files.contracts import Findings
from mtu_cli.files.graph_contract import Graph
from mtu_cli.files.graph_file import Rounds
from mtu_cli.model.graph.nominal import correlation_matrix, nominal_values
from mtu_cli.model.graph.units import Faults, not_lengths, place_units
from mtu_cli.stats.least_squares import FloatArray

ROUNDING = 1e-9
"""An eigenvalue of n correlations below -n times this is no rounding of 0, as in budgets."""


def examine(graph: Graph, rounds: Rounds, findings: Findings) -> None:
    """Adds to `findings` constructions that are degenerate at nominal, formulas whose dimensions
    disagree, and correlations that contradict each other (`files.graph_file.load_graph`).
    """
    _, _, degenerate = nominal_values(graph.places, rounds)
    for index, what in degenerate:
        findings.add(("transitions", index), f"degenerate at nominal: {what}")
    faults: Faults = []
    steps = [step for fired in rounds for step in fired]
    place_units(graph, steps, faults)
    for step, error in faults:
        path = ("transitions", step.index, "formula")
        document = findings.document
        line = document.line_of(*path)
        findings.problems.append(
            error.problem(file=document.source.shown, line=line, path=path_text(path))
        )
    for step, at, unit in not_lengths(graph, steps):
        findings.add(
            ("transitions", step.index, "in", at),
            f"{step.do} takes a length here, this place is in {unit}",
            value=step.inputs[at],
            expected="a length in mm",
        )
    _check_correlations(graph, findings)


def _check_correlations(graph: Graph, findings: Findings) -> None:
    pairs = [item for item in graph.correlations if item is not None]
    names = list(dict.fromkeys(name for item in pairs for name in item[:2]))
    sound = all(abs(r) <= 1 and first != second for first, second, r in pairs)
    if len(names) < 3 or len(pairs) < len(graph.correlations) or not sound:
        return
    matrix = correlation_matrix(graph, names)
    if _has_distribution(matrix):
        return
    what = "contradicts the other correlations: their matrix is not positive semi-definite"
    for index, (first, second, r) in reversed(list(enumerate(pairs))):
        found = _possible(matrix, names.index(first), names.index(second))
        if found is not None:
            expected = f"{found[0]:g} to {found[1]:g}, as the others are"
            value = f"{first}, {second}, {r:g}"
            findings.add(("correlations", index), what, value=value, expected=expected)
            return
    first, second = (names[i] for i in _strongest(matrix))
    what = "the correlations contradict each other: their matrix is not positive semi-definite"
    findings.add(("correlations",), what, value=f"{first}, {second} above all")


def _has_distribution(matrix: FloatArray) -> bool:
    return float(np.linalg.eigvalsh(matrix)[0]) >= -ROUNDING * len(matrix)


def _possible(matrix: FloatArray, i: int, j: int) -> tuple[float, float] | None:
    """Between which values r_ij makes the matrix positive semi-definite with the others as they
    are, None for no value: the partial correlation of i and j lies between -1 and 1.
    """
    rest = [k for k in range(len(matrix)) if k not in (i, j)]
    inverse = np.linalg.pinv(matrix[np.ix_(rest, rest)], hermitian=True)
    b, c = matrix[rest, i], matrix[rest, j]
    middle = float(b @ inverse @ c)
    left = (1.0 - float(b @ inverse @ b)) * (1.0 - float(c @ inverse @ c))
    tried = matrix.copy()
    tried[i, j] = tried[j, i] = middle
    if left < 0 or not _has_distribution(tried):
        return None
    low, high = (middle + sign * float(np.sqrt(left)) for sign in (-1, 1))
    return float(np.ceil(1e3 * low - 1e-6) / 1e3), float(np.floor(1e3 * high + 1e-6) / 1e3)


def _strongest(matrix: FloatArray) -> tuple[int, int]:
    """The pair that takes most from the least eigenvalue v' R v: the most negative v_i r_ij v_j."""
    v = np.linalg.eigh(matrix)[1][:, 0]
    parts = np.triu(matrix * np.outer(v, v), 1)
    i, j = np.unravel_index(np.argmin(parts), parts.shape)
    return int(i), int(j)
