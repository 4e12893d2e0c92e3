"""Text that is no YAML, in plain words."""

from __future__ import annotations

import re

import yaml

from mtu_cli.errors import InputError, fault

_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ufffe\uffff]")


def unreadable(error: yaml.MarkedYAMLError, text: str, shown: str, line: int | None) -> InputError:
    """The parser's words with the line, and what is expected where the line tells."""
    problem = error.problem or "unknown fault"
    expected = None
    lines = text.splitlines()
    faulty = lines[line - 1] if line is not None and line <= len(lines) else ""
    if "\t" in faulty[: len(faulty) - len(faulty.lstrip())]:
        expected = "spaces, not tabs, for indentation"
    elif "mapping values are not allowed" in problem:
        expected = "quotes around a text that holds ': '"
    where = f" ({error.context})" if error.context else ""
    return fault(
        f"not readable as YAML: {problem}{where}", file=shown, line=line, expected=expected
    )


def control_line(text: str) -> int | None:
    """The line of the first control character, if there is one."""
    found = _CONTROL.search(text)
    return None if found is None else text.count("\n", 0, found.start()) + 1
