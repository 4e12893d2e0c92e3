"""Equations that options of `simulate` give: read, and their dimensions checked."""

from __future__ import annotations

import re

from mtu_cli.errors import fault
from mtu_cli.files.column_dimensions import PLACE, Dimensions, column_dimensions, columns_of
from mtu_cli.files.covariates import as_temperature, looks_like_temperature
from mtu_cli.language import EquationError, Node, names, parse
from mtu_cli.language.dimensions import base_scales, length_scale
from mtu_cli.language.free_literals import Wanted, check_with_free_literals
from mtu_cli.units import DEGREE, MINUTE

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
        raise fault(f"{option} is not NAME: EQUATION", value=text, expected=EXAMPLES[column])
    name = match[1]
    if column and looks_like_temperature(name):
        # What reads the points would refuse the column.
        meant = as_temperature(name) or "T_<sensor>_degC"
        raise fault(f"{option}: not the name of a temperature", value=name, expected=meant)
    try:
        # Blanks for the name: columns count from the start of the option's text.
        tree = parse(" " * match.start(2) + match[2])
        check_with_free_literals(tree, _wanted(tree, column_dimensions(name) if column else PLACE))
    except EquationError as error:
        raise fault(
            f"{option} {name}: {error.what}",
            column=error.column,
            value=error.value or text,
            expected=error.expected,
        ) from None
    return name, tree


def _wanted(tree: Node, own: Dimensions | None) -> list[Wanted]:
    known = columns_of({name: column_dimensions(name) for name in names(tree)}, {})
    scales = base_scales(known.per)
    return [
        Wanted(scale=length_scale(known.lengths), exponent=own and own.length),
        Wanted(scale=scales[DEGREE], exponent=own and own.degree),
        Wanted(scale=scales[MINUTE], exponent=own and own.minute),
    ]
