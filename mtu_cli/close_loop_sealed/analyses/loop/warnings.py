"""What a user has to know about how the loop was closed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import entry_text
from mtu_cli.close_loop_sealed.bridge import loop_warning
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.files.contract import is_identifier
from mtu_cli.files.covariates import looks_like_temperature
from mtu_cli.findings import Finding, error
from mtu_cli.language import names, parse
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS, p_text

FEW_PARTS = 5
LIKELIER, NOT_PASSED = 0.95, 0.05
"""Posterior of a candidate that is likelier than what was found, and its p that does not pass."""
FEWEST_ENTRIES = 4
ALL = 0.999
MOST_NAMED = 6
MOST_ALIKE = 4
APART = 2.0
"""Scatter of passes over that of single readings, and of these over what is predicted of them, from
which on it is told."""
RARE = 5e-3
"""Chance of the latter on a machine whose s_repeat is known by as few readings."""
PLACE_DIGITS = 3
SPARE_PLACES = 3
"""Places beyond what an effect takes from which on a searched value is more than a guess."""
FREES = {
    "offset": "offsets of whole parts: trend, step, and drift and warm-up but for what changes "
    "within a part",
    "offset,rotation": "offsets of whole parts (trend, step, and drift and warm-up but for what "
    "changes within a part), rotation, and the "
    "difference between squareness and rotation",
}


def judged_tables(
    tables: Sequence[ResidualTable],
) -> tuple[list[ResidualTable], list[Finding]]:
    """The tables with enough to tell an effect from scatter, and a warning on each other one.

    Raises InputError where none has.
    """
    lacking = [_lacking(table) for table in tables]
    if lacking[0] is not None and None not in lacking:
        what, expected = lacking[0]
        raise error("too-little-data", what=what, expected=expected)
    warned = [
        loop_warning(code="too-few", message=f"not judged: {lack[0]}")
        for lack in lacking
        if lack is not None
    ]
    return [table for table, lack in zip(tables, lacking, strict=True) if lack is None], warned


def _lacking(table: ResidualTable) -> tuple[str, str] | None:
    """What there is too little of to judge by, and what there should be."""
    parts, features = table.there.shape
    of = "" if table.component is None else f" of {table.component}"
    part, feature = ("pass", "place") if of else ("part", "feature")
    both = f"{part}{'es' if of else 's'} and {feature}s"
    if max(parts, features) < FEWEST_ENTRIES:
        return f"{parts} by {features} {both}{of}", f"{FEWEST_ENTRIES} or more of one or the other"
    alone = int((table.there.sum(axis=1) == 1).sum())
    if min(parts, features) > 1 and alone > parts / 2:
        those = f"{alone} of {parts} {part}{'es' if of else 's'}{of} have"
        one = f"no {part}{of} has two {feature}s" if alone == parts else f"{those} one {feature}"
        return (
            f"{one}, and what {both} differ by cannot be told apart",
            f"in column {part!r} one value for all {feature}s that were measured in one go",
        )
    return None


def loop_warnings(tables: Sequence[TableResult], most: int) -> tuple[Finding, ...]:
    """Warnings on all tables, that were searched for `most` causes each."""
    found: list[Finding] = []
    for table in tables:
        found += _of_table(table)
        if table.stopped:
            name = table.table.component
            text = (
                f"the search{'' if name is None else f' of {name}'} stopped at {most} "
                f"cause{'' if most == 1 else 's'}, and more would pass (--max-effects)"
            )
            found.append(loop_warning(code="max-effects", message=text))
    found += _odd_names([table.table for table in tables])
    datum = tables[0].table.datum
    if datum in FREES:
        text = f"the datum {datum!r} is free in every part: unseen are {FREES[datum]}"
        found.append(loop_warning(code="datum-freed", message=text))
    return tuple(dict.fromkeys(found))


def _of_table(result: TableResult) -> list[Finding]:
    table, found = result.table, []
    parts, of = len(table.parts), "" if table.component is None else f" of {table.component}"
    what = "part" if table.component is None else "pass"
    if parts < FEW_PARTS:
        text = (
            f"{parts} {what}{'' if parts == 1 else 's' if what == 'part' else 'es'}{of}: effects "
            f"that change from {what} to {what} can hardly be told from its scatter"
        )
        found.append(loop_warning(code="few-parts", message=text))
    if result.held_out_by is None:
        text = f"too few {what}s and columns{of} to hold any out: before and after are in sample"
        found.append(loop_warning(code="not-held-out", message=text))
    if result.gross:
        names = ", ".join(entry_text(g, result) for g in result.gross[:MOST_NAMED])
        beyond = len(result.gross) - MOST_NAMED
        more = f" and {beyond} more" if beyond > 0 else ""
        text = f"far off whatever the rest does, and set aside{of}: {names}{more}"
        found.append(loop_warning(code="outliers-set-aside", message=text))
    found += [*_passes_apart(result), *_scatter_beyond(result)]
    for effect in result.effects:
        if effect.alike:
            found.append(loop_warning(code="not-separable", message=_alike(effect, of)))
        found += _few_places(effect, table)
        if effect.family == "covariate" and effect.explained_share > ALL:
            text = (
                f"{effect.covariate} explains all of the errors{of}: it seems to be the "
                f"measurement itself under another name (--exclude {effect.name})"
            )
            found.append(loop_warning(code="covariate-is-the-error", message=text))
    found += [*_unlike(result), *_likelier(result)]
    missing = table.there.size - int(table.there.sum()) - len(result.gross)
    if missing > table.there.size / 2:
        text = "more than half of the cells were not measured: the search has little power"
        found.append(loop_warning(code="sparse-table", message=text))
    return found


def _unlike(result: TableResult) -> list[Finding]:
    """Of parts that would turn, or grow, along one axis by more than along the other."""
    found = []
    for effect in result.effects:
        size = effect.scatter
        if size is None or size.p_alike is None or not size.axes_unlike:
            continue
        _, unit, *_ = size.parameter
        sizes = ", ".join(
            f"{axis.upper()} {value / UNITS[unit].to_internal:.2g}" for axis, value in size.by_axis
        )
        text = (
            f"{effect.name}: {sizes} {unit}, more than scatter makes it ({p_text(size.p_alike)}): "
            "what moves a whole part does so along both axes alike; look for what one axis alone "
            "has from part to part (its scale, a guide, a direction): the library has none of it, "
            "and this name is a hint only"
        )
        found.append(loop_warning(code="axes-unlike", message=text))
    return found


def _likelier(result: TableResult) -> list[Finding]:
    """Of a mean candidate that fits far better than what was found and does not pass: where cells
    are missing, what would be far out by its fit may yet be chance.
    """
    told = {name for effect in result.effects for name in effect.candidates}
    found = []
    for judged in result.candidates if told else ():
        p, posterior = judged.p_familywise, judged.posterior or 0.0
        if p is None or p <= NOT_PASSED or posterior < LIKELIER:
            continue
        if judged.name in told or judged.family.endswith("scatter"):
            continue
        text = (
            f"{judged.name} fits better than all that was found (posterior {100 * posterior:.0f} % "
            f"at the first look), but may be chance by how parts scatter (p = {p:.2f}): what was "
            "found may be a part of it; more parts, or the missing cells, would tell"
        )
        found.append(loop_warning(code="likelier-not-passed", message=text))
    return found


def _passes_apart(result: TableResult) -> list[Finding]:
    """That passes of readings stand far apart, which no check holds against the model: scatter
    from pass to pass is part of it, however large.
    """
    table, noise = result.table, result.floor
    if table.scatter_known or not noise or len(table.parts) < 2:
        return []
    left = np.where(table.there, (table.errors - result.explained)[..., 0], np.nan)
    left -= np.nanmean(left, axis=0)
    # A pass has a level of its own in each direction.
    sign = np.broadcast_to(table.covariates.get(f"dir_{table.axes[0]}", 0.0), left.shape)[0]
    squares = [_of_levels(left[:, sign == own], noise) for own in np.unique(sign)]
    apart = math.sqrt(max(float(np.mean(squares)), 0.0))
    if apart <= APART * noise:
        return []
    unit = UNITS[table.unit].to_internal
    text = (
        f"the passes of {table.component} stand {apart / unit:.2g} {table.unit} apart (standard "
        f"deviation), single readings scatter by {noise / unit:.2g} {table.unit}: the model takes "
        "it as scatter from pass to pass, whatever makes it"
    )
    return [loop_warning(code="passes-apart", message=text)]


def _scatter_beyond(result: TableResult) -> list[Finding]:
    """That single features scatter from part to part by more than the machine's repeatability and
    the CMM make of them: what does is no effect with an equation, and would go for repeatability.

    By chi-squared over the degrees of freedom of s_repeat, that of the entries being far more.
    """
    table, noise = result.table, result.floor
    known = table.repeat_dof > 0 and np.isfinite(table.repeat_variance).all()
    if table.visit is None or not noise or not known or len(table.parts) < FEW_PARTS:
        return []
    from scipy.special import chdtr

    each = float(np.mean(1 / table.repeats[table.there]))
    machine = float(np.mean(table.visit.variance))
    cmm = float(np.mean(table.repeat_variance)) * each
    ratio = (noise**2 - cmm) / machine if machine > 0 else np.inf
    # So small would s_repeat have to have come out by chance.
    p = float(chdtr(table.visit.dof, table.visit.dof / ratio)) if ratio > 0 else 1.0
    if noise <= APART * math.sqrt(machine + cmm) or (np.isfinite(table.visit.dof) and p > RARE):
        return []
    unit = UNITS[table.unit].to_internal
    sizes = [f"{math.sqrt(v) / unit:.2g}" for v in (noise**2, machine, cmm)]
    text = (
        f"single features scatter from part to part by {sizes[0]} {table.unit}, of which the "
        f"machine's repeatability is {sizes[1]} and the CMM's {sizes[2]}: something else makes it, "
        "which no equation takes out, and which is the repeatability told here"
    )
    return [loop_warning(code="scatter-not-predicted", message=text)]


def _of_levels(left: FloatArray, noise: float) -> float:
    """Variance of the passes' means, of entries (P, H) that scatter by `noise`."""
    count = np.isfinite(left).sum(axis=1)
    levels = np.nansum(left, axis=1)[count > 0] / count[count > 0]
    if len(levels) < 2:
        return 0.0
    return float(np.var(levels, ddof=1) - noise**2 * np.mean(1 / count[count > 0]))


def _odd_names(tables: Sequence[ResidualTable]) -> list[Finding]:
    """Columns that no equation can name, once for all tables; who reads them tells of sensors."""
    every = dict.fromkeys(name for table in tables for name in table.covariates)
    odd = [name for name in every if not is_identifier(name) and not looks_like_temperature(name)]
    if not odd:
        return []
    text = (
        f"not used: {', '.join(map(repr, odd))}, since an equation cannot name "
        f"{'them' if len(odd) > 1 else 'it'}; expected names of letters a to z, digits "
        "and _, that begin with no digit (a temperature is T_<sensor>_degC, a direction dir_x, a "
        "time time_min)"
    )
    return [loop_warning(code="column-not-used", message=text)]


def _alike(effect: FoundEffect, of: str) -> str:
    """That a searched value is one of several: what it says of other places may be wrong."""
    ((name, (value, _, _)),) = effect.searched.items()
    others = sorted(effect.alike, key=lambda other: abs(math.log(abs(other / value))))
    shown = ", ".join(f"{other:.3g}" for other in others[:MOST_ALIKE])
    beyond = len(others) - MOST_ALIKE
    more = f" and {beyond} more" if beyond > 0 else ""
    return (
        f"{effect.name}{of}: {name} may as well be {shown}{more} as {value:.3g}: at the places of "
        "this data they are the same, at others they are not; what is written holds at these "
        "alone, until features at other distances were measured"
    )


def _few_places(effect: FoundEffect, table: ResidualTable) -> list[Finding]:
    """That there are hardly more places along an axis than the effect has free figures: its
    parameters, a level, and what was searched."""
    taken = len(effect.parameters) + 1 + len(effect.searched)
    used = {name for text in effect.equations.values() for name in names(parse(text))}
    found = []
    for axis, letter in enumerate(AXES):
        if not effect.searched or effect.alike or letter not in used or effect.covariate:
            continue
        along = table.places[..., axis][table.there]
        count = len(np.unique(np.round(along[np.isfinite(along)], PLACE_DIGITS)))
        if count < taken + SPARE_PLACES:
            name = next(iter(effect.searched))
            text = (
                f"{effect.name}: {count} different places along {letter} tell {name} hardly: the "
                f"effect takes {taken} figures of them by itself, and quite another {name} may fit "
                "as well; features at more distances would tell"
            )
            found.append(loop_warning(code="not-separable", message=text))
    return found
