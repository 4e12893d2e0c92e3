"""Problems of input, in one form for every file and command, and the exit codes."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from mtu_cli.slips import nearest

EXIT_INPUT = 2
EXIT_GATE = 3

SHOWN_PROBLEMS = 20
SHOWN_ALIKE = 3
"""Equal problems of so many rows are shown one by one, those of more by the first."""
SHOWN_ROWS = 6
"""Rows (lines), or runs of them, that a problem shown by its first is told to be in."""
LONGEST_PATH = 200
LONGEST_WORDS = 500
"""Characters of a problem's parts; only names that are no names reach them."""
_LONG_NAME = re.compile(r"([^\s'\",;]{57})[^\s'\",;]{244,}")
"""More characters than a file's name has."""
_ENDINGS = re.compile(r"(?<=.)(?:\.[a-z]{1,5}){1,2}$")
MOST_KEYS = 12
"""Of a section of a contract: like problems of more places in it are of the user's own entries."""
_STEPS = re.compile(r"[^.\[\]]+")
"""Of a path inside a YAML document."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One fault of the input: where it stands, what it is, what was expected.

    `line` is a line of a YAML file or a row of a CSV file, both as a text editor counts
    them. `path` is a place inside a YAML document (``components.dx_x.unit``), `column` the
    name of a CSV column or the 1-based character of an equation. `lacks` is the key that the
    entry at `path` has not.
    """

    what: str
    file: str | None = None
    line: int | None = None
    path: str | None = None
    column: str | int | None = None
    value: str | None = None
    expected: str | None = None
    row: int | None = None
    lacks: str | None = None

    def __str__(self) -> str:
        place = cut_names(self.file or "")
        if self.line is not None:
            place += f":{self.line}" if place else f"line {self.line}"
        if self.row is not None:
            place += f", row {self.row}" if place else f"row {self.row}"
        if isinstance(self.column, str):
            name = f"column '{shorten(self.column)}'"
            place += f", {name}" if place else name
        text = f"{place}: " if place else ""
        if self.path:
            text += f"{shorten(self.path, LONGEST_PATH)}: "
        text += shorten(self.what, LONGEST_WORDS)
        if isinstance(self.column, int):
            text += f" at column {self.column}"
        if self.value is not None:
            text += f": {shorten(self.value)!r}"
        if self.expected:
            asks = self.expected.startswith("did you mean")
            expected = shorten(self.expected, LONGEST_WORDS)
            text += f"; {expected}" if asks else f"; expected {expected}"
        return printable(text)


class MtuError(Exception):
    """Base of every error that is reported to the user without a traceback."""


class InputError(MtuError):
    """The input or the call is at fault (exit code 2); carries every problem found."""

    def __init__(self, problems: Problem | Iterable[Problem]) -> None:
        listed = [problems] if isinstance(problems, Problem) else _in_file_order(problems)
        self.problems: tuple[Problem, ...] = tuple(listed)
        super().__init__(str(self))

    def __str__(self) -> str:
        lines = _told_once(self.problems)
        shown = [
            f"{problem}{_others(problem, others)}" for problem, others in lines[:SHOWN_PROBLEMS]
        ]
        if left := sum(1 + len(others) for _, others in lines[SHOWN_PROBLEMS:]):
            shown.append(f"... and {left} more")
        return "\n".join(shown)


def _told_once(problems: Sequence[Problem]) -> list[tuple[Problem, list[Problem]]]:
    """The problems to be shown, each with those that differ from it in the row alone, or in the
    entry of a YAML file: one fault of a whole column is not told a row at a time.
    """
    alike: dict[tuple[object, ...], list[int]] = {}
    own: list[int] = []
    for i, p in enumerate(problems):
        # One object may stand for millions of cells.
        if i == 0 or p is not problems[i - 1]:
            key = (p.what, p.file, _entries(p), p.column, p.value, p.expected)
            own = alike.setdefault(key, [])
        own.append(i)
    shown: dict[int, list[int]] = {}
    for own in alike.values():
        few = own if len(own) <= _told_singly(problems[own[0]]) else own[:1]
        shown |= {i: [] for i in few} | {few[-1]: own[len(few) :]}
    return [(problems[i], [problems[j] for j in shown[i]]) for i in sorted(shown)]


def _entries(problem: Problem) -> object:
    """What the places of like problems share: in a path such as ``features.H1.x`` the step of the
    entry is free, all else stands. Without a path, the line.
    """
    if problem.path is None or problem.line is None:
        return problem.path, problem.line
    steps = _STEPS.findall(problem.path)
    return (*steps[:1], *steps[2:], len(steps)) if len(steps) > 1 else (problem.path, problem.line)


def _told_singly(problem: Problem) -> int:
    """How many like problems are told each by itself: in ``settings.seed`` the second step is a
    key of the contract that must be named, but for what is missing in ``features.H1``.
    """
    own_key = problem.path is not None and len(_STEPS.findall(problem.path)) == 2
    return MOST_KEYS if own_key and problem.lacks is None else SHOWN_ALIKE


def _others(first: Problem, alike: Sequence[Problem]) -> str:
    """Where the same stands again, such as `` (and rows 3 to 91)``."""
    if not alike:
        return ""
    kind = "row" if alike[0].row is not None else "line"
    places = (p.row if kind == "row" else p.line for p in alike)
    rows = [place for place in places if place is not None]
    if len(rows) < len(alike):
        return f" (and {len(alike)} more)"
    rows = list(dict.fromkeys(rows)) if kind == "line" else rows
    if rows == [first.line]:
        return f" (and {len(alike)} more)"
    starts = [i for i, row in enumerate(rows) if i == 0 or row != rows[i - 1] + 1]
    if len(starts) > SHOWN_ROWS:
        return f" (and {len(rows)} more {kind}s, up to {kind} {rows[-1]})"
    runs = [rows[a:b] for a, b in pairwise([*starts, len(rows)])]
    told = [f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs]
    return f" (and {kind}{'s' if len(rows) > 1 else ''} {', '.join(told)})"


def _in_file_order(problems: Iterable[Problem]) -> list[Problem]:
    """Problems with a line or row by it among those of their file; others stay where they are."""
    listed = list(problems)
    places: dict[str | None, list[int]] = {}
    for i, problem in enumerate(listed):
        if problem.line is not None or problem.row is not None:
            places.setdefault(problem.file, []).append(i)
    result = list(listed)
    for own in places.values():
        for to, i in zip(own, sorted(own, key=lambda i: _place(listed[i])), strict=True):
            result[to] = listed[i]
    return result


def _place(problem: Problem) -> int:
    """Where in its file a problem stands: a YAML file has lines, a table rows."""
    return problem.line or problem.row or 0


def fault(what: str, **place: str | int | None) -> InputError:
    """An InputError with a single problem: ``raise fault("...", file=..., expected=...)``."""
    return InputError(Problem(what=what, **place))  # type: ignore[arg-type]  # fields by name


def reason(error: Exception) -> str:
    """What the system says about a failed file operation, without the path."""
    text = error.strerror if isinstance(error, OSError) else None
    return (text or str(error)).lower()


def shorten(text: str, width: int = 60) -> str:
    """Text cut to `width` characters, so that one message stays one line."""
    return text if len(text) <= width else text[: width - 3] + "..."


def cut_names(text: str) -> str:
    """Text in which names of hundreds of characters without a blank are cut, as `shorten` does; of
    paths the file's own name stays.
    """
    return _LONG_NAME.sub(_cut_name, text)


def _cut_name(found: re.Match[str]) -> str:
    folders, slash, name = found[0].rpartition("/")
    if not slash or len(name) >= LONGEST_PATH:
        return f"{found[1]}..."
    return f"{folders[:57]}.../{name}"


def printable(text: str) -> str:
    """Text in which control characters (of a file name, say) are escaped: no terminal obeys it."""
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in text
    )


def closest(name: str, names: Iterable[str]) -> str | None:
    """The known name that `name` was probably meant to be, or None."""
    return next(iter(nearest(name, names)), None)


def is_near(name: str, other: str) -> bool:
    """Whether at most a third of the letters of two names differ: who wrote one may have meant the
    other even where a folder holds little else. The endings of files say what they are, not which.
    """
    a, b = (_ENDINGS.sub("", each.casefold()) for each in (name, other))
    matcher = difflib.SequenceMatcher(None, a, b, autojunk=False)
    longest = max(len(a), len(b))
    return 3 * (longest - sum(block.size for block in matcher.get_matching_blocks())) <= longest


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """The ending of an unknown-name message: the closest name, or the known ones."""
    known = list(names)
    return question(nearest(name, known)) or listing(known)


def question(near: Sequence[str]) -> str:
    """``did you mean 'um' or 'mm'?``; nothing where no name is near, or so many are that none is
    nearer than the rest.
    """
    if not 0 < len(near) <= SHOWN_ALIKE:
        return ""
    *first, last = map(repr, near)
    return f"did you mean {', '.join(first)}{' or ' if first else ''}{last}?"


def listing(names: Iterable[str]) -> str:
    """The ending of an unknown-name message that no known name is like."""
    known = list(names)
    shown = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
    return f"one of: {shown}" if known else "no such name: none is known here"


def counted(number: int, noun: str, several: str = "") -> str:
    """``1 row``, ``2 rows``; ``1 entry``, and of `several` ``2 entries``."""
    return f"{number} {noun}" if number == 1 else f"{number} {several or noun + 's'}"


def listed(names: Iterable[str], most: int = 6) -> str:
    """Names for a message, the first few of them and how many more."""
    known = list(dict.fromkeys(names))
    more = f" and {len(known) - most} more" if len(known) > most else ""
    return ", ".join(known[:most]) + more
