"""Findings of the loop whose sentence is written where they are made, not in the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mtu_cli.catalogue import Kind
from mtu_cli.findings import Finding

FAULT = "fault"


@dataclass(frozen=True, kw_only=True)
class Worded(Finding):
    """A finding of which `facts` hold nothing but its ``message``."""

    __hash__ = Finding.__hash__

    @property
    def kind(self) -> Kind:
        """An error under the code FAULT, a warning under any other."""
        return Kind("error" if self.code == FAULT else "warning", "{message}")

    @property
    def text(self) -> str:
        """The sentence, uncut."""
        return str(self.facts["message"])

    def to_dict(self) -> dict[str, Any]:
        """As reports list it, without facts."""
        return {**super().to_dict(), "facts": {}}


def loop_warning(code: str, message: str) -> Finding:
    """A warning of the loop in its own words."""
    return Worded(code=code, facts={"message": message})


def loop_fault(message: str, **place: Any) -> Finding:
    """An error of the loop in its own words."""
    return Worded(code=FAULT, facts={"message": message}, **place)


def as_listed(entry: Mapping[str, Any]) -> Finding:
    """A warning that a report lists, to be listed again."""
    return loop_warning(str(entry.get("code")), str(entry.get("message")))
