"""What a comparison cannot tell, and why: every figure that is missing has its reason here."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mtu_cli.analyses.compare.evidence import FEWEST_PARTS
from mtu_cli.analyses.compare.verdicts import Compared
from mtu_cli.errors import Warned
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.drawn_parts import all_on_nominal
from mtu_cli.model.loose_features import loose_of_tables
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import MeasuredTables
from mtu_cli.model.measured_checks import not_measured
from mtu_cli.model.resolution import last_digit
from mtu_cli.model.visits import axes_of

MOST_NAMED = 6
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
    text = (
        f"with the other sign the prediction would explain {100 * share:.0f} % of the bias (sum of "
        "squares): are the errors of the readings, or of the points, nominal minus actual? Here "
        "an error is actual minus nominal"
    )
    return [Warned(code="sign-turned", message=text)]


def _axes(model: MachineModel, points: Points) -> list[Finding]:
    found = not_measured(model.axes, points)
    for i in axes_of(points):
        if AXES[i] not in model.axes:
            text = (
                f"{AXES[i]}_mm of the points is not compared: the machine has no equation for "
                f"E{AXES[i]}; along it lengths are predicted to be without error"
            )
            found.append(Warned(code="axis-not-predicted", message=text))
    return found


def _not_measured(part: LoadedPart, points: Points, lengths: Compared | None) -> list[Finding]:
    found = []
    known = set() if lengths is None else {label[1] for label in lengths.labels}
    lost = [entry.id for entry in part.part.lengths if entry.id not in known]
    if lost:
        text = (
            f"length {_named(lost)} is left out: no measurement of a part, in one operation, has "
            "both of its features"
        )
        found.append(Warned(code="not-measured", message=text))
    missing = [name for name in part.part.features if name not in points.features]
    if missing:
        text = f"feature {_named(missing)} of the part was not measured"
        found.append(Warned(code="not-measured", message=text))
    return found


def _empty(tables: MeasuredTables) -> list[Finding]:
    """Parts that an operation has, but not at every feature."""
    operations = np.array([label[0] for label in tables.labels])
    present = tables.cells.present
    empty = np.zeros_like(present)
    for operation in np.unique(operations):
        own = operations == operation
        empty[own] = ~present[own] & present[own].any(axis=0)
    if not empty.any():
        return []
    table, part = (int(index) for index in np.argwhere(empty)[0])
    name = " ".join(word for word in tables.labels[table] if word)
    text = (
        f"{int(empty.sum())} cells are empty (first: part {tables.parts[part]!r} was not measured "
        f"at {name}); the rest is compared with unequal counts"
    )
    return [Warned(code="empty-cells", message=text)]


def _parts(kinds: list[Compared]) -> list[Finding]:
    parts = np.concatenate([kind.one_way.parts for kind in kinds])
    repeats = np.concatenate([kind.one_way.df_within for kind in kinds])
    total = len(parts)
    few = (parts > 1) & (parts < FEWEST_PARTS)
    entries = [
        (
            "one-part", parts == 1,
            "there is one part only: no scatter can be measured, and a bias is judged by the "
            "predicted one",
        ),
        (
            "few-parts", few,
            f"there are fewer than {FEWEST_PARTS} parts: the mean is judged by the predicted "
            "scatter, and one that is off may be bias or scatter",
        ),
        (
            "no-repeats", (repeats < 1) & (parts > 1),
            "no part was measured twice: MS_between holds the scatter of the CMM too, which "
            "nothing predicts",
        ),
    ]  # fmt: skip
    return [
        Warned(code=code, message=_some(int(which.sum()), total) + text)
        for code, which, text in entries
        if which.any()
    ]


def _tests(kinds: list[Compared]) -> list[Finding]:
    total = sum(len(kind.labels) for kind in kinds)
    found = []
    untested = sum(kind.verdicts.count(None) for kind in kinds)
    if untested:
        text = (
            "not tested: neither is a difference or scatter measured, nor is any predicted (a "
            "datum may leave nothing of few features)"
        )
        found.append(Warned(code="not-tested", message=_some(untested, total) + text))
    withheld = sum(sum(kind.withheld) for kind in kinds)
    if withheld:
        text = (
            "the scatter is not judged. Of so few passes of the readings, or so few parts, even "
            "ten times the predicted scatter would pass for chance; read the machine in more "
            "passes"
        )
        found.append(Warned(code="scatter-not-tested", message=_some(withheld, total) + text))
    return found


def _predictions(kinds: list[Compared]) -> list[Finding]:
    found = []
    exact = [
        label[1] for kind in kinds for label, u in zip(kind.labels, kind.predicted.u, strict=True)
        if not u > 0
    ]  # fmt: skip
    if exact:
        text = (
            f"no uncertainty is predicted for {_named(exact)}: ratios cannot be had there, and "
            "scatter is more than was predicted, whatever its size"
        )
        found.append(Warned(code="no-predicted-uncertainty", message=text))
    alike = [
        label[1] for kind in kinds
        for label, s, n in zip(kind.labels, kind.s_part, kind.one_way.parts, strict=True)
        if s == 0 and n > 1
    ]  # fmt: skip
    if alike:
        text = (
            f"the parts are not seen to scatter at {_named(alike)}: the share of MS_between "
            "that is theirs cannot be had there"
        )
        found.append(Warned(code="no-part-scatter", message=text))
    return found


def _coarse(points: Points, features: Compared) -> list[Finding]:
    """A last digit that hides the scatter: parts look alike, or differ by whole digits."""
    found: list[tuple[str, float, float]] = []
    for axis in axes_of(points):
        own = [i for i, label in enumerate(features.labels) if label[2] == AXES[axis]]
        if all_on_nominal(points, axis):
            # Its digits are those of the drawing, which says whole millimetres.
            continue
        u = float(np.median(features.predicted.u[own])) if own else 0.0
        if u > NO_U and (digit := last_digit(points.measured[:, axis])) > COARSE * u:
            found.append((f"{AXES[axis]}_mm", digit, u))
    if not found:
        return []
    names, digits, predicted = zip(*found, strict=True)
    shown = " and ".join(dict.fromkeys(f"{float(f'{1e3 * digit:.3g}'):g}" for digit in digits))
    text = (
        f"{', '.join(names)} of the points {'are' if len(found) > 1 else 'is'} given to {shown} "
        f"um, and u = {1e3 * min(predicted):.2g} um is predicted: such a digit hides the scatter "
        'of the parts, so that "over-predicted" says nothing; export more digits'
    )
    return [Warned(code="coarse-digit", message=text)]


def _some(count: int, total: int) -> str:
    return "" if count == total else f"{count} of {total} items: "


def _named(names: Iterable[str]) -> str:
    known = list(dict.fromkeys(names))
    more = f" and {len(known) - MOST_NAMED} more" if len(known) > MOST_NAMED else ""
    return ", ".join(known[:MOST_NAMED]) + more
