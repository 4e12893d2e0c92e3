"""The old names of findings, until every room makes them by their codes."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from mtu_cli.catalogue import CATALOGUE, Kind
from mtu_cli.findings import (
    EXIT_GATE as EXIT_GATE,
)
from mtu_cli.findings import (
    EXIT_INPUT as EXIT_INPUT,
)
from mtu_cli.findings import (
    Finding,
)
from mtu_cli.findings import (
    InputError as InputError,
)
from mtu_cli.findings import (
    MtuError as MtuError,
)
from mtu_cli.findings import (
    closest as closest,
)
from mtu_cli.findings import (
    counted as counted,
)
from mtu_cli.findings import (
    listed as listed,
)
from mtu_cli.findings import (
    nearest as nearest,
)
from mtu_cli.findings import (
    printable as printable,
)
from mtu_cli.findings import (
    shorten as shorten,
)

SHOWN_ALIKE = 3
SHOWN_ROWS = 6
_ALL = re.compile(r"did you mean '[^']*'(?:(?:,| or) '[^']*')*\?")
_MEANT = re.compile(r"'([^']*)'")
_ENDINGS = re.compile(r"(?<=.)(?:\.[a-z]{1,5}){1,2}$")


class Bridged(Finding):
    """A finding whose sentence is written where it is made, not in the catalogue."""

    def __init__(
        self, *, code: str = "fault", facts: Any = None, expected: str | None = None, **given: Any
    ) -> None:
        names = ("what", "message", "report_only", "about", "coefficients_of", "lacks")
        own = {name: given.pop(name) for name in names if name in given}
        if "message" in own:
            own["told"] = own.pop("message")
        if expected and _ALL.fullmatch(expected):
            given, expected = {**given, "meant": tuple(_MEANT.findall(expected))}, None
        super().__init__(code=code, facts={**(facts or {}), **own}, expected=expected, **given)

    @property
    def text(self) -> str:
        """What is wrong, without its place."""
        words = self.facts.get("what", self.facts.get("told"))
        return super().text if words is None else str(words)

    @property
    def message(self) -> str:
        """The whole sentence."""
        whole = super().message
        return whole.replace("; expected did you mean", "; did you mean")

    @property
    def kind(self) -> Kind:
        """Its entry of the catalogue, or the sentence that it came with."""
        if "what" in self.facts:
            return Kind("error", "{what}")
        if "told" in self.facts:
            return Kind("note" if self.facts.get("report_only") else "warning", "{told}")
        return CATALOGUE[self.code]


def Problem(**given: Any) -> Finding:
    """A finding by its words."""
    return Bridged(**given)


Notice = Warned = Problem


def reworded(item: Finding, text: str) -> Finding:
    """The same finding with other words."""
    key = "what" if "what" in item.facts else "told"
    return replace(item, facts={**item.facts, key: text})


def fault(what: str, **place: Any) -> InputError:
    """An InputError with a single finding."""
    return InputError(Bridged(what=what, **place))


def reason(error: Exception) -> str:
    """What the system says about a failed file operation, without the path."""
    text = error.strerror if isinstance(error, OSError) else None
    return (text or str(error)).lower()


def cut_names(text: str) -> str:
    """Text in which names of hundreds of characters without a blank are cut."""
    return re.sub(r"([^\s'\",;]{57})[^\s'\",;]{244,}", r"\1...", text)


def is_near(name: str, other: str) -> bool:
    """Whether at most a third of the letters of two names differ."""
    a, b = (_ENDINGS.sub("", each.casefold()) for each in (name, other))
    matcher = difflib.SequenceMatcher(None, a, b, autojunk=False)
    longest = max(len(a), len(b))
    return 3 * (longest - sum(block.size for block in matcher.get_matching_blocks())) <= longest


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """The ending of an unknown-name message: the closest name, or the known ones."""
    known = list(names)
    return question(nearest(name, known)) or listing(known)


def question(near: Sequence[str]) -> str:
    """``did you mean 'um'?``; nothing where no name is near."""
    return f"did you mean {' or '.join(map(repr, near))}?" if near else ""


def listing(names: Iterable[str]) -> str:
    """The ending of an unknown-name message that no known name is like."""
    known = list(names)
    shown = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
    return f"one of: {shown}" if known else "no such name: none is known here"
