"""What did the machine really do: part-to-part and repeat scatter of measured parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.analyses.anova.tables import (
    FEWEST_PARTS,
    Analysed,
    Capability,
    Kind,
    Method,
    Trend,
    UnusualPart,
    analysed,
    capabilities,
    trends,
    unusual_parts,
)
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.readings import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding, finding
from mtu_cli.model.features import BELOW_THREE, FEW_DOF
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.measured import (
    Label,
    MeasuredTables,
    angle_tables,
    axis_warnings,
    feature_tables,
    length_tables,
    length_warnings,
    missing_entries,
    roundings,
    some,
)
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import aligned, axes_of, only_features, operations_of, visits_of
from mtu_cli.stats.coverage import FAMILY_RATE
from mtu_cli.stats.groups import known_mean
from mtu_cli.stats.least_squares import BoolArray, FloatArray


class Total(NamedTuple):
    """All features of an operation along an axis; mm and mm^2, nan where undefined.

    `mean` of the features' mean errors and their standard deviation `spread`. Mean variances
    `part` and `repeat` by the chosen method, `both` where they are not separable. Of `tested`
    features `differ` from part to part with the error rate held over all features.
    """

    operation: str
    axis: str
    features: int
    mean: float
    spread: float
    part: float
    repeat: float
    both: float
    differ: int
    tested: int


@dataclass(frozen=True, slots=True, kw_only=True)
class AnovaResult:
    """The analysis of all measured parts.

    `kinds` are features, then lengths and right angles where there are any. `unusual` is None
    where there are too few parts to tell; `sequence` has the place (parts,) of each part in an
    operation; `trends` are of all tables, `capabilities` of what has a tolerance.
    """

    method: Method
    datum: Datum
    kinds: tuple[Analysed, ...]
    unusual: tuple[UnusualPart, ...] | None
    sequence: Mapping[str, FloatArray]
    trends: tuple[Trend, ...]
    capabilities: tuple[Capability, ...]
    totals: tuple[Total, ...]
    warnings: tuple[Finding, ...]

    @property
    def features(self) -> Analysed:
        """The tables of features, which there always are."""
        return self.kinds[0]


def analyse_variance(
    points: Points,
    part: LoadedPart | None,
    method: Method,
    settings: Settings,
    datum: Datum = "none",
) -> AnovaResult:
    """Gilsinn & Ling 2004, section 4: one table a feature and axis, a length, an angle.

    `datum` removes the best-fit alignment of a set-up by hand from the features' errors, by
    measurement; lengths and angles do not depend on it.

    Raises InputError for a feature that stands twice in one repeat of one part, and a row or
    column that is off its axis.
    """
    aligned_points = aligned(points, axes_of(points), datum)
    tables: dict[Kind, MeasuredTables] = {
        "feature": feature_tables(aligned_points, rounding=roundings(points))
    }
    measured = [AXES[k] for k in range(3) if np.isfinite(points.measured[:, k]).any()]
    warnings = axis_warnings(points, measured, "", "{} is left out")
    if part is not None:
        lengths, angles = part.part.lengths, part.part.orthogonality
        names = [name for item in lengths for name in (item.from_, item.to)]
        names += [name for item in angles for name in (*item.row, *item.column)]
        if len(needed := only_features(points, names)):
            visits = visits_of(needed)
            if (table := length_tables(needed, visits, part)) is not None:
                tables["length"] = table
            if (table := angle_tables(needed, visits, part)) is not None:
                tables["angle"] = table
        labels = {kind: table.labels for kind, table in tables.items()}
        warnings += missing_entries("length", lengths, labels.get("length", ()))
        warnings += missing_entries("right angle", angles, labels.get("angle", ()))
        warnings += length_warnings(points, part)
    k = settings.coverage_factor
    kinds = [analysed(kind, table, method, k) for kind, table in tables.items()]
    unusual = unusual_parts(kinds, settings.seed)
    outliers: dict[Label, tuple[str, ...]] = {}
    for item in unusual or ():
        for label in item.singles:
            outliers[label] = (*outliers.get(label, ()), item.part)
    kinds = [replace(x, unusual=tuple(outliers.get(each, ()) for each in x.labels)) for x in kinds]
    operations, operation = operations_of(points)
    places = np.full((len(operations), len(points.parts)), np.nan)
    places[operation, points.part] = points.sequence
    sequence = dict(zip(operations, places, strict=True))
    return AnovaResult(
        method=method,
        datum=datum,
        kinds=tuple(kinds),
        unusual=unusual,
        sequence=sequence,
        trends=trends(kinds, sequence),
        capabilities=tuple(capabilities(kinds, part, sequence)),
        totals=tuple(_totals(kinds[0])),
        warnings=(*warnings, *_warnings(kinds, method)),
    )


def _totals(analysis: Analysed) -> Iterator[Total]:
    """One an operation and axis, operation by operation."""
    operations = list(dict.fromkeys(label[0] for label in analysis.labels))
    keys = dict.fromkeys((label[0], label[2]) for label in analysis.labels)
    for operation, axis in sorted(keys, key=lambda key: operations.index(key[0])):
        rows = [i for i, label in enumerate(analysis.labels) if label[::2] == (operation, axis)]
        mean = analysis.one_way.mean[rows]
        spread = float(mean.std(ddof=1)) if len(mean) > 1 else np.nan
        variances = analysis.components.part, analysis.components.repeat, analysis.both
        part, repeat, both = (float(known_mean(each[rows])) for each in variances)
        yield Total(
            operation=operation,
            axis=axis,
            features=len(rows),
            mean=float(mean.mean()),
            spread=spread,
            part=part,
            repeat=repeat,
            both=both,
            differ=int((analysis.p_parts[rows] <= FAMILY_RATE).sum()),
            tested=int(np.isfinite(analysis.one_way.F[rows]).sum()),
        )


KINDS = {"feature": "features and axes", "length": "lengths", "angle": "right angles"}
UNKNOWN = "no scatter from part to part, nor of a future part, can be known"
CONDITIONS: dict[str, tuple[Callable[[Analysed], BoolArray], dict[str, Any]]] = {
    "few-parts": (lambda x: x.one_way.df_between < 1, {"parts": 1, "consequence": UNKNOWN}),
    "no-repeats": (
        lambda x: x.one_way.df_within < 1,
        {"consequence": "the scatter from part to part contains that of the CMM"},
    ),
    "not-estimable": (
        lambda x: (x.one_way.df_within > 0) & (x.one_way.ms_within == 0),
        {"quantity": "F and p", "reason": "all repeats are equal"},
    ),
    "negative-variance": (
        lambda x: (x.components.part_estimate < 0) & (x.method == "anova"),
        {"what": "part-to-part", "consequence": "0 is used for uncertainties"},
    ),
    "few-degrees-of-freedom": (lambda x: x.dof_future < FEW_DOF, {"how": BELOW_THREE}),
}


def _warnings(kinds: Sequence[Analysed], method: Method) -> Iterator[Finding]:
    """Every figure that is missing has its reason here, for each kind of table by name, features
    first; and parts that were not measured in all tables where they are due.
    """
    for code, (condition, facts) in CONDITIONS.items():
        masks = [(KINDS[kind.kind], condition(kind)) for kind in kinds]
        items = [some(rows, name) for name, rows in masks if rows.any()]
        names = [f"u of a future part ({each})" for each in items]
        if all(rows.all() for _, rows in masks):
            items, names = ["all"], ["u of a future part"]
        for each, name in zip(items, names, strict=True):
            yield finding(code, items=each, names=[name], **facts)
    if method == "paper":
        yield finding("paper-method")
    # Parts (parts,) are due in all tables of an operation where they have any feature of it, and of
    # one that is crossed with theirs: more than half of its parts have features of both. Parts
    # nested in operations, each made by one of several machines, are due there alone.
    parts, features = kinds[0].tables.parts, kinds[0].tables
    of = np.array([label[0] for label in features.labels])
    operations = np.unique(of)
    made = np.array([features.cells.present[of == each].any(axis=0) for each in operations])
    crossed = 2 * (made.astype(int) @ made.T) > made.sum(axis=1)[:, None]
    due_at = dict(zip(operations.tolist(), crossed.T @ made, strict=True))
    for kind in kinds:
        present = kind.tables.cells.present
        due = np.array([due_at[label[0]] for label in kind.tables.labels])
        if (empty := due & ~present).any():
            table, part = np.argwhere(empty)[0].tolist()
            label = " ".join(filter(None, kind.tables.labels[table]))
            what = "measurements" if kind.kind == "feature" else KINDS[kind.kind]
            facts = {
                "what": f"{int(empty.sum())} of {int(due.sum())} {what} by part",
                "names": [f"first: part {parts[part]!r} at {label}"],
                "consequence": "the rest is analysed with unequal counts",
            }
            yield finding("missing-values", part=parts[part], label=label, **facts)
    if 2 <= len(parts) < FEWEST_PARTS:
        consequence = f"{FEWEST_PARTS} are needed to find outliers among them"
        yield finding("few-parts", parts=len(parts), items="all", consequence=consequence)
