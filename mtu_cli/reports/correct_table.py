"""The tables of correct: diameters and lengths before and after, then the points."""

from __future__ import annotations

import math
from dataclasses import replace

from mtu_cli.analyses.correct.quantity import Size
from mtu_cli.analyses.correct.result import CorrectResult
from mtu_cli.analyses.correct.summary import ROUNDING_MM
from mtu_cli.findings import listed
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.numbers import (
    MISSING,
    degrees_of_freedom,
    fixed,
    interval,
    plus_minus,
    significant,
)
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.units import UM

SHOWN = 40
"""Points listed one by one; of more each axis is summed up."""
SIZES = 60
"""Diameters or lengths listed."""
DETERMINED = {"circle": 3, "sphere": 4, "length": 2}
"""Points that determine a figure without any residual."""
SIGN = "corrected = measured + correction; correction = minus the modelled error"


def table(result: CorrectResult, digits: int = 2) -> list[Sheet]:
    """Circles, spheres and lengths where there are any, then the points."""
    sheets = _over_parts(result)
    for title, items in (
        ("Circles", result.of_kind("circle")),
        ("Spheres", result.of_kind("sphere")),
        ("Lengths", result.of_kind("length")),
    ):
        if items:
            sheet = _sizes(title, items, digits)
            sheets.append(replace(sheet, notes=[*sheet.notes, _scattered(result)]))
    few = len(result.points) <= SHOWN
    sheets.append(_listed(result, digits) if few else _summed(result, digits))
    return sheets


def _over_parts(result: CorrectResult) -> list[Sheet]:
    """The sizes of several parts, each over all of them."""
    found = [item for item in result.by_size() if item.parts > 1]
    if not found:
        return []
    columns = [
        Column(title="id\n", text=True, folds=True),
        Column(title="parts\n"),
        Column(title="mean before\num"),
        Column(title="after\num"),
        Column(title="rms before\num"),
        Column(title="after\num"),
    ]
    rows = []
    for item in found:
        # To the digits of the smaller root mean square: the mean is no finer.
        least = min(item.rms) / UM
        cells = (*item.mean, *item.rms)
        rows.append([item.id, str(item.parts), *(_rounded(x / UM, least, 2) for x in cells)])
    notes = ["errors (measured minus reference) of all parts: mean and root mean square"]
    return [Sheet(title="Before and after, all parts", columns=columns, rows=rows, notes=notes)]


def _sizes(title: str, items: tuple[Size, ...], digits: int) -> Sheet:
    rounds = items[0].kind != "length"
    warm = any(math.isfinite(item.temperature) for item in items)
    columns = [
        Column(title="id\n", text=True, folds=True),
        Column(title="part\n", text=True, folds=True),
    ]
    columns += [Column(title="T\ndegC", names=True)] if warm else []
    columns += [
        Column(title="calibrated\nmm" if rounds else "nominal\nmm"),
        Column(title="before\num"),
        Column(title="after\num"),
        Column(title="95 %\num"),
        Column(title="reduction\n%"),
    ]
    columns += [Column(title="form\num")] if rounds else []
    rows = [_row(item, digits, rounds=rounds, warm=warm) for item in items[:SIZES]]
    against = "calibrated diameter" if rounds else "nominal length"
    unknown, notes = [math.isnan(item.reference) for item in items], list[str]()
    if not all(unknown):
        notes = [
            f"before, after: measured minus {against}, after ± its u; "
            "reduction: 100 (1 - |after|/|before|), where before is more than that u"
        ]
    if any(unknown):
        where = "" if all(unknown) else "where no diameter is calibrated, "
        notes.append(
            f"{where}before, after: the diameter, after ± its u; calibrated_mm of the part would "
            "tell how far it is off"
        )
    if rounds:
        with_it = "" if all(unknown) else "u and 95 % with the calibration's; "
        notes += [f"{with_it}form: range of radial residuals", *_exact(items)]
    if any(len(item.repeats) > 1 for item in items):
        notes.append("means over the repeats of a part, which share what the machine did to it")
    if len(items) > SIZES:
        notes.append(f"{len(items) - SIZES} more in the report (-o)")
    return Sheet(title=f"{title} before and after", columns=columns, rows=rows, notes=notes)


def _exact(items: tuple[Size, ...]) -> list[str]:
    """Says whose calibration has no uncertainty."""
    names = {i.id for i in items if math.isfinite(i.reference) and math.isnan(i.U_reference)}
    if not names:
        return []
    return [f"no U_um of {listed(sorted(names))}: the calibration counts as exact"]


def _scattered(result: CorrectResult) -> str:
    """What u holds of the scatter of the measured points."""
    found = result.scatter
    if found is None:
        return "u: the machine's model only; the probing's own scatter is not known"
    dof = degrees_of_freedom(found.dof)
    if found.origin == "repeats":
        told = f"seen in repeats ({dof} dof)"
    else:
        told = f"seen in the rings' residuals ({dof} dof): their form error counts as scatter"
    if found.variance == 0:
        return f"points scatter no more than the model says, {told}"
    return (
        f"u holds the points' own scatter, {significant(found.s / UM)} um beyond the model, {told}"
    )


def _row(item: Size, digits: int, *, rounds: bool, warm: bool) -> list[str]:
    u = item.u_error / UM
    before, after = (value / UM for value in item.error)
    low, high = (end / UM for end in item.error_interval95)
    if math.isnan(item.reference):
        # Without a reference the sizes themselves are all that can be told.
        return [
            item.id,
            _part(item),
            *([fixed(item.temperature, 1)] if warm else []),
            MISSING,
            f"{item.size[0]:.4f} mm",
            f"{plus_minus(item.size[1], item.u, digits)} mm",
            MISSING,
            MISSING,
            _form(item),
        ]
    row = [item.id, _part(item), *([fixed(item.temperature, 1)] if warm else [])]
    row += [
        f"{item.reference:.4f}",
        _rounded(before, u, digits),
        plus_minus(after, u, digits),
        interval(low, high, u, digits),
        # Where there was nothing to reduce, a share of it says nothing: -580 % of half a um.
        MISSING if abs(before) <= u else fixed(item.reduction_percent, 1),
    ]
    return [*row, _form(item)] if rounds else row


def _part(item: Size) -> str:
    return " ".join(word for word in (item.operation, item.part) if word)


def _form(item: Size) -> str:
    """Form errors, um; what is below a tenth of a nanometre is rounding.

    Points no more than circle or sphere need lie on it, whatever their form.
    """
    if item.points == DETERMINED[item.kind]:
        return MISSING
    sides = (0.0 if side < ROUNDING_MM else side / UM for side in item.form)
    return " to ".join(significant(side) for side in sides)


def _listed(result: CorrectResult, digits: int) -> Sheet:
    points = result.points
    axes = [AXES.index(axis) for axis in result.axes]
    repeated = bool((points.repeat >= 0).any())
    columns = [
        Column(title="part\n", text=True, folds=True),
        Column(title="feature\n", text=True, folds=True),
    ]
    columns += [Column(title="repeat\n", names=True)] if repeated else []
    for axis in result.axes:
        columns.append(Column(title=f"correction\n{axis}, um", begins=True))
        columns.append(Column(title=f"corrected\n{axis}, mm"))
    u, _ = result.of_corrected()
    rows = []
    for i in range(len(points)):
        row = [points.parts[points.part[i]], points.features[points.feature[i]]]
        row += [str(points.repeat[i]) if points.repeat[i] >= 0 else MISSING] if repeated else []
        for k in axes:
            row.append(plus_minus(-result.error[i, k] / UM, result.u[i, k] / UM, digits))
            row.append(_mm(result.corrected[i, k], u[i, k]))
        rows.append(row)
    return Sheet(
        title="Points", columns=columns, rows=rows, notes=[f"{SIGN}; ± u; {_kind(result)}"]
    )


def _mm(value: float, u: float) -> str:
    """A coordinate to a tenth of a um, or coarser where its uncertainty is."""
    return fixed(value, 4 if not math.isfinite(u) or u < 0.01 else 3)


def _summed(result: CorrectResult, digits: int) -> Sheet:
    columns = [
        Column(title="axis\n", text=True),
        Column(title="points\n"),
        *(Column(title=f"{name}\num") for name in ("least", "mean", "largest", "u mean", "u max")),
    ]
    rows = []
    for axis in result.axes:
        own = result.along(axis)
        u = own.u_mean / UM
        rows.append(
            [
                axis,
                str(own.points),
                *(_rounded(value / UM, u, digits) for value in (own.least, own.mean, own.largest)),
                significant(u, digits),
                significant(own.u_largest / UM, digits),
            ]
        )
    notes = [f"{SIGN}; all points with --csv or -o; {_kind(result)}"]
    return Sheet(title="Corrections of the points", columns=columns, rows=rows, notes=notes)


def _rounded(value: float, u: float, digits: int) -> str:
    return plus_minus(value, u, digits).partition(" ")[0]


def _kind(result: CorrectResult) -> str:
    if result.independent:
        return "components and points taken as independent (Gilsinn & Ling 2004)"
    return "covariance of shared passes and coefficients included"
