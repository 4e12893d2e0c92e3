"""Does the prediction hold? Predicted errors and scatter beside those of measured parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.compare.evidence import (
    Evidence,
    Side,
    evidence,
    paper_length_variance,
)
from mtu_cli.analyses.compare.operations import (
    foretold_features,
    foretold_lengths,
    predict_operations,
)
from mtu_cli.analyses.compare.summary import Range, Summary, Undecided, summarised
from mtu_cli.analyses.compare.verdicts import (
    FAMILY_RATE,
    VERDICTS,
    Compared,
    Verdict,
    judged,
    less_pulled,
)
from mtu_cli.analyses.compare.warnings import compare_warnings
from mtu_cli.errors import fault
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.model.datum import Datum, freed
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.measured import MeasuredTables, feature_tables, length_tables
from mtu_cli.model.measured_checks import sound
from mtu_cli.model.outlying_points import Outlying, farthest_off, outlying
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings, Warned
from mtu_cli.model.visits import axes_of, visits_of
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
    "Undecided",
    "Verdict",
    "compare",
    "judged",
    "paper_length_variance",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareResult:
    """Features and lengths, predicted against measured; nominal `places` (ids, 3) in mm.

    The summaries have one entry an operation; `stands_out` names the parts of which single readings
    pull these figures (a warning names the readings).
    """

    ids: tuple[str, ...]
    places: FloatArray
    features: Compared
    lengths: Compared | None
    feature_summaries: tuple[Summary, ...]
    length_summaries: tuple[Summary, ...]
    datum: Datum
    coverage_factor: float
    warnings: tuple[Warned, ...]
    stands_out: tuple[str, ...] = ()


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
    (`Evidence`), as one family (Holm, 5 %): of clean studies one in twenty is no "consistent".

    Raises InputError for points that cannot be what they claim or share no axis with the
    machine, and for a missing covariate or one with gaps.
    """
    warnings, axes = sound(points, datum), _shared_axes(model, points)
    foreseen = predict_operations(model, points, covariates or {})
    predictions, given, points = foreseen.predictions, points, foreseen.points
    tables, more = _freed_tables(points, axes, datum)
    k, seen = settings.coverage_factor, np.unique(points.feature)
    features = evidence(tables, foretold_features(predictions, tables.labels, axes, datum), k)
    long = length_tables(points, visits := visits_of(points), part)
    lengths = _lengths(predictions, part, long, None if datum != "none" else features, k)
    odd, off = _odd(tables, long, given)
    found, others = _judged(features, lengths, off, k)
    warnings += [*more, *foreseen.warnings, *odd.warnings]
    return CompareResult(
        ids=tuple(points.features[i] for i in seen),
        places=visits.nominal[seen],
        features=found,
        lengths=others,
        feature_summaries=summarised(found),
        length_summaries=() if others is None else summarised(others),
        datum=datum,
        coverage_factor=k,
        warnings=(*warnings, *compare_warnings(model, part, points, tables, found, others)),
        stands_out=odd.parts,
    )


def _freed_tables(
    points: Points, axes: tuple[int, ...], datum: Datum
) -> tuple[MeasuredTables, list[Warned]]:
    """The tables of axes that the machine has an equation for, less the datum's freedoms."""
    loose, complete = freed(points, axes, datum)
    tables, names = feature_tables(loose), {AXES[k] for k in axes}
    text = (
        "parts with missing features were freed with the features they have; the prediction is "
        "freed with all"
    )
    warned = [] if complete else [Warned(code="incomplete-datum", message=text)]
    return tables.only([i for i, label in enumerate(tables.labels) if label[2] in names]), warned


def _odd(
    features: MeasuredTables, lengths: MeasuredTables | None, points: Points
) -> tuple[Outlying, list[FloatArray]]:
    """What stands out among the features and, where anything does, how far in the tables of both
    kinds.
    """
    odd, kinds = outlying(features, points), (features, lengths)
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
