"""What is said of the effects found: one sentence a cause, though it may be several effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint, NeutralPoint
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import own_verdict
from mtu_cli.close_loop_sealed.reports.close_loop_effects import effect_text
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    beside_which,
    class_of,
    either,
    sure_levels,
)
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.numbers import plus_minus


@dataclass(frozen=True, slots=True, kw_only=True)
class Sentence:
    """What is said of `effects`: of one, of those that are one cause, or (none) what follows from
    those of several sentences (`of`).
    """

    effects: tuple[FoundEffect, ...]
    text: str
    of: tuple[FoundEffect, ...] = ()

    @property
    def named(self) -> str:
        """The text with the names of the effects behind it."""
        names = " and ".join(effect.name for effect in self.effects)
        return f"{self.text} ({names})" if names else self.text


def sentences(item: TableResult) -> list[Sentence]:
    """One an effect, in the order found; an axis that grows from a fixed point, or drifts from a
    temperature (or turns about a place) at which it is right, takes one.

    A drift of several axes keeps its own beside it, unless all of them grow from fixed points; so
    do effects of which one stands and another is a hint.
    """
    joined: dict[int, Sentence] = {}
    told = _told_by_each(item)
    last = []
    for point in (p for p in item.fixed_points if p.given is None):
        first = item.effects[point.growth[0]]
        own = tuple(item.effects[e] for e in (*point.growth, *point.drift))
        beside = beside_one_of(item, *own)
        one = point.told and len(point.growth) == 1 and first.axis == point.axis
        if one and _alike(own, item):
            text = f"{beside}{effect_text(first, item)} from a fixed point at {_place(point)}"
            joined[point.growth[0]] = Sentence(effects=own, text=text)
            for e in point.drift:
                told.setdefault(e, set()).add(f"E{point.axis}")
        else:
            last.append(
                Sentence(effects=(), text=beside_one_of(item, *own) + _fixed(point), of=own)
            )
    for neutral in (p for p in item.neutral_points if p.given is None):
        (e, *more), right = neutral.drift, _right(neutral)
        own = tuple(item.effects[k] for k in (*neutral.drift, *neutral.offset))
        beside = beside_one_of(item, *own)
        one = not more and own[0].equations.keys() == {f"E{neutral.axis}"}
        if one and _alike(own, item):
            subject = f"{neutral.axis.upper()} " if neutral.covariate in AXES else ""
            text = f"{beside}{effect_text(own[0], item)}, and {subject}{right}"
            joined[e] = Sentence(effects=own, text=text)
            for k in neutral.offset:
                told.setdefault(k, set()).add(f"E{neutral.axis}")
        else:
            text = f"{beside}{neutral.axis.upper()} {right}"
            last.append(Sentence(effects=(), text=text, of=own))
    return [*_each(item, joined, told), *last]


def _each(
    item: TableResult, joined: Mapping[int, Sentence], told: Mapping[int, set[str]]
) -> list[Sentence]:
    """That of each effect, or of the cause that it is `joined` in; none of what others hold."""
    return [
        joined.get(e, Sentence(effects=(effect,), text=_text(item, effect)))
        for e, effect in enumerate(item.effects)
        if e not in told or not effect.equations.keys() <= told[e]
    ]


def _text(item: TableResult, effect: FoundEffect) -> str:
    """What is said of one effect, with the offset that it holds as its level: but of a component,
    whose readings are 0 wherever the instrument was set to 0.
    """
    shifts = "".join(
        f", and everything is shifted along {axis.upper()} by {plus_minus(own.value, own.u)} "
        f"{own.unit}"
        for own, axis in sure_levels(effect)
        if item.table.component is None
    )
    return (
        f"{if_one_of(item, effect)}{beside_one_of(item, effect)}{effect_text(effect, item)}{shifts}"
    )


def if_one_of(item: TableResult, offset: FoundEffect) -> str:
    """Which of a class have an offset that is not told from 0 beside the others, nor one cause with
    them.
    """
    for place, effect in enumerate(item.effects):
        gone = {rival.name for rival in effect.rivals if offset.name in rival.without}
        if item.verdict == "class":
            gone |= _one_cause_with(item, place, offset)
        left = tuple(name for name in class_of(effect) if name not in gone)
        if gone and left:
            return f"if it is {either(left)}, "
    return ""


def _one_cause_with(item: TableResult, place: int, offset: FoundEffect) -> set[str]:
    """Names that the effect at `place` may be and with which an offset is one cause."""
    fixed = [(p.given, p.drift) for p in item.fixed_points if p.told]
    found = [*fixed, *((p.given, p.offset) for p in item.neutral_points)]
    return {
        given[1]
        for given, others in found
        if given is not None and given[0] == place and offset in [item.effects[e] for e in others]
    }


def beside_one_of(item: TableResult, *effects: FoundEffect) -> str:
    """Beside which others effects have their sizes, where they have others beside their rivals."""
    changes = dict.fromkeys(name for own in effects for name in beside_which(item, own))
    return f"beside {' and '.join(changes)}, " if changes else ""


def _alike(effects: tuple[FoundEffect, ...], item: TableResult) -> bool:
    """Whether all of them stand, or none."""
    return len({own_verdict(effect, item) == "named" for effect in effects}) == 1


def _told_by_each(item: TableResult) -> dict[int, set[str]]:
    """Offsets, by their place with the equations, that are one cause with each of a class that the
    data cannot tell apart: what is said of each of them holds them.
    """
    told: dict[int, set[str]] = {}
    for point in item.neutral_points:
        place = None if point.given is None else point.given[0]
        if place is None or place not in point.drift:
            continue
        own = {p.given for p in item.neutral_points if p.axis == point.axis}
        offsets = {item.effects[e].name for e in point.offset}
        rivals = item.effects[place].rivals
        own |= {(place, rival.name) for rival in rivals if offsets <= {*rival.without}}
        whole = {(place, name) for name in item.effects[place].candidates} <= own
        about = {own_verdict(item.effects[e], item) for e in (place, *point.offset)}
        # Beside a hint what stands is told by itself.
        if whole and about != {"unexplained", "named"}:
            for e in point.offset:
                told.setdefault(e, set()).add(f"E{point.axis}")
    return told


def one_cause(item: TableResult, place: int, own: FoundEffect) -> str | None:
    """What follows if the effect at `place`, one of several, is `own`: with others it is an axis
    that is fixed somewhere, or right at a temperature, or has no offset.
    """
    if own.without:
        return f"{' and '.join(own.without)} is not told from 0 then"
    for point in item.fixed_points:
        if point.given != (place, own.name) or not point.told:
            continue
        others = [item.effects[e].name for e in (*point.growth, *point.drift) if e != place]
        first = own if point.growth[0] == place else item.effects[point.growth[0]]
        verb = "shrinks" if first.parameters[0][2] < 0 else "grows"
        return (
            f"with {' and '.join(others)} that is one cause: {point.axis.upper()} {verb} from a "
            f"fixed point at {_place(point)}"
        )
    for neutral in item.neutral_points:
        if neutral.given == (place, own.name):
            others = [item.effects[e].name for e in (*neutral.drift, *neutral.offset) if e != place]
            return (
                f"with {' and '.join(others)} that is one cause: {neutral.axis.upper()} "
                f"{_right(neutral)}"
            )
    return None


def _right(point: NeutralPoint) -> str:
    """Such as "is right at T_air_degC = 22.2 ± 0.8", and what the data have where it is none of
    theirs; where it changes `beside` it with another column, it stays where it is.
    """
    (low, high), at = point.seen, plus_minus(point.at, point.u)
    at += " mm" if point.covariate in AXES else ""
    beyond = "" if low <= point.at <= high else f" (beyond the data: {low:.4g} to {high:.4g})"
    stays = "is right" if point.beside is None else f"does not move with {point.beside}"
    return f"{stays} at {point.covariate} = {at}{beyond}"


def _fixed(point: FixedPoint) -> str:
    axis = point.axis.upper()
    if not point.told:
        return f"the fixed point of {axis} is not told"
    return f"in all, the fixed point of {axis} is {_place(point)}"


def _place(point: FixedPoint) -> str:
    return f"{point.axis} = {plus_minus(point.at, point.u)} mm"
