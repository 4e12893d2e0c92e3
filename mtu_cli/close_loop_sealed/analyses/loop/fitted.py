"""Effects beside the polynomial that the readings themselves gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_library import Candidate, Column, Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.units import PARAMETER_UNITS

NOTHING = 1e-9
"""Share of an effect below which a power of the polynomial holds nothing of it."""
AXES = ("x", "y", "z")


def beside_polynomial(
    table: ResidualTable, candidates: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """The candidates less what the fitted polynomial took of them, in columns and equations.

    Readings less their own least-squares polynomial hold of an effect c only what that
    polynomial leaves of it, c - P c (Frisch & Waugh, Econometrica 1 (1933) 387): an equation
    with all of c would count P c twice.
    """
    if table.fitted_degree < 0:
        return tuple(candidates)
    fit = _Polynomial(table)
    return tuple(
        replace(candidate, members=tuple(fit.without(member) for member in candidate.members))
        for candidate in candidates
    )


def refitted(table: ResidualTable) -> ResidualTable:
    """A table of readings less their own polynomial, after some of them were set aside."""
    if table.fitted_degree < 0:
        return table
    errors = np.where(table.there[:, :, None], table.errors, 0.0)
    left = _Polynomial(table).left_of(errors)
    return replace(table, errors=np.where(table.there[:, :, None], left, np.nan))


class _Polynomial:
    """The polynomial of the component over its measured cells."""

    def __init__(self, table: ResidualTable) -> None:
        self.there = table.there
        self.dimension = 1 if table.unit == "um" else 0
        self.axis = table.axes[0] if table.axes[0] in AXES else None
        self.centre, self.degree = 0.0, 0
        position = np.zeros(self.there.shape)
        if self.axis is not None and table.fitted_degree > 0:
            position = np.broadcast_to(table.places[..., AXES.index(self.axis)], self.there.shape)
            self.degree = table.fitted_degree
            self.centre = float(np.mean(position[self.there]))
        self.position = position - self.centre
        scale = max(float(np.abs(self.position).max()), 1e-300)
        self.powers = np.stack(
            [(self.position / scale) ** n for n in range(self.degree + 1)], axis=-1
        )
        X = self.powers[self.there]
        # By one matrix for all columns: (X'X)^-1 X'.
        self.solve = least_squares(X, np.zeros(len(X))).unscaled_covariance @ X.T
        self.scales = scale ** np.arange(self.degree + 1)

    def without(self, member: Member) -> Member:
        """A member less its polynomial part."""
        columns: list[Column] = []
        tangents: list[Column] = []
        equations = dict(member.equations)
        for (name, unit), column in zip(member.parameters, member.columns, strict=True):
            own = {}
            for axis, values in column.items():
                left, coefficients = self._left(values)
                own[axis] = left
                if equations and np.any(coefficients):
                    key = next(iter(equations))
                    dimension = self.dimension - PARAMETER_UNITS[unit].dimension
                    equations[key] += f" - {name}*({self._text(coefficients, dimension)})"
            columns.append(own)
        tangents += [{a: self._left(v)[0] for a, v in column.items()} for column in member.tangent]
        return replace(member, columns=tuple(columns), tangent=tuple(tangents), equations=equations)

    def left_of(self, errors: FloatArray) -> FloatArray:
        """Errors (P, H, 1) less their own least-squares polynomial over the measured cells."""
        found = self.solve @ errors[..., 0][self.there]
        left: FloatArray = errors - (self.powers @ found)[..., None]
        return left

    def _left(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        whole = np.broadcast_to(values, self.there.shape)
        if values.shape[1] == 1:
            # What differs from pass to pass alone has a mean and no shape along the axis.
            mean = float(whole[self.there].mean())
            return values - mean, np.array([mean])
        found = self.solve @ whole[self.there]
        size = float(np.abs(whole).max())
        found[np.abs(found) <= NOTHING * size] = 0.0
        if not found[1:].any():
            return values - found[0], found / self.scales
        left = whole - self.powers @ found
        alike = values.shape[0] == 1 and not np.ptp(self.position, axis=0).any()
        return (left[:1] if alike else left), found / self.scales

    def _text(self, coefficients: FloatArray, dimension: int) -> str:
        """The polynomial in the equation language, of a power of length as what it stands beside.

        The language takes a literal factor for a pure number: (1 + 0*x) is a length of 1 mm.
        """
        terms = []
        place = f"({self.axis} - {self.centre!r})" if self.centre else str(self.axis)
        length = f"(1 + 0*{self.axis})"
        for power, value in enumerate(coefficients.tolist()):
            if value == 0 and power:
                continue
            text = repr(value) + (f"*{place}" if power else "")
            text += f"**{power}" if power > 1 else ""
            missing = dimension - power if self.axis else 0
            if missing:
                text += f"{'*' if missing > 0 else '/'}{length}**{abs(missing)}"
            terms.append(text)
        return " + ".join(terms)
