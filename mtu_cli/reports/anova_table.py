"""The tables of anova: a screen that sums up, then lengths, angles and features."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.text import Text

from mtu_cli.analyses.anova import Analysed, AnovaResult
from mtu_cli.analyses.anova.parts import FAMILY_RATE, UnusualPart
from mtu_cli.analyses.anova.totals import Total
from mtu_cli.reports.document import root
from mtu_cli.reports.numbers import MISSING, p_value, plus_minus, significant, with_u
from mtu_cli.reports.tables import Column, Sheet
from mtu_cli.stats.swap import SwapTest
from mtu_cli.units import ARCSEC, UM

SHOWN = 24
"""Tables of a kind that are listed in full; of more the worst are shown."""
WORST = 10
SIGNIFICANT = 0.05
UNITS = {"feature": ("um", UM), "length": ("um", UM), "angle": ("arcsec", ARCSEC)}


def table(result: AnovaResult) -> list[object]:
    """What a terminal shows; everything is in the report and in the CSV."""
    k = result.coverage_factor
    found: list[object] = [_summary(result), *(Text(line) for line in sentences(result)), Text("")]
    if result.lengths is not None:
        found.append(_sheet("Lengths", result.lengths, k))
    if result.angles is not None:
        found.append(_sheet("Right angles", result.angles, k))
    found.append(_sheet("Features", result.features, k))
    return found


def _summary(result: AnovaResult) -> Sheet:
    parts = len(result.features.tables.parts)
    columns = [
        Column(title="operation\n", text=True, folds=True),
        Column(title="axis\n", text=True),
        Column(title="features\n"),
        Column(title="mean error\num"),
        Column(title="largest\num"),
        Column(title="feature s\num"),
        Column(title="part s\num"),
        Column(title="CMM s\num"),
        Column(title="CMM share\n%"),
        Column(title="parts differ\n"),
    ]
    told = np.isfinite([item.part for item in result.totals]).any()
    notes = [
        "largest: mean error of the worst feature; feature s, part s, CMM s: standard deviation of "
        "the features' mean errors, from part to part and of repeated measurement; parts differ: "
        "features with F above its 95 % value"
    ]
    if not told and parts > 1:
        notes[0] = (
            "largest: mean error of the worst feature; without repeats the scatter from part to "
            "part and that of the CMM are one: part s holds both"
        )
    return Sheet(
        title=f"{parts} part{'s' if parts > 1 else ''} by operation and axis",
        columns=columns,
        rows=[_total(item, parts) for item in result.totals],
        notes=notes,
    )


def _total(item: Total, parts: int) -> list[str]:
    part = item.part if np.isfinite(item.part) else item.both
    s_part, s_repeat = root(part) / UM, root(item.repeat) / UM
    spread = item.spread / UM
    known = [s for s in (s_part, s_repeat, spread) if np.isfinite(s)]
    scale = max(known, default=float("nan")) / np.sqrt(parts)
    return [
        item.operation or MISSING,
        item.axis,
        str(item.features),
        with_u(item.mean / UM, scale)[0],
        with_u(item.largest / UM, scale)[0],
        significant(spread),
        significant(s_part),
        significant(s_repeat),
        significant(100 * item.repeat_share),
        f"{item.significant} of {item.tested}" if item.tested else MISSING,
    ]


def sentences(result: AnovaResult) -> list[str]:
    """Unusual parts and the axes' scatter, in words."""
    rate = f"{100 * FAMILY_RATE:g} %"
    found = []
    if result.unusual is None:
        found.append("Too few parts to say whether one stands out.")
    elif not result.unusual:
        found.append(f"No part stands out (false alarm rate {rate} over the whole study).")
    found += [_unusual(item) for item in result.unusual or ()]
    found += [_axes(operation, test) for operation, test in result.axis_scatter]
    return found


def _unusual(item: UnusualPart) -> str:
    operation, name, axis = item.where
    unit, size = UNITS.get(axis, UNITS["feature"])
    deviation, typical = item.deviation / size, significant(item.typical / size)
    kinds = {"length": "in its lengths", "angle": "in its right angles"}
    place = kinds.get(axis, f"in {axis}")
    if name:
        place = f"at {'' if axis in kinds else 'feature '}{name} {place}"
    place += f" ({operation})" if operation else ""
    if item.why == "distance":
        text = f"is {significant(deviation)} {unit} off {place} (root mean square)"
    else:
        text = f"lies {with_u(deviation, item.typical / size)[0]} {unit} from the mean {place}"
        text += "" if name else ", all features together"
    p = p_value(item.p)
    shown = f"p {p}" if p.startswith("<") else f"p = {p}"
    return f"Part {item.part} stands out: it {text}; other parts: {typical} {unit} ({shown})."


def _axes(operation: str, test: SwapTest) -> str:
    prefix = f"{operation}: " if operation else ""
    if not np.isfinite(test.p):
        return f"{prefix}nothing scatters from part to part in x or y."
    if not np.isfinite(test.ratio):
        return f"{prefix}parts scatter in y only (p = {p_value(test.p)})."
    s = float(np.sqrt(test.ratio))
    if test.p > SIGNIFICANT:
        text = f"no sign that y scatters more than x or less (s ratio {s:.2f}"
        return f"{prefix}{text}, p = {p_value(test.p)})."
    p = p_value(test.p)
    shown = f"p {p}" if p.startswith("<") else f"p = {p}"
    times = f"{s:.2g} times" if s >= 1 else f"{1 / s:.2g} times"
    more, less = ("y", "x") if s >= 1 else ("x", "y")
    return f"{prefix}{more} scatters {times} as much as {less} from part to part ({shown})."


def _sheet(title: str, found: Analysed, k: float) -> Sheet:
    unit, size = UNITS[found.kind]
    chosen = _worst(found)
    total = len(found.tables.labels)
    operations = {label[0] for label in found.tables.labels} != {""}
    columns = [Column(title="operation\n", text=True, folds=True)] if operations else []
    columns.append(Column(title=f"{found.kind}\n", text=True, folds=True))
    columns += [Column(title="axis\n", text=True)] if found.kind == "feature" else []
    columns += [
        Column(title="n\n"),
        Column(title=f"mean ± u\n{unit}"),
        Column(title=f"part s\n{unit}"),
        Column(title=f"95 % interval\n{unit}"),
        Column(title=f"CMM s\n{unit}"),
        Column(title="F\n"),
        Column(title="F 95 %\n"),
        Column(title=f"U future\n{unit}"),
        Column(title="unusual\n", text=True, folds=True),
    ]
    notes = [f"U future = {k:g} u, of a future part; part s by {METHODS[found.method]}"]
    if total > len(chosen):
        title += f": the {len(chosen)} with the largest errors to come, of {total}"
        notes.append("largest |mean| + U future first; all of them: --csv FILE, -o FILE")
    rows = [_row(found, i, k, size, operations) for i in chosen]
    return Sheet(title=title, columns=columns, rows=rows, notes=notes)


METHODS = {
    "reml": "restricted maximum likelihood",
    "anova": "mean squares (a negative variance is shown as <0)",
    "paper": "the root of MS_between, as Gilsinn & Ling 2004; the interval is of s part itself",
}


def _worst(found: Analysed) -> Sequence[int]:
    total = len(found.tables.labels)
    if total <= SHOWN:
        return range(total)
    size = np.abs(found.one_way.mean) + 2 * np.nan_to_num(found.u_future)
    worst: list[int] = np.argsort(-size, kind="stable")[:WORST].tolist()
    return worst


def _row(found: Analysed, i: int, k: float, size: float, operations: bool) -> list[str]:
    operation, name, axis = found.tables.labels[i]
    one, components = found.one_way, found.components
    s_part = root(components.part[i]) / size
    low, high = (significant(root(end) / size) for end in found.interval[i])
    known = np.isfinite(found.interval[i]).all()
    shown = "<0" if components.part_estimate[i] < 0 else significant(s_part)
    return [
        *([operation or MISSING] if operations else []),
        name,
        *([axis] if found.kind == "feature" else []),
        str(int(one.N[i])),
        plus_minus(one.mean[i] / size, found.u_mean[i] / size),
        shown,
        f"[{low}, {high}]" if known else MISSING,
        significant(root(components.repeat[i]) / size),
        significant(one.F[i], 3),
        significant(one.F_critical_95[i], 3),
        significant(k * found.u_future[i] / size),
        " ".join(found.unusual[i]) + ("*" if found.unusual[i] else ""),
    ]
