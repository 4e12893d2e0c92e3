"""What is wrong or odd about an input: one form for every file, check and command.

A `Finding` is one entry of the `CATALOGUE` with the place where it stands and the facts of the
case. Errors travel in an `InputError`, all of a file at once; warnings and notes travel in results.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from string import Formatter
from typing import Any

from mtu_cli.catalogue import CATALOGUE, Kind, Severity

EXIT_INPUT = 2
EXIT_GATE = 3

MOST_SHOWN = 20
"""Findings of an error that are shown; the rest is counted."""
SHOWN_RUNS = 6
"""Runs of rows that a finding names."""
SHOWN_NAMES = 6
LONGEST_VALUE = 60
LONGEST_NAME = 200
LONGEST_TEXT = 500


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding: a `code` of the catalogue, its place, and the facts that its template names.

    `line` is a line of a YAML file, `row` a row of a CSV file, both counted as a text editor does;
    `path` a place inside a document (``components.dx_x.unit``); `column` the name of a CSV column,
    or the character of an equation counted from 1. `value` is what stands there, `expected` what
    should, `meant` the known names that are nearest to it.
    """

    code: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    file: str | None = None
    line: int | None = None
    row: int | None = None
    column: str | int | None = None
    path: str | None = None
    value: str | None = None
    expected: str | None = None
    meant: tuple[str, ...] = ()

    @property
    def kind(self) -> Kind:
        """Its entry of the catalogue."""
        return CATALOGUE[self.code]

    @property
    def severity(self) -> Severity:
        """``error``, ``warning`` or ``note``."""
        return self.kind.severity

    @property
    def text(self) -> str:
        """What is wrong, without its place.

        >>> Finding(code="unused", facts={"what": "component", "name": "dx_x"}).text
        "the component 'dx_x' is in no equation"
        """
        return _WORDS.vformat(self.kind.template, (), self.facts)

    @property
    def message(self) -> str:
        """The whole sentence: place, text, value, expectation.

        >>> print(Finding(code="wrong-type", facts={"kind": "a number"}, file="a.csv", row=3,
        ...               column="error", value="1.2.3", expected="a number").message)
        a.csv, row 3, column 'error': not a number: '1.2.3'; expected a number
        """
        return self._sentence([] if self.row is None else [self.row])

    def _sentence(self, rows: Sequence[int]) -> str:
        """The sentence of this finding in each of the `rows`."""
        text = self.text
        if isinstance(self.column, int):
            text += f" at column {self.column}"
        if self.path:
            text = f"{shorten(self.path, LONGEST_NAME)}: {text}"
        steps = [shorten(self.file, LONGEST_NAME)] if self.file else []
        if self.line is not None:
            steps = [f"{steps[0]}:{self.line}" if steps else f"line {self.line}"]
        steps += [f"row{'s' * (len(rows) > 1)} {runs(rows)}"] if rows else []
        if isinstance(self.column, str):
            steps.append(f"column {shorten(self.column)!r}")
        text = f"{', '.join(steps)}: {text}" if steps else text
        if self.value is not None:
            text += f": {shorten(self.value)!r}"
        if self.meant:
            text += f"; did you mean {' or '.join(map(repr, self.meant))}?"
        elif self.expected:
            text += f"; expected {shorten(self.expected, LONGEST_TEXT)}"
        return printable(text)

    def __str__(self) -> str:
        return self.message

    def __hash__(self) -> int:
        return hash((self.code, self.file, self.line, self.row, self.column, self.value))

    def at(self, **place: Any) -> Finding:
        """The same finding with the missing parts of its place (file, line, row, column, path)."""
        missing = {name: x for name, x in place.items() if getattr(self, name) in (None, ())}
        return replace(self, **missing)

    def to_dict(self) -> dict[str, Any]:
        """As reports list it: `file`, `line`, `row` and `column` where they apply."""
        result = {"code": self.code, "severity": self.severity, "message": self.message}
        facts = {name: _plain(value) for name, value in self.facts.items()}
        place = {"file": self.file, "line": self.line, "row": self.row, "column": self.column}
        return {**result, "facts": facts, **{k: v for k, v in place.items() if v is not None}}


class MtuError(Exception):
    """Base of every error that is reported to the user without a traceback."""


class InputError(MtuError):
    """The input or the call is at fault (exit code 2); carries every finding.

    `uncounted`: how many more there are that were not listed, such as the bad cells of a file
    beyond the first thousands.
    """

    def __init__(self, findings: Finding | Iterable[Finding], uncounted: int = 0) -> None:
        items = [findings] if isinstance(findings, Finding) else list(findings)
        # Those of one file by line or row, files in the order in which they come.
        files = {name: i for i, name in enumerate(dict.fromkeys(each.file for each in items))}
        items.sort(key=lambda each: (files[each.file], each.line or 0, each.row or 0))
        self.findings = tuple(items)
        self.uncounted = uncounted
        super().__init__(str(self))

    def __str__(self) -> str:
        # One line for findings that differ in the row only, as of a column in another unit.
        groups: dict[Finding, list[int | None]] = {}
        for each in self.findings:
            groups.setdefault(replace(each, row=None), []).append(each.row)
        first = [*groups.items()][:MOST_SHOWN]
        rest = len(self.findings) + self.uncounted - sum(len(rows) for _, rows in first)
        lines = [each._sentence([n for n in rows if n is not None]) for each, rows in first]
        return "\n".join([*lines, *([f"... and {rest} more"] if rest else [])])


def error(code: str, **place_and_facts: Any) -> InputError:
    """An InputError of one finding; names that are no fields of a Finding are its facts.

    >>> print(error("no-such-file", file="a.csv", meant=("b.csv",)))
    a.csv: no such file; did you mean 'b.csv'?
    """
    return InputError(finding(code, **place_and_facts))


def finding(code: str, **place_and_facts: Any) -> Finding:
    """A Finding from its place and its facts, both by name."""
    fields = Finding.__dataclass_fields__
    place = {name: value for name, value in place_and_facts.items() if name in fields}
    facts = {name: value for name, value in place_and_facts.items() if name not in fields}
    return Finding(code=code, **{**place, "facts": {**facts, **place.get("facts", {})}})


def runs(numbers: Sequence[int]) -> str:
    """Whole numbers as runs.

    >>> runs([3, 4, 5, 9])
    '3 to 5, 9'
    """
    values = sorted(set(numbers))
    starts = [i for i, n in enumerate(values) if i == 0 or n != values[i - 1] + 1]
    spans = [values[a:b] for a, b in pairwise([*starts, len(values)])]
    texts = [f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in spans]
    more = f" and {sum(map(len, spans[SHOWN_RUNS:]))} more" if len(spans) > SHOWN_RUNS else ""
    return ", ".join(texts[:SHOWN_RUNS]) + more


def listed(names: Iterable[object], most: int = SHOWN_NAMES, between: str = ", ") -> str:
    """Names for a sentence: the first few and how many more.

    >>> listed("abcdefgh", 3)
    'a, b, c and 5 more'
    """
    texts = list(dict.fromkeys(map(str, names)))
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return between.join(texts[:most]) + more


def counted(number: int, noun: str, several: str = "") -> str:
    """``1 row``, ``2 rows``; ``1 entry``, and of `several` ``2 entries``."""
    return f"{number} {noun}" if number == 1 else f"{number} {several or noun + 's'}"


def nearest(name: str, names: Iterable[str]) -> tuple[str, ...]:
    """The known name that `name` was probably meant to be, if there is one.

    >>> nearest("coverge_factor", ["seed", "coverage_factor"])
    ('coverage_factor',)
    """
    words = {str(x).casefold(): str(x) for x in names if len(str(x)) <= LONGEST_NAME}
    key = name.casefold()[:LONGEST_NAME]
    return tuple(words[each] for each in difflib.get_close_matches(key, words, 1, 0.65))


def closest(name: str, names: Iterable[str]) -> str | None:
    """The known name that `name` was probably meant to be, or None.

    >>> closest("coverge_factor", ["seed", "coverage_factor"])
    'coverage_factor'
    """
    return next(iter(nearest(name, names)), None)


def suggestion(name: str, names: Iterable[str]) -> dict[str, Any]:
    """Facts of a Finding of an unknown name: `meant`, the nearest names, else `expected`, all."""
    choices = list(names)
    if near := nearest(name, choices):
        return {"meant": near}
    text = ", ".join(map(shorten, choices[:12])) + (", ..." if len(choices) > 12 else "")
    return {"expected": f"one of: {text}" if choices else "no such name: none is known here"}


def shorten(text: str, width: int = LONGEST_VALUE) -> str:
    """Text cut to `width` characters, so that one message stays one line."""
    return text if len(text) <= width else text[: width - 3] + "..."


def printable(text: str) -> str:
    """Text in which control characters (of a file name, say) are escaped: no terminal obeys it."""
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in text
    )


def _plain(value: Any) -> Any:
    """A fact as JSON can hold it."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numbers and arrays of numpy, which is not imported here
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


class _Words(Formatter):
    """Facts in a sentence: names are listed, whole numbers are rows, floats have four digits."""

    def format_field(self, value: Any, format_spec: str) -> Any:
        if isinstance(value, tuple) and value and all(isinstance(each, int) for each in value):
            return f"row{'s' if len(value) > 1 else ''} {runs(value)}"
        if isinstance(value, (list, tuple, set, frozenset)):
            return listed(sorted(value) if isinstance(value, (set, frozenset)) else value)
        if isinstance(value, float) and not format_spec:
            return f"{value:.4g}"
        return format(
            shorten(value, LONGEST_NAME) if isinstance(value, str) else value, format_spec
        )


_WORDS = _Words()
