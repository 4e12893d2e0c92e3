"""A table of residuals as the library of effects sees it: values, numbers and kinds of columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_candidate import FloatArray
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.files.contract import is_identifier
from mtu_cli.files.covariates import COVARIATES, is_temperature
from mtu_cli.language.functions import MACHINE_FUNCTIONS

POSITIONS = ("x", "y", "z")
STEADY_K = 0.05
"""Range of a temperature that does not change: a thermometer reads as much from itself."""
COPY = 1.0 - 1e-7
"""Squared correlation from which two columns count as copies."""
FEW_RESETS = 0.4
"""Of the steps of a column that counts, at most this share may be resets."""

FEWEST_PLACES = 3
"""Of two each is off by what the other is not."""
_TAKEN = {"pi", "chosen", *POSITIONS, *MACHINE_FUNCTIONS}


@dataclass(frozen=True, slots=True, kw_only=True)
class TableData:
    """Positions and columns by name in compact shapes, and what is known of them.

    `temperatures`, `counts` and `others` are the columns that ``{T}``, ``{c}`` and ``{v}`` may
    be; `copies` says which column another one is a copy of.
    """

    table: ResidualTable
    values: dict[str, FloatArray]
    changing: frozenset[str]
    temperatures: tuple[str, ...]
    counts: tuple[str, ...]
    others: tuple[str, ...]
    unusable: tuple[str, ...]
    copies: dict[str, str]
    numbers: dict[tuple[str, str], float] = field(default_factory=dict)

    @classmethod
    def of(cls, table: ResidualTable) -> TableData:
        """Sorts the columns of a table."""
        values = _positions(table)
        unusable = []
        for name, value in table.covariates.items():
            if not is_identifier(name) or name in _TAKEN:
                unusable.append(name)
            elif np.isfinite(value).all():
                values[name] = np.atleast_2d(np.asarray(value, float))
        changing = frozenset(n for n, v in values.items() if v.size > 1 and _changes(n, v))
        columns = [name for name in values if name not in POSITIONS]
        counts = [name for name in columns if _may_count(name) and _counts(values[name])]
        if table.component is not None and "time_min" in columns:
            counts.append("time_min")
        if "sequence" in columns:
            counts.insert(0, "sequence")
        known = {*COVARIATES, *counts}
        return cls(
            table=table,
            values=values,
            changing=changing,
            temperatures=tuple(name for name in columns if is_temperature(name)),
            counts=tuple(counts),
            others=tuple(n for n in columns if n not in known and not is_temperature(n)),
            unusable=tuple(unusable),
            copies=_copies({name: values[name] for name in columns if name in changing}),
        )

    def varying_axes(self) -> tuple[str, ...]:
        """Axes along which the places differ."""
        return tuple(axis for axis in POSITIONS if axis in self.changing)

    def number(self, name: str, kind: str) -> float:
        """A number of a column over the measured cells, to 12 digits.

        ``0`` is its mean, ``_low`` its lowest value and ``3`` sum d^4 / sum d^2, d from the mean:
        d^3 less this times d is orthogonal to d.
        """
        if (name, kind) not in self.numbers:
            self.numbers[name, kind] = self._number(name, kind)
        return self.numbers[name, kind]

    def _number(self, name: str, kind: str) -> float:
        value = self.values[name]
        if kind == "_low":
            return float(value.min())
        weights = self._weights(value)
        mean = float(f"{float((weights * value).sum() / weights.sum()):.12g}")
        if kind == "0":
            return mean
        square = (value - mean) ** 2
        below = float((weights * square).sum())
        return float(f"{float((weights * square**2).sum()) / below:.12g}") if below else 0.0

    def _weights(self, value: FloatArray) -> FloatArray:
        measured = (self.table.repeats > 0).astype(float)
        if not measured.any():
            measured[:] = 1.0
        for axis in (0, 1):
            if value.shape[axis] == 1:
                measured = measured.sum(axis=axis, keepdims=True)
        return measured


def is_steady(name: str, span: float) -> bool:
    """Whether values whose range is `span` do not change, but for what a sensor reads."""
    # A range of printed values is rounded: 26.05 - 26.
    return span <= (STEADY_K + 1e-9 if is_temperature(name) else 0.0)


def _changes(name: str, values: FloatArray) -> bool:
    return not is_steady(name, float(np.ptp(values)))


def compact(value: FloatArray) -> FloatArray:
    """An array (P, H) in the smallest shape that broadcasts to it without loss."""
    if value.shape[0] > 1 and (value == value[:1]).all():
        value = value[:1]
    if value.shape[1] > 1 and (value == value[:, :1]).all():
        value = value[:, :1]
    return np.ascontiguousarray(value)


def _positions(table: ResidualTable) -> dict[str, FloatArray]:
    found = {}
    for i, axis in enumerate(POSITIONS):
        place = table.places[..., i]
        if place.size and np.isfinite(place).all():
            found[axis] = compact(place)
    return found


def _may_count(name: str) -> bool:
    return name not in COVARIATES and not is_temperature(name)


def _counts(value: FloatArray) -> bool:
    """Whether a column counts parts: whole numbers that rise, with a few falls to the start."""
    if value.shape[0] < 3 or (value != np.round(value)).any():
        return False
    steps = np.diff(value, axis=0)
    if not (steps > 0).any(axis=0).all():
        return False
    falls = steps < 0
    rise = np.median(steps[steps > 0])
    low = value.min(axis=0, keepdims=True)
    back = (value[1:] <= low + rise) | ~falls
    return bool(back.all() and (falls.mean(axis=0) <= FEW_RESETS).all())


def _copies(columns: Mapping[str, FloatArray]) -> dict[str, str]:
    by_shape: dict[tuple[int, ...], list[str]] = {}
    for name, value in columns.items():
        by_shape.setdefault(value.shape, []).append(name)
    found: dict[str, str] = {}
    for names in by_shape.values():
        centred = [(columns[name] - columns[name].mean()).ravel() for name in names]
        # First by the largest: squares of 1e-200 or of 1e200 are no numbers.
        scaled = [v / np.abs(v).max() for v in centred]
        unit = np.array([v / np.sqrt(v @ v) for v in scaled])
        alike = (unit @ unit.T) ** 2 > COPY
        for i, name in enumerate(names):
            first = int(np.argmax(alike[i]))
            if first < i:
                found[name] = names[first]
    return found


def copy_notes(data: TableData, names: Iterable[str]) -> tuple[str, ...]:
    """A sentence for each of these columns that is a copy of another one, or has copies."""
    wanted = set(names)
    return tuple(
        f"{copy} is a copy of {first} here: the two cannot be told apart"
        for copy, first in data.copies.items()
        if copy in wanted or first in wanted
    )


def labels(table: ResidualTable, over: str) -> Sequence[str]:
    """Names of the features, parts or operations; of readings there and back those of the positions
    follow, for a spot on a screw or scale shows in both directions.
    """
    if over == "feature":
        return (*table.features, *_both_ways(table))
    return {"part": table.parts, "operation": table.operations}[over]


def indicators(table: ResidualTable, over: str) -> FloatArray:
    """1 on the chosen one, else 0: (G, 1, H), (P, P, 1) or (operations, 1, H)."""
    if over == "part":
        return np.eye(len(table.parts))[:, :, None]
    if over == "feature":
        one = np.eye(len(table.features))
        both = [one[own].sum(axis=0) for own in _both_ways(table).values()]
        return np.stack([*one, *both])[:, None, :]
    codes = np.arange(len(table.operations))
    own: FloatArray = (table.operation[None, :] == codes[:, None]).astype(float)[:, None, :]
    return own


def _both_ways(table: ResidualTable) -> dict[str, list[int]]:
    """The columns of each position that was read in both directions, where those are enough to
    tell one from the others; none of parts.
    """
    found: dict[str, list[int]] = {}
    for i, name in enumerate(table.features if table.component is not None else ()):
        place, _, sign = name.partition(" ")
        if sign:
            found.setdefault(place, []).append(i)
    both = {place: own for place, own in found.items() if len(own) > 1}
    return both if len(both) >= FEWEST_PLACES else {}
