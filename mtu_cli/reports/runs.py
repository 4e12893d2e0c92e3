"""Which passes are one run there and back: in the report, and as a note below the table."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtu_cli.findings import listed
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.model.passes import Passes, PassKey

SHOWN = 12
"""Runs, and components, that a note names."""


def runs_fields(found: ComponentFit | None) -> list[dict[str, Any]] | None:
    """`runs` of a component: its passes by run, each in time; None where no passes are given.

    Of every pass the `file`, counted from 1 among the ball-bar and laser files of `inputs`, its
    number in there, and the `direction`: 1 forward, -1 reverse, 0 not told.
    """
    runs = [
        {"role": item.role, "passes": [_pass(item.read.keys[g]) for g in own]}
        for item in (() if found is None else found.instruments)
        if item.read is not None
        for own in _runs(item.read)
    ]
    return runs or None


def _pass(key: PassKey) -> dict[str, int]:
    file, number, direction = key
    return {"file": file + 1, "pass": number, "direction": direction}


def _runs(read: Passes) -> list[list[int]]:
    """The places of the passes of each run, runs and passes in time."""
    in_time = np.argsort(read.order, kind="stable")
    return [[int(g) for g in in_time if read.runs[g] == run] for run in np.unique(read.runs)]


def runs_notes(fit: MachineFit) -> list[str]:
    """One line for all components whose passes form the same runs; none where no pass could have
    had another as its way back.
    """
    grouped: dict[str, list[str]] = {}
    for name, found in fit.components.items():
        for item in found.instruments:
            if told := _told(item):
                shown = name if len(found.instruments) == 1 else f"{name} ({item.role})"
                grouped.setdefault(told, []).append(shown)
    return [f"{listed(names, SHOWN)}: {told}" for told, names in grouped.items()]


def _told(item: InstrumentFit) -> str | None:
    read = item.read
    if read is None or not {1, -1} <= {key[2] for key in read.keys}:
        return None
    runs = _runs(read)
    passes = {key[:2] for key in read.keys}
    several = len({file for file, _ in passes}) > 1
    names = ["+".join(dict.fromkeys(_name(read.keys[g][:2], several) for g in own)) for own in runs]
    back = [len({read.keys[g][2] for g in own}) > 1 for own in runs]
    how = "there and back" if all(back) else f"{sum(back)} there and back"
    count = f"{len(passes)} pass{'es' if len(passes) > 1 else ''}"
    among = f"{len(runs)} run{'s' if len(runs) > 1 else ''}"
    # Of a pass that was read both ways there is nothing to be told but that.
    which = "" if len(runs) == len(passes) and all(back) else f": {listed(names, SHOWN)}"
    return f"{count} in {among} ({'file.pass, ' if several and which else ''}{how}){which}"


def _name(key: tuple[int, int], several: bool) -> str:
    """A pass as the file counts it; of several files with the file in front, as in the report."""
    return f"{key[0] + 1}.{key[1]}" if several else f"{key[1]}"
