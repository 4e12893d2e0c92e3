"""The fault of an equation, with the character at which it stands."""

from __future__ import annotations

from mtu_cli.errors import MtuError, Problem
from mtu_cli.findings import Finding


class EquationError(MtuError):
    """A fault in an equation: `column` is the 1-based character at which it stands.

    `value` is what stands there, where the column alone does not show it.
    """

    def __init__(
        self, what: str, column: int, expected: str | None = None, value: str | None = None
    ) -> None:
        super().__init__(f"{what} at column {column}")
        self.what = what
        self.column = column
        self.expected = expected
        self.value = value

    def problem(
        self, *, file: str | None = None, line: int | None = None, path: str | None = None
    ) -> Finding:
        """This fault as a Problem of the file in which the equation stands."""
        return Problem(
            what=self.what,
            file=file,
            line=line,
            path=path,
            column=self.column,
            value=self.value,
            expected=self.expected,
        )
