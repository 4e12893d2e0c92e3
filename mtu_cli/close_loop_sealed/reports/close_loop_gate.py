"""What the line of a gate says of close-loop: the verdict and the effects behind it."""

from __future__ import annotations

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.shown import own_verdict
from mtu_cli.close_loop_sealed.reports.close_loop_shown import RIVALS, class_of
from mtu_cli.findings import listed


def gate_text(result: CloseLoopResult) -> str:
    """Such as "verdict named: backlash-y" or "verdict class: offset-x or drift-x".

    With "unexplained", where an effect is a hint at most, those that stand beside what has no
    name are told as such.
    """
    found = [(effect, own_verdict(effect, t)) for t in result.tables for effect in t.effects]
    said = f"verdict {result.verdict}"
    if result.verdict != "unexplained":
        return f"{said}: {listed(_name(effect) for effect, _ in found)}" if found else said
    beside = [_name(effect) for effect, own in found if own != "unexplained"]
    hints = [_name(effect) for effect, own in found if own == "unexplained"]
    said += f", beside {listed(beside)}" if beside else ""
    return said + (f", with a hint at {listed(hints)}" if hints else "")


def _name(effect: FoundEffect) -> str:
    """Of a class its first names; all where one more would be left."""
    known = class_of(effect)
    if len(known) <= RIVALS + 1:
        return " or ".join(known)
    names = " or ".join(known[:RIVALS])
    return f"{names} or {len(known) - RIVALS} more"
