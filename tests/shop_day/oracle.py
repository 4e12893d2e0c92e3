"""What one could know at best who knew the noise: signal to noise, best rival, held-out gain.

Parts and holes are crossed random effects; on a full table the covariance of one axis has three
strata, part means, hole means and interaction, with the variances
SIGMA^2 + H SIG_PART^2, SIGMA^2 + P SIG_HOLE^2, SIGMA^2 of orthonormal contrasts, and the overall
mean, which is free.
"""

from dataclasses import dataclass

import numpy as np

from shop_day.day import Floats, Ints, ShopDay
from shop_day.effects import FAMILIES, effect
from shop_day.noise import SIG_HOLE, SIG_PART, SIGMA
from shop_day.rivals import margin_columns, rival_columns, rival_margins
from shop_day.truth import Truth

SCATTERS = ("rotation-scatter", "operation-scatter")
"""Families that say nothing of the mean."""
TELLABLE = 4.0
"""Least separation d of an effect that should be named."""
DEPENDENT = 1e-6
"""Columns whose part apart from the others is smaller than this are left out."""


def whitened(field: Floats, sig_hole: float = SIG_HOLE) -> Floats:
    """`field` (..., P, H, 2) um times the inverse square root of the covariance, (..., P*H*2).

    Inner products of whitened fields are those of generalised least squares with a free overall
    mean for each axis; the number of parts and holes are taken from the shape.
    """
    P, H = field.shape[-3:-1]
    mean = field.mean(axis=(-3, -2), keepdims=True)
    part = field.mean(axis=-2, keepdims=True) - mean
    hole = field.mean(axis=-3, keepdims=True) - mean
    rest = field - part - hole - mean
    found: Floats = rest / SIGMA
    found += part / np.sqrt(SIGMA**2 + H * SIG_PART**2)
    found += hole / np.sqrt(SIGMA**2 + P * sig_hole**2)
    return found.reshape(*field.shape[:-3], 2 * P * H)


@dataclass(frozen=True, kw_only=True)
class Signal:
    """`z`: norm of the whitened effect. `rival`: the family, not its own, whose columns come
    closest to it, with their R^2 `rival_r2`; `aliases`: those with R^2 > 0.999.
    `d` = z sqrt(1 - R^2).
    """

    z: float
    rival: str
    rival_r2: float
    aliases: tuple[str, ...]

    @property
    def d(self) -> float:
        return self.z * float(np.sqrt(max(0.0, 1 - self.rival_r2)))


class Rivals:
    """Orthonormal whitened columns of every family on one day.

    `margins`: the lower-order terms of products are fitted beside them and count for nothing, in
    rivals as in the effect itself.
    """

    def __init__(self, day: ShopDay, *, margins: bool = False) -> None:
        self.day, self._margins = day, margins
        self._bases: dict[str, list[Floats]] = {}
        free = rival_margins(day) if margins else {}
        for name, members in rival_columns(day).items():
            own = [whitened(stack) for stack in members]
            if name in free:
                own = [_beside(own[0], _bases(whitened(free[name])))]
            self._bases[name] = [_bases(stack) for stack in own]

    def r2(self, y: Floats) -> dict[str, float]:
        """Largest R^2 of a whitened field with a member of each family."""
        total = float(y @ y)
        return {
            name: max(float(((basis @ y) ** 2).sum(axis=1).max()) for basis in bases) / total
            for name, bases in self._bases.items()
        }

    def signal(self, truth: Truth) -> Signal | None:
        """None where the effect moves no mean."""
        y = whitened(truth.errors)
        if self._margins and (free := margins_of(self.day, truth)):
            y = _beside(y[None, None], _bases(whitened(np.concatenate(free)[None])))[0, 0]
        z = float(np.linalg.norm(y))
        if z == 0:
            return None
        found = self.r2(y)
        others = {name: r2 for name, r2 in found.items() if name != truth.name}
        rival = max(others, key=others.__getitem__)
        return Signal(
            z=z,
            rival=rival,
            rival_r2=min(1.0, others[rival]),
            aliases=tuple(name for name, r2 in others.items() if r2 > 0.999),
        )


def margins_of(day: ShopDay, truth: Truth) -> list[Floats]:
    """Columns of the lower-order terms of an effect of the library that is a product."""
    a = truth.axes[0] if truth.axes else 0
    if truth.name is None:
        return []
    if truth.family == "backlash-step":
        over = np.where(day.full("sequence") > truth.searched["at"], 1.0, 0.0)
    elif truth.covariate is None:
        return []
    else:
        over = day.full(truth.covariate)
    return margin_columns(day, truth.name, a, over)


def _beside(columns: Floats, free: Floats) -> Floats:
    """Columns (members, k, N) less their parts along orthonormal ones (members, m, N)."""
    along = np.einsum("ikn,imn->ikm", columns, free)
    left: Floats = columns - np.einsum("ikm,imn->ikn", along, free)
    size, before = (np.linalg.norm(item, axis=-1, keepdims=True) for item in (left, columns))
    return np.where(size > DEPENDENT * before, left, 0.0)


def _bases(columns: Floats) -> Floats:
    """Orthonormal bases (members, k, N) of whitened columns (members, k, N), zero where they are
    not independent.
    """
    size = np.linalg.norm(columns, axis=-1, keepdims=True)
    normed = np.divide(columns, size, out=np.zeros_like(columns), where=size > 0)
    _, values, rows = np.linalg.svd(normed, full_matrices=False)
    kept: Floats = rows * (values > DEPENDENT)[..., None]
    return kept


def oracle_gain(errors: Floats, truth: Truth, folds: int) -> tuple[float, float]:
    """Mean squares of held-out errors before and after, um^2, of who knows an effect's columns and
    the noise; `errors` (P, H, 2) um.

    As the command counts: blocks of consecutive parts are held out, nothing is taken out before;
    after, the effect and along its axes the level of the training parts.
    """
    rows, left = np.arange(len(errors)), errors.copy()
    for held in np.array_split(rows, folds):
        train = np.setdiff1d(rows, held)
        rest = (
            errors[held] - errors[train].mean(axis=(0, 1)) - _foretold(truth, errors, train, held)
        )
        for a in truth.axes:
            left[held, :, a] = rest[..., a]
    return float(np.mean(errors**2)), float(np.mean(left**2))


def _foretold(truth: Truth, errors: Floats, train: Ints, held: Ints) -> Floats | float:
    """The effect on the held-out parts as the training parts show it, by generalised least squares
    with the true variances; 0 where they show too little of it to gain by it (a warm-up in the
    first block), which takes its true size to know.
    """
    if not len(truth.columns):
        return 0.0
    columns = truth.columns / np.sqrt((truth.columns**2).sum(axis=(1, 2, 3), keepdims=True))
    # A column that the training parts do not show gets the coefficient 0 and no variance.
    inverse = np.linalg.pinv(whitened(columns[:, train]).T, rcond=DEPENDENT)
    shift, right = (_shift(fields, train, held) for fields in (columns, truth.errors[None]))
    flat = shift.reshape(len(shift), -1)
    if np.trace(inverse @ inverse.T @ flat @ flat.T) >= np.sum(right**2):
        return 0.0
    return np.einsum("k,kpha->pha", inverse @ whitened(errors[train]), shift)


def _shift(fields: Floats, train: Ints, held: Ints) -> Floats:
    """Fields (k, P, H, 2) on the held-out parts against their mean over the training parts."""
    moved: Floats = fields[:, held] - fields[:, train].mean(axis=(1, 2), keepdims=True)
    return moved


def tellable_pair(
    rivals: Rivals, rng: np.random.Generator, amplitude: float
) -> tuple[Truth, Truth]:
    """Two families at random, of those that move a mean; drawn until either could be named."""
    families = [family for family in FAMILIES if family not in SCATTERS]
    while True:
        a, b = (str(family) for family in rng.choice(families, 2, replace=False))
        one, two = (effect(rivals.day, family, rng, amplitude) for family in (a, b))
        signals = [rivals.signal(truth) for truth in (one, two)]
        if all(signal and signal.d >= TELLABLE for signal in signals):
            return one, two
