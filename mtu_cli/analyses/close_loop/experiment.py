"""What a table would show: the smallest effects, and the experiment that would separate a class.

Further parts (or passes) are added to the table as they would be made; the separation of two
rivals is the distance, in standard deviations, of what one of them makes from all that the other
could (T-optimality, Atkinson & Fedorov 1975).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri, ndtri

from mtu_cli.analyses.close_loop.design import Member
from mtu_cli.analyses.close_loop.diagnosis import OF_PARTS, Diagnosis
from mtu_cli.analyses.close_loop.model_set import Entry
from mtu_cli.analyses.close_loop.result import Experiment
from mtu_cli.analyses.close_loop.strata import Strata, strata_of
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


def experiment(diagnosis: Diagnosis, entry: Entry) -> Experiment | None:
    """The follow-up that separates the first of the class of an entry, as it was estimated, best
    from its rivals, weighted by their posteriors; None where none does, or the effect is alone in
    it. Of follow-ups that do as well, the one that is less work stands first.
    """
    design, like = diagnosis.design, diagnosis.models.likelihood
    posteriors = {m: max(p, 1e-300) for _, m, p in entry.credible if m >= 0}
    items, rivals = [*posteriors], [design.members[m] for m in posteriors]
    if len(rivals) < 2:
        return None
    sizes = like.fit(like.closure(items[:1])).sizes(rivals[0])[: len(rivals[0].form.parameters)]
    known, weights = design.strata, diagnosis.sizes.fit.weights.tolist()
    variance = {x: 1 / w for x, w in zip(_places(known), weights, strict=True) if w > 0}
    # Whole parts, or passes, scatter along the same lines and bend as before.
    inner = {a: column for kind, a, column in _places(known) if kind == "interaction"}
    lines = [basis[:, 1 : inner.get(a)] for a, basis in enumerate(known.of_features)]
    moving = sum(name in OF_PARTS for name, _, _ in diagnosis.scatter)
    spread, (a, _, j) = np.ones(known.of_features.shape[:2]), known.cells
    spread[a, j] = known.spread
    best, crossed = Experiment("", 0.0), "feature" in known.kinds
    for do, table in follow_ups(design.table, rivals):
        strata = strata_of(len(table.parts), lines, features_scatter=crossed, moving=moving)
        a, _, j = strata.cells
        strata = replace(strata, of_features=known.of_features, spread=spread[a, j])
        of_strata = [variance.get(place, np.inf) for place in _places(strata)]
        root = 1 / np.sqrt(of_strata)[strata.labels()]
        data, signal, distances = TableData(table), np.zeros(len(root)), list[float]()
        for m in items:
            member = design.members[m]
            levers = [
                {a: v[[member.chosen if len(v) > 1 else 0]] for a, v in lever.items()}
                for form in (member.form, *member.form.margins)
                for lever in replace(form, data=data).columns(np.array([member.value]))
            ]
            at, X = strata.of_levers(levers, 1)
            columns = np.zeros((len(levers), len(root)))
            columns[:, at] = X[0] * root[at]
            if m == items[0]:
                signal = sizes @ columns[: len(sizes)]
                continue
            Q, R = np.linalg.qr(columns.T)
            Q = Q[:, np.abs(np.diag(R)) > 1e-9 * max(np.abs(np.diag(R)).max(), 1e-300)]
            distance, norm = np.linalg.norm([signal - Q @ (Q.T @ signal), signal], axis=1).tolist()
            distances.append(distance if distance > 1e-9 * norm else 0.0)
        d = float(np.average(distances, weights=[posteriors[m] for m in items[1:]]))
        if not best.do or d > ENOUGH * best.predicted_d:
            best = Experiment(do, d)
    return best if best.predicted_d > 0 else None


def _places(strata: Strata) -> list[tuple[str, int, int]]:
    """Kind, axis, and first column of the features' basis of each stratum."""
    columns = strata.cells[2][[part.start for part in strata.slices]].tolist()
    return [*zip(strata.kinds, strata.axis, columns, strict=True)]


def follow_ups(
    table: ResidualTable, rivals: Sequence[Member]
) -> Iterator[tuple[str, ResidualTable]]:
    """Further parts, which repeat the last ones but that what counts parts or time goes on; then
    made otherwise in what the rivals depend on.
    """
    P, readings, noun = len(table.parts), table.component is not None, table.plurals[0]
    make = "run" if readings else "make and measure"
    used = {name for rival in rivals for name in rival.form.used}
    names = [name for name in table.covariates if name in used]
    counters = [name for name in COUNTING if name in table.covariates]
    # A clock that starts anew with each part is alike in all of them.
    counting = [name for name in counters if len(table.covariates[name]) == P > 1]
    rows = {n: np.broadcast_to(v, (P, v.shape[1])) for n, v in table.covariates.items()}
    last = P - min(MORE, P) + np.arange(MORE) % min(MORE, P)
    more = table.taken(np.r_[:P, last], 0)
    more = replace(
        more,
        parts=(*table.parts, *(f"+{i + 1}" for i in range(MORE))),
        errors=np.zeros(more.errors.shape),
        repeats=np.ones(more.repeats.shape, np.int64),
    )

    def made(changes: Mapping[str, FloatArray]) -> ResidualTable:
        covariates = {n: np.concatenate([rows[n], further]) for n, further in changes.items()}
        return replace(more, covariates=more.covariates | covariates)

    steps = {name: np.diff(rows[name], axis=0) for name in counting}
    rises = {n: np.median(step[step > 0]) if (step > 0).any() else 1.0 for n, step in steps.items()}
    on = np.arange(1, MORE + 1)[:, None]
    more = made({name: rows[name][-1:] + rises[name] * on for name in counting})
    yield f"{make} {MORE} more {noun} as before", more
    reverse = {name: -rows[name][last] for name in names if name.startswith("dir_")}
    if reverse and not readings:
        yield "run the program in the reverse direction", made(reverse)
    again = {n: rows[n][np.arange(MORE) % P] for n in counters if n != "sequence"}
    if again and used & {*COUNTING}:
        rest = "after a cold start" if "time_min" in used else "with a new tool"
        yield f"{make} {MORE} more {noun} {rest}", made(again)
    warmer = {name: rows[name][last] + OTHER_DAY_K for name in names if is_temperature(name)}
    if warmer:
        yield f"{make} {MORE} more {noun} at {OTHER_DAY_K:g} K more", made(warmer)
    pitch = next((rival.value for rival in rivals if rival.form.scale == "frequency"), None)
    for i, axis in enumerate(AXES):
        places = table.places[..., i][np.isfinite(table.places[..., i])]
        span = float(np.ptp(places)) if len(places) else 0.0
        if axis in used and span > 0:
            shift = SHIFT * (pitch or span)
            what = "the positions" if readings else "the fixture"
            shifted = more.places.copy()
            shifted[P:, :, i] += shift
            text = f"shift {what} by {shift:.3g} mm along {axis}"
            yield text, replace(more, places=shifted)


def minimum_detectable(diagnosis: Diagnosis) -> dict[str, float]:
    """Root mean square, mm or rad, over the cells of the smallest effect of each candidate that
    passes the gate four times in five; the median over its members. The effects of the diagnosis
    are in the model.

    The deviance of k columns among v degrees of freedom passes its limit D where the statistic t of
    noncentral Student distribution is above c = sqrt(v (exp(D / v) - 1)). By (t (1 - 1/4v) - z) /
    sqrt(1 + t^2/2v) ~ N(0, 1) (Abramowitz & Stegun 1972, 26.7.10) that has a probability of 80 % at
    a signal-to-noise z = c (1 - 1/4v) + 0.84 sqrt(1 + c^2/2v). D is Sidak's over all candidates
    and the members of each.
    """
    design, strata = diagnosis.design, diagnosis.design.strata
    fit = diagnosis.models.likelihood.fit(diagnosis.models.columns(diagnosis.model))
    P, H, _ = strata.shape
    of = design.owner
    counts = np.bincount(of)
    tests = int((counts > 0).sum())
    sizes = np.full(design.tested, np.nan)
    for partials in design.partials((), fit.weights):
        k = partials.terms.shape[1]
        # The coefficients are uncertain as far as is known beforehand.
        prior = np.sum(
            partials.slopes**2 * design.columns.precisions[partials.nuisance][:, None], axis=(1, 2)
        )
        signal = (np.einsum("smkk->m", partials.information) + prior) / k
        crossed = design.columns.cross(partials.terms, partials.terms).sum(axis=-1)
        shares = fit.weights[:, None] * crossed
        v = np.maximum(fit.dof @ shares / np.maximum(shares.sum(axis=0), 1e-300) - k, 1.0)
        p = (1 - (1 - diagnosis.models.alpha) ** (1 / tests)) / counts[of[partials.members]]
        c2 = v * np.expm1(np.minimum(chdtri(k, p) / v, 50.0))
        z = np.sqrt(c2) * (1 - 0.25 / v) + ndtri(0.8) * np.sqrt(1 + c2 / (2 * v))
        axes = [np.bincount(strata.axis, share) > 0 for share in shares.T]
        cells = P * H * np.sum(axes, axis=1)
        estimable = signal * k > 1e-9 * partials.unadjusted.sum(axis=1)
        sizes[partials.members] = z / np.sqrt(np.where(estimable, signal, np.nan) * cells)
    of_candidates = {c: sizes[(of == c) & np.isfinite(sizes)] for c in np.unique(of)}
    return {
        design.candidates[c].name: float(np.median(values)) * diagnosis.design.scale
        for c, values in of_candidates.items()
        if len(values)
    }
