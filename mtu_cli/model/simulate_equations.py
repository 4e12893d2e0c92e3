"""Equations of a simulated part, as options give them: their values at its features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.joined import LARGEST_READING
from mtu_cli.findings import error, listed, nearest
from mtu_cli.language import Node, evaluate
from mtu_cli.language import names as names_of
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray

LARGEST_MM = 1e6
"""No machine is a kilometre long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Visits:
    """One part, counted from 1: features `ids` (n,) at `points` (n, 3) mm under `values` (n,)."""

    part: int
    ids: Sequence[str]
    points: FloatArray
    values: Mapping[str, FloatArray]

    def named(self, index: int) -> str:
        """A feature of this part in words."""
        return f"in part {self.part} at feature {self.ids[index]!r}"


def error_values(option: str, node: Node, visits: Visits) -> FloatArray:
    """An error (n,) in mm.

    Raises InputError for an unknown name, and for a value that no points file could hold.
    """
    return _bounded(option, node, visits, LARGEST_MM, " mm")


def deviation_values(option: str, node: Node, visits: Visits) -> FloatArray:
    """A standard deviation (n,) in mm.

    Raises InputError as `error_values` does, and for a negative one.
    """
    found = error_values(option, node, visits)
    if (found < 0).any():
        i = int(np.argmax(found < 0))
        raise error(
            "out-of-range",
            path=f"{option} {visits.named(i)}",
            value=f"{found[i]:g}",
            expected="a standard deviation of 0 or more, mm",
        )
    return found


def covariate_values(option: str, node: Node, visits: Visits) -> FloatArray:
    """A covariate (n,).

    Raises InputError for an unknown name, and for a value that no points file could hold.
    """
    return _bounded(option, node, visits, LARGEST_READING, "")


def check_coordinates(measured: FloatArray, axes: Sequence[str], visits: Visits) -> None:
    """Raises InputError for `measured` (repeats, n, axes) in mm that no points file could hold:
    the part may not say where a feature is, the machine's components, an offset or the CMM's
    uncertainty may be as large.
    """
    sound = np.abs(measured) <= LARGEST_MM
    if sound.all():
        return
    repeat, i, k = np.argwhere(~sound)[0]
    if np.isnan(visits.points[i, AXES.index(axes[k])]):
        raise error(
            "missing-key",
            key=f"{axes[k]}_mm",
            path=f"features.{visits.ids[i]}",
            expected=f"{axes[k]}_mm of every feature in the part file",
        )
    raise error(
        "out-of-range",
        path=f"the measured {axes[k]} {visits.named(int(i))}",
        value=f"{measured[repeat, i, k]:g}",
        expected=f"at most {LARGEST_MM:g} mm in size, of nominal place and all errors together",
    )


def _bounded(option: str, node: Node, visits: Visits, most: float, unit: str) -> FloatArray:
    found = _values(option, node, visits)
    large = np.abs(found) > most
    if large.any():
        i = int(np.argmax(large))
        raise error(
            "out-of-range",
            path=f"{option} {visits.named(i)}",
            value=f"{found[i]:g}",
            expected=f"at most {most:g}{unit} in size",
        )
    return found


def _values(option: str, node: Node, visits: Visits) -> FloatArray:
    known = {axis: visits.points[:, k] for k, axis in enumerate(AXES)} | dict(visits.values)
    names = names_of(node)
    for name in names:
        if name not in known:
            meant = nearest(name, known)
            expected = f"one of {listed(known, 12)}, or a covariate (--covariate '{name}: ...')"
            place = {"path": option, "column": names[name], "meant": meant, "expected": expected}
            raise error("unknown-name", what="name", value=name, **place)
    found = np.array(np.broadcast_to(np.asarray(evaluate(node, known), float), len(visits.ids)))
    if not np.isfinite(found).all():
        i = int(np.argmin(np.isfinite(found)))
        at = ", ".join(f"{name} = {known[name][i]:g}" for name in names)
        raise error(
            "no-value-here",
            operation="the equation",
            path=option,
            at=f"{at} {visits.named(i)}".strip(),
            expected="an equation that has one at every feature",
        )
    return found
