"""A simulator of shop days with known undeclared effects, written apart from the package.

day = ShopDay("A", seed=3)
truth = effect(day, "backlash", rng, 1.0)
errors = measure(day, rng, [truth])             # (P, H, 2) um
z_and_d = Rivals(day).signal(truth)
before_and_after = oracle_gain(errors, truth, folds=7)
write_csv(day, measure_repeats(day, rng, [truth]), path)
"""

from shop_day.day import ShopDay
from shop_day.effects import FAMILIES, effect
from shop_day.files import write_csv, write_machine, write_part
from shop_day.noise import NOISES, Noise, measure, measure_repeats
from shop_day.oracle import Rivals, oracle_gain, whitened
from shop_day.outside import MISSHAPEN, OUTSIDE, misshapen_effect, outside_effect
from shop_day.truth import Truth

__all__ = [
    "FAMILIES", "MISSHAPEN", "NOISES", "OUTSIDE", "Noise", "Rivals", "ShopDay", "Truth", "effect",
    "measure", "measure_repeats", "misshapen_effect", "oracle_gain", "outside_effect", "whitened",
    "write_csv", "write_machine", "write_part",
]  # fmt: skip
