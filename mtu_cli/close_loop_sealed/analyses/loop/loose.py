"""Single features that scatter more than all others: no effect of a machine, nor repeatability."""

from __future__ import annotations

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import TableResult
from mtu_cli.close_loop_sealed.model.loose_features import loose_features
from mtu_cli.findings import Finding


def loose_warnings(result: TableResult) -> list[Finding]:
    """Without gross entries, which are single ones. Of readings none: their places are not looked
    at for themselves.

    An operation may have been found to scatter for one of its features: that is told then, too.
    """
    given = result.table
    if given.component is not None:
        return []
    left = given.errors - result.explained
    places = given.places.mean(axis=0)
    there = np.asarray(np.isfinite(left).all(axis=2))
    return loose_features(left, there, places, given.features, given.axes)
