"""The gates of `--fail-if`: one or several with commas between them."""

from __future__ import annotations

from collections.abc import Sequence

from mtu_cli.errors import fault


def gates_of(given: str | None, known: Sequence[str]) -> tuple[str, ...]:
    """The gates that are asked for, of those that a command knows.

    Raises InputError for the first that it does not.
    """
    gates = () if given is None else tuple(name.strip() for name in given.split(","))
    for gate in gates:
        if gate not in known:
            several = f", or both: --fail-if {','.join(known)}" if len(known) > 1 else ""
            raise fault("unknown gate", value=gate, expected=f"{' or '.join(known)}{several}")
    return gates
