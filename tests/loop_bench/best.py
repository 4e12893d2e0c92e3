"""The share of the oracle's held-out gain that can be had.

Who knows the noise, the four sizes that effects have in the bench, that there is one, and whether
it lies in whole parts, but not which it is, nor its size, its axis, its sign, its time constant
or its part, foretells best by the posterior mean under the distribution that effects are drawn
from: of all estimators it has the least mean square on the average over the four sizes (Lehmann
and Casella, Theory of Point Estimation, 1998, ch. 4). Effects that lie elsewhere are told as the
oracle tells them. All of that is more than the engine knows.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from shop_day import ShopDay, Truth, blocks, effect, measure
from shop_day.day import Floats, Ints
from shop_day.effects import TAU_MIN
from shop_day.oracle import whitened
from shop_day.truth import Shape, column, scaled

from loop_bench.cells import CELLS, Cell, Record
from loop_bench.days import FOLDS

WHOLE_PARTS = ("thermal-drift", "trend", "warm-up", "step")
"""Families of effects that all features of a part share."""
TIME_CONSTANTS = 41
"""Values that stand for the log-uniform distribution: 5 % apart."""


@dataclass(frozen=True, kw_only=True)
class Meant:
    """Effects (M, P, H, 2) um of one sign, with their probabilities (M,) beforehand."""

    errors: Floats
    prior: Floats


def meant(day: ShopDay, amplitudes: Sequence[float]) -> Meant:
    """All effects of whole parts that a day may have, at one of these amplitudes."""
    found = [
        (truth.errors, 1 / (len(WHOLE_PARTS) * 2 * len(amplitudes) * len(own)))
        for family in WHOLE_PARTS
        for axis in range(2)
        for amplitude in amplitudes
        for own in [list(_of_family(day, family, axis, amplitude))]
        for truth in own
    ]
    errors, prior = zip(*found, strict=True)
    return Meant(errors=np.array(errors), prior=np.array(prior))


def _of_family(day: ShopDay, family: str, axis: int, amplitude: float) -> Iterator[Truth]:
    for searched, values in _values(day, family):
        shape = Shape(
            name=None, columns=column(day, axis, values), weights=np.ones(1), searched=searched
        )
        yield scaled(family, shape, amplitude, 1.0)


def _values(day: ShopDay, family: str) -> Iterator[tuple[dict[str, float], Floats]]:
    if family == "warm-up":
        middle = (np.arange(TIME_CONSTANTS) + 0.5) / TIME_CONSTANTS
        low, high = TAU_MIN
        for tau in (low * (high / low) ** middle).tolist():
            yield {"tau_min": tau}, 1 - np.exp(-day.full("time_min") / tau)
    elif family == "step":
        for part in range(6, day.P - 3):
            at = part - 0.5
            yield {"at": at}, np.where(day.full("sequence") > at, 1.0, 0.0)
    elif family == "trend":
        yield {}, day.full("tool_parts")
    else:
        yield {}, np.broadcast_to(day.spindle_rise[:, None], (day.P, day.H))


def after(errors: Floats, known: Meant, splits: Iterable[tuple[Ints, Ints]]) -> float:
    """Mean square, um^2, of held-out parts' errors (against the training parts' mean, as the
    oracle counts) less the posterior mean of the effect.
    """
    total = 0.0
    for train, held in splits:
        X, y = whitened(known.errors[:, train]), whitened(errors[train])
        plain = np.log(known.prior) - 0.5 * np.einsum("mn,mn->m", X, X)
        score = np.concatenate([plain + X @ y, plain - X @ y])
        weight = np.exp(score - score.max())
        weight /= weight.sum()
        signed = weight[: len(X)] - weight[len(X) :]
        moved = known.errors[:, held] - known.errors[:, train].mean(axis=(1, 2), keepdims=True)
        rest = errors[held] - errors[train].mean(axis=(0, 1))
        total += float(np.sum((rest - np.tensordot(signed, moved, axes=1)) ** 2))
    return total / errors.size


def with_best(cell: Cell, kind: str, base: int, records: Iterable[Record]) -> list[Record]:
    """The records of a library cell, each with `best_blocks`: what can be had of it."""
    amplitudes = [own.amplitude for own in CELLS if own.measure == "library"]
    days: dict[int, tuple[ShopDay, Meant]] = {}
    found = []
    for record in records:
        if "oracle_blocks" not in record:
            found.append(record)
            continue
        best = record["oracle_blocks"]
        if record["families"][0] in WHOLE_PARTS:
            if record["day"] not in days:
                day = ShopDay("A" if kind == "A" else "B", seed=record["day"])
                days[record["day"]] = day, meant(day, amplitudes)
            day, known = days[record["day"]]
            best = after(_errors(cell, day, base, record["index"]), known, blocks(day.P, FOLDS))
        found.append(record | {"best_blocks": best})
    return found


def _errors(cell: Cell, day: ShopDay, base: int, index: int) -> Floats:
    """The data set again, as `cells.record` drew it."""
    rng = np.random.default_rng([base, zlib.crc32(cell.name.encode()), ord(day.kind), index])
    family = cell.families[index % len(cell.families)]
    return measure(day, rng, (effect(day, family, rng, cell.amplitude),), cell.noise)
