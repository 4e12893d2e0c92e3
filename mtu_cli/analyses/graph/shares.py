"""Through which measured places and constants does the variance of a place come in?"""

from __future__ import annotations

import numpy as np

from mtu_cli.findings import error
from mtu_cli.model.graph.first_order import first_order
from mtu_cli.model.graph.measurement_graph import MeasurementGraph, evaluation


def shares_by_place(graph: MeasurementGraph, of: str) -> dict[str, float]:
    """Shares of the first-order variance of `of` by the place where they come in, summing to 1;
    of a place with several coordinates, of the sum of their variances.

    Raises InputError for an unknown place, one whose coordinates have different units, or where
    the first-order variance is 0.
    """
    outputs = graph.outputs([of])
    if len({item.unit for item in outputs}) > 1:
        names, reason = ", ".join(map(str, outputs)), "the place has several coordinates"
        raise error("not-applicable", reason=reason, value=of, expected=f"one of: {names}")
    linear = first_order(evaluation(graph, outputs))
    total = float(np.sum(linear.u**2))
    if total == 0:
        reason = "the first-order uncertainty is 0: no shares of variance"
        raise error("not-applicable", reason=reason, value=of, expected="another place")
    return {
        name: float(np.nansum(values * linear.u**2) / total)
        for name, values in linear.by_place.items()
    }
