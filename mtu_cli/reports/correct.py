"""The report of correct: points, diameters and lengths before and after.

A correction is minus the modelled error; u of a mean over repeats is that of one part.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from mtu_cli.analyses.correct import CorrectResult
from mtu_cli.analyses.correct.scatter import Kind
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import part_figures
from mtu_cli.reports.document import KIND, Document, Table
from mtu_cli.reports.fields import Fields, RowOf, declare, rows_of
from mtu_cli.reports.numbers import significant
from mtu_cli.units import UM

SHOWN = 40
"""Points, and sizes of several parts, that are listed without ``--detail``."""
ROUNDING_UM = 1e-4
"""A form error below a tenth of a nanometre is rounding."""
KINDS: dict[Kind, str] = {"circle": "circles", "sphere": "spheres", "length": "lengths"}
POINT = """
    part | | name of the part | part, text
    feature | | name of the feature | feature, text
    repeat | | its repeat | repeat, count, names
    operation | | its operation | operation, text
    *of_axes
"""
OF_AXES = (
    "measured.A_mm | points.measured.K | measured",
    """
    correction_um.A | correction.K | minus the modelled error \
        | correction A, plus-minus, u=u.K, unit=um, csv=correction_A_um
    u_correction_um.A | u.K | its standard uncertainty | -, unit=um, csv=u_correction_A_um
    """,
    "corrected.A_mm | corrected.K | measured plus correction | corrected A, u=u_corrected.K",
    """
    u_corrected_um.A | u_corrected.K | standard uncertainty of corrected \
        | -, unit=um, csv=u_corrected_A_um
    """,
)
"""Each of every axis before the next."""
ROW = declare(
    POINT,
    of_axes=[
        field
        for text in OF_AXES
        for k, axis in enumerate(AXES)
        for field in declare(text.replace("A", axis).replace("K", str(k)))
    ],
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
    reduction_percent | | 100 (1 - |after|/|before|) | reduction / %, fix1
    u_um | u | standard uncertainty of the corrected size
    U_um | U | expanded uncertainty k u
    dof_effective | dof | degrees of freedom of u; null: infinite
    interval95_mm | interval95 | 95 % interval of the corrected size
    u_error_um | u_error | standard uncertainty of the error after
    interval95_um | error_interval95 | 95 % interval of the error after \
        | 95 % interval, interval, u=u_error
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
TEMPERATURE = "temperature_degC | temperature | of the ring | T, fix1, names"


def _form(value: float, u: None, digits: int) -> str:
    return "0" if value < ROUNDING_UM else significant(value)


def size(kind: Kind) -> Fields:
    """The figures of a diameter or length of a part."""
    length = kind == "length"
    measure, reference = ("length", "nominal") if length else ("diameter", "calibrated")
    return declare(
        SIZE.replace("MEASURE", measure).replace("REFERENCE", reference),
        temperature=[] if length else declare(TEMPERATURE),
        ring=[] if length else declare(RING, form=_form),
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


def _points(result: CorrectResult) -> list[RowOf]:
    return rows_of(result, len(result.points))


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
    points=_points,
    point=ROW,
    form_left=FORM_LEFT,
    **{name: SIZES[kind] for kind, name in KINDS.items()},
    **{str(kind): partial(CorrectResult.of_kind, kind=kind) for kind in KINDS},
)


def document(result: CorrectResult, digits: int = 2) -> Document:
    """One row a measured point; before them the sizes, over all parts and one by one."""
    points = _points(result)
    many = len(points) > SHOWN
    footer = "corrected = measured + correction, minus the modelled error; "
    footer += KIND[result.independent]
    tables = [
        Table("Points", ROW, points, f"{footer}; ± u", detail=many),
    ]
    scatter = "unknown"
    if result.scatter is not None:
        scatter = f"{significant(result.scatter.s / UM)} um from {result.scatter.origin} included"
    errors = (
        "error: measured minus reference, ± u with that of the calibration; scatter of the points "
        f"beyond the model {scatter}"
    )
    for kind, name in KINDS.items():
        sizes = result.of_kind(kind)
        title, detail = f"{name.capitalize()} before and after", len(sizes) > SHOWN
        tables.append(Table(title, SIZES[kind], sizes, errors, detail=detail))
    form = "mean form over the visits; explained: u of the model and scatter of the points"
    tables.append(Table("Form left", FORM_LEFT, result.forms, form, detail=True))
    figure, verdict = partial(part_figures.correct, result), _verdict(result)
    return Document("Corrected points", (RESULTS, result), tables, figure, verdict, digits)


def _verdict(result: CorrectResult) -> str:
    kinds: dict[str, tuple[Kind, ...]] = {"diameters": ("circle", "sphere"), "lengths": ("length",)}
    for name, each in kinds.items():
        if rms := result.rms(each):
            before, after = (significant(value / UM) for value in rms)
            changes = "reduces" if rms[1] <= rms[0] else "increases"
            of = f"the rms error of {name} from {before} to {after} um"
            return f"Correction {changes} {of}."
    along = np.nan_to_num(np.abs(result.error)).max(axis=0)
    largest, axis = significant(along.max() / UM, 3), AXES[int(along.argmax())]
    return f"The largest correction is {largest} um, along {axis}."
