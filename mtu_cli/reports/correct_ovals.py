"""What correct says of calibrated rings that stay oval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from math import hypot
from typing import Any

from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.errors import Warned, listed
from mtu_cli.findings import Finding
from mtu_cli.reports.document import um
from mtu_cli.reports.numbers import plus_minus
from mtu_cli.units import PARAMETER_UNITS, UM

SHOWN = 6
"""Rings that contradict each other, named one by one."""
APART = 3.0
"""Times the u of a difference of sizes up to which they are those of one cause."""


def document_of(own: Oval) -> dict[str, Any]:
    """An oval ring of the report."""
    told = _directions(own)
    longer, shorter = (None, None) if told is None else told
    value, u, unit = _size(own)
    return {
        "kind": own.kind,
        "id": own.id,
        "operation": own.operation or None,
        "longer_um": um(own.longer),
        "u_longer_um": um(own.u),
        "along": longer,
        "than_along": shorter,
        "may_lack": None
        if own.axes is None
        else {
            "effect": "squareness" if own.shear else "scale",
            "axes": sorted(own.axes),
            "value": value,
            "u": u,
            "unit": unit,
        },
    }


def ovals_left(ovals: Sequence[Oval]) -> list[Finding]:
    """The warning of rings that an ellipse is left of: a squareness does not show in a diameter."""
    if not ovals:
        return []
    names = list(dict.fromkeys(map(_label, ovals)))
    verb, its = ("stays", "its") if len(names) == 1 else ("stay", "their")
    text = (
        f"after the correction {listed(names)} {verb} oval, by more than {its} points scatter and "
        "the model is uncertain"
    )
    if _contradict(ovals):
        # One of each direction at least, then the others.
        worst = _worst_of_each(_directions, ovals)
        worst = [*worst, *(own for own in ovals if own not in worst)][:SHOWN]
        text += (
            f", and not alike ({'; '.join(map(_longer, worst))}): what the model lacks "
            "everywhere would be of one sign: they are not round themselves, or it lacks what "
            "differs from place to place"
        )
    else:
        worst = _worst_of_each(_cause, ovals)
        itself = "it is not round itself" if len(names) == 1 else "they are not round themselves"
        text += f" ({'; '.join(map(_longer, worst))}): {itself}, or the model lacks {_lack(worst)}"
    return [Warned(code="oval-left", message=f"{text} (`mtu close-loop` tells)")]


def _cause(own: Oval) -> tuple[tuple[str, ...], bool]:
    """The axes of a squareness or scale, () where none is told, and whether it is a squareness."""
    return tuple(sorted(own.axes or ())), own.shear


def _contradict(ovals: Sequence[Oval]) -> bool:
    """Whether rings show one cause with both signs: what a machine does everywhere has one."""
    named = [own for own in ovals if own.axes is not None]
    return len({(_cause(own), _directions(own)) for own in named}) > len(set(map(_cause, named)))


def _worst_of_each(key: Callable[[Oval], object], ovals: Sequence[Oval]) -> list[Oval]:
    """The rings that are the longest of their key, the longest first."""
    found: dict[object, Oval] = {}
    for own in sorted(ovals, key=lambda own: -own.longer):
        found.setdefault(key(own), own)
    return list(found.values())


def _longer(own: Oval) -> str:
    """By what a ring is oval."""
    longer, told = f"{plus_minus(own.longer / UM, own.u / UM)} um", _directions(own)
    if told is None:
        return f"{_label(own)}: its longest diameter is {longer} more than its shortest"
    return f"{_label(own)}: {longer} longer along {told[0]} than along {told[1]}"


def _lack(worst: Sequence[Oval]) -> str:
    """What the model may lack, of the worst ring of each cause."""
    named = [own for own in worst if own.axes is not None]
    if not named:
        return "a squareness or a scale"
    if len(worst) == 1:
        return _lacks(worst[0])
    scales = [own for own in named if not own.shear]
    axis = _shared(scales)
    apart = named if axis is None else [own for own in named if own.shear]
    told = [f"{_lacks(own)} ({_label(own)})" for own in apart]
    if axis is not None:
        against = [
            f"{_shown_size(own)} against {_other(own, axis)} ({_label(own)})" for own in scales
        ]
        told.append(f"a scale of {axis}, {' and '.join(against)}")
    return " and ".join(told)


def _shared(scales: Sequence[Oval]) -> str | None:
    """The axis of which one scale makes all differences of several pairs of axes: longer, or
    shorter, than each of the others, by as much. None where there are not several, or no such axis.
    """
    if len(scales) < 2 or not all(_as_large(*pair) for pair in combinations(scales, 2)):
        return None
    sides = [[own.axes[side] for own in scales if own.axes is not None] for side in (0, 1)]
    return next((side[0] for side in sides if len(set(side)) == 1), None)


def _as_large(a: Oval, b: Oval) -> bool:
    return abs(a.size - b.size) <= APART * hypot(_u_of_size(a), _u_of_size(b))


def _u_of_size(own: Oval) -> float:
    """The same share of the size as of the difference of diameters."""
    return abs(own.size) * own.u / own.longer if own.longer else 0.0


def _other(own: Oval, axis: str) -> str:
    return next(other for other in own.axes or () if other != axis)


def _label(own: Oval) -> str:
    return " ".join(filter(None, [own.operation, own.id]))


def _directions(own: Oval) -> tuple[str, str] | None:
    if own.axes is None:
        return None
    a, b = own.axes
    if not own.shear:
        return a, b
    plus, minus = f"{a} + {b}", f"{a} - {b}"
    return (plus, minus) if own.size > 0 else (minus, plus)


def _size(own: Oval) -> tuple[float, float, str]:
    """Squareness or difference of scales, without a sign (`_directions` has it), and its u."""
    unit = "arcsec" if own.shear else "um/m"
    scale = PARAMETER_UNITS[unit].to_internal
    return abs(own.size) / scale, _u_of_size(own) / scale, unit


def _shown_size(own: Oval) -> str:
    value, u, unit = _size(own)
    return f"{plus_minus(value, u)} {unit}"


def _lacks(own: Oval) -> str:
    a, b = _cause(own)[0]
    if own.shear:
        return f"a squareness of {a} and {b} of {_shown_size(own)}"
    return f"a scale of {a} or {b}, {_shown_size(own)} between them"
