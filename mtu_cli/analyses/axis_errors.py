"""The errors of one axis, with what they scatter by: of readings of a component, as a machine file
states a component or an effect, and the sum of several.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.iso230 import check_places, places_read
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.readings import Readings
from mtu_cli.findings import error, suggestion
from mtu_cli.model.estimates import Estimates, known_component
from mtu_cli.model.machine_model import AXES, component_alone, coordinates_of, design, effect_alone
from mtu_cli.model.prediction import component_blocks
from mtu_cli.model.visits import passes_read
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.pass_tests import FTest, f_test
from mtu_cli.units import LENGTH, UNITS

POINTS = 11
"""Positions over the travel, where there is no table."""


class Block(NamedTuple):
    """What one run adds to the errors (2T,): `root` (2T, k) of its covariance, with `dof`;
    `shared` by all its readings, as a line is, or independent by reading.
    """

    root: FloatArray
    dof: float
    shared: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisErrors:
    """Errors of one axis at `targets` (T,), mm (of a `rotary` axis deg), in the readings' frame.

    `means` (2, T) forward and reverse, mm or rad, `expected` (2, T) what the axis most likely has;
    `ways` 1 or 2 directions were measured. `runs` tests stand behind them, none where they are
    stated and not `read`; `blocks` are lines of passes and scatter about them, `known` (2T, 2T) the
    covariance of what was stated. `varies`: the F test of backlash over targets. `angle`: the
    errors are angles.
    """

    targets: FloatArray
    means: FloatArray
    expected: FloatArray
    known: FloatArray
    ways: int = 1
    runs: int = 1
    blocks: tuple[Block, ...] = ()
    varies: FTest | None = None
    angle: bool = False
    rotary: bool = False
    read: bool = True

    def plus(self, values: FloatArray, covariance: FloatArray, turns: bool) -> AxisErrors:
        """With what a machine file states of another component or effect at the same targets."""
        means, expected = self.means + values, self.expected + values
        known, ways = self.known + covariance, 2 if turns else self.ways
        return replace(self, means=means, expected=expected, ways=ways, known=known)

    @property
    def backlash(self) -> FloatArray | None:
        """Forward minus reverse (T,); None of one direction."""
        return None if self.ways == 1 else np.asarray(self.means[0] - self.means[1])

    def of_run(self) -> FloatArray:
        """The covariance (2T, 2T) of the readings of one run."""
        return sum((b.root @ b.root.T for b in self.blocks), np.zeros((self.means.size,) * 2))

    def of_means(self) -> FloatArray:
        """The covariance (2T, 2T) of the means, that of the table."""
        return self.of_run() * (1.0 / self.runs) + self.known

    def draw(self, trials: int, seed: int) -> FloatArray:
        """What a new test of as many runs differs by (trials, 2, T): each variance over chi-squared
        with its degrees of freedom (the scale of the table's error and of the new test's). Of
        `expected` the backlash of a target has K of its variance in `means`.
        """
        rng, size = stream(seed, 49), self.means.size
        result = np.zeros((trials, size))
        share = np.sqrt(2.0 / self.runs)
        for root, dof, _ in self.blocks:
            scale = np.ones(trials) if np.isinf(dof) else np.sqrt(dof / rng.chisquare(dof, trials))
            z = rng.standard_normal((trials, root.shape[1]))
            result += share * scale[:, None] * (z @ root.T)
        if self.known.any():
            result += rng.standard_normal((trials, size)) @ covariance_root(self.known).T
        draws = result.reshape(trials, 2, -1)
        return draws - (1.0 - np.sqrt((1.0 + reversal_share(self.varies)) / 2)) * reversal_of(draws)


def reversal_share(varies: FTest | None) -> float:
    """K = max(0, 1 - 1/F), the share of the variance of backlash over targets that is not scatter
    (James and Stein 1961, "Estimation with quadratic loss"); 1 where no F is known.
    """
    return 1.0 if varies is None or varies.F <= 0 else max(0.0, 1.0 - 1.0 / varies.F)


def reversal_of(errors: FloatArray) -> FloatArray:
    """Half the backlash of errors (..., 2, T) less its mean over targets, with the sign of each
    direction (..., 2, T).
    """
    half = (errors[..., 0, :] - errors[..., 1, :]) / 2
    half = half - half.mean(-1, keepdims=True)
    return np.stack([half, -half], -2)


def axis_errors(
    position: FloatArray, way: IntArray, value: FloatArray, run: IntArray, *, angle: bool = False,
    rotary: bool = False,
) -> AxisErrors:  # fmt: skip
    """Means by target and direction (`way` +1, -1, 0 unknown) of readings (n,) in runs (n,), and
    their scatter: a line of each pass, jointly in a run, and the residuals about the lines.
    Backlash is expected as its means drawn to their average over targets by 1 - K: the largest of
    the means themselves would be too large.
    """
    targets, at = np.unique(np.round(position, 6), return_inverse=True)
    T, back = len(targets), (way < 0).astype(int)
    ways = len(np.unique(back))
    cell = (back * T if ways == 2 else 0) + at.reshape(-1)
    counts = np.bincount(cell, minlength=2 * T)[: ways * T]
    if (counts == 0).any():
        where = float(targets[int(np.argmin(counts)) % T])
        reason = f"target {where:g} was read in one direction only, others in both"
        raise error("not-applicable", reason=reason, expected="every target in both directions")
    means = np.bincount(cell, value, minlength=ways * T) / counts
    blocks, runs = _scatter(targets, cell, value - means[cell], run, ways, counts)
    # Two-way analysis of variance of forward - reverse by target and run, where complete.
    varies, (numbers, index) = None, np.unique(run, return_inverse=True)
    place, R = index.reshape(-1) * 2 * T + cell, len(numbers)
    of_run = np.bincount(place, minlength=2 * T * R)
    if ways == 2 and T > 1 and of_run.all():
        each = (np.bincount(place, value, minlength=2 * T * R) / of_run).reshape(R, 2, T)
        B = each[:, 0] - each[:, 1]
        rest = B - B.mean(0) - B.mean(1)[:, None] + B.mean()
        df = (T - 1) * (R - 1)
        between = R * float(np.var(B.mean(0), ddof=1))
        varies = f_test(between, float((rest**2).sum()) / max(df, 1), T - 1, df)
    both = means.reshape(ways, T)[[0, -1]]
    return AxisErrors(
        targets=targets,
        means=both,
        expected=both - (1.0 - reversal_share(varies)) * reversal_of(both),
        ways=ways,
        runs=runs,
        blocks=blocks,
        varies=varies,
        known=np.zeros((both.size, both.size)),
        angle=angle,
        rotary=rotary,
    )


def _scatter(
    targets: FloatArray, cell: IntArray, residual: FloatArray, run: IntArray, ways: int,
    counts: IntArray,
) -> tuple[tuple[Block, ...], int]:  # fmt: skip
    """The blocks of one run, and the runs behind a mean; none where nothing was repeated."""
    T, numbers = len(targets), np.unique(run)
    R, rest = len(numbers), len(residual) - ways * T
    # Of one direction reverse is forward.
    spread = np.kron(np.eye(2) if ways == 2 else np.ones((2, 1)), np.eye(T))
    if R < 2:
        # Repeats without pass numbers: nothing is known to be shared.
        s = np.sqrt(float(residual @ residual) / rest) if rest > 0 else 0.0
        blocks = (Block(np.asarray(s * spread), float(rest)),) if s else ()
        return blocks, max(int(counts.min()), 1)
    middle, half = targets.mean(), float(np.ptp(targets)) / 2 or 1.0
    line = np.column_stack([np.ones(T), (targets - middle) / half])[:, : min(2, T - 1) or 1]
    X = np.kron(np.eye(ways), line)
    lines, scatter = np.zeros((R, X.shape[1])), residual.copy()
    for i, number in enumerate(numbers):
        rows = run == number
        lines[i] = np.linalg.lstsq(X[cell[rows]], residual[rows], rcond=None)[0]
        scatter[rows] -= X[cell[rows]] @ lines[i]
    root = spread @ X @ covariance_root(lines.T @ lines / (R - 1))
    of_lines = [Block(root, float(R - 1), shared=True)]
    dof = rest - X.shape[1] * (R - 1)
    if dof > 0:
        s = np.sqrt(float(scatter @ scatter) / dof)
        root = s * spread @ (np.eye(ways * T) - X @ np.linalg.pinv(X))
        of_lines.append(Block(root, float(dof)))
    return tuple(of_lines), R


# As the machine file states them.


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """A component or an effect of a machine file that is an error along one `axis`, in the
    direction of the axis `output` (y of a straightness of x in y); `at_mm` of a table.
    """

    name: str
    axis: str
    output: str
    angle: bool = False
    at_mm: FloatArray | None = None

    def default_positions(self, machine: LoadedMachine) -> FloatArray:
        """The positions of its table, or equal steps over the travel of its axis."""
        if self.at_mm is not None:
            return self.at_mm
        if self.axis not in machine.machine.travels:
            expected = "axes: in the machine file, or --from, --to, --step"
            raise error("missing-input", what=f"the travel of {self.axis}", expected=expected)
        return np.linspace(*machine.machine.travels[self.axis], POINTS)

    def errors_at(
        self, machine: LoadedMachine, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray, bool]:
        """Its errors (2, n) by the machine file, forward and reverse at `positions` (n,) mm, in mm
        or rad, their covariance (2n, 2n), and whether the directions differ.

        Raises InputError for a component without coefficients.
        """
        entry = machine.machine.components.get(self.name)
        if entry is None:
            model = effect_alone(
                machine, [x.name for x in machine.machine.effects].index(self.name)
            )
        elif entry.coefficients is None:
            expected = "readings of it, or coefficients in the machine file"
            raise error("missing-input", what=f"an estimate of {self.name}", expected=expected)
        else:
            model = component_alone(self.name, self.axis, known_component(self.name, entry))
        way, points = f"dir_{self.axis}", np.full((2 * len(positions), 3), np.nan)
        points[:, AXES.index(self.axis)] = np.tile(positions, 2)
        rows = design(model, points, {way: np.repeat([1.0, -1.0], len(positions))})
        blocks = component_blocks(model, rows.J, rows.levers)
        covariance = np.sum([block.G @ block.C @ block.G.T for block in blocks], axis=0)
        return rows.mean.reshape(2, -1), covariance, way in model.covariates()


def known_names(machine: LoadedMachine) -> list[str]:
    """What a table may be made of: components and effects."""
    return [*machine.machine.components, *(each.name for each in machine.machine.effects)]


def stated(machine: LoadedMachine, name: str) -> Stated:
    """The component or effect of this name; raises InputError for none along one axis."""
    names_known = known_names(machine)
    if name not in names_known:
        near = suggestion(name, names_known)
        raise error("unknown-name", path="--component", what="component", value=name, **near)
    axis, angle, component = "", False, machine.machine.components.get(name)
    if component is not None:
        if component.of is None:
            raise error("not-applicable", reason=f"{name} is a constant: no table of an axis")
        angle, axis, at = UNITS[component.unit].dimension != LENGTH, component.of, component.at_mm
        equations = [key for key, form in machine.forms.items() if name in form.coefficients]
    else:
        i = names_known.index(name) - len(machine.machine.components)
        model, components = effect_alone(machine, i), machine.machine.effects[i].components
        used = {*model.covariates(), *(x for k in model.axes for x in coordinates_of(model, k))}
        axes = {x.removeprefix("dir_") for x in used} & {*AXES}
        rest = used - {*axes, *(f"dir_{x}" for x in axes)}
        if len(model.axes) > 1 or len(axes) != 1 or rest or any(model.remainders.values()):
            depends = ", ".join(sorted(rest | axes)) or "several axes"
            reason = f"the effect {name} depends on {depends}: no table of one axis holds it"
            raise error("not-applicable", reason=reason)
        axis, equations = axes.pop(), [f"E{model.axes[0]}"]
        at = next((x.at_mm for x in components.values() if x.at_mm), None)
    return Stated(
        name=name,
        axis=axis,
        output=equations[0][1:] if len(equations) == 1 else axis,
        angle=angle,
        at_mm=None if at is None else np.array(at, float),
    )


def angle_between(machine: LoadedMachine, estimates: Estimates, name: str) -> float:
    """The angle less 90 degrees, rad, of a component that is one between two axes.

    Raises InputError for another component, and for one without an estimate.
    """
    entry, estimate = machine.machine.components.get(name), estimates.components.get(name)
    if entry is None or entry.of is not None or UNITS[entry.unit].dimension == LENGTH:
        reason, expected = f"{name} is no angle between two axes", "a component without `of`"
        raise error("not-applicable", reason=reason, expected=f"{expected}, such as axy")
    if estimate is None:
        expected = "readings of it, or coefficients in the machine file"
        raise error("missing-input", what=f"an estimate of {name}", expected=expected)
    return float(estimate.coefficients[0])


# Of a call: readings of one component, and what the machine file states of others.


def _rows(readings: Readings | None, name: str) -> IntArray:
    """The readings of a component."""
    if readings is None or name not in readings.components:
        return np.zeros(0, int)
    return np.flatnonzero(readings.code == readings.components.index(name))


def readings_along(
    readings: Readings, name: str, axis: str
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Position (mm, of a rotary axis deg), direction, error and run of the readings of a component.

    Raises InputError for one without a position.
    """
    rows = _rows(readings, name)
    position = places_read(readings)[0][rows]
    check_places(readings, rows, position)
    group, passes = passes_read(readings, rows, axis)
    direction = readings.direction[rows].astype(np.int64)
    return position, direction, readings.error[rows], passes.runs[group]


def errors_of(
    machine: LoadedMachine,
    readings: Readings | None,
    names: Sequence[str],
    positions: FloatArray | None,
    rotary: str,
) -> tuple[AxisErrors, list[Stated]]:
    """The errors of the one component that was read plus what the machine file states of the
    others, without readings of that alone, at `positions` (n,) mm or its own; and what they are of,
    the first that one. A rotary axis is called `rotary`.

    Raises InputError for what is not along one axis, and for readings of several components.
    """
    names = sorted(names, key=lambda name: not len(_rows(readings, name)))
    read = [name for name in names if len(_rows(readings, name))]
    if read[1:]:
        reason = f"there are readings of {' and '.join(read)}: those of one are compensated"
        raise error("not-applicable", reason=reason, expected="one of them")
    name, component = names[0], machine.machine.components.get(names[0])
    if readings and places_read(readings)[1][_rows(readings, name)].any():
        if names[1:]:
            reason = f"{name} is of a rotary axis: nothing is added to its readings"
            raise error("not-applicable", reason=reason)
        angle = component is not None and UNITS[component.unit].dimension != LENGTH
        columns = readings_along(readings, name, rotary)
        only = Stated(name=name, axis=rotary, output=rotary)
        return axis_errors(*columns, angle=angle, rotary=True), [only]
    summands = [stated(machine, each) for each in names]
    first, rest = summands[0], summands
    if any(each.axis != first.axis for each in rest):
        raise error("not-applicable", reason=f"{', '.join(names)} are not along one axis")
    if readings and read:
        errors = axis_errors(*readings_along(readings, name, first.axis), angle=first.angle)
        rest = rest[1:]
    else:
        at = first.default_positions(machine) if positions is None else positions
        none = np.zeros((2, len(at)))
        errors = AxisErrors(
            targets=at,
            means=none,
            expected=none,
            known=np.zeros((none.size, none.size)),
            angle=first.angle,
            read=False,
        )
    for each in rest:
        errors = errors.plus(*each.errors_at(machine, errors.targets))
    return errors, summands
