"""A simulator of shop days with known undeclared effects, written apart from the package.

day = ShopDay("A", seed=3)
truth = effect(day, "backlash", rng, 1.0)
errors = measure(day, rng, [truth])             # (P, H, 2) um
z_and_d = Rivals(day).signal(truth)
at_best = oracle_held_out(errors, [truth])
write_csv(day, measure_repeats(day, rng, [truth]), path)
"""

from __future__ import annotations

from shop_day.day import ShopDay
from shop_day.effects import FAMILIES, ONE_AXIS, effect
from shop_day.files import write_csv
from shop_day.machine import geometric_errors, predicted_errors, write_machine, write_part
from shop_day.noise import (
    NOISES,
    REPEATS,
    SIGMA,
    Noise,
    measure,
    measure_repeats,
    named_by_noise,
)
from shop_day.oracle import (
    HeldOut,
    Rivals,
    Signal,
    blocks,
    interleaved,
    oracle_gain,
    oracle_held_out,
    whitened,
)
from shop_day.outside import MISSHAPEN, OUTSIDE, misshapen_effect, outside_effect
from shop_day.truth import Truth

__all__ = [
    "FAMILIES", "MISSHAPEN", "NOISES", "ONE_AXIS", "OUTSIDE", "REPEATS", "SIGMA", "HeldOut",
    "Noise", "Rivals", "ShopDay", "Signal", "Truth", "blocks", "effect", "geometric_errors",
    "interleaved", "measure", "measure_repeats", "misshapen_effect", "named_by_noise",
    "oracle_gain", "oracle_held_out",
    "outside_effect", "predicted_errors", "whitened", "write_csv", "write_machine", "write_part",
]  # fmt: skip
