"""What would be logged of parts (or passes) that were not made yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS, TableData, compact
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.model.visits import IntArray
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, kw_only=True)
class FollowUp:
    """P parts as they are and `count` further ones, made as `words` say; `noun` counts them.

    `fits` is what the words of a library say of the same experiment, `detail` what they leave
    open. `places` (P + K, H, 3) mm;
    `values` of positions and covariates by name, each in the smallest shape that broadcasts to
    (P + K, H); `new_tool` are other values of what counts parts, for effects of a tool.
    `copied` are the parts that the further ones are, measured again; empty for new parts.
    """

    name: str
    words: str
    fits: str
    count: int
    noun: str
    places: FloatArray
    values: Mapping[str, FloatArray]
    new_tool: Mapping[str, FloatArray]
    copied: tuple[int, ...] = ()
    detail: str = ""


def noun_of(table: ResidualTable, count: int, again: bool = False) -> str:
    """What the further rows of a table are; `again`: of parts that were measured before."""
    if table.component is not None:
        return "pass" if count == 1 else "passes"
    return ("measurement" if again else "part") + ("" if count == 1 else "s")


class FurtherParts:
    """What is logged of the parts of a table, and of `count` further ones."""

    def __init__(self, table: ResidualTable, count: int) -> None:
        self.table, self.count = table, count
        self.data = TableData.of(table)
        self.P = len(table.parts)
        self.columns = {n: v for n, v in self.data.values.items() if n not in POSITIONS}
        self.counts = [name for name in self.data.counts if name != "time_min"]
        self.last = (np.arange(count) - count) % self.P
        self.first = np.arange(count) % self.P

    @property
    def sequence_is_tool(self) -> bool:
        """Whether `sequence` stands for the parts of the tool: no other column tells them."""
        others = [name for name in self.counts if name != "sequence"]
        return "sequence" in self.counts and all(n in self.data.copies for n in others)

    def rows(self, name: str, parts: IntArray) -> FloatArray:
        """The values (K or 1, ...) of some parts."""
        value = self.columns[name]
        found: FloatArray = value[parts] if len(value) > 1 else value
        return found

    def _step(self, name: str) -> float:
        value = self.columns[name].mean(axis=1)
        steps = np.diff(value)
        rising = steps[steps > 0]
        return float(np.median(rising)) if rising.size else 0.0

    def going_on(self, name: str) -> FloatArray:
        """The values after the last part, at the usual step."""
        found: FloatArray = self.columns[name][-1:] + self._step(name) * self._number(1)
        return found

    def begun_again(self, name: str) -> FloatArray:
        """A count from its lowest value on."""
        lowest = self.columns[name].min(axis=0, keepdims=True)
        found: FloatArray = lowest + self._step(name) * self._number(0)
        return found

    def _number(self, first: int) -> FloatArray:
        return np.arange(first, first + self.count, dtype=float)[:, None]

    def made(
        self,
        name: str,
        words: str,
        fits: str,
        *,
        changed: Mapping[str, FloatArray] | None = None,
        new_tool: Mapping[str, FloatArray] | None = None,
        places: FloatArray | None = None,
        parts: IntArray | None = None,
        detail: str = "",
    ) -> FollowUp:
        """A follow-up in which the columns `changed` differ from going on as before; `parts`
        are measured again instead of new ones.
        """
        rows = self.last if parts is None else parts
        own = self.table.places[rows] if places is None else places
        joined = np.concatenate([self.table.places, own])
        values = {
            axis: compact(joined[..., i])
            for i, axis in enumerate(POSITIONS)
            if axis in self.data.values
        }
        for column in self.columns:
            new = self.rows(column, rows)
            if parts is None and (column == "time_min" or column in self.counts):
                new = self.going_on(column)
            values[column] = self._joined(column, (changed or {}).get(column, new))
        return FollowUp(
            name=name,
            words=words,
            fits=fits,
            count=self.count,
            noun=noun_of(self.table, self.count, parts is not None),
            places=joined,
            values=values,
            new_tool={n: self._joined(n, new) for n, new in (new_tool or {}).items()},
            copied=() if parts is None else tuple(int(p) for p in parts),
            detail=detail,
        )

    def _joined(self, name: str, new: FloatArray) -> FloatArray:
        old = self.columns[name]
        width = max(old.shape[1], new.shape[1])
        both = np.concatenate(
            [np.broadcast_to(old, (self.P, width)), np.broadcast_to(new, (self.count, width))]
        )
        return compact(both)
