"""What close-loop found, in the words of a machinist: the verdict on a table."""

from __future__ import annotations

from itertools import groupby

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import (
    CloseLoopResult,
    TableResult,
)
from mtu_cli.close_loop_sealed.analyses.loop.shown import (
    own_verdict,
    things,
)
from mtu_cli.close_loop_sealed.analyses.loop.warnings import APART, FEW_PARTS, FREES
from mtu_cli.close_loop_sealed.reports.close_loop_class import class_lines
from mtu_cli.close_loop_sealed.reports.close_loop_hints import hints, is_strong
from mtu_cli.close_loop_sealed.reports.close_loop_notes import MEANINGS, of_p
from mtu_cli.close_loop_sealed.reports.close_loop_rest import (
    beside_gross,
    nameless_text,
    rest_text,
    together,
)
from mtu_cli.close_loop_sealed.reports.close_loop_sentences import Sentence, sentences
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    capital,
    plural,
    ranked,
    size_of,
    stays,
)
from mtu_cli.close_loop_sealed.reports.close_loop_sums import sum_texts
from mtu_cli.reports.numbers import p_value, significant
from mtu_cli.units import UNITS

PART_VARIANCE, TURNED = "part-variance", "rotation-scatter"
NO_ERROR = 1e-12
"""Root mean square (mm, rad) below which errors are the rounding of coordinates."""
MORE_LEFT = 1.3
"""Times the held-out error from which on more left in all data is told."""
COMPARES = " `mtu compare`, which tests item by item, may call it biased."
HOPELESS = 100.0
"""Times the rms of the errors beyond which an effect would be found only in name."""


def verdict_text(item: TableResult, result: CloseLoopResult) -> str:
    """The verdict on a table in a few sentences, its component in front."""
    return " ".join(text for _, text in verdict_lines(item, result))


def verdict_lines(item: TableResult, result: CloseLoopResult) -> list[tuple[bool, str]]:
    """The same in paragraphs, each with whether it is one of several that cannot be told apart."""
    if item.verdict == "none":
        said = [(False, _none(item, result.alpha))]
    elif item.verdict == "class":
        said = _class(item, result)
    elif item.verdict == "named":
        said = [(False, _named(item, result))]
    else:
        said = [(False, _unexplained(item))]
    if item.table.component is not None:
        said[0] = (False, f"{item.table.component}: {said[0][1]}")
    return said


def _named(item: TableResult, result: CloseLoopResult) -> str:
    """Such as "X loses 8.2 ± 0.6 um at reversal, short from both sides (backlash-x). ..."."""
    found = "; ".join(said.named for said in sentences(item))
    return " ".join([f"{capital(found, item)}.", *_worth(item, result)])


def _class(item: TableResult, result: CloseLoopResult) -> list[tuple[bool, str]]:
    """What cannot be told apart one by one, and what it is worth behind all of them."""
    lines = [*class_lines(item), *((False, text) for text in _worth(item, result))]
    return [
        (one, text)
        for one, run in groupby(lines, key=lambda line: line[0])
        for text in ([own for _, own in run] if one else [" ".join(own for _, own in run)])
    ]


def _worth(item: TableResult, result: CloseLoopResult) -> list[str]:
    """What follows where effects were found: what else may be, and the error before and after."""
    said = [*_not_by_itself(item, result.alpha), *sum_texts(item, result), *_set_up(item)]
    said += _of_one_part(item)
    return [*said, _before_after(item), *_by_column(item)]


def _not_by_itself(item: TableResult, alpha: float) -> list[str]:
    """Of what is the same in all parts beside an effect that was found (`same_in_all`)."""
    row, _ = things(item)
    return [
        f"{own.name} does not pass by itself (p {of_p(own.p_familywise)}): without it what varies "
        f"from {row} to {row} and what is the same in all would ask for two sizes of one effect."
        for own in item.effects
        if own.p_familywise >= alpha
    ]


def _unexplained(item: TableResult) -> str:
    row, column = things(item)
    mass = {"rows": plural(row), "columns": plural(column)}
    p = dict(item.checks)
    fired = [f"{MEANINGS[n].format(**mass)} ({n}, p {of_p(p[n])})" for n in item.fired]
    if item.without_name:
        fired.append(nameless_text(item))
    fired += [
        f"{name} fits only twice over, in two forms that no one cause has at once, and together "
        "they are a shape without a name"
        for name in item.twofold
    ]
    sure, others = _sure(item)
    alone = [said for said in others if any(effect.of_one_axis for effect in said.effects)]
    rest_of = [said for said in others if said not in alone]
    fired += [f"{said.text}, to which {said.effects[0].name} comes nearest" for said in alone]
    known = "; ".join(said.named for said in sure)
    beside = "Beside that something" if sure else "Something"
    # What only might have no name is no more than that.
    lead = f"{beside} may be there that no effect of the library describes"
    if item.fired or item.twofold or alone:
        lead = f"{beside} is there that no effect of the library describes"
    elif rest_of:
        lead = f"{beside} is there, and this data cannot tell whether it has a name"
    text = f"{lead}: {'; '.join(fired)}."
    first = [f"{capital(known, item)}."] if sure else []
    return " ".join(
        [*first, text, *hints(item, rest_of), *_set_up(item), rest_text(item), *_by_column(item)]
    )


def _by_column(item: TableResult) -> list[str]:
    """What a table of corrections would make of an error that stays where it is."""
    if item.by_column is None or not stays(item):
        return []
    (row, column), unit = things(item), item.table.unit
    after, own = together(item, item.after.rms, item.by_column.rms)
    said = f"Much of it stays: a correction of its own for every {column} would take the rms of"
    return [f"{said} held-out {plural(row)} from {after} to {own} {unit}."]


def _sure(item: TableResult) -> tuple[list[Sentence], list[Sentence]]:
    """What is said of effects that stand beside what has no name; then of the others."""
    sure: list[Sentence] = []
    others: list[Sentence] = []
    for said in sentences(item):
        about = said.effects or said.of
        stands = all(own_verdict(e, item) == "named" for e in about)
        (sure if stands else others).append(said)
    return sure, others


def _set_up(item: TableResult) -> list[str]:
    """Parts that differ as a whole may have been set up by hand: what takes that out, and what
    is unseen then.
    """
    free, whole = item.table.datum, [e for e in item.effects if not e.of_one_axis]
    turned = any(e.family == TURNED for e in whole)
    shifted = PART_VARIANCE in item.fired and free == "none"
    if item.table.component is not None or not (turned or shifted) or "rotation" in free:
        return []
    datum, own = ("offset,rotation", "an offset and a turn") if turned else ("offset", "an offset")
    return [
        f"It may be that each part was set up by hand (on the machine or the CMM), with {own} of "
        f"its own: --datum {datum} takes that out; unseen are then {FREES[datum]}."
    ]


def _of_one_part(item: TableResult) -> list[str]:
    """What one part has left as a whole: nothing tells how it was set up from what the machine does
    to every part.
    """
    table, unit = item.table, UNITS[item.table.unit].to_internal
    if len(table.parts) != 1 or table.component is not None or item.floor is None:
        return []
    left = np.where(table.there[..., None], table.errors - item.explained, np.nan)
    means = np.nanmean(left, axis=(0, 1))
    told = [
        f"{axis.upper()} {significant(value / unit)}"
        for axis, value in zip(table.axes, means.tolist(), strict=True)
        if abs(value) > APART * item.floor
    ]
    if not told:
        return []
    return [
        f"Of one part it is not known whether it lay shifted or the machine does that to every "
        f"part: a mean error of {', '.join(told)} {table.unit} is left."
    ]


def _none(item: TableResult, alpha: float) -> str:
    if item.before.rms <= NO_ERROR:
        return "Nothing undeclared was found: what was measured is what the model predicts."
    unit = item.table.unit
    rms, floor = together(item, item.before.rms, item.floor)
    likely = _likely(item, alpha)
    passes = "may be scatter" if likely else _passes_for(item)
    said = [
        f"Nothing undeclared was found{beside_gross(item)} (at {100 * alpha:g} % false "
        f"alarms in all): the rms of {rms} {unit} {passes}"
        + (f", repeatability is {floor} {unit}." if item.floor is not None else "."),
        *likely,
    ]
    told = [c for c in item.candidates if c.minimum_detectable is not None]
    known = [c for c in told if (c.minimum_detectable or 0.0) <= HOPELESS * item.before.rms]
    if known:
        low = min(known, key=lambda c: c.minimum_detectable or 0.0)
        high = max(known, key=lambda c: c.minimum_detectable or 0.0)
        small, large = (significant(size_of(item, c.minimum_detectable)) for c in (low, high))
        said.append(
            f"Four times in five, an effect of {small} {unit} rms ({low.name}) "
            f"to {large} {unit} ({high.name}) would have been found"
            + (f"; {len(told) - len(known)} more hardly." if len(told) > len(known) else ".")
        )
    return " ".join([*said, *_by_column(item)])


def _passes_for(item: TableResult) -> str:
    """What stays is no scatter from part to part, which few parts say little of."""
    row, column = things(item)
    if item.by_column is None or not stays(item):
        count = len(item.table.parts)
        few = f", of which {count} {plural(row)} say little" if 1 < count < FEW_PARTS else ""
        return f"passes for scatter{few}"
    return f"passes for errors of single {plural(column)}, the same in every {row}"


def _likely(item: TableResult, alpha: float) -> list[str]:
    """What fits by far the best, but is not proven: the parts may scatter that much."""
    count, best = len(item.table.parts), ranked(item)
    if count < 2 or not best:
        return []
    first = best[0]
    if not is_strong(first):
        return []
    row, _ = things(item)
    p = first.p_familywise
    if p is not None and p <= alpha:
        return [
            f"{first.name} fits best by far (p {p_value(p)}), but its own size, by "
            f"what {plural(row)} scatter there, is not told from 0. Take more."
        ]
    return [
        f"{first.name} fits best by far, but {count} {plural(row)} cannot prove it "
        f"(p {p_value(1.0 if p is None else p)}): {plural(row)} may scatter that much. Take more."
        + (COMPARES if item.table.component is None else "")
    ]


def _before_after(item: TableResult) -> str:
    """The error before and after on data that took no part in finding the effects."""
    unit = item.table.unit
    if all(effect.kind == "scatter" for effect in item.effects):
        rms, floor = together(item, item.before.rms, item.floor)
        said = f"This is scatter, which no equation takes out: the rms stays at {rms} {unit}"
        return f"{said}; repeatability is {floor} {unit}." if item.floor is not None else f"{said}."
    before, after, floor = together(item, item.before.rms, item.after.rms, item.floor)
    row, column = things(item)
    of = {"parts": f"Held-out {plural(row)}", "columns": f"Held-out {plural(column)}"}.get(
        item.held_out_by or "", "All data (none could be held out)"
    )
    said = f"{of}: rms {before} -> {after} {unit}"
    said = f"{said}; repeatability {floor} {unit}." if item.floor is not None else f"{said}."
    left = item.in_sample_after.rms
    if item.held_out_by is None or left <= MORE_LEFT * item.after.rms:
        return said
    # The folds took out what the search of all data did not.
    rest = together(item, left)[0]
    return f"{said} With all data less was found: what is told here leaves {rest} {unit} in them."
