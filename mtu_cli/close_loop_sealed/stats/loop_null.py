"""What the errors of a table are when nothing is missing in the model: fitted and drawn.

    Y_pha = part effect + smooth directions of the part + column effect + model's own error + e

per axis a: the part's offset and smooth directions have one covariance T over axes and
directions, the columns a variance of their own, e the variance of the interaction; the model's
coefficients are uncertain along directions that they share with the columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.stats.as_if_complete import as_if_complete
from mtu_cli.close_loop_sealed.stats.estimated_scatter import scattered
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.mean_squares import MeanSquares, mean_squares
from mtu_cli.close_loop_sealed.stats.strata import Strata, Stratum
from mtu_cli.stats.least_squares import FloatArray

TRUST = 3.0
"""Degrees of freedom that the predicted scatter of parts counts for beside the measured one."""
FEWEST = 4
"""Columns beyond the smooth directions that tell their scatter by themselves."""
FEW_PARTS = 10
"""Up to so many parts the machine's own prediction of their scatter counts beside it."""

WHITENED = 1e-13
"""Share of the smooth part of a covariance below which the rest is rounding of it."""
ROUNDING = 1e-20
"""Share of the largest variance that is rounding of it (of the errors, 1e-10)."""


@dataclass(frozen=True, slots=True)
class KnownScatter:
    """What the model says of itself: `part` the covariance of a part's coordinates, `common` the
    factor of the coefficients' covariance in them, `dof` the degrees of freedom that both were
    estimated with. `least` is the variance of one entry by rounding, by axis (or of all of them).
    """

    part: FloatArray
    common: FloatArray
    dof: float
    least: FloatArray | float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class NullModel:
    """`interaction`, `column`, `reversal` (A,) variances of one entry of the table, of a column
    effect, and of what differs between the two directions of approach of a column;
    `part` ((1 + k) A,) x2 the covariance of the part's coordinates, offset first, then the k
    smooth directions, axis by axis; `with_noise` the same with the noise of an entry in it, as
    estimated with `part_dof` degrees of freedom, also where it is less than that noise;
    `predicted_part` what the model says of it; `common` (A (1 + k), K) the factor of the
    coefficients' covariance along them, times P; `model_dof` the degrees of freedom that the
    model's own figures were estimated with.
    """

    interaction: FloatArray
    column: FloatArray
    reversal: FloatArray
    part: FloatArray
    with_noise: FloatArray
    part_dof: float
    common: FloatArray
    predicted_part: FloatArray
    model_dof: float

    def as_estimated(self) -> NullModel:
        """The same with the scatter of parts taken for known: for second moments of what is drawn,
        which the tails of an estimate do not have.
        """
        return replace(self, part_dof=np.inf)

    def of_columns(self, kind: str, axis: int) -> float:
        """Variance of a column effect in a stratum of kind column or reversal."""
        return float((self.column if kind == "column" else self.reversal)[axis])


def null_of(frame: Frame, y: FloatArray, dof: FloatArray, known: KnownScatter) -> NullModel:
    """Fits the null to coordinates `y` (N,).

    In an incomplete table the mean squares are biased by the filling: they are brought to what
    the same components would give in a complete one.
    """
    strata = frame.strata
    found = mean_squares(strata, y[None], dof)
    if not frame.completion.complete or frame.freeing is not None:
        found = as_if_complete(frame, found, dof, known.part, known.common)
    return _components(strata, found, known, _told(frame))


def _told(frame: Frame) -> int:
    """How many parts tell their lines along the smooth directions."""
    rows = frame.completion.rows
    if frame.completion.complete or rows.shape[1] == 1:
        return len(rows)
    return int(rows[:, 1:, 1:].any(axis=(1, 2)).sum())


def _components(strata: Strata, squares: MeanSquares, known: KnownScatter, told: int) -> NullModel:
    """The components that mean squares tell, the scatter of parts by `told` of them."""
    P = strata.shape[0]
    k = strata.lines
    interaction = np.where(np.isfinite(squares.interaction), squares.interaction, 0.0)
    if P == 1:
        # One part: its entries scatter as the columns do, and no two can be told apart.
        interaction = np.where(np.isfinite(squares.rest), squares.rest, 0.0)
    interaction = np.maximum(interaction, known.least)
    noise = np.repeat(interaction, 1 + k)
    excess, part_dof = known.part, known.dof
    if P > 1:
        excess, part_dof = squares.part - np.diag(noise), max(told - 1.0, 1.0)
        if known.part.any() and P <= FEW_PARTS:
            trust = min(TRUST, known.dof)
            excess = ((P - 1) * excess + trust * known.part) / (P - 1 + trust)
            part_dof += trust
    return NullModel(
        interaction=interaction,
        column=_column_variance(strata, squares.rest, interaction, "column"),
        reversal=_column_variance(strata, squares.turned, interaction, "reversal"),
        part=_psd(excess, noise),
        with_noise=excess + np.diag(noise),
        part_dof=part_dof,
        common=known.common,
        predicted_part=known.part,
        model_dof=known.dof,
    )


def _column_variance(
    strata: Strata, square: FloatArray, interaction: FloatArray, kind: str
) -> FloatArray:
    """Variance (A,) of column effects from their mean square, which few columns tell badly."""
    P = strata.shape[0]
    if P == 1 and kind == "column":
        return np.zeros(len(interaction))
    beyond = min((s.size - len(s.lead) for s in strata.all if s.kind == kind), default=0)
    known = np.where(np.isfinite(square), square, interaction)
    weight = min(beyond, FEWEST) / FEWEST
    blended = weight * known + (1 - weight) * interaction
    found: FloatArray = np.maximum(blended - interaction, 0.0) / P
    return found


def _psd(excess: FloatArray, noise: FloatArray) -> FloatArray:
    """The positive part, relative to the noise of each coordinate."""
    # An axis without errors has rounding of the others: beside nothing it would be everything.
    least = ROUNDING * float(np.abs(np.diag(excess)).max(initial=0.0))
    scale = np.sqrt(np.maximum(noise, max(least, 1e-300)))
    values, vectors = np.linalg.eigh(excess / np.outer(scale, scale))
    found: FloatArray = (vectors * np.maximum(values, 0.0)) @ vectors.T
    scaled: FloatArray = found * np.outer(scale, scale)
    return scaled


def whitening_of(strata: Strata, model: NullModel) -> FloatArray:
    """(A, k, k): makes the column coordinates along the smooth directions as uncertain as the
    others, axis by axis; what the axes have in common is left to the drawn null.
    """
    P, _, A = strata.shape
    k = strata.lines
    found = np.broadcast_to(np.eye(k), (A, k, k)).copy()
    C = model.common @ model.common.T
    for stratum in strata.all:
        a, lead = stratum.axis, np.array(stratum.lead, int)
        level = model.interaction[a]
        if not len(lead) or level <= 0:
            continue
        level = level + P * model.of_columns(stratum.kind, a)
        own = np.ix_(a * (1 + k) + lead, a * (1 + k) + lead)
        smooth = model.part[own] + C[own]
        level = max(level, WHITENED * float(np.trace(smooth)))
        total = level * np.eye(len(lead)) + smooth
        found[a][np.ix_(lead - 1, lead - 1)] = np.linalg.inv(np.linalg.cholesky(total / level))
    return found


def draw(
    frame: Frame, model: NullModel, samples: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Coordinates (samples, N) and grand means (samples, A) of tables of the null."""
    strata = frame.strata
    P, H, A = strata.shape
    k = strata.lines
    # Along the smooth directions a coordinate is one draw a part; the last one is of their mean.
    parts = rng.standard_normal((samples, P, A * (1 + k))) @ _root(model.part).T
    common = rng.standard_normal((samples, model.common.shape[1])) @ model.common.T
    if np.isfinite(model.model_dof):
        # The coefficients' covariance is an estimate: their errors follow Student's t.
        common *= np.sqrt(model.model_dof / rng.chisquare(model.model_dof, samples))[:, None]
    parts = parts.reshape(samples, P, A, 1 + k)
    common = common.reshape(samples, A, 1 + k)
    y = rng.standard_normal((samples, strata.size))
    # A stream of its own: what scatter is not known moves no other draw.
    (of_scatter,) = rng.spawn(1)
    grand = rng.standard_normal((samples, A)) * np.sqrt(model.interaction + P * model.column)
    grand += parts[:, -1, :, 0] + common[:, :, 0]
    for stratum in strata.all:
        a, own = stratum.axis, y[:, stratum.slice]
        if stratum.kind in ("column", "reversal"):
            lead, variance = list(stratum.lead), P * model.of_columns(stratum.kind, a)
            own[:, len(lead) :] *= np.sqrt(model.interaction[a] + variance)
            of_parts = np.sqrt(model.interaction[a]) * own[:, : len(lead)] + parts[:, -1, a, lead]
            of_columns = np.sqrt(variance) * of_scatter.standard_normal(of_parts.shape)
            own[:, : len(lead)] = of_columns + common[:, a, lead]
            own[:, : len(lead)] += _about_the_truth(model, stratum, k, of_parts, of_scatter)
        else:
            own *= np.sqrt(model.interaction[a])
        if stratum.kind in ("part", "line"):
            own += parts[:, : P - 1, a, stratum.line]
    grand /= np.sqrt(P * H)
    if frame.completion.complete and frame.freeing is None:
        return y, grand
    tables = strata.tables(y) + grand[:, None, None, :]
    return frame.coordinates(tables)


def _about_the_truth(
    model: NullModel, stratum: Stratum, k: int, of_parts: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """`of_parts` (B, b), drawn with the estimated scatter of parts, as it does about the true."""
    noise = model.interaction[stratum.axis]
    if not stratum.lead or noise <= 0 or not np.isfinite(model.part_dof):
        return of_parts
    place = stratum.axis * (1 + k) + np.array(stratum.lead, int)
    S = model.with_noise[np.ix_(place, place)] / noise
    return scattered(of_parts, S, model.part_dof, rng)


def _root(covariance: FloatArray) -> FloatArray:
    """The symmetric root: that of eigenvectors alone hangs on signs that rounding gives them."""
    values, vectors = np.linalg.eigh(covariance)
    found: FloatArray = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return found


def entry_variance(null: NullModel, strata: Strata) -> FloatArray:
    """Variance (A,) of one entry: interaction, column, and the mean share of part and model."""
    P, H, A = strata.shape
    k = strata.lines
    # The coefficients' factor is that of the sum over the parts: one part has 1/P of its square.
    both = np.diag(null.part) + (null.common**2).sum(axis=1) / P
    smooth = both.reshape(A, 1 + k).sum(axis=1)
    turned = null.reversal * len(strata.odd) / H
    found: FloatArray = null.interaction + null.column + turned + smooth / H
    return found
