"""The gates of `--fail-if`, one or several with commas between them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from mtu_cli.cli.parameters import SUSPICIOUS
from mtu_cli.findings import Finding, InputError, counted, finding, listed

OWNERS = {
    "drift": "fit-components",
    "nonconforming": "lengths",
    "unusual": "anova",
    "biased": "compare",
    "under-predicted": "compare",
    "found": "close-loop",
    "unexplained": "close-loop",
}
"""The command of each gate: a step that is copied within a script brings another's along."""


def read_gates(given: str | None, known: Callable[[str], bool], expected: str) -> list[str]:
    """The gates asked for, each once.

    Raises InputError with each of them that is not `known`, and not with those beside it.
    """
    gates = given_gates(given)
    unknown = unknown_gates(gates, known, lambda _: expected)
    if unknown:
        raise InputError(unknown)
    return gates


def given_gates(given: str | None) -> list[str]:
    """The names between the commas, each once, but for SUSPICIOUS, which all commands have; an
    empty one, of a script's variable that is not set, is a name too.
    """
    names = [] if given is None else [name.strip() for name in given.split(",")]
    return [name for name in dict.fromkeys(names) if name != SUSPICIOUS]


def suspicious(given: str | None, warnings: Iterable[Finding]) -> str | None:
    """Why the gate SUSPICIOUS is met, if it was asked for: the codes of the checks' warnings."""
    if given is None or SUSPICIOUS not in map(str.strip, given.split(",")):
        return None
    codes = [each.code for each in warnings if each.kind.suspicious]
    return f"{counted(len(codes), 'warning')} of the checks ({listed(codes)})" if codes else None


def unknown_gates(
    gates: Iterable[str], known: Callable[[str], bool], expected: Callable[[str], str]
) -> list[Finding]:
    """The Finding of each that is not `known`, with the command that has it, if one does."""
    return [
        finding(
            "unknown-name", what="gate", value=gate, expected=expected(gate) + _of_another(gate)
        )
        for gate in gates
        if not known(gate)
    ]


def _of_another(gate: str) -> str:
    name = gate.partition("=")[0]
    return f"; {name} is a gate of mtu {OWNERS[name]}" if name in OWNERS else ""
