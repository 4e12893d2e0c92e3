"""Equations of a simulated part, as options give them: their values at its features."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.covariates import (
    PLACE,
    as_temperature,
    column_dimensions,
    looks_like_temperature,
    own_columns,
)
from mtu_cli.files.headers import LARGEST_READING
from mtu_cli.findings import InputError, error, listed, nearest, suggestion
from mtu_cli.language import Node, check_dimension, evaluate, parse
from mtu_cli.language import names as names_of
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray

LARGEST_MM = 1e6
"""No machine is a kilometre long."""
TAKEN = {
    *("part", "feature", "operation", "repeat", "sequence", "time", "time_min"),
    *(f"{start}{axis}" for axis in AXES for start in ("", "dir_")),
    *(f"{start}{axis}_mm" for axis in AXES for start in ("", "nominal_")),
}
"""Columns that points have anyway: no covariate may be called so."""


def errors_by_axis(
    option: str, texts: Sequence[str], axes: Sequence[str]
) -> tuple[tuple[str, Node], ...]:
    """Equations named Ex, Ey or Ez, by their axis, which is one of `axes`."""
    known = [f"E{axis}" for axis in axes]
    equations = [named_equation(option, text) for text in texts]
    for name, _ in equations:
        if name not in known:
            hint = suggestion(name, known)
            raise error("unknown-name", path=option, what="equation", value=name, **hint)
    return tuple((name[1:], node) for name, node in equations)


def covariate_equations(option: str, texts: Sequence[str]) -> tuple[tuple[str, Node], ...]:
    """Declared covariates; none may take a column that the points have anyway."""
    found: dict[str, Node] = {}
    for text in texts:
        name, node = named_equation(option, text, column=True)
        if name in TAKEN or name in found:
            place = {"path": option, "value": text, "taken": "a column of the points"}
            raise error("name-taken", **place, expected="another name, such as T_spindle_degC")
        found[name] = node
    return tuple(found.items())


def named_equation(option: str, text: str, *, column: bool = False) -> tuple[str, Node]:
    """Name and equation of an error in mm, or of a `column` in the unit that its name tells.

    The numbers of an equation may have units: ``0.004*dir_x`` are mm. Without a number in it a
    term must be what the equation is, as in a machine file.

    Raises InputError for what is no such text, for a column that looks like a sensor's and is
    none, and for terms of another dimension.
    """
    name, colon, equation = text.partition(":")
    blanks, name = " " * len(name + colon), name.strip()
    if not (colon and name.isascii() and name.isidentifier()):
        example = "'T_spindle_degC: 20 + 2*(sequence - 1)'" if column else "'Ex: 0.004*dir_x'"
        place = {"path": option, "value": text, "expected": f"{example}, say"}
        raise error("wrong-type", kind="NAME: EQUATION", **place)
    if column and looks_like_temperature(name):
        # What reads the points would refuse the column.
        place = {"value": name, "expected": as_temperature(name) or "T_<sensor>_degC"}
        raise error("wrong-type", path=option, kind="the name of a temperature", **place)
    try:
        # Blanks for the name: columns count from the start of the option's text.
        tree = parse(blanks + equation)
        wanted = column_dimensions(name) if column else PLACE
        check_dimension(tree, wanted, own_columns(names_of(tree), ()), free=True)
    except InputError as fault:
        place = {"path": f"{option} {name}", "value": text}
        raise InputError(each.at(**place) for each in fault.findings) from None
    return name, tree


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
            "no-finite-value",
            what="the equation",
            path=option,
            where=f" at {at} {visits.named(i)}".rstrip(),
            expected="an equation that has one at every feature",
        )
    return found
