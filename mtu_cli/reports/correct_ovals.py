"""What correct says of calibrated rings that stay oval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.model.settings import Warned
from mtu_cli.reports.document import listed, um
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


def ovals_left(ovals: Sequence[Oval]) -> list[Warned]:
    """The warning of rings that an ellipse is left of: a squareness does not show in a diameter."""
    if not ovals:
        return []
    names = [_label(own) for own in ovals]
    worst = max(ovals, key=lambda own: own.longer)
    longer = f"{plus_minus(worst.longer / UM, worst.u / UM)} um"
    told = _directions(worst)
    if told is None:
        how = f"its longest diameter is {longer} more than its shortest"
    else:
        how = f"{longer} longer along {told[0]} than along {told[1]}"
    verb, its = ("stays", "its") if len(names) == 1 else ("stay", "their")
    text = (
        f"after the correction {listed(names)} {verb} oval, by more than {its} points scatter and "
        f"the model is uncertain ({_label(worst)}: {how}): it is not round itself, or the model "
        f"lacks {_lacks(worst)} (`mtu close-loop` tells)"
    )
    return [Warned(code="oval-left", message=text)]


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
    value = abs(own.size) / PARAMETER_UNITS[unit].to_internal
    return value, value * own.u / own.longer if own.longer else 0.0, unit


def _lacks(own: Oval) -> str:
    if own.axes is None:
        return "a squareness or a scale"
    value, u, unit = _size(own)
    a, b = sorted(own.axes)
    size = f"{plus_minus(value, u)} {unit}"
    if own.shear:
        return f"a squareness of {a} and {b} of {size}"
    return f"a scale of {a} or {b}, {size} between them"
