"""Runs of readings whose sign is the opposite of all the others'."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.readings import Readings

    Floats = NDArray[np.float64]
    Rows = NDArray[np.int64]

NEAR = 0.2
"""Share of a pattern up to which another may be off and still be the same: of the mean of the other
runs, with its sign or the opposite one. Their correlation is above 0.97 then."""
FEWEST_PLACES = 6
FEWEST_RUNS = 5
"""Of fewer, noise is that alike now and then, and so are slopes that a warm axis gives each run."""
SAME_PLACE = 0.25
"""Share of the least step by which the positions of two runs may differ."""
MOST_WAYS = 20
"""Different positions of runs that are looked at: of more, none are the same."""
NAMED = 4


class _Run(NamedTuple):
    """A pass in one direction: its positions and mean errors there, (n,), and its first row."""

    number: int
    way: int
    first: int
    places: Floats
    errors: Floats


def run_signs(readings: Readings) -> Iterator[Finding]:
    """One warning of the runs with the opposite sign of all others of their component, which agree
    with each other: a run is a pass in one direction, through the same positions.
    """
    found: dict[tuple[str, int], int] = {}
    for code, name in enumerate(readings.components):
        inside = np.flatnonzero((readings.code == code) & np.isfinite(readings.position_mm))
        for group in _alike(_runs(readings, inside)):
            odd = _opposite(group)
            if odd is not None:
                key = (name, odd.number)
                found[key] = min(odd.first, found.get(key, odd.first))
    if not found:
        return
    first = min(found.values())
    told = [f"pass {number} of {name}" for name, number in found]
    more = f" and {len(told) - NAMED} more" if len(told) > NAMED else ""
    text = (
        f"{readings.sources[readings.file_index[first]].shown}, row {readings.row[first]}: "
        f"{', '.join(told[:NAMED])}{more} {'has' if len(told) == 1 else 'have'} the opposite sign "
        "of the other passes there, which agree: was the instrument turned around?"
    )
    yield Notice(code="run-sign", message=text)


def _runs(readings: Readings, inside: Rows) -> Iterator[_Run]:
    """The runs among the rows `inside` (n,) of a component, in their order."""
    if not len(inside):
        return
    key = np.column_stack([
        readings.file_index[inside], readings.pass_number[inside], readings.direction[inside]
    ])  # fmt: skip
    own, run = np.unique(key, axis=0, return_inverse=True)
    order = np.argsort(run.reshape(-1), kind="stable")
    ends = np.cumsum(np.bincount(run.reshape(-1), minlength=len(own)))[:-1]
    for (_, number, direction), rows in zip(
        own.tolist(), np.split(inside[order], ends), strict=True
    ):
        position = readings.position_mm[rows]
        places, at = np.unique(position, return_inverse=True)
        if readings.has_pass[rows[0]] and len(places) >= FEWEST_PLACES:
            at = at.reshape(-1)
            errors = np.bincount(at, readings.error[rows]) / np.bincount(at)
            yield _Run(number, direction or _way(position), int(rows[0]), places, errors)


def _way(position: Floats) -> int:
    """The direction in which positions (n,) were gone through: 0 for there and back."""
    steps = np.sign(np.diff(position))
    return int(steps[0]) if len(steps) and (steps == steps[0]).all() else 0


def _alike(runs: Iterator[_Run]) -> list[list[_Run]]:
    """Groups of runs of one direction through the same positions."""
    groups: dict[tuple[int, int], list[list[_Run]]] = defaultdict(list)
    for run in runs:
        known = groups[run.way, len(run.places)]
        for group in known:
            most = SAME_PLACE * float(np.diff(group[0].places).min())
            if np.abs(group[0].places - run.places).max() < most:
                group.append(run)
                break
        else:
            if len(known) < MOST_WAYS:
                known.append([run])
    return [group for known in groups.values() for group in known]


def _opposite(runs: list[_Run]) -> _Run | None:
    """The run of which all others are the opposite, while they agree with each other."""
    if len(runs) < FEWEST_RUNS:
        return None
    away = np.array([run.errors - run.errors.mean() for run in runs])
    (odd,) = np.nonzero(_near_others(away, -1.0))
    if len(odd) != 1:
        return None
    rest = np.delete(away, odd, axis=0)
    return runs[int(odd[0])] if _near_others(rest, 1.0).all() else None


def _near_others(away: Floats, sign: float) -> NDArray[np.bool_]:
    """Which patterns (k, n) about their means are nearly `sign` times the mean of the others."""
    others = (away.sum(axis=0) - away) / (len(away) - 1)
    off = ((away - sign * others) ** 2).sum(axis=1)
    near: NDArray[np.bool_] = off < NEAR**2 * (others**2).sum(axis=1)
    return near
