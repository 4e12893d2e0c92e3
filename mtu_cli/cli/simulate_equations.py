"""Equations that options of `simulate` give: read, and their dimensions checked."""

from __future__ import annotations

import re

from mtu_cli.files.column_dimensions import PLACE, column_dimensions, own_columns
from mtu_cli.files.covariates import as_temperature, looks_like_temperature
from mtu_cli.findings import InputError, error
from mtu_cli.language import Node, check_dimension, names, parse

_NAMED = re.compile(r"\s*([A-Za-z_][A-Za-z_0-9]*)\s*:(.*)", re.DOTALL)

EXAMPLES = {False: "'Ex: 0.004*dir_x'", True: "'T_spindle_degC: 20 + 2*(sequence - 1)'"}
"""Of an error and of a column."""


def named_equation(option: str, text: str, *, column: bool = False) -> tuple[str, Node]:
    """Name and equation of an error in mm, or of a `column` in the unit that its name tells.

    The numbers of an equation may have units: ``0.004*dir_x`` are mm. Without a number in it a
    term must be what the equation is, as in a machine file.

    Raises InputError for what is no such text, for a column that looks like a sensor's and is
    none, and for terms of another dimension.
    """
    match = _NAMED.fullmatch(text)
    if match is None:
        raise error(
            "option-form",
            path=option,
            form="NAME: EQUATION",
            value=text,
            expected=EXAMPLES[column],
        )
    name = match[1]
    if column and looks_like_temperature(name):
        # What reads the points would refuse the column.
        meant = as_temperature(name) or "T_<sensor>_degC"
        raise error("not-a-temperature", path=option, value=name, expected=meant)
    try:
        # Blanks for the name: columns count from the start of the option's text.
        tree = parse(" " * match.start(2) + match[2])
        wanted = column_dimensions(name) if column else PLACE
        check_dimension(tree, wanted, own_columns(names(tree), ()), free=True)
    except InputError as fault:
        raise InputError(
            each.at(path=f"{option} {name}", value=text) for each in fault.findings
        ) from None
    return name, tree
