"""What correct says of errors that it makes larger, or leaves, and what they are laid to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

from mtu_cli.analyses.correct.result import CorrectResult
from mtu_cli.analyses.correct.summary import SizeErrors
from mtu_cli.findings import Finding, finding
from mtu_cli.reports.numbers import significant
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


_CAUSES = {
    "heights": "the points of {worst} lie at different heights, which makes it {larger} um larger",
    "calibration": "{worst} gets rounder: calibrated_mm is wrong, or the model lacks a scale that "
    "its axes share",
    "model": "the model does not describe these points, or calibrated_mm is wrong",
}


def _cause_text(cause: Cause, worst: SizeErrors, result: CorrectResult) -> str:
    larger = significant(_larger(worst, result) / UM)
    return _CAUSES[cause].format(worst=worst.id, larger=larger)


def _grown(items: Items, result: CorrectResult) -> list[Finding]:
    return [
        finding(
            "errors-grown",
            names=[item.id for item in own],
            worst=worst.id,
            rms_before_um=worst.rms[0] / UM,
            rms_after_um=worst.rms[1] / UM,
            cause=_cause_text(cause, worst, result),
        )
        for cause, own, worst in _by_cause(items, result, lambda item: item.rms[1] - item.rms[0])
    ]


def _left(items: Items, result: CorrectResult) -> list[Finding]:
    return [
        finding(
            "errors-left",
            names=[item.id for item in own],
            worst=worst.id,
            mean_um=worst.mean[1] / UM,
            half_width_um=worst.half / UM,
            cause=_cause_text(cause, worst, result),
        )
        for cause, own, worst in _by_cause(items, result, lambda x: abs(x.mean[1]) - x.half)
    ]
