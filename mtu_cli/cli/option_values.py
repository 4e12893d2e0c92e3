"""Values of a call that are no numbers and names that are no file, in the words of all faults."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from mtu_cli.findings import Finding, InputError, error, finding

WRITES = "write_"
"""How the names of options begin that name a file to write beside these."""
OUTPUTS = ("out", "csv", "plot")
DRAWING = "to"
"""What `graph draw` writes: its only file."""
SEPARATORS = tuple({os.sep, "/"})

_DECIMAL_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+")
LONGEST_WHOLE = 15
"""Digits of a whole number that are written out: 1e99 is a slip, and a line of its digits none to
copy."""
_THOUSANDS = re.compile(r"[-+]?[0-9]{1,3}(?:[,.' _][0-9]{3})+")


def bad_number(param: Any, raw: Mapping[str, Any], said: str) -> InputError | None:
    """The fault of an option whose value is no number, None where it is none of a number.

    `raw` are the values of the call as they were written; `said` is what the parser says, which
    knows whether a whole number was wanted.
    """
    whole = "integer" in said
    bad = [
        item
        for item in _listed(raw.get(param.name))
        if isinstance(item, str) and not _fits(item, whole)
    ]
    if not bad or not (whole or "number" in said or "float" in said):
        return None
    code = "not-a-whole-number" if whole else "not-a-number"
    return error(code, path=_shown(param), value=bad[0], expected=_meant(bad[0].strip(), whole))


def no_number(option: str, text: str, *, whole: bool = False) -> Finding | None:
    """The Finding of a part of an option's value, such as the VALUE of NAME=VALUE, that is no
    finite number; None of one that is.
    """
    from mtu_cli.files.contract import number_expectation
    from mtu_cli.files.csv_cells import is_not_finite, number

    text = text.strip()
    if is_not_finite(text):
        return finding("not-finite", path=option, value=text)
    if number(text) is None or (whole and not _fits(text, whole)):
        expected = _meant(text, whole)
        expected = number_expectation(text) if expected == "a number" else expected
        code = "not-a-whole-number" if whole else "not-a-number"
        return finding(code, path=option, value=text, expected=expected)
    return None


def _fits(text: str, whole: bool) -> bool:
    try:
        (int if whole else float)(text)
    except ValueError:
        return False
    return True


def _meant(text: str, whole: bool) -> str:
    if not whole and _DECIMAL_COMMA.fullmatch(text):
        return f"{text.replace(',', '.')} with a decimal point"
    wanted = "a whole number" if whole else "a number"
    if whole and _THOUSANDS.fullmatch(text):
        digits = re.sub("[^-+0-9]", "", text)
        return f"{_short(digits)}{wanted} without signs between its digits"
    if whole and _fits(text, False) and isfinite(float(text)) and float(text) == int(float(text)):
        return f"{_short(str(int(float(text))))}{wanted} in digits"
    return wanted


def _short(digits: str) -> str:
    return f"{digits}, " if len(digits.lstrip("-+")) <= LONGEST_WHOLE else ""


def check_names(params: Iterable[Any], values: Mapping[str, Any], raw: Mapping[str, Any]) -> None:
    """Raises InputError for every file whose name is empty, which as a path is this folder, and
    for every file to be written whose name ends as a folder's, which a path forgets.
    """
    problems = []
    for param in params:
        named = _listed(raw.get(param.name)) if _holds_path(values.get(param.name)) else []
        if "" in named:
            problems.append(finding("names-no-file", path=_shown(param), value=""))
        if param.name in (*OUTPUTS, DRAWING) or param.name.startswith(WRITES):
            problems += [
                finding(
                    "not-a-file",
                    kind="folder",
                    path=_shown(param),
                    value=name,
                    expected="a file in it",
                )
                for name in map(str, named)
                if name.endswith(SEPARATORS)
            ]
    if problems:
        raise InputError(problems)


def _shown(param: Any) -> str:
    name = str(max(param.opts, key=len))
    return name if name.startswith("-") else name.upper()


def _holds_path(value: object) -> bool:
    return any(isinstance(item, Path) for item in _listed(value))


def _listed(value: object) -> list[object]:
    return list(value) if isinstance(value, (list, tuple)) else [value]
