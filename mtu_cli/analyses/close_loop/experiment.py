"""The experiment that would separate a class: the follow-up with the largest separation.

Further parts (or passes) are added to the table as they would be made; the separation of two
rivals is the distance, in standard deviations, of what one of them makes from all that the other
could (T-optimality, Atkinson & Fedorov 1975).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mtu_cli.analyses.close_loop.design import Member
from mtu_cli.analyses.close_loop.estimate import levers_on
from mtu_cli.analyses.close_loop.strata import FEATURE, INTERACTION, Strata, strata_of
from mtu_cli.files.covariates import is_temperature
from mtu_cli.model.effect_library import TableData
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

MORE = 6
"""Further parts that a follow-up is judged by."""
OTHER_DAY_K = 5.0
SHIFT = 0.25
"""Of the places' span, by which a fixture is shifted; of a pitch, where one is searched."""
ENOUGH = 1.25
"""Times the separation that more of the same gives, from which another experiment is worth it."""
COUNTING = ("sequence", "tool_parts", "time_min")
"""Columns that go on from part to part."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """What to do, and the separation of the rivals in standard deviations after it."""

    do: str
    predicted_d: float


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
    by_kind: dict[tuple[str, int], list[float]] = {}
    for s, kind in enumerate(strata.kinds):
        if weights[s] > 0:
            by_kind.setdefault((kind, strata.axis[s]), []).append(1 / weights[s])
    variance = {key: float(np.mean(values)) for key, values in by_kind.items()}
    best: tuple[float, str] | None = None
    for do, further in follow_ups(table, rivals):
        d = separation(further, rivals, variance)
        if best is None or d > ENOUGH * best[0]:
            best = (d, do)
    return None if best is None else Experiment(do=best[1], predicted_d=best[0])


def separation(
    table: ResidualTable, rivals: Sequence[Rival], variance: Mapping[tuple[str, int], float]
) -> float:
    """The separation of the first rival from the others, weighted by their posterior, on a table
    with the `variance` of each kind of stratum and axis.
    """
    P, H, A = table.errors.shape
    lines = [np.zeros((H, 0))] * A
    features = (FEATURE, 0) in variance
    strata = strata_of(P, A, lines, H=H, features_scatter=features)
    w = np.array(
        [
            1 / variance.get((kind, a), variance.get((INTERACTION, a), 1.0))
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
    signal = (rivals[0].sizes @ columns[0][: len(rivals[0].sizes)]) * root
    total, weight = 0.0, 0.0
    for rival, X in zip(rivals[1:], columns[1:], strict=True):
        Q, R = np.linalg.qr((X * root).T)
        Q = Q[:, np.abs(np.diag(R)) > 1e-9 * max(np.abs(np.diag(R)).max(), 1e-300)]
        rest = signal - Q @ (Q.T @ signal)
        total += rival.posterior * float(np.linalg.norm(rest))
        weight += rival.posterior
    return total / weight if weight > 0 else 0.0


def follow_ups(
    table: ResidualTable, rivals: Sequence[Rival]
) -> Iterator[tuple[str, ResidualTable]]:
    """Further parts as before, then made otherwise in what the rivals depend on."""
    readings = table.component is not None
    noun, make = ("passes", "run") if readings else ("parts", "make and measure")
    forms = [rival.member.form for rival in rivals]
    used = {name for form in forms for name in form.used}
    used |= {axis for axis in AXES if any(axis in t for f in forms for t in f.texts().values())}
    yield f"{make} {MORE} more {noun} as before", extended(table)
    names = [name for name in table.covariates if name in used]
    reverse = {n: np.negative for n in names if n.startswith("dir_")}
    if reverse and not readings:
        yield "run the program in the reverse direction", extended(table, reverse)
    again = {n: partial(_first, table.covariates[n]) for n in COUNTING if n in table.covariates}
    if again.keys() & used and again.keys() - {"sequence"}:
        again.pop("sequence", None)
        rest = "after a cold start" if "time_min" in used else "with a new tool"
        yield f"{make} {MORE} more {noun} {rest}", extended(table, again)
    warmer = {n: partial(np.add, OTHER_DAY_K) for n in names if is_temperature(n)}
    if warmer:
        yield f"{make} {MORE} more {noun} at {OTHER_DAY_K:g} K more", extended(table, warmer)
    pitch = next((r.member.value for r in rivals if r.member.form.scale == "frequency"), None)
    for i, axis in enumerate(AXES):
        known = table.places[..., i][np.isfinite(table.places[..., i])]
        span = float(np.ptp(known)) if len(known) else 0.0
        if axis in used and span > 0:
            shift = SHIFT * (pitch or span)
            what = "the positions" if readings else "the fixture"
            yield f"shift {what} by {shift:.3g} mm along {axis}", extended(table, shift={i: shift})


def _first(values: FloatArray, _: FloatArray) -> FloatArray:
    """As the first parts were."""
    return np.resize(values, (MORE, values.shape[1]))


def extended(
    table: ResidualTable,
    changes: Mapping[str, Callable[[FloatArray], FloatArray]] | None = None,
    shift: Mapping[int, float] | None = None,
) -> ResidualTable:
    """The table with further parts, which repeat the last ones but for `changes` of columns and a
    `shift` (mm) of places; those that count parts or time go on.
    """
    P, changes = len(table.parts), changes or {}
    again = P - min(MORE, P) + np.arange(MORE) % min(MORE, P)
    covariates = dict(table.covariates)
    for name, values in table.covariates.items():
        if name in changes or len(values) == P > 1:
            known = np.broadcast_to(values, (P, values.shape[1]))
            further = known[again]
            if name in COUNTING:
                step = np.diff(known, axis=0)
                rise = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
                further = known[-1:] + rise * np.arange(1, MORE + 1)[:, None]
            change = changes.get(name, np.asarray)
            covariates[name] = np.concatenate([known, change(further)])
    places = np.concatenate([table.places, table.places[again]])
    for i, by in (shift or {}).items():
        places[P:, :, i] += by
    return replace(
        table,
        parts=(*table.parts, *(f"+{i + 1}" for i in range(MORE))),
        errors=np.zeros((P + MORE, *table.errors.shape[1:])),
        repeats=np.ones((P + MORE, len(table.features)), np.int64),
        places=places,
        covariates=covariates,
    )
