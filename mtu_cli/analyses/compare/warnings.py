"""What a comparison leaves open, and why: every missing figure has its reason here."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtu_cli.analyses.anova.warnings import missing_cells, missing_entries, some
from mtu_cli.analyses.compare.evidence import FEWEST_PARTS
from mtu_cli.analyses.compare.verdicts import Compared
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import MeasuredTables, not_measured
from mtu_cli.model.visits import axes_of
from mtu_cli.stats.anova import BoolArray

FEWEST_TURNED, TURNED = 3, 0.9
"""Biased items, and the share of their bias that the other sign explains, from which on it is
asked for."""
NO_U = 1e-6
"""mm; a datum leaves no more of some features than rounding."""
COARSE = 3.0
"""Last digits of so many predicted u round most scatter away (u of one part holds that)."""


ALONE = "a bias is judged by the predicted scatter"
FEW = (
    f"{FEWEST_PARTS} are needed to measure the scatter: means are judged by the predicted one, and "
    "one that is off may be scatter"
)
UNREPEATED = "MS_between contains the scatter of the CMM, which is not predicted"
NO_SCATTER = "no scatter is measured and none predicted"
WITHHELD = "of so few passes or parts ten times the predicted scatter would pass"
NO_EQUATION = "the points are not compared there, and lengths have no predicted error along it"
EXACT, ALIKE = "no uncertainty is predicted", "the parts do not scatter"


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
    without = [AXES[i] for i in axes_of(points) if AXES[i] not in model.axes]
    return [
        *_sign(kinds),
        *not_measured(model.axes, points),
        *(finding("axis-without-equation", axis=x, consequence=NO_EQUATION) for x in without),
        *_not_measured(part, points, lengths),
        *_empty(tables),
        *_items(kinds),
        *_coarse(tables, features),
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


def _items(kinds: list[Compared]) -> list[Finding]:
    """What parts, repeats and predictions are too few for, item by item."""
    parts = np.concatenate([kind.one_way.parts for kind in kinds])
    repeats = np.concatenate([kind.one_way.df_within for kind in kinds])
    exact = np.concatenate([~(kind.predicted.u > 0) for kind in kinds])
    alike = np.concatenate([kind.s_part == 0 for kind in kinds]) & (parts > 1)
    untested = np.array([verdict is None for kind in kinds for verdict in kind.verdicts])
    withheld = np.array([held for kind in kinds for held in kind.withheld])
    few = (parts > 1) & (parts < FEWEST_PARTS)
    least = int(parts[few].min(initial=FEWEST_PARTS))
    ids = np.array([label[1] for kind in kinds for label in kind.labels], object)
    cases: tuple[tuple[str, BoolArray, dict[str, Any]], ...] = (
        ("few-parts", parts == 1, {"parts": 1, "consequence": ALONE}),
        ("few-parts", few, {"parts": least, "consequence": FEW}),
        ("no-repeats", (repeats < 1) & (parts > 1), {"consequence": UNREPEATED}),
        ("not-tested", untested, {"what": "the difference", "reason": NO_SCATTER}),
        ("not-tested", withheld, {"what": "the scatter", "reason": WITHHELD}),
        ("not-estimable", exact, {"quantity": "ratios to the predicted scatter", "reason": EXACT}),
        ("not-estimable", alike, {"quantity": "the parts' share of MS_between", "reason": ALIKE}),
    )
    found = []
    for code, rows, facts in cases:
        if code == "not-estimable":
            facts["names"] = list(dict.fromkeys(ids[rows]))
        else:
            facts["items"] = some(rows, "items")
        if rows.any():
            found.append(finding(code, **facts))
    return found


def _coarse(tables: MeasuredTables, features: Compared) -> list[Finding]:
    """A last digit that hides the scatter: parts look alike, or differ by whole digits."""
    found: list[tuple[str, float, float]] = []
    for axis in dict.fromkeys(label[2] for label in features.labels):
        own = [i for i, label in enumerate(features.labels) if label[2] == axis]
        u = float(np.median(features.predicted.u[own]))
        digit = float(np.sqrt(12 * tables.rounding[own].max()))
        if u > NO_U and digit > COARSE * u:
            found.append((f"{axis}_mm", digit, u))
    if not found:
        return []
    names, digits, predicted = zip(*found, strict=True)
    shown = " and ".join(dict.fromkeys(f"{float(f'{1e3 * digit:.3g}'):g}" for digit in digits))
    u = 1e3 * min(predicted)
    return [
        finding("coarse-digit", columns=names, digits_um=shown, u_um=u, expected="more decimals")
    ]
