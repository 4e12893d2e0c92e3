"""What one could know at best who knew the noise: signal to noise, best rival, held-out gain.

Parts and holes are crossed random effects; on a full table the covariance of one axis has three
strata, part means, hole means and interaction, with the variances
SIGMA^2 + H SIG_PART^2, SIGMA^2 + P SIG_HOLE^2, SIGMA^2 of orthonormal contrasts, and the overall
mean, which is free.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from shop_day.day import Floats, Ints, ShopDay
from shop_day.effects import FAMILIES, effect
from shop_day.noise import SIG_HOLE, SIG_PART, SIGMA
from shop_day.rivals import REFERENCE_DEGC, margin_columns, rival_columns, rival_margins
from shop_day.truth import Truth

FOLDS = 3
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
    closest to it, with their R^2 `rival_r2`; `aliases`: those with R^2 > 0.999. `own_r2`: of the
    own family's columns, None where they are not listed. `d` = z sqrt(1 - R^2).
    """

    z: float
    rival: str
    rival_r2: float
    own_r2: float | None
    aliases: tuple[str, ...]

    @property
    def d(self) -> float:
        return self.z * float(np.sqrt(max(0.0, 1 - self.rival_r2)))


class Rivals:
    """Orthonormal whitened columns of every family on one day.

    Growth and squareness with temperature vanish at `zero` degC, None for the day's mean.
    `margins`: the lower-order terms of products are fitted beside them and count for nothing, in
    rivals as in the effect itself.
    """

    def __init__(
        self, day: ShopDay, zero: float | None = REFERENCE_DEGC, *, margins: bool = False
    ) -> None:
        self.day, self._margins = day, margins
        self._bases: dict[str, list[Floats]] = {}
        free = rival_margins(day) if margins else {}
        for name, members in rival_columns(day, zero).items():
            own = [whitened(stack) for stack in members]
            if name in free:
                own = [_beside(own[0], _bases(whitened(free[name])))]
            self._bases[name] = [_bases(stack) for stack in own]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._bases)

    def r2(self, field: Floats) -> dict[str, float]:
        """Largest R^2 of a field (P, H, 2) with a member of each family."""
        return self._r2(whitened(field))

    def _r2(self, y: Floats) -> dict[str, float]:
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
        found = self._r2(y)
        others = {name: r2 for name, r2 in found.items() if name != truth.name}
        rival = max(others, key=others.__getitem__)
        return Signal(
            z=z,
            rival=rival,
            rival_r2=min(1.0, others[rival]),
            own_r2=found.get(truth.name or ""),
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


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Mean squares of held-out parts' errors, um^2: `before` against the training parts' mean,
    `after` with the effect added that is fitted on them, `truth` with the true effect.
    """

    before: float
    after: float
    truth: float

    @property
    def gain(self) -> float:
        """Mean square that the effect takes away, um^2."""
        return self.before - self.after


def blocks(parts: int, folds: int = FOLDS) -> Iterator[tuple[Ints, Ints]]:
    """(training, held-out) rows: blocks of consecutive parts."""
    rows = np.arange(parts)
    for held in np.array_split(rows, folds):
        yield np.setdiff1d(rows, held), held


def interleaved(parts: int, folds: int = FOLDS) -> Iterator[tuple[Ints, Ints]]:
    """(training, held-out) rows: every `folds`-th part held out."""
    rows = np.arange(parts)
    for first in range(folds):
        held = rows[first::folds]
        yield np.setdiff1d(rows, held), held


def oracle_held_out(
    errors: Floats,
    truths: Sequence[Truth],
    splits: Iterable[tuple[Ints, Ints]] | None = None,
    *,
    always: bool = False,
) -> HeldOut:
    """The held-out gain of who knows the effects' columns, their sizes and the noise.

    `errors` (P, H, 2) um. Coefficients of all columns are fitted on the training parts by
    generalised least squares with the true variances. An effect stays out of a fold whose
    training parts show it too little to gain by it (a warm-up in the first block), which takes its
    true size to know; `always`: it is fitted in every fold, gain or loss. `splits` are blocks of
    consecutive parts if not given.
    """
    sums = np.zeros(3)
    for train, held in blocks(len(errors)) if splits is None else splits:
        used = [truth for truth in truths if len(truth.columns)]
        while used:
            fit = _Fit(used, errors, train, held)
            losing = fit.losing()
            if always or losing is None:
                break
            used = [truth for truth in used if truth is not losing]
        rest = errors[held] - errors[train].mean(axis=(0, 1))
        found = fit.predicted if used else np.zeros(rest.shape)
        right = sum((_shift(t.errors[None], train, held)[0] for t in truths), np.zeros(rest.shape))
        sums += [np.sum(rest**2), np.sum((rest - found) ** 2), np.sum((rest - right) ** 2)]
    before, after, truth = (float(value) for value in sums / errors.size)
    return HeldOut(before=before, after=after, truth=truth)


def _shift(fields: Floats, train: Ints, held: Ints) -> Floats:
    """Fields (k, P, H, 2) on the held-out parts against their mean over the training parts."""
    moved: Floats = fields[:, held] - fields[:, train].mean(axis=(1, 2), keepdims=True)
    return moved


class _Fit:
    """Effects fitted together on some parts, for the others."""

    def __init__(self, truths: list[Truth], errors: Floats, train: Ints, held: Ints) -> None:
        self.truths = truths
        stack = np.concatenate([truth.columns for truth in truths])
        self._owner = np.repeat(np.arange(len(truths)), [len(truth.columns) for truth in truths])
        size = np.sqrt((stack**2).sum(axis=(1, 2, 3)))
        stack = stack / size[:, None, None, None]
        X = whitened(stack[:, train])
        # A column that the training parts do not show gets the coefficient 0 and no variance.
        inverse = np.linalg.pinv(X.T, rcond=DEPENDENT)
        self._covariance = inverse @ inverse.T
        self._shift = _shift(stack, train, held)
        fitted = inverse @ whitened(errors[train])
        self.predicted: Floats = np.einsum("k,kpha->pha", fitted, self._shift)
        self._right = [_shift(truth.errors[None], train, held)[0] for truth in truths]

    def losing(self) -> Truth | None:
        """The effect whose fit is expected to cost the held-out parts most, if any does."""
        costs = []
        for i, right in enumerate(self._right):
            own = self._owner == i
            shift = self._shift[own].reshape(own.sum(), -1)
            noise = np.trace(self._covariance[np.ix_(own, own)] @ shift @ shift.T)
            costs.append(float(noise - np.sum(right**2)))
        worst = int(np.argmax(costs))
        return self.truths[worst] if costs[worst] >= 0 else None


def oracle_gain(errors: Floats, truth: Truth, folds: int) -> tuple[float, float]:
    """Mean squares of held-out errors before and after, um^2, as the command counts: nothing is
    taken out before; after, the effect and along its axes the level of the training parts.
    """
    still = [a for a in range(2) if a not in truth.axes]
    with_levels = oracle_held_out(errors, [truth], blocks(len(errors), folds))
    less_level = sum(
        float(np.sum((errors[held] - errors[train].mean(axis=(0, 1)))[..., still] ** 2))
        for train, held in blocks(len(errors), folds)
    )
    as_is = float(np.sum(errors[..., still] ** 2))
    after = with_levels.after + (as_is - less_level) / errors.size
    return float(np.mean(errors**2)), after


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
