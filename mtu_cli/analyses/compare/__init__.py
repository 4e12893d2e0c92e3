"""Does the prediction hold? Predicted errors and scatter beside those of measured parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.compare.evidence import (
    Evidence,
    Side,
    evidence,
    paper_length_variance,
)
from mtu_cli.analyses.compare.operations import (
    OperationPredictions,
    predict_operations,
    predicted_features,
    predicted_lengths,
)
from mtu_cli.analyses.compare.summary import Range, Summary, summarised
from mtu_cli.analyses.compare.verdicts import (
    VERDICTS,
    Compared,
    Verdict,
    judged,
)
from mtu_cli.analyses.compare.warnings import compare_warnings
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.datum import Datum, freed, incomplete_datum
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import (
    MeasuredTables,
    feature_tables,
    left_out,
    length_tables,
    no_shared_axis,
)
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import axes_of, visits_of
from mtu_cli.stats.family import FAMILY_RATE
from mtu_cli.stats.least_squares import FloatArray

__all__ = [
    "FAMILY_RATE",
    "VERDICTS",
    "CompareResult",
    "Compared",
    "Evidence",
    "Range",
    "Side",
    "Summary",
    "Verdict",
    "compare",
    "judged",
    "paper_length_variance",
]


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
    warnings, axes = left_out(points), _shared_axes(model, points)
    predicted = predict_operations(model, points, covariates or {})
    points = predicted.points
    task = _Task(predicted=predicted, axes=axes, datum=datum, part=part, k=settings.coverage_factor)
    sides = _sides(task, points)
    features, lengths = judged(sides.features, sides.lengths)
    warnings = [*warnings, *sides.warnings, *predicted.warnings]
    seen = np.unique(points.feature)
    return CompareResult(
        ids=tuple(points.features[i] for i in seen),
        places=visits_of(points).nominal[seen],
        features=features,
        lengths=lengths,
        feature_summaries=summarised(features),
        length_summaries=() if lengths is None else summarised(lengths, "lengths"),
        datum=datum,
        coverage_factor=task.k,
        warnings=(
            *warnings,
            *compare_warnings(model, part, points, sides.tables, features, lengths),
        ),
    )


class _Task(NamedTuple):
    """What is compared, whatever the readings."""

    predicted: OperationPredictions
    axes: tuple[int, ...]
    datum: Datum
    part: LoadedPart
    k: float


class _Sides(NamedTuple):
    """The evidence of both kinds, the tables it is of, and what is odd about these."""

    features: Evidence
    lengths: Evidence | None
    tables: MeasuredTables
    length_tables: MeasuredTables | None
    warnings: list[Finding]


def _sides(task: _Task, points: Points) -> _Sides:
    predictions, datum, k = task.predicted.predictions, task.datum, task.k
    tables, warned = _freed_tables(points, task.axes, datum)
    features = evidence(tables, predicted_features(predictions, tables.labels, task.axes, datum), k)
    long = length_tables(points, visits_of(points), task.part)
    lengths = _lengths(predictions, task.part, long, None if datum != "none" else features, k)
    return _Sides(features, lengths, tables, long, warned)


def _freed_tables(
    points: Points, axes: tuple[int, ...], datum: Datum
) -> tuple[MeasuredTables, list[Finding]]:
    """The tables of axes that the machine has an equation for, less the datum's freedoms."""
    loose, complete = freed(points, axes, datum)
    tables, names = feature_tables(loose), {AXES[k] for k in axes}
    warned = [] if complete else [incomplete_datum()]
    return tables.only([i for i, label in enumerate(tables.labels) if label[2] in names]), warned


def _lengths(
    predictions: Mapping[str, Prediction],
    part: LoadedPart,
    tables: MeasuredTables | None,
    holes: Evidence | None,
    k: float,
) -> Evidence | None:
    if tables is None:
        return None
    return evidence(tables, predicted_lengths(predictions, tables.labels, part, holes), k)


def _shared_axes(model: MachineModel, points: Points) -> tuple[int, ...]:
    """The axes (0, 1, 2) that were measured and that the machine has an equation for."""
    measured = axes_of(points)
    axes = tuple(i for i in measured if AXES[i] in model.axes)
    if not axes:
        raise no_shared_axis(model, points, measured)
    return axes
