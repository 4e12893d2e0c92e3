"""What did the machine really do: part-to-part and repeat scatter of measured parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova.capability import (
    Capability,
    Trend,
    capabilities,
    sequences,
    trends,
)
from mtu_cli.analyses.anova.outliers import (
    UnusualPart,
    parts_table,
    unusual_parts,
)
from mtu_cli.analyses.anova.summary import (
    Total,
    anova_warnings,
    missing_entries,
    set_up_warnings,
    totals,
)
from mtu_cli.analyses.anova.tables import METHODS, Analysed, Kind, Label, Method, analysed
from mtu_cli.files.points import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding
from mtu_cli.model.measured import (
    MeasuredTables,
    angle_tables,
    feature_tables,
    left_out,
    length_tables,
    length_warnings,
    roundings,
)
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import axes_of, freed, incomplete_datum, only_features, visits_of
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart

__all__ = ["METHODS", "Analysed", "AnovaResult", "Method", "analyse_variance"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AnovaResult:
    """The analysis of all measured parts.

    `kinds` are features, then lengths and right angles where there are any. `unusual` is None
    where there are too few parts to tell; `sequence` has the place (parts,) of each part in an
    operation; `trends` are of all tables, `capabilities` of what has a tolerance. `shown` are
    (operation, feature) by interest: where a part is an outlier, then the largest
    errors to come.
    """

    method: Method
    datum: Datum
    kinds: tuple[Analysed, ...]
    unusual: tuple[UnusualPart, ...] | None
    sequence: Mapping[str, FloatArray]
    trends: tuple[Trend, ...]
    capabilities: tuple[Capability, ...]
    totals: tuple[Total, ...]
    shown: tuple[tuple[str, str], ...]
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

    `datum` takes the freedoms of a set-up by hand out of the features' errors, measurement by
    measurement; lengths and angles do not depend on it.

    Raises InputError for a feature that stands twice in one repeat of one part, and a row or
    column that is off its axis.
    """
    measured, warnings = _measured(points, part, datum)
    k = settings.coverage_factor
    kinds = [analysed(kind, tables, method, k) for kind, tables in measured.items()]
    unusual = unusual_parts(parts_table(kinds), settings.seed)
    names: dict[Label, tuple[str, ...]] = {}
    for item in unusual or ():
        for label in item.singles:
            names[label] = (*names.get(label, ()), item.part)
    kinds = [replace(x, unusual=tuple(names.get(label, ()) for label in x.labels)) for x in kinds]
    features = kinds[0]
    places = np.full((len(points.features), 3), np.nan)
    places[points.feature] = points.nominal
    where = dict(zip(points.features, places, strict=True))
    labels, sequence = features.labels, sequences(points)
    rounding = float(features.tables.rounding.mean())
    with_parts = [labels[i] for i, parts in enumerate(features.unusual) if parts]
    interesting = [*with_parts, *(labels[i] for i in features.order)]
    return AnovaResult(
        method=method,
        datum=datum,
        kinds=tuple(kinds),
        unusual=unusual,
        sequence=sequence,
        trends=trends(kinds, sequence),
        capabilities=capabilities(kinds, part, sequence),
        totals=totals(features),
        shown=tuple(dict.fromkeys(label[:2] for label in interesting)),
        warnings=(
            *warnings,
            *(set_up_warnings(features, where, rounding) if datum == "none" else ()),
            *anova_warnings(kinds, method),
        ),
    )


def _measured(
    points: Points, part: LoadedPart | None, datum: Datum
) -> tuple[dict[Kind, MeasuredTables], list[Finding]]:
    """The tables of all kinds that there are, features first, and what is odd about the data."""
    loose, complete = freed(points, axes_of(points), datum)
    features = feature_tables(loose, roundings(points))
    warnings = left_out(points)
    if not complete:
        warnings.append(incomplete_datum())
    found: dict[Kind, MeasuredTables | None] = {"feature": features}
    if part is not None:
        lengths, angles = part.part.lengths, part.part.orthogonality
        names = [name for item in lengths for name in (item.from_, item.to)]
        names += [name for item in angles for name in (*item.row, *item.column)]
        if len(needed := only_features(points, names)):
            visits = visits_of(needed)
            found["length"] = length_tables(needed, visits, part)
            found["angle"] = angle_tables(needed, visits, part)
    measured = {kind: tables for kind, tables in found.items() if tables is not None}
    if part is not None:
        labels = {kind: tables.labels for kind, tables in measured.items()}
        warnings += missing_entries("length", part.part.lengths, labels.get("length", ()))
        warnings += missing_entries("right angle", part.part.orthogonality, labels.get("angle", ()))
        warnings += length_warnings(points, part)
    return measured, warnings
