"""The experiment that would tell a class apart: the follow-up with the largest separation.

Further parts (or passes) are added to the table as they would be made; the separation of two
rivals is the distance, in standard deviations, of what one of them makes from all that the other
could (T-optimality, Atkinson & Fedorov 1975).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.close_loop.design import Member
from mtu_cli.analyses.close_loop.estimate import levers_on
from mtu_cli.analyses.close_loop.strata import FEATURE, INTERACTION, Strata, strata_of
from mtu_cli.files.covariates import is_temperature
from mtu_cli.model.effect_library import TableData
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

MORE = 6
"""Further parts that a follow-up is judged by."""
OTHER_DAY_K = 5.0
SHIFT = 0.25
"""Of the places' span, by which a fixture is shifted; of a pitch, where one is searched."""
ENOUGH = 1.25
"""Times the separation that more of the same gives, from which another experiment is worth it."""
COUNTS = ("sequence", "tool_parts")


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """What to do, and the separation of the rivals in standard deviations after it and today."""

    do: str
    predicted_d: float
    now_d: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """An effect of a class: its member, what it explains of the table's columns, its posterior."""

    member: Member
    sizes: FloatArray
    posterior: float


def experiment(
    table: ResidualTable, rivals: Sequence[Rival], strata: Strata, weights: FloatArray
) -> Experiment | None:
    """The best follow-up for a class, the first rival the effect that is reported; None for one
    rival alone. Of follow-ups that do as well, the one that is less work stands first.
    """
    if len(rivals) < 2:
        return None
    variance = _variances(strata, weights)
    now = separation(table, table, rivals, variance)
    best: tuple[float, str] | None = None
    for do, further in follow_ups(table, rivals):
        d = separation(further, table, rivals, variance)
        if best is None or d > ENOUGH * best[0]:
            best = (d, do)
    if best is None:
        return None
    return Experiment(do=best[1], predicted_d=best[0], now_d=now)


def _variances(strata: Strata, weights: FloatArray) -> dict[tuple[str, int], float]:
    """1/weights by kind and axis; the mean of a kind of which there are several."""
    found: dict[tuple[str, int], list[float]] = {}
    for s, kind in enumerate(strata.kinds):
        if weights[s] > 0:
            found.setdefault((kind, strata.axis[s]), []).append(1 / weights[s])
    return {key: float(np.mean(values)) for key, values in found.items()}


def separation(
    table: ResidualTable,
    origin: ResidualTable,
    rivals: Sequence[Rival],
    variance: dict[tuple[str, int], float],
) -> float:
    """The separation of the first rival from the others, weighed by their posterior, on a table
    whose strata have the variances of another (`origin`).
    """
    P, H, A = table.errors.shape
    features = (FEATURE, 0) in variance
    lines = [np.zeros((H, 0))] * A
    strata = strata_of(P, A, lines, H=H, lines_scatter=False, features_scatter=features)
    default = variance.get((INTERACTION, 0), 1.0)
    w = np.array(
        [
            1 / variance.get((kind, a), variance.get((INTERACTION, a), default))
            for kind, a in zip(strata.kinds, strata.axis, strict=True)
        ]
    )
    root = np.sqrt(w)[strata.labels()]
    data = TableData.of(table)
    columns = []
    for rival in rivals:
        levers = [{a: v[None] for a, v in own.items()} for own in levers_on(rival.member, data)]
        at, X = strata.of_levers(levers, 1)
        columns.append(np.zeros((len(levers), len(root))))
        columns[-1][:, at] = X[0]
    k = len(rivals[0].sizes)
    signal = (rivals[0].sizes @ columns[0][:k]) * root
    total, weight = 0.0, 0.0
    for rival, X in zip(rivals[1:], columns[1:], strict=True):
        Q, R = np.linalg.qr((X * root).T)
        Q = Q[:, np.abs(np.diag(R)) > 1e-9 * max(np.abs(np.diag(R)).max(), 1e-300)]
        left = signal - Q @ (Q.T @ signal)
        total += rival.posterior * float(np.linalg.norm(left))
        weight += rival.posterior
    return total / weight if weight > 0 else 0.0


def follow_ups(
    table: ResidualTable, rivals: Sequence[Rival]
) -> Iterator[tuple[str, ResidualTable]]:
    """Further parts as before, then made otherwise in what the rivals depend on."""
    noun, make = ("passes", "run") if table.component else ("parts", "make and measure")
    P = len(table.parts)
    used = {name for rival in rivals for name in rival.member.form.bound.used} | {
        axis
        for rival in rivals
        for axis in "xyz"
        if any(axis in text for text in rival.member.form.bound.texts().values())
    }
    yield f"{make} {MORE} more {noun} as before", extended(table)
    names = [name for name in table.covariates if name in used]
    turned = {n: -extended(table).covariates[n] for n in names if n.startswith("dir_")}
    if turned and not table.component:
        yield "run the program in the reverse direction", extended(table, turned)
    counts = [n for n in table.covariates if n in COUNTS or n == "time_min"]
    if set(counts) & used:
        again = {n: _begun_again(table, n) for n in counts if n != "sequence"}
        if again:
            rest = "after a cold start" if "time_min" in used else "with a new tool"
            yield f"{make} {MORE} more {noun} {rest}", extended(table, again)
    hot = [n for n in names if is_temperature(n)]
    if hot:
        other = {n: extended(table).covariates[n] + OTHER_DAY_K for n in hot}
        yield f"{make} {MORE} more {noun} at {OTHER_DAY_K:g} K more", extended(table, other)
    for i, axis in enumerate("xyz"):
        known = table.places[..., i][np.isfinite(table.places[..., i])]
        span = float(np.ptp(known)) if len(known) else 0.0
        if axis not in used or span == 0:
            continue
        pitches = [r.member.value for r in rivals if r.member.form.bound.is_periodic]
        shift = SHIFT * (float(pitches[0] or span) if pitches else span)
        what = "the positions" if table.component else "the fixture"
        yield f"shift {what} by {shift:.3g} mm along {axis}", extended(table, shift={i: shift})
    if P == 1:
        return


def extended(
    table: ResidualTable,
    changed: dict[str, FloatArray] | None = None,
    shift: dict[int, float] | None = None,
) -> ResidualTable:
    """The table with further parts, which repeat the last ones but for some covariates; those that
    count parts or time go on.
    """
    P = len(table.parts)
    last = np.arange(P - min(MORE, P), P)
    again = last[np.arange(MORE) % len(last)]

    def longer(name: str, values: FloatArray) -> FloatArray:
        if len(values) != P or P == 1:
            whole = np.broadcast_to(values, (P, values.shape[1]))
            if changed is None or name not in changed:
                return values
            values = np.array(whole)
        more = values[again].copy()
        if name in (*COUNTS, "time_min"):
            step = np.diff(values, axis=0)
            rise = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
            more = values[-1:] + rise * np.arange(1, MORE + 1)[:, None]
        if changed is not None and name in changed:
            own = np.broadcast_to(changed[name], (len(changed[name]), values.shape[1]))
            more = own[-MORE:] if len(own) >= MORE else np.broadcast_to(own[-1:], more.shape)
        return np.concatenate([values, more])

    places = np.concatenate([table.places, table.places[again]])
    for i, by in (shift or {}).items():
        places[P:, :, i] += by

    def repeated(factor: FloatArray) -> FloatArray:
        return np.concatenate([factor, factor[again]]) if len(factor) == P > 1 else factor

    return replace(
        table,
        parts=(*table.parts, *(f"+{i + 1}" for i in range(MORE))),
        errors=np.zeros((P + MORE, *table.errors.shape[1:])),
        repeats=np.ones((P + MORE, len(table.features)), np.int64),
        places=places,
        covariates={name: longer(name, values) for name, values in table.covariates.items()},
        common=repeated(table.common),
        of_part=repeated(table.of_part),
    )


def _begun_again(table: ResidualTable, name: str) -> FloatArray:
    """A column that counts, from its start."""
    values = table.covariates[name]
    return values[:MORE] if len(values) >= MORE else values
