"""Values of a call that are no numbers and names that are no file, in the words of all faults."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mtu_cli.findings import Finding, InputError, finding

WRITES = "write_"
"""How the names of options begin that name a file to write beside these."""
OUTPUTS = ("out", "csv", "plot", "report")
DRAWING = "to"
"""What `graph draw` writes: its only file."""
SEPARATORS = tuple({os.sep, "/"})


def option_name(name: str) -> str:
    """The option of a parameter: --sensor-noise-degC of sensor_noise_degc."""
    return f"--{name.replace('_', '-')}".replace("degc", "degC")


def no_number(option: str, text: str, *, whole: bool = False) -> Finding | None:
    """The Finding of a part of an option's value, such as the VALUE of NAME=VALUE, that is no
    finite number; None of one that is.
    """
    from mtu_cli.files.contract import number_expectation
    from mtu_cli.files.csv_table import is_not_finite, number

    text = text.strip()
    value = number(text)
    if is_not_finite(text):
        return finding("not-finite", path=option, value=text)
    if value is None:
        return finding("not-a-number", path=option, value=text, expected=number_expectation(text))
    if whole and not text.lstrip("+-").isdigit():
        return finding("not-a-whole-number", path=option, value=text, expected="a whole number")
    return None


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
