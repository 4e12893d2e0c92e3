"""Measured points that cannot be what they claim: swapped axes, wrong units, copied parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mtu_cli.errors import InputError, Warned, fault
from mtu_cli.files.features_alike import SAME_MM
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.copied_parts import copied_parts
from mtu_cli.model.copied_repeats import copied_repeats
from mtu_cli.model.datum import Datum, freed
from mtu_cli.model.drawn_parts import drawn_axes, drawn_parts
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured_orders import parts_in_other_order, typical
from mtu_cli.model.measured_reach import reach_problems
from mtu_cli.model.measured_rows import TWICE, check_rows
from mtu_cli.model.measured_slips import slips
from mtu_cli.model.measured_units import EXPLAINS, look_like_errors, parts_of_other_units
from mtu_cli.model.visits import axes_of
from mtu_cli.stats.least_squares import FloatArray

LEFT_OUT = "axis-left-out"
SUSPICIOUS_MM = 0.5
"""A typical error beyond this is not one of a machine tool."""
FAR = "error-of-millimetres"
ORIGIN = "origin"
FEW_NAMED = 3
MOST: Datum = "offset,rotation"
_BLOCK = 1 << 15


def check_measured(points: Points, datum: Datum = "none") -> list[Finding]:
    """Warnings on errors of millimetres less the freedoms of `datum`, with the mistake that would
    explain them, on rows that stand twice, on repeats that are copies, on axes that are all on
    their nominal, and of what was noted when the points were read.

    Raises InputError for rows that contradict each other (`check_rows`) and for a part whose
    values are those of another part, or of the drawing, to the last digit, where that cannot be
    chance.
    """
    rows = check_rows(points)
    axes = axes_of(points)
    return [
        *drawn_parts(points, axes),
        *(Warned(code=note.code, message=note.message) for note in points.notes),
        *rows,
        *copied_parts(points, axes),
        *([] if any(w.code == TWICE for w in rows) else copied_repeats(points, axes)),
        *drawn_axes(points, axes),
        *_left_out(points, axes),
        *_moved(points, axes),
        *_far(points, freed(points, axes, datum)[0], axes),
    ]


def sound(points: Points, datum: Datum | None = None) -> list[Finding]:
    """The warnings of `check_measured` on points that `refuse_mistaken` lets pass; raises as both
    do.
    """
    refuse_mistaken(points, datum)
    return check_measured(points, datum or "none")


def refuse_mistaken(points: Points, datum: Datum | None = None) -> None:
    """Raises InputError where most points are so far from their nominal that the error of no
    machine is behind it, for parts in another unit than the others, and for single readings
    that are not on the part at all: what follows from them would be said of a machine, or of
    parts.

    Parts that lie on the CMM as they were put down may be millimetres off: the freedoms of
    `datum` are taken out first. None: the command has no such option to hint at.
    """
    axes = axes_of(points)
    loose = freed(points, axes, datum or "none")[0]
    far = _are_far(loose, axes)
    few, free = 2 * int(far.sum()) <= len(far), datum not in (None, "none")
    problems = list(parts_of_other_units(points, far, axes, SUSPICIOUS_MM, free)) if few else []
    # One reading moves all of its part where the freedoms are taken out.
    if not problems and (few or free):
        problems = list(reach_problems(points, axes, SUSPICIOUS_MM))
    if problems:
        raise InputError(problems)
    if few:
        return
    errors = np.abs(loose.measured[far][:, axes] - loose.nominal[far][:, axes])
    guess = _mistake(loose.measured[far][:, axes], loose.nominal[far][:, axes])
    expected = "measured coordinates in mm, in the frame of the nominal ones"
    if (
        datum == "none"
        and ORIGIN in guess
        and not _are_far(freed(points, axes, MOST)[0], axes).any()
    ):
        expected += f"; where each part was put down by hand: --datum offset, or --datum {MOST}"
    i = int(np.argmax(far))
    raise fault(
        f"{int(far.sum())} of {len(far)} points are more than {SUSPICIOUS_MM:g} mm from their "
        f"nominal, typically {float(np.median(errors.max(axis=1))):.3g} mm: {guess}",
        file=points.sources[points.file_index[i]].shown,
        row=int(points.row[i]),
        expected=expected,
    )


def _are_far(points: Points, axes: tuple[int, ...]) -> np.ndarray:
    """Which points (n,) no error of a machine tool brings where they are."""
    far = np.zeros(len(points), bool)
    for block in _blocks(points):
        for axis in axes:
            error = points.measured[block, axis] - points.nominal[block, axis]
            far[block] |= np.abs(error) > SUSPICIOUS_MM
    return far


def _far(points: Points, loose: Points, axes: tuple[int, ...]) -> list[Finding]:
    far = _are_far(loose, axes)
    if not far.any():
        return []
    i = int(np.argmax(far))
    guess = _mistake(loose.measured[far][:, axes], loose.nominal[far][:, axes])
    place = f" (first: {points.sources[points.file_index[i]].shown}, row {points.row[i]})"
    if order := parts_in_other_order(loose, far, axes, SUSPICIOUS_MM):
        guess = order
    elif ORIGIN in guess and (single := slips(points, loose, axes, far, SUSPICIOUS_MM)):
        place, guess = "", single
    elif ORIGIN in guess and len(own := np.unique(points.part[far])) <= FEW_NAMED:
        names = " and ".join(repr(points.parts[code]) for code in own)
        guess = f"of part{'s' if len(own) > 1 else ''} {names} {guess}"
    count = int(far.sum())
    return [
        Warned(
            code=FAR,
            message=f"{count} of {len(far)} points {'is' if count == 1 else 'are'} more than "
            f"{SUSPICIOUS_MM:g} mm from {'its' if count == 1 else 'their'} nominal{place}: {guess}",
        )
    ]


def _left_out(points: Points, axes: tuple[int, ...]) -> list[Finding]:
    """An axis that only some points have, or that has no nominal, is not analysed: say so."""
    found = []
    for axis in range(3):
        if axis not in axes and np.isfinite(points.measured[:, axis]).any():
            what = f"{AXES[axis]}_mm is left out: not every point has it with a nominal"
            found.append(Warned(code=LEFT_OUT, message=what))
    return found


def not_measured(predicted: Sequence[str], points: Points) -> list[Finding]:
    """Of axes with an equation along which no point was measured: nothing is judged there."""
    found = []
    for axis, name in enumerate(AXES):
        if name in predicted and not np.isfinite(points.measured[:, axis]).any():
            text = (
                f"the points have no {name}_mm: the E{name} of the machine is not judged "
                "(is the column named otherwise?)"
            )
            found.append(Warned(code="axis-not-measured", message=text))
    return found


def _moved(points: Points, axes: tuple[int, ...]) -> list[Finding]:
    """A feature is one place of the part: two nominals are two features, or a slip."""
    place = np.zeros((len(points.features), len(axes)))
    for block in reversed(list(_blocks(points))):
        # Of rows of the same feature the first is written last.
        for k, axis in enumerate(axes):
            place[points.feature[block][::-1], k] = points.nominal[block, axis][::-1]
    moved = np.zeros(len(points), bool)
    for block in _blocks(points):
        for k, axis in enumerate(axes):
            away = points.nominal[block, axis] - place[points.feature[block], k]
            moved[block] |= np.abs(away) > SAME_MM
    if not moved.any():
        return []
    i = int(np.argmax(moved))
    names = np.unique(points.feature[moved])
    text = (
        f"{len(names)} of {len(points.features)} features have more than one nominal place "
        f"(first: {points.features[points.feature[i]]!r} in "
        f"{points.sources[points.file_index[i]].shown}, row {points.row[i]}): the errors of "
        "different places are analysed as one feature"
    )
    return [Warned(code="nominals-differ", message=text)]


def _blocks(points: Points) -> Iterator[slice]:
    """Pieces of the points that fit the cache."""
    return (slice(start, start + _BLOCK) for start in range(0, len(points), _BLOCK))


def _mistake(measured: FloatArray, nominal: FloatArray) -> str:
    now = typical(measured - nominal)
    guesses = {
        "this looks like x and y swapped": measured[:, [1, 0, *range(2, measured.shape[1])]],
        "this looks like a sign the other way round": -measured,
        "this looks like the sign of x the other way round": measured * _of_one(measured, 0, -1.0),
        "this looks like the sign of y the other way round": measured * _of_one(measured, 1, -1.0),
        "this looks like inches taken for mm": measured * 25.4,
        **{
            f"this looks like {letter} alone in {unit}, not mm": measured * _of_one(measured, i, f)
            for i, letter in enumerate(AXES[: measured.shape[1]])
            for unit, f in (("inches", 25.4), ("um", 1e-3))
        },
        "this looks like mm taken for inches": measured / 25.4,
        "this looks like um taken for mm": measured / 1000.0,
        "this looks like metres taken for mm": measured * 1000.0,
    }
    left = {text: typical(changed - nominal) for text, changed in guesses.items()}
    best = min(left, key=lambda text: left[text])
    if left[best] < min(EXPLAINS * now, SUSPICIOUS_MM):
        return best
    shift = np.median(measured - nominal, axis=0)
    if typical(measured - nominal - shift) < EXPLAINS * now:
        return "this looks like an origin that differs by " + ", ".join(
            f"{value:.4g} mm" for value in shift
        )
    if look_like_errors(measured, nominal):
        return "these look like errors, not like the coordinates that they are errors of"
    return "this looks like a unit, sign or swap mistake, or another origin"


def _of_one(measured: FloatArray, axis: int, factor: float) -> FloatArray:
    """Factors (axes,): that of one axis, 1 of the others."""
    found = np.ones(measured.shape[1])
    found[axis] = factor
    return found
