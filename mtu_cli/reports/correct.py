"""The report of correct: points, diameters and lengths before and after.

A correction is minus the modelled error; u of a mean over repeats is that of one part.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from mtu_cli.analyses.correct import CorrectResult
from mtu_cli.analyses.correct.sizes import Kind
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.document import KIND, Document, Table
from mtu_cli.reports.fields import Fields, declare, rows_of
from mtu_cli.reports.numbers import significant, words
from mtu_cli.units import UM

SHOWN = 40
"""Points, and sizes of several parts, that are listed without ``--detail``."""
KINDS: dict[Kind, str] = {"circle": "circles", "sphere": "spheres", "length": "lengths"}
ROW = declare(
    """
    part | | name of the part | part, text
    feature | | name of the feature | feature, text
    repeat | | its repeat | repeat, count, names
    operation | | its operation | operation, text
    for AXIS NUMBER in axes
        measured.AXIS_mm | points.measured.NUMBER | measured
    for AXIS NUMBER in axes
        correction_um.AXIS | correction.NUMBER | minus the modelled error \
            | correction AXIS, plus-minus, u=u.NUMBER, unit=um, csv=correction_AXIS_um
        u_correction_um.AXIS | u.NUMBER | its standard uncertainty \
            | -, unit=um, csv=u_correction_AXIS_um
    for AXIS NUMBER in axes
        corrected.AXIS_mm | corrected.NUMBER | measured plus correction \
            | corrected AXIS, u=u_corrected.NUMBER
    for AXIS NUMBER in axes
        u_corrected_um.AXIS | u_corrected.NUMBER | standard uncertainty of corrected \
            | -, unit=um, csv=u_corrected_AXIS_um
    """,
    axes=list(zip(AXES, "012", strict=True)),
)
SIZE = """
    id | | its name | id, text
    part | | name of the part | part, text
    operation | stated(operation) | its operation | operation, text
    n_repeats | | number of repeats
    *temperature
    MEASURE_mm.before | size.0 | mean over the repeats before the correction | -, unit=mm
    MEASURE_mm.after | size.1 | mean over the repeats after the correction \
        | corrected, plus-minus, u=u, unit=mm
    REFERENCE_mm | reference | reference | REFERENCE, fix4
    error_um.before | error.0 | measured minus reference before the correction \
        | error before, u=u_error, unit=um
    error_um.after | error.1 | measured minus reference after the correction \
        | after, plus-minus, u=u_error, unit=um
    reduction_percent | | 100 (1 - |after|/|before|) | reduction / %, whole
    u_um | u | standard uncertainty of the corrected size
    U_um | U | expanded uncertainty k u
    dof_effective | dof | degrees of freedom of u; null: infinite
    interval95_mm | interval95 | 95 % interval of the corrected size
    u_error_um | u_error | standard uncertainty of the error after
    interval95_um | error_interval95 | its 95 % interval | 95 % interval, interval, u=u_error
    s_repeats_um | s_repeats | standard deviation of the repeats | s repeats, detail
    *ring
"""
RING = """
    form_um.before | form.0 | range of radial residuals before the correction \
        | form before, form(), detail, unit=um
    form_um.after | form.1 | range of radial residuals after the correction \
        | form after, form(), detail, unit=um
    U_calibrated_um | U_reference | of the calibration (k = 2)
"""
TEMPERATURE = "    temperature_degC | temperature | of the ring | T, fix1, names"


def size(kind: Kind) -> Fields:
    """The figures of a diameter or length of a part."""
    length = kind == "length"
    return declare(
        SIZE,
        MEASURE="length" if length else "diameter",
        REFERENCE="nominal" if length else "calibrated",
        temperature="" if length else TEMPERATURE,
        ring="" if length else RING,
        # Below a tenth of a nanometre it is rounding.
        form=lambda value, u, digits: "0" if value < 1e-4 else significant(value),
    )


FORM_LEFT = declare("""
    kind | | circle or sphere
    id | | its name | id, text
    operation | stated(operation) | its operation | operation, text
    visits | | in how many visits it was measured | visits, count
    rms_um | rms | rms of its mean radial residuals | rms
    explained_um | explained | rms by the model's uncertainty and the points' scatter | explained
    F | | ratio of the two mean squares | F, sig3
    p | | p that nothing else is left | p, p
""")
SIZES = {kind: size(kind) for kind in KINDS}


RESULTS = declare(
    """
    axes | | axes that were corrected
    point_scatter.s_um | scatter.s | scatter of the points beyond the model
    point_scatter.dof | scatter.dof | its degrees of freedom
    point_scatter.from | scatter.origin | repeats, or form of the rings
    points[] | points() | *point
    circles[] | circle() | *circles
    spheres[] | sphere() | *spheres
    lengths[] | length() | *lengths
    form_left[] | forms | *form_left
    """,
    points=lambda result: rows_of(result, len(result.points)),
    point=ROW,
    form_left=FORM_LEFT,
    **{name: SIZES[kind] for kind, name in KINDS.items()},
    **{str(kind): partial(CorrectResult.of_kind, kind=kind) for kind in KINDS},
)


def document(result: CorrectResult, digits: int = 2) -> Document:
    """One row a measured point; before them the sizes, over all parts and one by one."""
    points = rows_of(result, len(result.points))
    footer = "corrected = measured + correction, minus the modelled error; "
    footer += f"{KIND[result.independent]}; ± u"
    tables = [Table("Points", ROW, points, footer, detail=len(points) > SHOWN)]
    scatter = "unknown"
    if result.scatter is not None:
        scatter = f"{significant(result.scatter.s / UM)} um from {result.scatter.origin} included"
    errors = f"error: measured minus reference, ± u of both; scatter beyond the model {scatter}"
    maxima = np.nan_to_num(np.abs(result.error)).max(axis=0)
    largest, axis = significant(maxima.max() / UM, 3), AXES[int(maxima.argmax())]
    verdict = f"The largest correction is {largest} um, along {axis}."
    for kind, name in reversed(KINDS.items()):
        sizes = result.of_kind(kind)
        title = f"{name.capitalize()} before and after"
        tables.insert(1, Table(title, SIZES[kind], sizes, errors, detail=len(sizes) > SHOWN))
        if rms := result.rms(kind):
            before, after = (significant(value / UM) for value in rms)
            changes = "reduces" if rms[1] <= rms[0] else "increases"
            verdict = (
                f"Correction {changes} the rms error of the {name} from {before} to {after} um."
            )
    form = "mean form over the visits; explained: u of the model and scatter of the points"
    tables.append(Table("Form left", FORM_LEFT, result.forms, form, detail=True))
    return Document("Corrected points", (RESULTS, result), tables, figure, verdict, digits)


def figure(result: CorrectResult) -> figures.Figure:
    """Errors of the sizes, without any of the points, before and after with 95 % intervals."""
    sizes = [item for item in result.sizes if not np.isnan(item.reference)]
    half = None
    if sizes:
        title = "Errors of diameters and lengths"
        warm = ["" if np.isnan(x.temperature) else f"at {x.temperature:.1f} °C" for x in sizes]
        names = [
            words(x.id, x.operation, f"part {x.part}", at)
            for x, at in zip(sizes, warm, strict=True)
        ]
        before, after = np.array([x.error for x in sizes]).T / UM
        half = np.array([np.ptp(x.error_interval95) for x in sizes]) / (2 * UM)
    else:
        title, at = "Errors of the points", [AXES.index(axis) for axis in result.axes]
        nominal = result.points.nominal
        before, after = (
            (x - nominal)[:, at].ravel() / UM for x in (result.points.measured, result.corrected)
        )
        names = [words(x, axis) for x in result.feature for axis in result.axes]
    intervals = [
        ("before", figures.ORANGE, before, None, 0.0),
        ("after, with 95 % interval", figures.BLUE, after, half, 0.0),
    ]
    title += " before and after the correction"
    return figures.listing(title, names, intervals, "measured minus reference, um")
