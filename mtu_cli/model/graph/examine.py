"""Faults of a graph file that only calculating tells."""

from __future__ import annotations

import numpy as np

from mtu_cli.files.contract import Faults
from mtu_cli.files.graph import Rounds, Step
from mtu_cli.files.graph_contract import Graph
from mtu_cli.findings import InputError
from mtu_cli.model.graph.nominal import correlation_matrix, nominal_values
from mtu_cli.model.graph.units import not_lengths, place_units
from mtu_cli.stats.least_squares import FloatArray

CONTRADICT = "the correlations contradict each other: their matrix is not positive semi-definite"
ROUNDING = 1e-9
"""An eigenvalue of n correlations below -n times this is no rounding of 0, as in budgets."""


def examine(graph: Graph, rounds: Rounds, faults: Faults) -> None:
    """Adds to `faults` constructions that are degenerate at nominal, formulas whose dimensions
    disagree, and correlations that contradict each other (`files.graph.load_graph`).
    """
    _, _, degenerate = nominal_values(graph.places, rounds)
    for index, own in degenerate:
        faults.extend(("transitions", index), [own])
    steps = [step for fired in rounds for step in fired]
    disagreeing: list[tuple[Step, InputError]] = []
    place_units(graph, steps, disagreeing)
    for step, error in disagreeing:
        faults.extend(("transitions", step.index, "formula"), error)
    for step, at, unit in not_lengths(graph, steps):
        path, kind = ("transitions", step.index, "in", at), f"a length, as {step.do} takes here"
        given = {"value": step.inputs[at], "expected": f"a place in mm, not in {unit}"}
        faults.add(path, "wrong-type", kind=kind, **given)
    _check_correlations(graph, faults)


def _check_correlations(graph: Graph, faults: Faults) -> None:
    """That their matrix is one: the last pair that the others forbid, and what they allow it."""
    pairs = [item for item in graph.correlations if item is not None]
    names = list(dict.fromkeys(name for item in pairs for name in item[:2]))
    sound = all(abs(r) <= 1 and first != second for first, second, r in pairs)
    if len(names) < 3 or len(pairs) < len(graph.correlations) or not sound:
        return
    matrix = correlation_matrix(graph, names)
    if _has_distribution(matrix):
        return
    for index, (first, second, r) in reversed(list(enumerate(pairs))):
        found = _possible(matrix, names.index(first), names.index(second))
        if found is not None:
            expected = f"{found[0]:g} to {found[1]:g}, as the others are"
            value = f"{first}, {second}, {r:g}"
            given = {"reason": CONTRADICT, "value": value, "expected": expected}
            faults.add(("correlations", index), "wrong-correlation", **given)
            return
    faults.add(("correlations",), "wrong-correlation", reason=CONTRADICT)


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
