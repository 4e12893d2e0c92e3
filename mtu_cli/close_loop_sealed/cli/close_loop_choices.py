"""What a user chooses of close-loop: the option over the study over the default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mtu_cli.cli.gates import given_gates, unknown_gates
from mtu_cli.cli.inputs import Inputs
from mtu_cli.findings import InputError, finding
from mtu_cli.model.datum import Datum

if TYPE_CHECKING:
    from mtu_cli.close_loop_sealed.analyses.loop import CloseLoopResult

ALPHA = 0.05
MAX_EFFECTS = 4
FOUND, UNEXPLAINED = "found", "unexplained"
GATES = (FOUND, UNEXPLAINED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Choices:
    """`alpha` family-wise rate of false alarms, `gates` of `--fail-if`."""

    alpha: float
    max_effects: int
    datum: Datum
    exclude: tuple[str, ...]
    gates: tuple[str, ...]

    def are_met_by(self, result: CloseLoopResult) -> bool:
        """Whether a gate is: undeclared effects, named or not, meet `found`, but for what is no
        more than a hint; a remainder without a name meets both.
        """
        met = {FOUND: result.is_found, UNEXPLAINED: result.verdict == UNEXPLAINED}
        return any(met[gate] for gate in self.gates)


def read_choices(inputs: Inputs) -> Choices:
    """Raises InputError for every choice that is out of range, at once."""
    alpha = float(_given(inputs, "alpha", ALPHA))
    max_effects = int(_given(inputs, "max_effects", MAX_EFFECTS))
    gates = given_gates(inputs.options.fail_if)
    problems = []
    if not 0 < alpha < 1:
        problems.append(
            finding(
                "out-of-range", path="--alpha", value=str(alpha), expected="a rate between 0 and 1"
            )
        )
    if max_effects < 1:
        problems.append(
            finding(
                "out-of-range", path="--max-effects", value=str(max_effects), expected="1 or more"
            )
        )
    problems += unknown_gates(gates, GATES.__contains__, lambda _: " or ".join(GATES))
    if problems:
        raise InputError(problems)
    return Choices(
        alpha=alpha,
        max_effects=max_effects,
        datum=inputs.datum,
        exclude=tuple(dict.fromkeys(inputs.options.exclude or ())),
        gates=tuple(gates),
    )


def _given(inputs: Inputs, name: str, default: Any) -> Any:
    value = inputs.options.values.get(name)
    if value is None and inputs.study is not None:
        value = getattr(inputs.study.study.settings, name)
    return default if value is None else value
