"""What a comparison leaves open, and why: every missing figure has its reason here."""

from __future__ import annotations

import numpy as np

from mtu_cli.analyses.anova.warnings import missing_cells, missing_entries, some
from mtu_cli.analyses.compare.evidence import FEWEST_PARTS
from mtu_cli.analyses.compare.verdicts import Compared
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.columns import last_digit
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import MeasuredTables, loose_of_tables, not_measured
from mtu_cli.model.visits import axes_of

FEWEST_TURNED, TURNED = 3, 0.9
"""Biased items, and the share of their bias that the other sign explains, from which on it is
asked for."""
NO_U = 1e-6
"""mm; a datum leaves no more of some features than rounding."""
COARSE = 3.0
"""Last digits of so many predicted u round most scatter away (u of one part holds that)."""


def compare_warnings(
    model: MachineModel,
    part: LoadedPart,
    points: Points,
    tables: MeasuredTables,
    features: Compared,
    lengths: Compared | None,
) -> list[Finding]:
    """All warnings on the items; `tables` are those of the features."""
    kinds = [features] if lengths is None else [features, lengths]
    return [
        *_sign(kinds),
        *_axes(model, points),
        *_not_measured(part, points, lengths),
        *_empty(tables),
        *_parts(kinds),
        *_tests(kinds),
        *_predictions(kinds),
        *_coarse(points, features),
        *loose_of_tables(tables, points),
    ]


def _sign(kinds: list[Compared]) -> list[Finding]:
    """Means that are those predicted with the other sign: readings or points are nominal minus
    actual. By the sum of squares of all items, each in its own u, before and after.
    """
    biased = sum(sum(answer is True for answer in kind.biased) for kind in kinds)
    if biased < FEWEST_TURNED:
        return []
    now = after = 0.0
    for kind in kinds:
        known = kind.u_difference > 0
        u, predicted = kind.u_difference[known], kind.predicted.mean[known]
        now += float(((kind.bias[known] / u) ** 2).sum())
        after += float((((kind.bias[known] + 2 * predicted) / u) ** 2).sum())
    if not now:
        # Of a machine that is known exactly and parts that are all equal nothing has a u.
        return []
    share = 1 - after / now
    if share < TURNED:
        return []
    return [finding("sign-turned", percent=100 * share)]


def _axes(model: MachineModel, points: Points) -> list[Finding]:
    consequence = "the points are not compared there, and lengths have no predicted error along it"
    return [
        *not_measured(model.axes, points),
        *(
            finding("axis-without-equation", axis=AXES[i], consequence=consequence)
            for i in axes_of(points)
            if AXES[i] not in model.axes
        ),
    ]


def _not_measured(part: LoadedPart, points: Points, lengths: Compared | None) -> list[Finding]:
    missing = [f"feature {name}" for name in part.part.features if name not in points.features]
    found = missing_entries("length", part.part.lengths, lengths.labels if lengths else ())
    if missing:
        found.append(finding("not-measured", names=missing, reason="not among the points"))
    return found


def _empty(tables: MeasuredTables) -> list[Finding]:
    """Parts that an operation has, but not at every feature."""
    operations = np.array([label[0] for label in tables.labels])
    present = tables.cells.present
    empty = np.zeros_like(present)
    for operation in np.unique(operations):
        rows = operations == operation
        empty[rows] = ~present[rows] & present[rows].any(axis=0)
    return missing_cells(tables, empty, "measurements")


def _parts(kinds: list[Compared]) -> list[Finding]:
    parts = np.concatenate([kind.one_way.parts for kind in kinds])
    repeats = np.concatenate([kind.one_way.df_within for kind in kinds])
    one, few = parts == 1, (parts > 1) & (parts < FEWEST_PARTS)
    unrepeated = (repeats < 1) & (parts > 1)
    found = []
    if one.any():
        consequence = "a bias is judged by the predicted scatter"
        found.append(
            finding("few-parts", parts=1, items=some(one, "items"), consequence=consequence)
        )
    if few.any():
        least, items = int(parts[few].min()), some(few, "items")
        consequence = f"{FEWEST_PARTS} are needed to measure the scatter: means are judged by the "
        consequence += "predicted one"
        found.append(finding("few-parts", parts=least, items=items, consequence=consequence))
    if unrepeated.any():
        consequence = "MS_between contains the scatter of the CMM, which is not predicted"
        found.append(
            finding("no-repeats", items=some(unrepeated, "items"), consequence=consequence)
        )
    return found


def _tests(kinds: list[Compared]) -> list[Finding]:
    untested = np.array([verdict is None for kind in kinds for verdict in kind.verdicts])
    withheld = np.array([held for kind in kinds for held in kind.withheld])
    reasons = (
        ("the difference", untested, "no scatter is measured and none predicted"),
        (
            "the scatter",
            withheld,
            "with so few passes of the readings, or so few parts, ten times the predicted scatter "
            "would pass",
        ),
    )
    return [
        finding("not-tested", what=what, items=some(rows, "items"), reason=reason)
        for what, rows, reason in reasons
        if rows.any()
    ]


def _predictions(kinds: list[Compared]) -> list[Finding]:
    exact = [
        label[1]
        for kind in kinds
        for label, u in zip(kind.labels, kind.predicted.u, strict=True)
        if not u > 0
    ]
    alike = [
        label[1]
        for kind in kinds
        for label, s, n in zip(kind.labels, kind.s_part, kind.one_way.parts, strict=True)
        if s == 0 and n > 1
    ]
    return [
        finding("not-estimable", quantity=quantity, names=list(dict.fromkeys(names)), reason=reason)
        for names, quantity, reason in (
            (exact, "ratios to the predicted scatter", "no uncertainty is predicted"),
            (alike, "the parts' share of MS_between", "the parts do not scatter"),
        )
        if names
    ]


def _coarse(points: Points, features: Compared) -> list[Finding]:
    """A last digit that hides the scatter: parts look alike, or differ by whole digits."""
    found: list[tuple[str, float, float]] = []
    for axis in axes_of(points):
        own = [i for i, label in enumerate(features.labels) if label[2] == AXES[axis]]
        if (points.measured[:, axis] == points.nominal[:, axis]).all():
            # Its digits are those of the drawing, which says whole millimetres.
            continue
        u = float(np.median(features.predicted.u[own])) if own else 0.0
        if u > NO_U and (digit := last_digit(points.measured[:, axis])) > COARSE * u:
            found.append((f"{AXES[axis]}_mm", digit, u))
    if not found:
        return []
    names, digits, predicted = zip(*found, strict=True)
    shown = " and ".join(dict.fromkeys(f"{float(f'{1e3 * digit:.3g}'):g}" for digit in digits))
    u = 1e3 * min(predicted)
    return [
        finding("coarse-digit", columns=names, digits_um=shown, u_um=u, expected="more decimals")
    ]
