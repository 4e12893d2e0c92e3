"""Errors of one axis as a table, and what a control's format has to say of itself.

The one internal model: e = actual - nominal, in mm or rad, at machine positions in mm, forward and
reverse, with linear interpolation between the points and the end values held beyond them. Sign,
quantum, zero rule and reading back belong to each format.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from mtu_cli.files.headers import number
from mtu_cli.findings import InputError, error, finding, suggestion
from mtu_cli.stats.least_squares import FloatArray

Parameters = Mapping[str, str]
"""The control's own parameters of --set, by name."""
NANOMETRE, NANORADIAN = 1e-6, 1e-9
"""Last place that is written of a length (mm) and of an angle (rad), where the format has none."""
LARGEST = 1e15
"""No number of a table is as large."""
EQUAL_STEP = 1e-6
"""mm: steps that differ by less are equal."""
FOLLOWS = 0.02
"""How near a slope on the positions is to 1 or -1 of what are positions, read as errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorTable:
    """Errors (2, n) forward and reverse, mm or rad, at rising machine positions `at` (n,), mm; of a
    table of one direction both are the same.

    `both`: the two directions differ by intention. `angle`: in rad; `rotary`: at positions in deg.
    """

    at: FloatArray
    errors: FloatArray
    both: bool = False
    angle: bool = False
    rotary: bool = False

    @classmethod
    def of(cls, at: ArrayLike, *errors: ArrayLike, angle: bool = False) -> ErrorTable:
        """A table of one direction, or of two."""
        columns = np.array([errors[0], errors[-1]], float)
        return cls(at=np.asarray(at, float), errors=columns, both=len(errors) > 1, angle=angle)

    def at_places(self, places: FloatArray) -> FloatArray:
        """Errors (2, m) at other positions: linear between points, held beyond the ends."""
        return np.stack([np.interp(places, self.at, row) for row in self.errors])

    @property
    def step(self) -> float | None:
        """The distance of its points; None where they are not equidistant."""
        steps = np.diff(self.at)
        if len(steps) == 0 or np.ptp(steps) > EQUAL_STEP:
            return None
        return float(round((self.at[-1] - self.at[0]) / len(steps), 6))


@dataclass(frozen=True, slots=True)
class Controller:
    """A control's format.

    `sign` says what its values are: `error` (e), `correction` (-e) or `position` (nominal + e);
    `says` the convention in a sentence, written as a comment that begins with `comment`, or, where
    the format has none, into a file beside it. `two`: it has a column for each direction.
    `zeroed`: "" as they are; "forward": less the forward value at the reference; "each": less the
    first value of each direction. `parameters` with their defaults ("": has to be given where it is
    needed). `most`: points that the control holds. `angles`: it holds errors that are angles,
    `rotary`: those of a rotary axis. `listing`: for hand entry.
    """

    name: str
    sign: str
    write: Callable[[ErrorTable, Parameters], list[str]]
    read: Callable[[str, Parameters], ErrorTable]
    parameters: Parameters
    _: KW_ONLY
    says: str
    quantum: Callable[[Parameters], float] = lambda _: NANOMETRE
    two: Callable[[Parameters], bool] = lambda _: False
    equidistant: Callable[[Parameters], bool] = lambda _: True
    zeroed: str = ""
    comment: str = ""
    most: int | None = None
    angles: bool = False
    rotary: bool = False
    listing: bool = False
    newline: str = "\r\n"

    def resolution(self, table: ErrorTable, parameters: Parameters) -> float:
        """The quantum of the values, in mm or rad."""
        return NANORADIAN if table.angle else self.quantum(parameters)

    def zero_at(self, table: ErrorTable, reference: float) -> float | None:
        """Where the table is zeroed, mm; None: nowhere."""
        return {"forward": reference, "each": float(table.at[0])}.get(self.zeroed)

    def zero(self, table: ErrorTable, reference: float) -> ErrorTable:
        """The table as the zero rule of the control has it."""
        place = self.zero_at(table, reference)
        if place is None:
            return table
        shift = table.at_places(np.array([place]))
        return replace(table, errors=table.errors - (shift if self.zeroed == "each" else shift[0]))

    def text(self, table: ErrorTable, parameters: Parameters, note: str = "") -> str:
        """The file, with its sign convention and a `note` where comments are allowed.

        Raises InputError with all that the format cannot hold of a table.
        """
        faults = []
        if table.angle and not (self.angles or (self.rotary and table.rotary)):
            reason = f"{self.name} holds lengths, the component is an angle"
            faults.append(finding("not-applicable", reason=reason))
        if table.step is None and self.equidistant(parameters):
            expected = "--from MM --to MM --step MM for equidistant points"
            reason = f"{self.name} holds equidistant points, and the targets are not"
            faults.append(finding("not-applicable", reason=reason, expected=expected))
        if self.most is not None and len(table.at) > self.most:
            reason = f"{len(table.at)} points; {self.name} holds {self.most}"
            faults.append(finding("not-applicable", reason=reason, expected="a larger --step"))
        if faults:
            raise InputError(faults)
        notes = [f"{self.comment} {line}" for line in (self.says, note) if line and self.comment]
        return self.newline.join([*notes, *self.write(table, parameters), ""])

    def read_back(self, text: str, parameters: Parameters) -> ErrorTable:
        """What a file says; raises InputError for one that the control would not read so.

        Lines end as on Windows or Unix.
        """
        table = self.read(text.replace("\r\n", "\n"), parameters)
        if len(table.at) < 2:
            refuse(f"{len(table.at)} point(s)", expected="two points or more")
        if (np.diff(table.at) <= 0).any():
            refuse("the positions do not rise", expected="rising positions")
        x = table.at - table.at.mean()
        if abs(abs(table.errors.mean(axis=0) @ x / (x @ x)) - 1) < FOLLOWS:
            expected = "the --set parameters that it was written with"
            refuse("its errors would follow the positions", expected=expected)
        return table


def decimals(value: float, places: int = 6) -> str:
    """A number to so many places, without zeros at its end.

    >>> decimals(50.0050), decimals(-0.0000001)
    ('50.005', '0')
    """
    return real(value, places).removesuffix(".0")


def real(value: float, places: int = 6) -> str:
    """The same with a decimal point, as controls write real numbers."""
    text = f"{value:.{places}f}".rstrip("0")
    text += "0" * text.endswith(".")
    return "0.0" if text == "-0.0" else text


def parameter(parameters: Parameters, name: str, form: str = "VALUE") -> str:
    """A parameter that has to be there, of this form."""
    if not parameters[name]:
        raise error("missing-input", what=f"the parameter {name}", expected=f"--set {name}={form}")
    return parameters[name]


def number_parameter(parameters: Parameters, name: str) -> float:
    """A parameter that is a number above 0; raises InputError for another."""
    value = number(parameter(parameters, name))
    if value is None or not 0 < value < np.inf:
        place = {"path": f"--set {name}", "value": parameters[name]}
        raise error("wrong-type", kind="a number above 0", **place)
    return value


def choice(parameters: Parameters, name: str, choices: tuple[str, ...]) -> str:
    """A parameter that is one of the `choices`."""
    value = parameter(parameters, name, " or ".join(choices))
    if value not in choices:
        hint = suggestion(value, choices)
        raise error("unknown-name", path=f"--set {name}", what=name, value=value, **hint)
    return value


def refuse(reason: str, line: int | None = None, expected: str | None = None) -> NoReturn:
    """Raises InputError for a file that the control would not read."""
    raise error("not-readable", reason=reason, line=line, expected=expected)


def numeric(text: str, line: int | None = None) -> float:
    """A finite number of a file; raises InputError."""
    value = number(text.strip())
    if value is None or not abs(value) < LARGEST:
        refuse(f"{text.strip()!r} is no number of a table", line, "a number")
    return value


def lines_of(text: str, *comments: str) -> list[tuple[int, str]]:
    """The stripped lines of a text with their numbers, without comments and blank lines."""
    result = []
    for i, line in enumerate(text.split("\n"), 1):
        for sign in comments:
            line = line.partition(sign)[0]
        if line.strip():
            result.append((i, line.strip()))
    return result


def rows_of(
    lines: Iterable[tuple[int, str]], count: int, separator: str | None = None
) -> FloatArray:
    """Numbers (n, count) of numbered lines; raises InputError for a line of others, or for none."""
    rows = []
    for line, text in lines:
        cells = text.split(separator)
        if len(cells) != count:
            refuse(f"{len(cells)} values", line, f"{count}")
        rows.append([numeric(cell, line) for cell in cells])
    if not rows:
        refuse("it has no rows of numbers")
    return np.array(rows)


def in_order(values: Mapping[int, float], what: str, count: int) -> FloatArray:
    """Values by their numbers; raises InputError where these do not run from 0 to count - 1."""
    if sorted(values) != list(range(count)):
        refuse(f"the numbers of {what} do not run from 0 to {count - 1}")
    return np.array([values[k] for k in range(count)])
