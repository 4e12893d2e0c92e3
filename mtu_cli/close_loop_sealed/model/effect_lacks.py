"""Why data have no member of a candidate: columns that are not there, or do not change."""

from __future__ import annotations

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS, STEADY_K, TableData


class NoMember(Exception):  # noqa: N818  # no fault: it says why the data has no such member
    """Why the data has no such member; empty where it could not have one."""


def check_column(name: str, data: TableData) -> None:
    """Raises NoMember, with the reason, unless a column or position is there and changes."""
    if name in data.values:
        if name not in data.changing:
            span = float(np.ptp(data.values[name]))
            more = f" by more than {STEADY_K:g} K" if span else ""
            raise NoMember(f"{name} does not change{more}")
        return
    if name in data.table.axes and name not in POSITIONS:
        # A component without an axis: no position of it is missing.
        raise NoMember
    if name in POSITIONS:
        raise NoMember(f"the position along {name} is not known")
    raise NoMember(f"{name} has gaps" if name in data.table.covariates else f"no column {name}")
