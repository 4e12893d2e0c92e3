"""What a user chooses of close-loop: the option over the study over the default."""

from __future__ import annotations

from dataclasses import dataclass

from mtu_cli.cli.load import Inputs
from mtu_cli.model.visits import Datum

ALPHA = 0.05
MAX_EFFECTS = 4
UNEXPLAINED = "unexplained"


@dataclass(frozen=True, slots=True, kw_only=True)
class Choices:
    """`alpha` family-wise rate of false alarms."""

    alpha: float
    max_effects: int
    datum: Datum
    exclude: tuple[str, ...]


def read_choices(inputs: Inputs) -> Choices:
    """Raises InputError for every choice that is out of range, at once."""
    chosen = inputs.chosen
    return Choices(
        alpha=ALPHA if chosen.alpha is None else chosen.alpha,
        max_effects=MAX_EFFECTS if chosen.max_effects is None else chosen.max_effects,
        datum=chosen.datum or "none",
        exclude=tuple(dict.fromkeys(inputs.options.exclude or ())),
    )
