"""Every finding that the house can make: its code, severity and sentence.

Names in braces are the facts of a finding. File, row, column, value and expectation are put
around the sentence by `Finding.message`. What a code means, why it matters and what to do stands
in ``help/findings.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of finding; a `suspicious` one is of the checks and meets --fail-if suspicious."""

    severity: Severity
    template: str
    suspicious: bool = False


def _error(template: str, suspicious: bool = False) -> Kind:
    return Kind("error", template, suspicious)


def _warning(template: str, suspicious: bool = False) -> Kind:
    return Kind("warning", template, suspicious)


def _note(template: str) -> Kind:
    return Kind("note", template)


CATALOGUE: dict[str, Kind] = {
    # Files and cells.
    "no-such-file": _error("no such file"),
    "not-readable": _error("cannot be read: {reason}"),
    "not-text": _error("not UTF-8 text: {reason}"),
    "not-a-number": _error("not a number"),
    "not-finite": _error("not a finite number"),
    "empty-cell": _error("empty cell"),
    # The machine.
    "unused-component": _warning("the component '{component}' is in no equation"),
}
