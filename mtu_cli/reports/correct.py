"""The report of correct: points, diameters and lengths before and after.

A correction is minus the modelled error; null along an axis that is not corrected. Of a size, `u`
and `interval95_mm` are of the corrected size, `u_error_um`, `interval95_um` and `E_n` of its error
after, the calibration's uncertainty included. The u of a mean over repeats is that of one part,
which repeats share. `point_scatter` is part of the u of corrected points and of sizes, not of that
of a correction, which the machine alone makes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from mtu_cli.analyses.correct.result import CorrectResult, SizeErrors
from mtu_cli.analyses.correct.wanted import Kind
from mtu_cli.findings import listed
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, RowOf, rows_of
from mtu_cli.reports.numbers import degrees_of_freedom, fixed, significant
from mtu_cli.units import UM

SHOWN = 40
"""Points, and sizes of several parts, that are listed without ``--detail``."""
ROUNDING_UM = 1e-4
"""A form error below a tenth of a nanometre is rounding."""
KINDS: dict[Kind, str] = {"circle": "circles", "sphere": "spheres", "length": "lengths"}


def _of_axes(name: str, value: str, meaning: str, unit: str = "") -> Iterator[Field]:
    """A figure of each axis, beside the others of its kind; without a unit not in the CSV."""
    path = f"{name}_{unit}" if unit else name
    for k, a in enumerate(AXES):
        csv = f"{name}_{a}_{unit}" if unit else ""
        yield Field(f"{path}.{a}", f"{value}.{k}", meaning, csv=csv, unit=unit)


ROW: Fields = (
    Field("part", meaning="name of the part", head="part", show="text"),
    Field("feature", meaning="name of the feature", head="feature", show="text"),
    Field("repeat", meaning="its repeat", head="repeat", show="count", names=True),
    Field("operation", meaning="its operation", head="operation", show="text"),
    *(Field(f"measured.{a}_mm", f"points.measured.{k}", "measured") for k, a in enumerate(AXES)),
    *(
        each
        for k, a in enumerate(AXES)
        for each in (
            Field(
                f"correction_um.{a}",
                f"correction.{k}",
                "minus the modelled error",
                csv=f"correction_{a}_um",
                unit="um",
                head=f"correction {a}",
                u=f"u.{k}",
                show="plus-minus",
            ),
            Field(
                f"u_correction_um.{a}",
                f"u.{k}",
                "its standard uncertainty",
                csv=f"u_correction_{a}_um",
                unit="um",
            ),
        )
    ),
    *_of_axes("dof_effective", "dof", "of the correction; null: infinite"),
    *(
        Field(
            f"corrected.{a}_mm",
            f"corrected.{k}",
            "measured plus correction",
            head=f"corrected {a}",
            u=f"u_corrected.{k}",
        )
        for k, a in enumerate(AXES)
    ),
    *_of_axes("u_corrected", "u_corrected", "standard uncertainty of corrected", "um"),
    *_of_axes("dof_corrected", "dof_corrected", "of it; null: infinite"),
)


def _sides(path: str, value: str, of: str, before: Any, after: Any) -> tuple[Field, Field]:
    """A figure before and after the correction, with what tables need of each."""
    unit = path.rpartition("_")[2]
    return (
        Field(f"{path}.before", f"{value}.0", f"{of} before the correction", unit=unit, **before),
        Field(f"{path}.after", f"{value}.1", f"{of} after the correction", unit=unit, **after),
    )


def _form(value: float, u: None, digits: int) -> str:
    return "0" if value < ROUNDING_UM else significant(value)


TEMPERATURE = Field(
    "temperature_degC", "temperature", "of the ring", head="T", names=True,
    show=lambda value, u, digits: fixed(value, 1),
)  # fmt: skip
ERROR = _sides(
    "error_um",
    "error",
    "measured minus reference",
    {"head": "error before", "u": "u_error"},
    {"head": "after", "u": "u_error", "show": "plus-minus"},
)
U_SIZE = Field("u_um", "u", "standard uncertainty of the corrected size")
FORM = _sides(
    "form_um",
    "form",
    "range of radial residuals",
    {"head": "form before", "show": _form, "detail": True},
    {"head": "form after", "show": _form, "detail": True},
)


def size(kind: Kind) -> Fields:
    """The figures of a diameter or length of a part."""
    ring = kind != "length"
    reference = "calibrated_mm" if ring else "nominal_mm"
    known = Field(
        reference, "reference", "reference", head=reference.removesuffix("_mm"),
        show=lambda value, u, digits: fixed(value, 4),
    )  # fmt: skip
    sizes = _sides(
        "diameter_mm" if ring else "length_mm",
        "size",
        "mean over the repeats",
        {},
        {"head": "corrected", "u": "u", "show": "plus-minus"},
    )
    repeat = Field("repeat", meaning="number of the repeat")
    repeats = (
        (repeat, TEMPERATURE, *sizes, known, *ERROR, U_SIZE, *FORM)
        if ring
        else (repeat, *sizes, *ERROR, U_SIZE)
    )
    return (
        Field("id", meaning="its name", head="id", show="text"),
        Field("part", meaning="name of the part", head="part", show="text"),
        Field("operation", lambda x: x.operation or None, "its operation", head="operation",
              show="text"),
        Field("n_repeats", lambda x: len(x.repeats), "number of repeats"),
        *((TEMPERATURE,) if ring else ()),
        *sizes,
        known,
        *ERROR,
        Field("reduction_percent", meaning="100 (1 - |after|/|before|)"),
        U_SIZE,
        Field("U_um", "U", "expanded uncertainty k u"),
        Field("dof_effective", "dof", "degrees of freedom of u; null: infinite"),
        Field("interval95_mm", "interval95", "95 % interval of the corrected size"),
        Field("u_error_um", "u_error", "standard uncertainty of the error after"),
        Field("interval95_um", "error_interval95", "95 % interval of the error after",
              head="95 % interval", show="interval", u="u_error"),
        Field("", "reduction_shown", head="reduction\n%", show=lambda x, u, d: fixed(x, 1)),
        Field("E_n", meaning="error after over its expanded uncertainty (ISO 13528)",
              head="E_n", detail=True),
        Field("s_repeats_um", "s_repeats", "standard deviation of the repeats", head="s repeats",
              detail=True),
        *((*FORM, Field("U_calibrated_um", "U_reference", "of the calibration (k = 2)"))
          if ring else ()),
        Group("repeats", repeats, many=True),
    )  # fmt: skip


def _least_rms(item: SizeErrors) -> float:
    """What means and root mean squares are rounded to."""
    return min(item.rms)


def _over_parts(path: str, value: str, of: str, head: str) -> tuple[Field, Field]:
    before, after = ({"head": f"{head} {x}", "u": _least_rms} for x in ("before", "after"))
    return _sides(path, value, of, before, after)


SUMMARY: Fields = (
    Field("kind", meaning="circle, sphere or length"),
    Field("id", meaning="its name", head="id", show="text"),
    Field("n_parts", "parts", "number of parts", head="parts", show="count"),
    *_over_parts("mean_error_um", "mean", "mean error", "mean"),
    *_over_parts("rms_error_um", "rms", "root mean square error", "rms"),
)
FORM_LEFT: Fields = (
    Field("kind", meaning="circle or sphere"),
    Field("id", meaning="its name", head="id", show="text"),
    Field("operation", lambda form: form.operation or None, "its operation", head="operation",
          show="text"),
    Field("visits", meaning="in how many visits it was measured", head="visits", show="count"),
    Field("rms_um", "rms", "rms of its mean radial residuals", head="rms"),
    Field("explained_um", "explained", "rms by the model's uncertainty and the points' scatter",
          head="explained"),
    Field("F", meaning="ratio of the two mean squares", head="F",
          show=lambda value, u, digits: significant(value, 3)),
    Field("p", meaning="p that nothing else is left", head="p", show="p"),
)  # fmt: skip
AXIS: Fields = (
    Field("", "axis", head="axis", show="text"),
    Field("", "points", head="points", show="count"),
    *(Field("", name, head=name, unit="um", u="u_mean") for name in ("least", "mean", "largest")),
    Field("", "u_mean", head="u mean", unit="um"),
    Field("", "u_largest", head="u largest", unit="um"),
)


SIZES = {kind: size(kind) for kind in KINDS}


def _points(result: CorrectResult) -> list[RowOf]:
    return rows_of(result, len(result.points))


RESULTS: Fields = (
    Field("axes", meaning="axes that were corrected"),
    Field("point_scatter.s_um", "scatter.s", "scatter of the points beyond the model"),
    Field("point_scatter.dof", "scatter.dof", "its degrees of freedom"),
    Field("point_scatter.from", "scatter.origin", "repeats, or form of the rings"),
    Group("points", ROW, _points, many=True),
    *(
        Group(name, SIZES[each], partial(CorrectResult.of_kind, kind=each), many=True)
        for each, name in KINDS.items()
    ),
    Group("summary", SUMMARY, CorrectResult.by_size, many=True),
    Group("form_left", FORM_LEFT, "forms", many=True),
)


def document(result: CorrectResult, digits: int = 2) -> Document:
    """One row a measured point; before them the sizes, over all parts and one by one."""
    from mtu_cli.reports import part_figures

    points = _points(result)
    summary = result.by_size()
    several = any(item.parts > 1 for item in summary)
    many = len(points) > SHOWN
    kind = "components and points independent" if result.independent else "covariance included"
    footer = f"corrected = measured + correction, minus the modelled error; {kind}"
    tables = [
        Table(title="Points", fields=ROW, items=points, footer=f"{footer}; ± u", detail=many),
        Table(
            title="Before and after, all parts",
            fields=SUMMARY,
            items=summary if several else [],
            footer="errors (measured minus reference): mean and root mean square",
        ),
        *(
            Table(
                title=f"{name.capitalize()} before and after",
                fields=SIZES[each],
                items=result.of_kind(each),
                footer="error: measured minus reference, ± u with that of the calibration",
                notes=list(_notes(result)),
                detail=several and len(result.of_kind(each)) > SHOWN,
            )
            for each, name in KINDS.items()
        ),
        Table(
            title="Form left",
            fields=FORM_LEFT,
            items=result.forms,
            footer="mean form over the visits; explained: u of the model and scatter of the points",
            detail=True,
        ),
        Table(
            title="Corrections of the points",
            fields=AXIS,
            items=result.by_axis() if many else [],
            footer=footer,
        ),
    ]
    return Document(
        title="Corrected points",
        results=(RESULTS, result),
        tables=tables,
        figure=lambda: part_figures.correct(result),
        verdict=_verdict(result),
        digits=digits,
    )


def _notes(result: CorrectResult) -> Iterator[str]:
    """What the uncertainties of sizes hold."""
    scatter = result.scatter
    if scatter is None:
        yield "u: of the machine's model only; the scatter of the points is unknown"
    else:
        source = "repeats" if scatter.origin == "repeats" else "radial residuals, form included"
        yield (
            f"u includes a scatter of the points of {significant(scatter.s / UM)} um beyond the "
            f"model, from {source} ({degrees_of_freedom(scatter.dof)} dof)"
        )
    exact = {
        x.id for x in result.sizes
        if x.kind != "length" and math.isfinite(x.reference) and math.isnan(x.U_reference)
    }  # fmt: skip
    if exact:
        yield f"no U_um of {listed(sorted(exact))}: the calibration counts as exact"


def _verdict(result: CorrectResult) -> str:
    off = [item.id for item in result.by_size() if item.off]
    left = f"; the mean error of {listed(off)} exceeds its uncertainty" if off else ""
    kinds: dict[str, tuple[Kind, ...]] = {"diameters": ("circle", "sphere"), "lengths": ("length",)}
    for name, each in kinds.items():
        rms = result.rms(each)
        if rms is not None:
            before, after = (significant(value / UM) for value in rms)
            changes = "reduces" if rms[1] <= rms[0] else "increases"
            return (
                f"Correction {changes} the rms error of {name} from {before} to {after} um{left}."
            )
    by_axis = result.by_axis()
    largest = {x.axis: max(abs(x.least), abs(x.largest)) for x in by_axis}
    axis = max(largest, key=largest.__getitem__)
    return f"The largest correction is {significant(largest[axis] / UM, 3)} um, along {axis}."
