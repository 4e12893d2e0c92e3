"""Does the prediction hold? Predicted errors and scatter beside those of measured parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.compare.evidence import evidence
from mtu_cli.analyses.compare.predicted import (
    predict_operations,
    predicted_features,
    predicted_lengths,
)
from mtu_cli.analyses.compare.verdicts import Compared, Summary, Verdict, judged, summarised
from mtu_cli.analyses.compare.warnings import compare_warnings
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import (
    feature_tables,
    left_out,
    length_tables,
    no_shared_axis,
    roundings,
)
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import Datum, axes_of, freed, incomplete_datum, visits_of
from mtu_cli.stats.least_squares import FloatArray

__all__ = ["CompareResult", "Compared", "Summary", "Verdict", "compare", "judged"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareResult:
    """Features and lengths, predicted against measured; nominal `places` (ids, 3) in mm.

    The summaries have one entry an operation.
    """

    ids: tuple[str, ...]
    places: FloatArray
    features: Compared
    lengths: Compared | None
    feature_summaries: tuple[Summary, ...]
    length_summaries: tuple[Summary, ...]
    datum: Datum
    coverage_factor: float
    warnings: tuple[Finding, ...]


def compare(
    model: MachineModel,
    part: LoadedPart,
    points: Points,
    settings: Settings,
    datum: Datum = "none",
    covariates: Mapping[str, float] | None = None,
) -> CompareResult:
    """Gilsinn & Ling 2004, section 5 and Table 10, with tests in place of a look.

    The machine is predicted once an operation, with `covariates`, or the points' own: what these
    change from part to part is taken out of the points. Means and scatter are tested item by item
    (`Evidence`), and the scatter of all features at once, as one family (Holm, 5 %): of clean
    studies one in twenty is no "consistent".

    Raises InputError for points that share no axis with the machine, and for a missing covariate
    or one with gaps.
    """
    axes, k = _shared_axes(model, points), settings.coverage_factor
    rounding = roundings(points)
    warnings = left_out(points)
    predicted = predict_operations(model, points, covariates or {})
    points, predictions = predicted.points, predicted.predictions
    loose, complete = freed(points, axes, datum)
    tables, names = feature_tables(loose, rounding), {AXES[i] for i in axes}
    if not complete:
        warnings.append(incomplete_datum())
    tables = tables.only([i for i, label in enumerate(tables.labels) if label[2] in names])
    of_features = evidence(tables, predicted_features(predictions, tables.labels, axes, datum), k)
    of_lengths, long = None, length_tables(points, visits_of(points), part)
    if long is not None:
        holes = of_features if datum == "none" else None
        items = predicted_lengths(predictions, long.labels, part, holes)
        of_lengths = evidence(long, items, k)
    features, lengths = judged(of_features, of_lengths)
    seen = np.unique(points.feature)
    return CompareResult(
        ids=tuple(points.features[i] for i in seen),
        places=visits_of(points).nominal[seen],
        features=features,
        lengths=lengths,
        feature_summaries=summarised(features),
        length_summaries=() if lengths is None else summarised(lengths, "lengths"),
        datum=datum,
        coverage_factor=k,
        warnings=(
            *warnings,
            *predicted.warnings,
            *compare_warnings(model, part, points, tables, features, lengths),
        ),
    )


def _shared_axes(model: MachineModel, points: Points) -> tuple[int, ...]:
    """The axes (0, 1, 2) that were measured and that the machine has an equation for."""
    measured = axes_of(points)
    axes = tuple(i for i in measured if AXES[i] in model.axes)
    if not axes:
        raise no_shared_axis(model, points, measured)
    return axes
