"""Further parts (or passes), made as before or otherwise: what an experiment would add."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.further_parts import FollowUp, FurtherParts, noun_of
from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.files.covariates import is_temperature

MORE = 6
"""Further parts that a follow-up is judged by."""
OTHER_DAY_K = 5.0
PITCH_SHARE, SPAN_SHARE = 0.25, 0.1
"""How far a fixture is shifted: of a searched pitch, else of the places' span."""
MOST_SHARE = 0.5
"""Of that span at most, where neither the travel is known nor what of it was read."""
GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""Multiples of it, whole numbers taken off, are as far from simple fractions as can be."""

Travel = Mapping[str, tuple[float, float]]
"""Ends of the axes' travel, mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What the effects of a class depend on: names `used` in their equations, `pitches` (mm) by
    axis, the parts that stand out in one of them; `travel` of the machine where it is known, and
    what of it was `read`.
    """

    used: Collection[str]
    pitches: Mapping[str, float]
    outlying: Collection[int] = ()
    travel: Travel = field(default_factory=dict)
    read: Travel = field(default_factory=dict)


def as_it_is(table: ResidualTable) -> FollowUp:
    """The table without a further part."""
    return FurtherParts(table, 0).made("now", "", "")


def follow_ups(table: ResidualTable, wanted: Wanted, count: int = MORE) -> tuple[FollowUp, ...]:
    """What may tell a class apart: more of the same first, then the easier before the harder.

    Those that change nothing that the class depends on are left out. Of a single part, one
    more is taken.
    """
    log = FurtherParts(table, count if len(table.parts) > 1 else 1)
    made = "measure" if table.component is not None else "make and measure"
    words = f"{made} {log.count} more {noun_of(table, log.count)} as before"
    return (log.made("more", words, "measure it again"), *_others(log, wanted))


def _others(log: FurtherParts, wanted: Wanted) -> Iterator[FollowUp]:
    used = set(wanted.used)
    points = log.table.component is None
    directions = [n for n in log.columns if n in used and n in ("dir_x", "dir_y", "dir_z")]
    if directions and points:
        # Where it runs both ways already, half of the parts are reversed: more of them may tell.
        both = any(np.ptp(log.columns[name], axis=0).any() for name in directions)
        yield log.made(
            "reverse",
            "run the program in the reverse direction",
            "" if both else "reverse the program's direction",
            changed={name: -log.rows(name, log.last) for name in directions},
        )
    if points and used & set(log.counts) and (log.sequence_is_tool or used & _tools(log)):
        yield _new_tool(log)
    for axis in POSITIONS[:2]:
        if axis in used and axis in log.data.changing:
            yield from _shifted(log, axis, wanted)
    if points and "z" in used and "z" in log.data.changing:
        yield _other_height(log)
    for name in log.data.others:
        if name in used and name in log.data.changing:
            yield _varied(log, name)
    for part in wanted.outlying:
        again = np.full(log.count, part)
        words, fits = f"run pass {log.table.parts[part]} again", "run this pass again"
        if points:
            words = f"clamp and measure {log.table.parts[part]} again"
            fits = "measure this part again"
        yield log.made("again", words, fits, parts=again)
    yield from _other_times(log, used)


def _tools(log: FurtherParts) -> set[str]:
    return {name for name in log.counts if name != "sequence"}


def _new_tool(log: FurtherParts) -> FollowUp:
    """Counts begin again; `sequence` goes on, but for effects of the tool that it stands for."""
    own = {name: log.begun_again(name) for name in log.counts if name != "sequence"}
    stand_in = {"sequence": log.begun_again("sequence")} if log.sequence_is_tool else {}
    words = "put in a new tool"
    if not own:
        words += ", and count its parts in a column"
    return log.made("new-tool", words, "put in a new tool", changed=own, new_tool=stand_in)


def _shifted(log: FurtherParts, axis: str, wanted: Wanted) -> Iterator[FollowUp]:
    """By a quarter of the pitch or a tenth of the span; more for each part, so that waves of all
    lengths show; by half of a known travel. Where that is not known, by no more than a tenth of
    the span, or as far as the axis was read.
    """
    at = log.table.places[..., POSITIONS.index(axis)]
    low, high = float(at.min()), float(at.max())
    ends = wanted.travel.get(axis)
    if axis in wanted.pitches:
        by, fits = PITCH_SHARE * wanted.pitches[axis], "a quarter of the pitch"
    else:
        by, fits = SPAN_SHARE * (high - low), "a tenth of the span"
    room = (np.inf, np.inf) if ends is None else (ends[1] - high, low - ends[0])
    if by <= max(room):
        yield _moved(log, axis, by if by <= room[0] else -by, fits)
    spacing = float(np.median(np.diff(np.unique(at))))
    most = max(spacing, SPAN_SHARE * (high - low))
    if ends is None:
        most = min(most, _known_room(wanted.read.get(axis), low, high))
    if log.count > 1 and most <= max(room):
        yield _staggered(log, axis, most if most <= room[0] else -most)
    if ends is not None:
        half = 0.5 * (ends[1] - ends[0])
        far = min(half, max(room))
        if far > by:
            sign = 1.0 if room[0] >= room[1] else -1.0
            yield _moved(log, axis, sign * far, "half of the travel" if far == half else "")


def _known_room(read: tuple[float, float] | None, low: float, high: float) -> float:
    """How far places from `low` to `high` mm may go on an axis of unknown travel."""
    if read is None:
        return MOST_SHARE * (high - low)
    return max(SPAN_SHARE * (high - low), read[1] - high)


def _moved(log: FurtherParts, axis: str, by: float, fits: str) -> FollowUp:
    places = log.table.places[log.last].copy()
    places[..., POSITIONS.index(axis)] += by
    fixture = "fixture" if log.table.component is None else "positions"
    return log.made(
        f"shift-{axis}",
        f"shift the {fixture} along {axis} by {by:.3g} mm",
        f"shift the {fixture} along {axis} by {fits}" if fits else "",
        places=places,
        detail=f"{by:.3g} mm",
    )


def _staggered(log: FurtherParts, axis: str, most: float) -> FollowUp:
    by = most * (GOLDEN * np.arange(1, log.count + 1) % 1.0)
    places = log.table.places[log.last].copy()
    places[..., POSITIONS.index(axis)] += by[:, None]
    fixture = "fixture" if log.table.component is None else "positions"
    amounts = ", ".join(f"{value:.3g}" for value in by)
    words = f"shift the {fixture} along {axis} by {amounts} mm, one after the other"
    return log.made(f"stagger-{axis}", words, "", places=places)


def _other_height(log: FurtherParts) -> FollowUp:
    places = log.table.places[log.last].copy()
    whole = log.table.places[..., 2]
    places[..., 2] = whole.min() + whole.max() - places[..., 2]
    words = "make the same features at another height (the high ones low, the low ones high)"
    return log.made("height", words, "at another height", places=places)


def _varied(log: FurtherParts, name: str) -> FollowUp:
    """Turn and turn about at the lowest and the highest value."""
    value = log.columns[name]
    ends = np.where(np.arange(log.count) % 2 == 0, value.min(), value.max())
    words = f"vary {name} on purpose between its lowest and its highest value"
    fits = "vary this column on purpose"
    return log.made(f"vary-{name}", words, fits, changed={name: ends[:, None]})


def _other_times(log: FurtherParts, used: set[str]) -> Iterator[FollowUp]:
    """After a cold start time and temperatures are those of the first parts once more."""
    warmth = [name for name in log.columns if is_temperature(name)]
    again = {n: log.rows(n, log.first) for n in (*warmth, "time_min") if n in log.columns}
    if used & set(again) & log.data.changing and log.P > 1:
        words = "let the machine cool down, and start again"
        yield log.made("cold", words, "after a cold start", changed=again)
    if used & set(warmth):
        for by, word in ((OTHER_DAY_K, "warmer"), (-OTHER_DAY_K, "colder")):
            other = again | {name: again[name] + by for name in warmth}
            how = f"{OTHER_DAY_K:g} K {word}"
            yield log.made(
                f"day-{word}",
                f"repeat the run on a day that is {how}",
                "again at another temperature",
                changed=other,
                detail=how,
            )
