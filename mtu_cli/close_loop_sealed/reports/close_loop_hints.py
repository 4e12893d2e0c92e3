"""What is told of names that are not proven, or not to be trusted where something is left."""

from __future__ import annotations

from mtu_cli.close_loop_sealed.analyses.loop.result import Judged, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import is_lone
from mtu_cli.close_loop_sealed.reports.close_loop_class import members
from mtu_cli.close_loop_sealed.reports.close_loop_sentences import Sentence
from mtu_cli.close_loop_sealed.reports.close_loop_shown import class_of, in_words, ranked

STRONG, LONE = 5.0, 0.9
"""log Bayes factor and posterior from which on an effect that is not proven is told."""
SURELY = 0.99
"""Posterior from which on no other name of the library comes near."""


def hints(item: TableResult, said: list[Sentence]) -> list[str]:
    """The nearest names, of which none is to be trusted where something is left."""
    if said:
        found = [effect for own in said for effect in own.effects]
        alone = all(is_lone(effect) and effect.posterior > SURELY for effect in found)
        lead = "As a hint only"
        if found and alone and not (item.without_name or item.twofold):
            lead = "As a hint only, though by far the likeliest of the library"
        return [f"{lead}: {'; '.join(_hinted(own, item) for own in said)}."]
    best = ranked(item)
    if item.effects:
        return []
    if not best or not is_strong(best[0]):
        return ["No one effect of the library stands out."]
    return [f"As a hint only: of the named effects {best[0].name} comes nearest."]


def _hinted(said: Sentence, item: TableResult) -> str:
    if len(said.effects) != 1:
        return said.named
    (effect,) = said.effects
    if len(class_of(effect)) == 1:
        return f"{effect.name} ({said.text})"
    known = {name: "; ".join(filter(None, said)) for name, *said in members(item, effect)}
    return " or ".join(
        f"{name} ({known[name]})" if name in known else in_words(name) for name in class_of(effect)
    )


def is_strong(judged: Judged) -> bool:
    """Whether a candidate that is not proven is so much the best that its name is of use: of many
    there is always one that fits noise best.
    """
    return (judged.log_bayes_factor or 0.0) >= STRONG and (judged.posterior or 0.0) >= LONE
