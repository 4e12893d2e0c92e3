"""Text that is no YAML, in plain words."""

from __future__ import annotations

import re
from collections.abc import Sequence

import yaml

from mtu_cli.errors import InputError, fault
from mtu_cli.files.yaml_entries import COLON, as_entry

_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ufffe\uffff]")
NOT_READABLE = "not readable as YAML"
_ENTRY = re.compile(
    r"\s*+(?:- ++)*+(?:'[^']*+'\s*+|\"[^\"]*+\"\s*+|[^\s'\"#{\[][^#{\[]*?):(?:\s|$)"
)
_BRACKETS = re.compile(r"^while parsing a flow (mapping|sequence)")
BEGUN = ("found unexpected end of stream", "could not find expected ':'")
"""How the parser's words begin where the fault is the line in which it began to read a text."""
EXPECTED = {
    "could not find expected ':'": "`key: value`, or a text deeper in than its key",
    "found unknown escape": r"single quotes: within double ones a \ stands for more",
    "found unexpected end of stream": "a quotation mark at the end of the text, as at its start",
    "did not find expected '-'": "a dash before every entry of a list",
    "did not find expected key": "one `key: value` a line, each as far in as the others",
    "block sequence entries are not allowed": "the list on lines of its own below its key",
    "found character that cannot start": "quotes around a text that begins with such a sign",
    "did not find expected alphabetic": "quotes around a text that begins with * or &",
    "did not find expected <document start>": "one mapping, which begins in the first column",
    "did not find expected node": "a value between two commas",
    "found unexpected ':'": "a blank behind the colon, or quotes around the text",
}
"""What is expected, by how the parser's words begin."""


def unreadable(error: yaml.MarkedYAMLError, text: str, shown: str, line: int | None) -> InputError:
    """The parser's words with the line, and what is expected where the line tells; a line that
    lacks its colon is told itself, not the one at which the parser stumbles over it.
    """
    problem = error.problem or "unknown fault"
    lines = text.splitlines()
    faulty = lines[line - 1] if line is not None and line <= len(lines) else ""
    begun = None if error.context_mark is None else error.context_mark.line + 1
    # The parser may stumble lines below, where it finds no end.
    stop = begun if problem.startswith(BEGUN) else line
    missed = None
    if line is not None and _of_a_key(problem):
        missed = _without_colon(lines, line, _indent(lines, line if stop is None else stop))
    if missed is not None:
        at, entry = missed
        what = f"{NOT_READABLE}: no `key: value`"
        expected = f"'{entry}', {COLON}"
        return fault(what, file=shown, line=at, value=lines[at - 1].strip(), expected=expected)
    line = line if stop is None else stop
    asked = next((own for start, own in EXPECTED.items() if problem.startswith(start)), None)
    where = f" ({error.context})" if error.context else ""
    opened = _BRACKETS.match(error.context or "")
    if "\t" in faulty[: len(faulty) - len(faulty.lstrip())]:
        asked = "spaces, not tabs, for indentation"
    elif "mapping values are not allowed" in problem:
        asked = "one `key: value` a line, or quotes around a text that holds ': '"
    elif opened:
        bracket = "}" if opened[1] == "mapping" else "]"
        of = "" if begun in (None, line) else f" of the bracket opened in line {begun}"
        asked = f"a comma between two entries, or the '{bracket}'{of}"
    return fault(f"{NOT_READABLE}: {problem}{where}", file=shown, line=line, expected=asked)


def _of_a_key(problem: str) -> bool:
    """Whether a colon is what the parser missed, or what it did not expect."""
    return "mapping values are not allowed" in problem or "could not find expected ':'" in problem


def _indent(lines: Sequence[str], line: int) -> int:
    own = lines[line - 1] if line <= len(lines) else ""
    return len(own) - len(own.lstrip(" "))


def _without_colon(lines: Sequence[str], line: int, deepest: int) -> tuple[int, str] | None:
    """The last line up to `line` that looks like an entry without its colon, and that entry.

    Entries stand one to a line: what stands above a sound one is not at fault, nor is what is
    further in than the `deepest`, as the text of a note is.
    """
    for at in range(min(line, len(lines)), 0, -1):
        own = lines[at - 1]
        if not own.strip() or own.lstrip().startswith("#"):
            continue
        if _indent(lines, at) > deepest:
            return None
        if not _ENTRY.match(own):
            entry = as_entry(own.strip().removeprefix("- "))
            return None if entry is None else (at, entry)
        if at < line:
            return None
    return None


def control_line(text: str) -> int | None:
    """The line of the first control character, if there is one."""
    found = _CONTROL.search(text)
    return None if found is None else text.count("\n", 0, found.start()) + 1
