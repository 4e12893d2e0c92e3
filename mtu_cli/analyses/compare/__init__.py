"""Does the prediction hold? Predicted errors and scatter beside those of measured parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    less_pulled,
)
from mtu_cli.analyses.compare.warnings import compare_warnings
from mtu_cli.errors import Warned, fault
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.datum import Datum, freed
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import MeasuredTables, feature_tables, length_tables
from mtu_cli.model.measured_checks import sound
from mtu_cli.model.outlying_points import Outlying, farthest_off, outlying
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import axes_of, only_features, only_rows, visits_of
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
    "StandsOut",
    "Summary",
    "Undecided",
    "Verdict",
    "compare",
    "judged",
    "paper_length_variance",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class StandsOut:
    """Readings that pull the figures: of which `parts`, `texts` on what the first few of all that
    are `told` are, and what is said of all other readings (summaries as in `CompareResult`; none
    where nothing is left).

    They were chosen for being far off, by more than 1 clean study in 1000 has, so that the others
    are judged as if they were all there is; it is no verdict on all parts.
    """

    parts: tuple[str, ...]
    texts: tuple[str, ...]
    told: int
    rows: int
    feature_summaries: tuple[Summary, ...]
    length_summaries: tuple[Summary, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareResult:
    """Features and lengths, predicted against measured; nominal `places` (ids, 3) in mm.

    The summaries have one entry an operation. Verdicts are those of all readings; `stands_out`
    tells those that pull these figures, None where none does.
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
    stands_out: StandsOut | None = None


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

    Raises InputError for points that cannot be what they claim or share no axis with the
    machine, and for a missing covariate or one with gaps.
    """
    warnings, axes = sound(points, datum), _shared_axes(model, points)
    foreseen = predict_operations(model, points, covariates or {})
    given, points = points, foreseen.points
    task = _Task(foreseen=foreseen, axes=axes, datum=datum, part=part, k=settings.coverage_factor)
    sides = _sides(task, points)
    odd, off = _odd(sides, given)
    found, others = _judged(sides.features, sides.lengths, off, task.k)
    warnings = [*odd.warnings, *warnings, *sides.warnings, *foreseen.warnings]
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
        stands_out=_stands_out(task, points, odd) if odd.parts else None,
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


def _stands_out(task: _Task, points: Points, odd: Outlying) -> StandsOut:
    """The same of all readings but those that stand out."""
    rest = np.setdiff1d(np.arange(len(points)), odd.rows)
    features: Compared | None = None
    lengths: Compared | None = None
    if len(rest):
        left = only_rows(points, rest)
        # A feature that was measured on no other part is none of what is left.
        names = [left.features[i] for i in np.unique(left.feature)]
        sides = _sides(task, only_features(left, names))
        features, lengths = judged(sides.features, sides.lengths)
    return StandsOut(
        parts=odd.parts,
        texts=odd.texts,
        told=odd.told,
        rows=len(odd.rows),
        feature_summaries=() if features is None else summarised(features),
        length_summaries=() if lengths is None else summarised(lengths),
    )


def _freed_tables(
    points: Points, axes: tuple[int, ...], datum: Datum
) -> tuple[MeasuredTables, list[Finding]]:
    """The tables of axes that the machine has an equation for, less the datum's freedoms."""
    loose, complete = freed(points, axes, datum)
    tables, names = feature_tables(loose), {AXES[k] for k in axes}
    text = (
        "parts with missing features were freed with the features they have; the prediction is "
        "freed with all"
    )
    warned = [] if complete else [Warned(code="incomplete-datum", message=text)]
    return tables.only([i for i, label in enumerate(tables.labels) if label[2] in names]), warned


def _odd(sides: _Sides, points: Points) -> tuple[Outlying, list[FloatArray]]:
    """What stands out among the features and, where anything does, how far in the tables of both
    kinds.
    """
    odd, kinds = outlying(sides.tables, points), (sides.tables, sides.length_tables)
    return odd, [farthest_off(x, points) for x in kinds if x is not None and odd.parts]


def _judged(
    features: Evidence, lengths: Evidence | None, off: Sequence[FloatArray], k: float
) -> tuple[Compared, Compared | None]:
    """The verdicts; `off` (items,) of both kinds, mm, by how much single readings stand out, or
    nothing where none does.
    """
    found, others = judged(features, lengths)
    if not off:
        return found, others
    return less_pulled(found, off[0], k), others and less_pulled(others, off[1], k)


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
        have = ", ".join(f"{AXES[i]}_mm" for i in measured)
        raise fault(
            f"the machine {model.name!r} has equations for {', '.join(model.axes)} alone, the "
            f"points have {have}: there is nothing to compare",
            file=", ".join(source.shown for source in points.sources),
            expected=f"{wanted} with a nominal at every point",
        )
    return axes
