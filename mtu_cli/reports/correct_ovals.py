"""What correct says of calibrated rings that stay oval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.findings import Finding, finding
from mtu_cli.reports.document import um
from mtu_cli.reports.numbers import plus_minus
from mtu_cli.units import PARAMETER_UNITS, UM


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
    by_size = sorted(ovals, key=lambda own: -own.longer)
    causes: dict[tuple[Any, bool], Oval] = {}
    for own in by_size:
        if own.axes is not None:
            causes.setdefault((frozenset(own.axes), own.shear), own)
    lacks = [f"{_lacks(own)} ({_label(own)})" for own in causes.values()]
    if any(_directions(own) != _directions(causes[key]) for own, key in _keyed(ovals)):
        # One effect everywhere has one sign.
        lacks = ["an effect that differs from place to place"]
    return [
        finding(
            "oval-left",
            names=list(dict.fromkeys(map(_label, ovals))),
            worst=_longer(by_size[0]),
            lacks=lacks or ["a squareness or a scale"],
        )
    ]


def _keyed(ovals: Sequence[Oval]) -> list[tuple[Oval, tuple[Any, bool]]]:
    return [(own, (frozenset(own.axes), own.shear)) for own in ovals if own.axes is not None]


def _longer(own: Oval) -> str:
    """By what a ring is oval."""
    longer, along = f"{plus_minus(own.longer / UM, own.u / UM)} um", _directions(own)
    if along is None:
        return f"{_label(own)}: its longest diameter is {longer} more than its shortest"
    return f"{_label(own)}: {longer} longer along {along[0]} than along {along[1]}"


def _u_of_size(own: Oval) -> float:
    """The same share of the size as of the difference of diameters."""
    return abs(own.size) * own.u / own.longer if own.longer else 0.0


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


def _lacks(own: Oval) -> str:
    value, u, unit = _size(own)
    a, b = sorted(own.axes or ())
    size = f"{plus_minus(value, u)} {unit}"
    if own.shear:
        return f"a squareness of {a} and {b} of {size}"
    return f"a scale of {a} or {b}, {size} between them"
