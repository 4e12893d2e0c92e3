"""What close-loop says of effects that the data cannot tell apart: each of them, and what would."""

from __future__ import annotations

from dataclasses import replace

from mtu_cli.close_loop_sealed.analyses.loop.result import Experiment, FoundEffect, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import is_nameless, pitch_is_open, should_be_told
from mtu_cli.close_loop_sealed.reports.close_loop_effects import effect_text
from mtu_cli.close_loop_sealed.reports.close_loop_notes import COPIED, copied
from mtu_cli.close_loop_sealed.reports.close_loop_sentences import (
    Sentence,
    beside_one_of,
    if_one_of,
    one_cause,
    sentences,
)
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    RIVALS,
    capital,
    class_of,
    either,
    nearly_alone,
    stays,
)
from mtu_cli.language import names as names_in
from mtu_cli.language import parse
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.numbers import significant

ON_MACHINE = "look for each of them on the machine itself"
BEND, PLACES = "straightness-", 4
"""A line of third order with a free mean goes through any three places."""
OTHER_PLACES = "measure features at more, and uneven, distances along the axis"
NO_DISTANCE = 0.05
"""Standard deviations below which rivals are the same in the data so far."""

WORTH = 1.0
"""Further standard deviations that make a follow-up worth its parts."""

Line = tuple[bool, str]
"""Whether it is what one of several rivals would be, and the words."""


def class_lines(item: TableResult) -> list[Line]:
    """What was found, each of what cannot be told apart on a line of its own, and what to do."""
    lines: list[Line] = []
    # What is sure stands before what is one of several.
    for said in sorted(sentences(item), key=lambda said: _order(item, said)):
        effect = said.effects[0] if len(said.effects) == 1 else None
        names = () if effect is None else class_of(effect)
        if effect is None or len(names) < 2:
            lines.append((False, capital(f"{said.named}.", item)))
            if effect is not None and effect.apart:
                apart = f"Not much less likely, but no readings of it: {either(effect.apart)}."
                lines.append((False, apart))
        elif nearly_alone(effect):
            cause = one_cause(item, _place(item, effect), effect)
            likely = "; ".join(filter(None, [said.named, cause]))
            rest = f"{either(names[1:])} is not excluded."
            lines.append((False, f"Most likely {likely}; {rest}"))
        else:
            lines += _rivals(item, effect, beside=bool(lines))
        if effect is not None and (len(names) > 1 or pitch_is_open(effect)):
            lines += [(False, text) for text in _experiment(effect)]
    return lines


def _order(item: TableResult, said: Sentence) -> int:
    """0 of what is sure, 1 of one of several, 2 of what follows from one of them."""
    if any(len(class_of(effect)) > 1 for effect in said.of):
        return 2
    if len(said.effects) != 1:
        return 0
    (effect,) = said.effects
    return 2 if if_one_of(item, effect) else int(len(class_of(effect)) > 1)


def _rivals(item: TableResult, effect: FoundEffect, *, beside: bool) -> list[Line]:
    """The names, then each of them; a cause that all of them make with others is told once."""
    names = class_of(effect)
    more = " (more in the table)" if len(names) > RIVALS + 1 else ""
    first = "Beside that " if beside else ""  # What stands there is sure.
    both = f", or {'both' if len(names) == 2 else 'several of them'}" if stays(item) else ""
    alike = [text.removesuffix(COPIED) for text in copied(item, names[:RIVALS])]
    why = f", for {' and '.join(alike)}" if alike else ""
    lead = f"{first}{either(names)}{both}{more}: this data cannot tell which{why}."
    known = members(item, effect)
    causes = {cause for _, _, cause in known}
    one = causes.pop() if len(known) > 1 and len(causes) == 1 else None
    lines = [
        (True, f"If {name}: {text}{'' if one or cause is None else f'; {cause}'}.")
        for name, text, cause in known
    ]
    left = [x for x in names if not is_nameless(x) and x not in {name for name, *_ in known}]
    if 0 < len(left) < RIVALS:
        # The same on these points, and far less likely.
        lines.append((True, f"What {either(tuple(left))} would be is not estimated."))
    which = f"If {either(tuple(name for name, *_ in known))}" if left else "Whichever it is"
    return [(False, lead), *lines, *([(False, f"{which}, {one}.")] if one else [])]


def members(item: TableResult, effect: FoundEffect) -> list[tuple[str, str, str | None]]:
    """The name of each of a class, what it would be, as far as it was estimated, and what that
    would make of the other effects.
    """
    place = _place(item, effect)
    # A rival stands in its place: what it would be is told beside the others.
    others = replace(item, effects=tuple(own for own in item.effects if own is not effect))
    first = f"{beside_one_of(item, effect)}{effect_text(effect, others)}"
    texts = [first, *(effect_text(own, others) + _changed(own, item) for own in effect.rivals)]
    return [
        (own.name, text, one_cause(item, place, own))
        for own, text in zip((effect, *effect.rivals), texts, strict=True)
    ]


def _changed(rival: FoundEffect, item: TableResult) -> str:
    """What other effects are beside a rival, where it is not what they were found as."""
    return "".join(f"; then {effect_text(own, item)} ({own.name})" for own in rival.changed)


def _place(item: TableResult, effect: FoundEffect) -> int:
    return next(e for e, own in enumerate(item.effects) if own is effect)


def _experiment(effect: FoundEffect) -> list[str]:
    """What to do to tell the class apart, where anything is known of it."""
    planned = effect.experiment
    if effect.inseparable and any(name.startswith("cyclic-") for name in class_of(effect)):
        return [f"No further parts like these tell them apart. To tell: {OTHER_PLACES}."]
    if effect.inseparable:
        return _no_parts(effect)
    if planned is None and pitch_is_open(effect):
        return [f"To tell: {OTHER_PLACES}."]
    if planned is None:
        return [] if effect.separates is None else [f"To tell: {effect.separates}."]
    further = significant(planned.further_d)
    now = significant(planned.now_d) if planned.now_d >= NO_DISTANCE else "none"
    little = planned.further_d < WORTH
    if should_be_told(effect):
        nameless = any(map(is_nameless, effect.class_names))
        one = "One of those with a name" if nameless else "One of them"
        none = "or what has no name" if nameless else "or something else"
        lead = f"{one} alone would show in this data ({now} standard deviations): more than one "
        if little:
            return [f"{lead}may act at once, {none}. {_little(planned)}"]
        return [f"{lead}may act at once, {none}. To tell: {planned.do}."]
    if little:
        return [_little(planned)]
    return [
        f"To tell: {planned.do}: that should set them a further {further} standard deviations "
        f"apart (so far {now})."
    ]


def _little(planned: Experiment) -> str:
    """That the best follow-up is not worth its parts."""
    further = significant(planned.further_d)
    return (
        f"Further parts tell little: the best of all follow-ups ({planned.do}) sets them a "
        f"further {further} standard deviations apart."
    )


def _no_parts(effect: FoundEffect) -> list[str]:
    """What to do where no further parts tell a class apart. A bend is the same as a lean, as long
    as it has a free parameter for every place that the features have, and tells itself beyond.
    """
    names = class_of(effect)
    bends = [name for name in names if name.startswith(BEND)]
    others = tuple(name for name in names if name not in bends)
    if len(bends) != 1 or not others:
        return [f"No further parts tell these apart: {ON_MACHINE}."]
    (bend,) = bends
    # One that was not estimated is the same as the effect, along the same axis.
    own = next((rival for rival in (effect, *effect.rivals) if rival.name == bend), effect)
    known = {name for text in own.equations.values() for name in names_in(parse(text))}
    along = [axis for axis in AXES if axis in known]
    if len(along) != 1:
        return [f"No further parts tell these apart: {ON_MACHINE}."]
    rest = others[0] if len(others) == 1 else "the others"
    texts = [f"Features at {PLACES} or more different {along[0]} in all tell {bend} from {rest}."]
    if len(others) > 1:
        texts.append(f"No further parts tell {either(others)} apart: {ON_MACHINE}.")
    return texts
