"""The gates of `--fail-if`, one or several with commas between them."""

from __future__ import annotations

from collections.abc import Callable

from mtu_cli.errors import InputError, Problem


def read_gates(given: str | None, known: Callable[[str], bool], expected: str) -> list[str]:
    """The gates asked for, each once.

    Raises InputError with each of them that is not `known`, and not with those beside it.
    """
    gates = [] if given is None else [name.strip() for name in given.split(",")]
    gates = list(dict.fromkeys(gates))
    unknown = [
        Problem(what="unknown gate", value=gate, expected=expected)
        for gate in gates
        if not known(gate)
    ]
    if unknown:
        raise InputError(unknown)
    return gates
