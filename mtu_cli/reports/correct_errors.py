"""What correct says of errors that it makes larger, or leaves, and what they are laid to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

from mtu_cli.analyses.correct.result import CorrectResult
from mtu_cli.analyses.correct.summary import ROUNDING_MM, SizeErrors
from mtu_cli.errors import Warned, listed
from mtu_cli.findings import Finding
from mtu_cli.reports.numbers import significant, told_apart
from mtu_cli.units import UM

Cause = Literal["calibration", "model", "heights"]
Items = list[SizeErrors]
MOST = 0.5
"""Share of an error that heights of the points make, from which on they are its cause."""


def errors_after(result: CorrectResult) -> list[Finding]:
    """Of errors that the correction makes larger, and of those that it makes smaller, and yet
    leaves.
    """
    items = result.by_size()
    return [
        *_grown([item for item in items if item.grown], result),
        *_left([item for item in items if item.off and not item.grown], result),
    ]


def _by_cause(
    items: Sequence[SizeErrors], result: CorrectResult, worst: Callable[[SizeErrors], float]
) -> list[tuple[Cause, Items, SizeErrors]]:
    """What errors are laid to, those of each, and the worst of them."""
    groups: dict[Cause, Items] = {"calibration": [], "model": [], "heights": []}
    for item in items:
        groups[_cause(item, result)].append(item)
    return [(cause, own, max(own, key=worst)) for cause, own in groups.items() if own]


def _cause(item: SizeErrors, result: CorrectResult) -> Cause:
    if _larger(item, result) > MOST * abs(item.mean[1]) and item.mean[1] > 0:
        return "heights"
    # One that stays oval tells by itself that the model lacks something.
    oval = (item.kind, item.id) in {(own.kind, own.id) for own in result.ovals}
    return "calibration" if item.grown and item.rounder and not oval else "model"


def _larger(item: SizeErrors, result: CorrectResult) -> float:
    """What heights of its points make of a circle, mm."""
    own = [lean.larger for lean in result.leaning if lean.id == item.id]
    return max(own, default=0.0) if item.kind == "circle" else 0.0


def _by_heights(worst: SizeErrors, result: CorrectResult) -> str:
    larger = significant(_larger(worst, result) / UM)
    return f"the points of {worst.id} lie at different heights: a bore is {larger} um larger there"


def _grown(items: Items, result: CorrectResult) -> list[Finding]:
    found = []
    for cause, own, worst in _by_cause(items, result, lambda item: item.rms[1] - item.rms[0]):
        before, after = told_apart(worst.rms[0] / UM, worst.rms[1] / UM)
        text = (
            f"the correction makes the errors of {listed([item.id for item in own])} larger "
            f"({worst.id}: root mean square {before} um before, {after} um after), by more than "
            "its uncertainty: "
        )
        if cause == "heights":
            text += _by_heights(worst, result)
        elif cause == "calibration":
            sides = (0.0 if side < ROUNDING_MM else side / UM for side in worst.form)
            first, last = map(significant, sides)
            text += (
                f"{worst.id} gets rounder (form {first} um before, {last} um after): is "
                "calibrated_mm right, or does the model lack a scale that its axes share?"
            )
        else:
            text += (
                "the model does not describe these points (`mtu compare` and `mtu close-loop` "
                "tell what it lacks), or calibrated_mm is not right"
            )
        found.append(Warned(code="errors-grown", message=text))
    return found


def _left(items: Items, result: CorrectResult) -> list[Finding]:
    found = []
    for cause, own, worst in _by_cause(items, result, lambda x: abs(x.mean[1]) - x.half):
        mean, half = (significant(value / UM) for value in (worst.mean[1], worst.half))
        within = f"95 % within {half} um" if worst.half else "no uncertainty is known"
        text = (
            f"after the correction the mean errors of {listed([item.id for item in own])} are "
            f"beyond their uncertainty ({worst.id}: {mean} um, {within}): "
        )
        if cause == "heights":
            text += _by_heights(worst, result)
        else:
            text += (
                "the model does not take out all of it (`mtu compare` and `mtu close-loop` tell "
                "what it lacks), or calibrated_mm is not right"
            )
        found.append(Warned(code="errors-left", message=text))
    return found
