"""Other pitches of a periodic error that fit the measured places as well as the one found.

At few places, or at even distances, sines of many pitches are nearly or exactly the same: what
they say of other places is not. All pitches that the library speaks of are compared, those
shorter than the places can follow among them: a pitch does not get longer because the features
stand far apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.describe import SUPPORT, Described
from mtu_cli.close_loop_sealed.analyses.loop.estimate import FLAT
from mtu_cli.close_loop_sealed.analyses.loop.follow_up import as_it_is
from mtu_cli.close_loop_sealed.analyses.loop.result import FIELD, FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.same_waves import WaveFits
from mtu_cli.close_loop_sealed.analyses.loop.separation import Seen, Sight, sight_of
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_candidate import Column, Member
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary
from mtu_cli.close_loop_sealed.model.effect_search import Waves, waves_of
from mtu_cli.close_loop_sealed.stats.column_groups import whiten
from mtu_cli.stats.least_squares import FloatArray, beside

MOST_PLACES = 250
"""Different places along an axis up to which other pitches are sought."""
PLACE_DIGITS = 3
PER_SPAN = 32.0
"""Frequencies a span: the phase is off by a 64th of a period between two of them at most."""
MOST_FREQUENCIES = 200_000
DIGITS = 7
ZOOMS, MOST_ZOOMS, NARROWEST = 4, 24, 1e-6
FINE, INSIDE = 65, 0.25
"""Frequencies about the best one, and the share of them within which the data hold it."""
FEW = 4
"""Pitches whose images are sought: where more of them fit, nearly all that there are do."""
SAME = 0.01
"""Share of a pitch within which two are one."""


def with_other_pitches(
    told: Described, effects: Sequence[FoundEffect], library: EffectLibrary
) -> tuple[FoundEffect, ...]:
    """The effects, each `alike` with the other pitches that fit as well, which the interval of
    what was searched then holds.

    On no more places than an effect takes figures (its parameters, its pitch, a level) some
    pitch fits whatever there is: its class then holds a field without a name.
    """
    found = []
    place = 0
    for step, effect in zip(told.found.steps, effects, strict=True):
        seen = periodic(told, step, library) if step.member >= 0 else None
        found.append(
            effect if seen is None else _with(effect, seen, pitches_as_good(told, seen, place))
        )
        place += step.member >= 0
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Others:
    """Pitches that are the `same` as the one found at these places, those `as_good`, and the
    `ends` of all that the data support; of those about the one found `near`, where that is known.
    """

    same: tuple[float, ...] = ()
    as_good: tuple[float, ...] = ()
    ends: tuple[float, ...] = ()
    near: tuple[float, ...] = ()


def _with(effect: FoundEffect, seen: Periodic, others: Others) -> FoundEffect:
    known = list(others.same)
    for v in (*effect.alike, *others.as_good):
        # Those of the grid that was searched are near to what is the same.
        if all(abs(v - own) > SAME * own for own in (seen.found, *known)):
            known.append(v)
    alike = tuple(sorted(known, reverse=True))
    ((name, (value, low, high)),) = effect.searched.items()
    ends = (*(others.near or (low, high)), *alike, *(others.ends if alike else ()))
    names = effect.class_names
    if len(seen.along) <= len(seen.waves.bound.parameters()) + 2:
        names = tuple(dict.fromkeys([*names, f"{FIELD}-{seen.letter}"]))
    return replace(
        effect,
        alike=alike,
        class_names=names,
        searched={name: (value, min(ends), max(ends))},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Periodic:
    """A periodic `member` along different places `along` (D,), the `first` (D,) columns of the
    table at each, and `which` (H,) of them each column is at; it is an error of `axis`.
    """

    member: Member
    waves: Waves
    axis: int
    letter: str
    along: FloatArray
    first: NDArray[np.intp]
    which: NDArray[np.intp]

    @property
    def found(self) -> float:
        """The pitch found."""
        (value,) = self.member.searched.values()
        return value


def periodic(told: Described, step: Step, library: EffectLibrary) -> Periodic | None:
    """None where nothing periodic was found along an axis whose places all parts share."""
    prepared = told.effects.prepared
    member = prepared.members[step.member]
    waves = waves_of(prepared.table, library, prepared.candidates[step.index], member)
    axes = {axis for column in member.columns for axis in column}
    if waves is None or waves.along.shape[0] > 1 or len(axes) > 1:
        return None
    along, first, which = np.unique(
        np.round(waves.along[0], PLACE_DIGITS), return_index=True, return_inverse=True
    )
    if len(along) > MOST_PLACES:
        return None
    (axis,) = axes
    letter = prepared.table.axes[axis]
    return Periodic(
        member=member, waves=waves, axis=axis, letter=letter, along=along, first=first, which=which
    )


def pitches_as_good(told: Described, seen: Periodic, place: int) -> Others:
    """Pitches that fit as well as the one found."""
    span = float(np.ptp(seen.along))
    frequencies = _frequencies(seen, span)
    fits = _fits(told, seen, place)
    if fits is None:
        return Others()
    found = 1.0 / seen.found
    others = _as_good(fits, frequencies, found, 1.0 / span)
    return replace(others, near=_near(fits, found, 1.0 / span))


def best_near(told: Described, seen: Periodic, place: int, apart: float) -> float:
    """The pitch that fits the best of those `apart` in frequency from the one found at most.

    Those that are searched lie up to an eighth of a period apart at the ends of the data. Where
    none is better, as at three places, it stays: near one that all places are in phase with, the
    size goes beyond all bounds.
    """
    fits, at = _fits(told, seen, place), 1.0 / seen.found
    if fits is None:
        return seen.found
    low, high = _ends(seen, float(np.ptp(seen.along)))
    half = apart
    for _ in range(ZOOMS):
        tried = np.clip(at + half * np.linspace(-1, 1, FINE), low, high)
        at = float(tried[np.argmin(fits.left(tried))])
        half *= 4.0 / FINE
    better = float(-np.diff(fits.left(np.array([1.0 / seen.found, at])))[0]) >= FLAT
    return float(f"{1.0 / at:.{DIGITS}g}") if better else seen.found


def _near(fits: WaveFits, found: float, apart: float) -> tuple[float, ...]:
    """The 95 % interval of the pitch about the one found, where both ends are in sight."""
    half = apart
    for _ in range(MOST_ZOOMS):
        tried = found + half * np.linspace(-1, 1, FINE)
        tried = tried[tried > 0]
        left = fits.left(tried)
        over = left - left.min() - SUPPORT
        inside = np.flatnonzero(over <= 0)
        if len(inside) > INSIDE * FINE or half < apart * NARROWEST:
            break
        half *= 0.5
    first, last = int(inside[0]), int(inside[-1])
    if first == 0 or last == len(tried) - 1:
        return ()
    low = np.interp(0.0, over[[first, first - 1]], tried[[first, first - 1]])
    high = np.interp(0.0, over[[last, last + 1]], tried[[last, last + 1]])
    return _pitches([float(low), float(high)])


def squares_left(
    told: Described, seen: Periodic, place: int, pitches: FloatArray
) -> FloatArray | None:
    """What each of G pitches leaves (G,) of the data beside all other effects, by generalised
    least squares: chi^2 up to a constant. None where the data have no scatter to measure by.
    """
    fits = _fits(told, seen, place)
    return None if fits is None else fits.left(1.0 / pitches)


def _fits(told: Described, seen: Periodic, place: int) -> WaveFits | None:
    others = [m for i, m in enumerate(told.effects.members) if i != place]
    D, axis = len(seen.along), seen.axis
    levels = [{axis: (seen.which == d).astype(float)[None]} for d in range(1, D)]
    A, z = _compressed(told, others, levels)
    if not np.abs(A).max(initial=0.0) > 0:
        return None
    return WaveFits.of(
        waves=seen.waves,
        axis=axis,
        first=seen.first,
        A=A,
        z=z,
        ends=_ends(seen, float(np.ptp(seen.along))),
    )


def _compressed(
    told: Described, others: Sequence[int], levels: Sequence[Column]
) -> tuple[FloatArray, FloatArray]:
    """A (D - 1, D - 1) and z (D - 1,): |z - A e|^2 is what errors e of all places but the first,
    less its own, leave of the data, beside all other effects, in standard deviations and up to
    what no e takes.
    """
    prepared = told.effects.prepared
    sight = sight_of(prepared, as_it_is(prepared.table), tuple(others))
    seen = sight.columns(levels)
    known = {index for column in (*sight.nuisance, *seen) for index in column}
    y = _weighted(sight, prepared.y, known)
    stacked = sight.stacked([*sight.nuisance, *seen, y])
    R = beside(stacked, len(sight.nuisance))[: len(levels)]
    return R[:, :-1], R[:, -1]


def _weighted(sight: Sight, y: FloatArray, strata: set[int]) -> Seen:
    """Coordinates of the errors as those of columns are seen."""
    found = {}
    for index in strata:
        own = y[sight.frame.strata.all[index].slice] * sight.root[index]
        whiten(sight.frame.strata, sight.whitening, index, own)
        found[index] = own
    return found


def _ends(seen: Periodic, span: float) -> tuple[float, float]:
    """From half of the places' span to the shortest pitch, the one found among them, 1/mm."""
    found = 1.0 / seen.found
    return min(2.0 / span, found), max(1.0 / seen.waves.shortest, found)


def _frequencies(seen: Periodic, span: float) -> FloatArray:
    low, high = _ends(seen, span)
    count = int(min(np.ceil((high - low) * span * PER_SPAN) + 2, MOST_FREQUENCIES))
    high = min(high, low + (count - 1) / (span * PER_SPAN))
    frequencies: FloatArray = np.union1d(np.linspace(low, high, count), [1.0 / seen.found])
    return frequencies


def _as_good(fits: WaveFits, frequencies: FloatArray, found: float, apart: float) -> Others:
    """Pitches that are the same as the one found at these places, and those that leave no more
    than it, by what bounds a 95 % interval: the best of those nearer to one another than the
    resolution of the places (`apart`), and what is the same as that.
    """
    left = fits.left(frequencies)
    near = np.abs(frequencies - found) <= apart / 8
    good = np.flatnonzero(left <= left[near].min() + SUPPORT)
    good = good[np.argsort(left[good], kind="stable")]
    same = fits.same_as(found, frequencies)
    known = [found, *same]
    others: list[float] = []
    modes = 0
    if same:
        others = _with_same(fits, frequencies, _better_near(frequencies[good], known, apart))
    for f in frequencies[good].tolist():
        if all(abs(f - other) >= apart for other in (*known, *others)):
            modes += 1
            others += _with_same(fits, frequencies, [f]) if same and modes <= FEW else [f]
    ends = (1.0 / float(frequencies[good].max()), 1.0 / float(frequencies[good].min()))
    return Others(same=_pitches(same), as_good=_pitches(others), ends=ends)


def _pitches(frequencies: Sequence[float]) -> tuple[float, ...]:
    """To digits that are known: where sine and cosine are one column, a wave is flat in pitch."""
    return tuple(float(f"{1.0 / f:.{DIGITS}g}") for f in frequencies)


def _better_near(frequencies: FloatArray, known: Sequence[float], apart: float) -> list[float]:
    """The first of the frequencies near a known one, unless it is as good as that one itself: a
    phase that is off by a 16th of a period at each end at most.
    """
    for f in frequencies.tolist():
        off = min(abs(f - other) for other in known)
        if off < apart:
            return [f] if off > apart / 8 else []
    return []


def _with_same(fits: WaveFits, frequencies: FloatArray, chosen: Sequence[float]) -> list[float]:
    """Frequencies with those that are the same at these places."""
    return [f for own in chosen for f in (own, *fits.same_as(own, frequencies))]
