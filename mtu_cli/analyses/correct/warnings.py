"""What the correction leaves wrong with diameters and lengths, and what that points to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mtu_cli.analyses.correct.leaning import Leaning
from mtu_cli.analyses.correct.quantity import Size
from mtu_cli.analyses.correct.roundness import Oval
from mtu_cli.analyses.correct.summary import SizeErrors, size_errors
from mtu_cli.findings import Finding, finding, listed
from mtu_cli.units import UM

MOST = 0.5
"""Share of an error that heights of the points make, from which on they are its cause."""
CAUSES = {
    "calibration": "{worst} gets rounder: calibrated_mm is wrong, or the model lacks a scale that "
    "its axes share",
    "model": "the model does not describe these points, or calibrated_mm is wrong",
    "heights": "the points of {worst} lie at different heights, which makes it {larger:.2g} um "
    "larger",
}


def size_warnings(
    sizes: Sequence[Size], ovals: Sequence[Oval], leaning: Sequence[Leaning]
) -> Iterator[Finding]:
    """Figures that are not estimable, and errors that the correction makes or leaves."""
    exact = [item for item in sizes if item.error[0] == 0]
    yield from _not_estimable("reduction_percent", exact, "no error before the correction")
    yield from heights_differ(leaning)
    yield from _errors_after(sizes, ovals, leaning)
    yield from _ovals_left(ovals)
    sure = [item for item in sizes if item.u_error == 0]
    yield from _not_estimable("E_n", sure, "its uncertainty is unknown")


def _not_estimable(quantity: str, sizes: Sequence[Size], reason: str) -> Iterator[Finding]:
    names = [f"{item.id} of {item.part}" for item in sizes]
    if names:
        yield finding("not-estimable", quantity=quantity, names=names, reason=reason)


def heights_differ(leaning: Sequence[Leaning]) -> Iterator[Finding]:
    """A warning for each direction that heights differ along."""
    for axis in dict.fromkeys(item.axis for item in leaning):
        items = [item for item in leaning if item.axis == axis]
        worst = max(items, key=lambda item: item.larger)
        # Without z a circle is that of x and y: of another direction it is none.
        without = ", or no column z_mm" if axis == "z" else ""
        yield finding(
            "heights-differ",
            names=list(dict.fromkeys(item.label for item in items)),
            axis="the axis of the inclined bore" if axis is None else axis,
            worst=worst.label,
            angle_deg=float(np.degrees(worst.angle)),
            larger_um=worst.larger / UM,
            expected=f"points at one height{without}",
        )


def _errors_after(
    sizes: Sequence[Size], ovals: Sequence[Oval], leaning: Sequence[Leaning]
) -> Iterator[Finding]:
    """Of errors that the correction makes larger, and of those that it leaves, by cause."""
    oval = {(item.kind, item.id) for item in ovals}

    def larger(item: SizeErrors) -> float:
        """What heights of its points make of a circle, mm."""
        own = [lean.larger for lean in leaning if lean.id == item.id and item.kind == "circle"]
        return max(own, default=0.0)

    def cause(item: SizeErrors) -> str:
        if item.mean[1] > 0 and larger(item) > MOST * item.mean[1]:
            return "heights"
        # A ring that stays oval shows by itself that the model lacks something.
        rounder = item.grown and item.rounder and (item.kind, item.id) not in oval
        return "calibration" if rounder else "model"

    off = [item for item in size_errors(sizes) if item.off]
    for grown, excess in (
        (True, lambda item: item.rms[1] - item.rms[0]),
        (False, lambda item: abs(item.mean[1]) - item.half),
    ):
        for name, text in CAUSES.items():
            items = [item for item in off if item.grown == grown and cause(item) == name]
            if items:
                worst = max(items, key=excess)
                because = text.format(worst=worst.id, larger=larger(worst) / UM)
                yield _after(items, worst, because)


def _after(items: Sequence[SizeErrors], worst: SizeErrors, cause: str) -> Finding:
    named = listed([item.id for item in items])
    if worst.grown:
        before, after = worst.rms[0] / UM, worst.rms[1] / UM
        figures = {"rms_before_um": before, "rms_after_um": after}
        what = f"the errors of {named} are larger ({worst.id}: rms {before:.3g} um before, "
        what += f"{after:.3g} um after)"
    else:
        mean, half = worst.mean[1] / UM, worst.half / UM
        figures = {"mean_um": mean, "half_width_um": half}
        what = f"the mean errors of {named} exceed their uncertainty ({worst.id}: {mean:.3g} um, "
        what += f"95 % within {half:.3g} um)"
    return finding("errors-left", what=what, worst=worst.id, **figures, cause=cause)


def _ovals_left(ovals: Sequence[Oval]) -> Iterator[Finding]:
    """Of rings that an ellipse is left of: a squareness does not show in a diameter."""
    by_size = sorted(ovals, key=lambda item: -item.longer)
    causes: dict[tuple[str | None, tuple[str, ...]], Oval] = {}
    for item in by_size:
        if item.axes is not None:
            causes.setdefault((item.effect, item.sorted_axes), item)
    lacks = [f"{_lack(item)} ({item.label})" for item in causes.values()]
    named = [item for item in ovals if item.axes is not None]
    if any(x.directions != causes[x.effect, x.sorted_axes].directions for x in named):
        # One effect everywhere has one sign.
        lacks = ["an effect that differs from place to place"]
    if ovals:
        yield finding(
            "oval-left",
            names=list(dict.fromkeys(item.label for item in ovals)),
            worst=_longer(by_size[0]),
            lacks=lacks or ["a squareness or a scale"],
        )


def _longer(oval: Oval) -> str:
    longer = f"{_plus_minus(oval.longer / UM, oval.u / UM)} um"
    if oval.directions is None:
        return f"{oval.label}: its longest diameter is {longer} more than its shortest"
    along, than = oval.directions
    return f"{oval.label}: {longer} longer along {along} than along {than}"


def _lack(oval: Oval) -> str:
    unit = oval.unit
    size = _plus_minus(abs(oval.size) / unit.to_internal, oval.u_size / unit.to_internal)
    a, b = oval.sorted_axes
    if oval.shear:
        return f"a squareness of {a} and {b} of {size} {unit.name}"
    return f"a scale of {a} or {b}, {size} {unit.name} between them"


def _plus_minus(value: float, u: float) -> str:
    return f"{value:.3g} ± {u:.2g}"
