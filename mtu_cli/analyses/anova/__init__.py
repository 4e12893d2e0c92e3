"""What did the machine really do: part-to-part and repeat scatter of measured parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova.axis_scatter import AxisScatter, axis_scatter
from mtu_cli.analyses.anova.features import (
    FeatureMap,
    UnusualFeature,
    maps,
    set_up_warnings,
    unusual_features,
)
from mtu_cli.analyses.anova.parts import (
    Family,
    Label,
    UnusualPart,
    full_labels,
    part_limits,
    parts_table,
    side_by_side,
    unusual_parts,
)
from mtu_cli.analyses.anova.tables import METHODS, Analysed, Base, Kind, Method, analysed
from mtu_cli.analyses.anova.totals import Total, totals_of
from mtu_cli.analyses.anova.warnings import anova_warnings, missing_entries
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.datum import Datum, freed, incomplete_datum
from mtu_cli.model.loose_features import loose_of_tables
from mtu_cli.model.measured import (
    MeasuredTables,
    angle_tables,
    axes_of,
    feature_tables,
    left_out,
    length_tables,
    length_warnings,
    only_features,
    visits_of,
)
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart

__all__ = ["METHODS", "Analysed", "AnovaResult", "Method", "analyse_variance"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AnovaResult:
    """The analysis of all measured parts.

    `unusual` is None where there are too few parts to tell; `axis_scatter` has one test an
    operation, y over x; `shown` are (operation, feature) in the order of their interest: where a
    part is an outlier, those that are outliers themselves, the largest errors to come. `maps` are
    the mean errors in the plane.
    """

    method: Method
    datum: Datum
    features: Analysed
    lengths: Analysed | None
    angles: Analysed | None
    family: Family
    unusual: tuple[UnusualPart, ...] | None
    unusual_features: tuple[UnusualFeature, ...]
    axis_scatter: tuple[AxisScatter, ...]
    totals: tuple[Total, ...]
    shown: tuple[tuple[str, str], ...]
    maps: tuple[FeatureMap, ...]
    coverage_factor: float
    warnings: tuple[Finding, ...]

    @property
    def kinds(self) -> tuple[Analysed, ...]:
        """Features, then lengths and right angles where there are any."""
        found = (self.features, self.lengths, self.angles)
        return tuple(item for item in found if item is not None)

    def limits(self, i: int) -> FloatArray:
        """Limits (2, parts) of the part means of table `i` of features, mm; nan where none."""
        centre: FloatArray = self.features.one_way.mean[i] + part_limits(self.family, i)
        return centre


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
    bases, warnings = _bases(points, part, datum)
    tables = (parts_table(b.tables, b.kind, b.one_way, b.reml) for b in bases)
    family, unusual = unusual_parts(side_by_side(*tables), settings.seed)
    k, singles = settings.coverage_factor, _by_label(unusual)
    kinds = {base.kind: _analysed(base, method, k, singles) for base in bases}
    features = kinds["feature"]
    standing = unusual_features(features.tables, features.one_way)
    planes = maps(features.tables, features.one_way, _places(points))
    warnings += set_up_warnings(planes) if datum == "none" else []
    return AnovaResult(
        method=method,
        datum=datum,
        features=features,
        lengths=kinds.get("length"),
        angles=kinds.get("angle"),
        family=family,
        unusual=None if family.found is None else tuple(unusual),
        unusual_features=standing,
        axis_scatter=axis_scatter(features.tables, features.one_way),
        totals=totals_of(features),
        shown=_shown(features, standing),
        maps=planes,
        coverage_factor=k,
        warnings=(*warnings, *anova_warnings(list(kinds.values()), method)),
    )


def _by_label(unusual: Sequence[UnusualPart]) -> dict[Label, list[str]]:
    """The outlying parts of single tables, by table."""
    found: dict[Label, list[str]] = {}
    for item in unusual:
        for label in item.singles:
            found.setdefault(label, []).append(item.part)
    return found


def _bases(
    points: Points, part: LoadedPart | None, datum: Datum
) -> tuple[list[Base], list[Finding]]:
    """The tables of all kinds that there are, features first, and what is odd about the data."""
    loose, complete = freed(points, axes_of(points), datum)
    features = feature_tables(loose)
    kinds: dict[Kind, MeasuredTables | None] = {"feature": features}
    warnings = [*left_out(points), *loose_of_tables(features, points)]
    if not complete:
        warnings.append(incomplete_datum())
    if part is not None:
        kinds |= _of_part(points, part)
        warnings += missing_entries(part, kinds["length"], kinds["angle"])
        warnings += length_warnings(points, part)
    return [Base(k, tables) for k, tables in kinds.items() if tables is not None], warnings


def _of_part(points: Points, part: LoadedPart) -> dict[Kind, MeasuredTables | None]:
    """Tables of the part file's lengths and angles."""
    lengths, angles = part.part.lengths, part.part.orthogonality
    names = [name for item in lengths for name in (item.from_, item.to)]
    names += [name for item in angles for name in (*item.row, *item.column)]
    needed = only_features(points, names)
    if not len(needed):
        return {"length": None, "angle": None}
    visits = visits_of(needed)
    return {
        "length": length_tables(needed, visits, part),
        "angle": angle_tables(needed, visits, part),
    }


def _analysed(base: Base, method: Method, k: float, singles: dict[Label, list[str]]) -> Analysed:
    labels = full_labels(base.tables, base.kind)
    return analysed(base, method, k, tuple(tuple(singles.get(label, ())) for label in labels))


def _places(points: Points) -> dict[str, FloatArray]:
    places = np.full((len(points.features), 3), np.nan)
    places[points.feature] = points.nominal
    return dict(zip(points.features, places, strict=True))


def _shown(features: Analysed, standing: tuple[UnusualFeature, ...]) -> tuple[tuple[str, str], ...]:
    labels = features.tables.labels
    with_parts = [labels[i][:2] for i, parts in enumerate(features.unusual) if parts]
    themselves = [item.where[:2] for item in standing]
    largest = [labels[i][:2] for i in features.largest()]
    return tuple(dict.fromkeys((*with_parts, *themselves, *largest)))
