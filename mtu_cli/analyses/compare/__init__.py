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
    Foreseen,
    foretold_features,
    foretold_lengths,
    predict_operations,
)
from mtu_cli.analyses.compare.summary import Range, Summary, Undecided, summarised
from mtu_cli.analyses.compare.verdicts import (
    FAMILY_RATE,
    VERDICTS,
    AllAtOnce,
    Compared,
    Verdict,
    judged,
)
from mtu_cli.analyses.compare.warnings import compare_warnings
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, error, finding
from mtu_cli.model.datum import Datum, freed
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import MeasuredTables, feature_tables, left_out, length_tables
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import axes_of, visits_of
from mtu_cli.stats.least_squares import FloatArray

__all__ = [
    "FAMILY_RATE",
    "VERDICTS",
    "AllAtOnce",
    "CompareResult",
    "Compared",
    "Evidence",
    "Range",
    "Side",
    "Summary",
    "Undecided",
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
    warnings, axes = [*points.notes, *left_out(points)], _shared_axes(model, points)
    foreseen = predict_operations(model, points, covariates or {})
    points = foreseen.points
    task = _Task(foreseen=foreseen, axes=axes, datum=datum, part=part, k=settings.coverage_factor)
    sides = _sides(task, points)
    found, others = judged(sides.features, sides.lengths)
    warnings = [*warnings, *sides.warnings, *foreseen.warnings]
    seen = np.unique(points.feature)
    return CompareResult(
        ids=tuple(points.features[i] for i in seen),
        places=visits_of(points).nominal[seen],
        features=found,
        lengths=others,
        feature_summaries=summarised(found),
        length_summaries=() if others is None else summarised(others),
        datum=datum,
        coverage_factor=task.k,
        warnings=(*warnings, *compare_warnings(model, part, points, sides.tables, found, others)),
    )


class _Task(NamedTuple):
    """What is compared, whatever the readings."""

    foreseen: Foreseen
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
    predictions, datum, k = task.foreseen.predictions, task.datum, task.k
    tables, warned = _freed_tables(points, task.axes, datum)
    features = evidence(tables, foretold_features(predictions, tables.labels, task.axes, datum), k)
    long = length_tables(points, visits_of(points), task.part)
    lengths = _lengths(predictions, task.part, long, None if datum != "none" else features, k)
    return _Sides(features, lengths, tables, long, warned)


def _freed_tables(
    points: Points, axes: tuple[int, ...], datum: Datum
) -> tuple[MeasuredTables, list[Finding]]:
    """The tables of axes that the machine has an equation for, less the datum's freedoms."""
    loose, complete = freed(points, axes, datum)
    tables, names = feature_tables(loose), {AXES[k] for k in axes}
    warned = [] if complete else [finding("incomplete-datum")]
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
    return evidence(tables, foretold_lengths(predictions, tables.labels, part, holes), k)


def _shared_axes(model: MachineModel, points: Points) -> tuple[int, ...]:
    """The axes (0, 1, 2) that were measured and that the machine has an equation for."""
    measured = axes_of(points)
    axes = tuple(i for i in measured if AXES[i] in model.axes)
    if not axes:
        wanted = " or ".join(f"{axis}_mm" for axis in model.axes)
        raise error(
            "no-shared-axis",
            machine=model.name,
            axes=model.axes,
            columns=[f"{AXES[i]}_mm" for i in measured],
            file=", ".join(source.shown for source in points.sources),
            expected=f"{wanted} with a nominal at every point",
        )
    return axes
