"""From the errors of an axis to the table of its control, and what the table will leave.

Errors e = actual - nominal. With the table t a control moves to nominal - t, so that e - t is left:
after the quantum, the zero rule and the linear interpolation of the control. A new test of as many
runs scatters about that by what the means of the first one do not know, and by its own scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mtu_cli.findings import Finding, error, finding
from mtu_cli.formats.control.errors import Controller, ErrorTable, Parameters
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.pass_tests import FTest, f_test
from mtu_cli.stats.streams import stream
from mtu_cli.units import ARCSEC, UM

TRIALS = 10_000
MOST_MOVES = 7
"""Targets of the verification, in both directions."""
VARIES_SHARE, VARIES_P = 0.25, 0.01
"""Backlash varies where its range is a larger share of its mean, and chance is so improbable."""
VERDICTS = {0.0: "worked", 1.0: "no-effect", 2.0: "wrong-sign"}
SAME_PLACE = 1e-3
"""mm: a verification reading this near a target is of that target."""


class Block(NamedTuple):
    """What one run adds to the errors (2T,): `root` (2T, k) of its covariance, with `dof`."""

    root: FloatArray
    dof: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisErrors:
    """Errors of one axis at `targets` (T,), mm, in the frame of the readings.

    `means` (2, T) forward and reverse, mm or rad; `ways` 1 or 2 directions were measured. `runs`
    tests stand behind them; `blocks` are lines of passes and scatter about them, `known` (2T, 2T)
    the covariance of what was not read but stated. `varies`: the F test of backlash over targets.
    """

    targets: FloatArray
    means: FloatArray
    ways: int
    runs: int
    blocks: tuple[Block, ...] = ()
    known: FloatArray | None = None
    varies: FTest | None = None
    angle: bool = False
    read: bool = True

    @property
    def backlash(self) -> FloatArray | None:
        """Forward minus reverse (T,); None of one direction."""
        return None if self.ways == 1 else np.asarray(self.means[0] - self.means[1])

    def of_run(self) -> FloatArray:
        """The covariance (2T, 2T) of the readings of one run."""
        size = 2 * len(self.targets)
        return sum((b.root @ b.root.T for b in self.blocks), np.zeros((size, size)))

    def of_means(self) -> FloatArray:
        """The covariance (2T, 2T) of the means: the table's own."""
        own = self.of_run() / self.runs if self.read else np.zeros_like(self.of_run())
        return own if self.known is None else own + self.known

    def draw(self, trials: int, seed: int) -> FloatArray:
        """What a new test of as many runs differs by (trials, 2, T): each variance over chi-squared
        with its own degrees of freedom (the scale of the table's error and of the new test's).
        """
        rng, T = stream(seed, 49), len(self.targets)
        found = np.zeros((trials, 2 * T))
        share = np.sqrt((2.0 if self.read else 1.0) / self.runs)
        for root, dof in self.blocks:
            scale = np.ones(trials) if np.isinf(dof) else np.sqrt(dof / rng.chisquare(dof, trials))
            z = rng.standard_normal((trials, root.shape[1]))
            found += share * scale[:, None] * (z @ root.T)
        if self.known is not None:
            found += rng.standard_normal((trials, 2 * T)) @ root_of(self.known).T
        return found.reshape(trials, 2, T)


def root_of(C: FloatArray) -> FloatArray:
    """A root of a covariance, negative eigenvalues as 0."""
    values, vectors = np.linalg.eigh(C)
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))


def axis_errors(
    position: FloatArray, way: IntArray, value: FloatArray, run: IntArray, *, angle: bool = False
) -> AxisErrors:
    """Means by target and direction (`way` +1, -1, 0 unknown) of readings (n,) in runs (n,), and
    their scatter: a line of each pass, jointly in a run, and what is left about the lines.
    """
    targets, at = np.unique(np.round(position, 6), return_inverse=True)
    T, back = len(targets), (way < 0).astype(int)
    ways = len(np.unique(back))
    back = back if ways == 2 else np.zeros_like(back)
    cell = back * T + at.reshape(-1)
    counts = np.bincount(cell, minlength=2 * T)[: ways * T]
    if (counts == 0).any():
        where = float(targets[int(np.argmin(counts)) % T])
        reason = f"target {where:g} mm was read in one direction only, others in both"
        raise error("not-applicable", reason=reason, expected="every target in both directions")
    means = np.bincount(cell, value, minlength=ways * T) / counts
    blocks, runs = _scatter(targets, cell, value - means[cell], run, ways, counts)
    both = means.reshape(ways, T)
    return AxisErrors(
        targets=targets,
        means=np.vstack([both[0], both[-1]]),
        ways=ways,
        runs=runs,
        blocks=blocks,
        varies=_varies(cell, value, run, T) if ways == 2 else None,
        angle=angle,
    )


def _scatter(
    targets: FloatArray,
    cell: IntArray,
    residual: FloatArray,
    run: IntArray,
    ways: int,
    counts: IntArray,
) -> tuple[tuple[Block, ...], int]:
    """The blocks of one run, and the runs behind a mean; none where nothing was repeated."""
    T, numbers = len(targets), np.unique(run)
    R = len(numbers)
    middle, half = targets.mean(), float(np.ptp(targets)) / 2 or 1.0
    line = np.column_stack([np.ones(T), (targets - middle) / half])[:, : min(2, T - 1) or 1]
    X = np.kron(np.eye(ways), line)
    lines, left = np.zeros((R, X.shape[1])), residual.copy()
    for i, number in enumerate(numbers):
        rows = run == number
        lines[i] = np.linalg.lstsq(X[cell[rows]], residual[rows], rcond=None)[0]
        left[rows] -= X[cell[rows]] @ lines[i]
    if R < 2:
        # Repeats without pass numbers: nothing is known to be shared.
        dof = len(residual) - ways * T
        s = np.sqrt(float(residual @ residual) / dof) if dof > 0 else 0.0
        plain = (Block(_doubled(s * np.eye(ways * T), ways), float(dof)),) if s else ()
        return plain, max(int(counts.min()), 1)
    S = lines.T @ lines / (R - 1)
    dof = len(residual) - ways * T - X.shape[1] * (R - 1)
    blocks = [Block(_doubled(X @ root_of(S), ways), float(R - 1))]
    if dof > 0:
        s = np.sqrt(float(left @ left) / dof)
        apart = s * (np.eye(ways * T) - X @ np.linalg.pinv(X))
        blocks.append(Block(_doubled(apart, ways), float(dof)))
    return tuple(blocks), R


def _doubled(root: FloatArray, ways: int) -> FloatArray:
    """Of one direction: reverse is forward."""
    return root if ways == 2 else np.vstack([root, root])


def _varies(cell: IntArray, value: FloatArray, run: IntArray, T: int) -> FTest | None:
    """Two-way analysis of variance of forward - reverse by target and run, where complete."""
    numbers, index = np.unique(run, return_inverse=True)
    R = len(numbers)
    place = index.reshape(-1) * 2 * T + cell
    counts = np.bincount(place, minlength=2 * T * R)
    if (counts == 0).any():
        return None
    means = (np.bincount(place, value, minlength=2 * T * R) / counts).reshape(R, 2, T)
    B = means[:, 0] - means[:, 1]
    rest = B - B.mean(0) - B.mean(1)[:, None] + B.mean()
    df = (T - 1) * (R - 1)
    between = R * float(np.var(B.mean(0), ddof=1)) if T > 1 else 0.0
    return f_test(between, float((rest**2).sum()) / df if df else 0.0, T - 1, df)


class Figures(NamedTuple):
    """E, M and rms of the mean errors of both directions, and B, in mm or rad; B is nan of one."""

    E: FloatArray
    B: FloatArray
    M: FloatArray
    rms: FloatArray


def figures(means: FloatArray, ways: int) -> Figures:
    """Systematic figures of ISO 230-2 of means (..., 2, T): E = max - min of both directions, B the
    largest |forward - reverse|, M the range of the mean of both; rms over all of them.
    """
    both = means[..., 0, :] - means[..., 1, :]
    B = np.abs(both).max(-1) if ways == 2 else np.full(means.shape[:-2], np.nan)
    middle = means.mean(-2)
    E = means.max((-1, -2)) - means.min((-1, -2))
    return Figures(E, B, np.ptp(middle, axis=-1), np.sqrt((means**2).mean((-1, -2))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Where the part's zero lies in machine coordinates, and whether the axis runs backwards."""

    zero: float = 0.0
    reverse: bool = False

    @property
    def says(self) -> str:
        """For the file."""
        way = "the other way" if self.reverse else "as the readings"
        return (
            f"Positions are machine coordinates: zero of the readings at {self.zero:g}, axis {way}."
        )

    def table(self, errors: AxisErrors, both: bool) -> ErrorTable:
        """The errors in machine coordinates."""
        forward, reverse = errors.means
        table = ErrorTable(
            at=errors.targets + self.zero, forward=forward, reverse=reverse, both=both,
            angle=errors.angle,
        )  # fmt: skip
        if not self.reverse:
            return table
        return replace(
            table,
            at=self.zero - errors.targets[::-1],
            forward=-reverse[::-1],
            reverse=-forward[::-1],
        )

    def applied(self, table: ErrorTable, targets: FloatArray) -> FloatArray:
        """What a table applies (2, T) at targets of the readings."""
        if not self.reverse:
            return table.at_places(targets + self.zero)
        return -table.at_places(self.zero - targets)[::-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """How the table is to be: direction, positions (`low`, `high`, `step`, machine coordinates),
    reference, frame, and the table that was active while measuring.
    """

    direction: str | None = None
    positions: tuple[float, float, float] | None = None
    reference: float | None = None
    frame: Frame = Frame()
    current: ErrorTable | None = None


class Move(NamedTuple):
    """A verification move and the errors that are expected there, mm."""

    command: float
    direction: str
    without: float
    with_table: float
    wrong_sign: float
    u: float


class Verified(NamedTuple):
    """The slope k of readings on the applied table, and what it says."""

    verdict: str
    k: float
    u: float
    interval95: tuple[float, float]
    p: float


class Point(NamedTuple):
    """A point of the table: errors asked for and held, mm or rad."""

    position: float
    forward: float
    reverse: float
    held_forward: float
    held_reverse: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CompensateResult:
    """The table of a control. `asked` is its errors before the quantum, `held` as read back from
    `text`; `after` (trials,) each; None where no scatter is known.
    """

    component: str
    controller: Controller | None
    direction: str
    asked: ErrorTable
    held: ErrorTable
    text: str
    quantum: float
    reference: float | None
    errors: AxisErrors | None = None
    before: Figures | None = None
    after: Figures | None = None
    moves: tuple[Move, ...] = ()
    verified: Verified | None = None
    warnings: tuple[Finding, ...] = ()

    @property
    def unit(self) -> str:
        """Of errors."""
        return "arcsec" if self.asked.angle else "um"

    @property
    def size(self) -> float:
        """Of that unit."""
        return ARCSEC if self.asked.angle else UM

    @property
    def points(self) -> list[Point]:
        """The points of the table."""
        columns = (self.asked.at, *self.asked.errors, *self.held.errors)
        return [Point(*map(float, row)) for row in zip(*columns, strict=True)]


def compensate(
    errors: AxisErrors,
    control: Controller,
    parameters: Parameters,
    wanted: Wanted,
    *,
    component: str = "",
    seed: int = 1,
    trials: int | None = None,
) -> CompensateResult:
    """The table of a control for the errors of an axis, read back, with what it will leave.

    Raises InputError for a table that the format cannot hold, or that comes back otherwise.
    """
    two = control.two(parameters)
    direction = wanted.direction or ("both" if two and errors.ways == 2 else "mean")
    if direction == "both" and not two:
        reason = f"{control.name} has one column for both directions"
        raise error("not-applicable", reason=reason, expected="--direction mean or forward")
    table = _as_asked(_one_way(errors, direction), errors, wanted)
    reference = wanted.reference
    if reference is None:
        reference = 0.0 if np.any(np.abs(table.at) < SAME_PLACE) else float(table.at[0])
    table = control.zero(table, reference)
    text = control.text(table, parameters, wanted.frame.says)
    held = _read_back(control, parameters, text, table)
    applied = wanted.frame.applied(held, errors.targets)
    if wanted.current is not None:
        applied = applied - wanted.frame.applied(wanted.current, errors.targets)
    left = errors.means - applied
    after = None
    if errors.blocks or errors.known is not None:
        after = figures(left + errors.draw(trials or TRIALS, seed), errors.ways)
    return CompensateResult(
        component=component,
        controller=control,
        direction=direction,
        asked=table,
        held=held,
        text=text,
        quantum=control.resolution(table, parameters),
        reference=control.zero_at(table, reference),
        errors=errors,
        before=figures(errors.means, errors.ways),
        after=after,
        moves=() if errors.angle else _moves(errors, applied),
        warnings=tuple(_warnings(errors, component, after)),
    )


def _one_way(errors: AxisErrors, direction: str) -> AxisErrors:
    forward, reverse = errors.means
    if direction == "both":
        return errors
    one = forward if direction == "forward" else (forward + reverse) / 2
    return replace(errors, means=np.vstack([one, one]))


def _as_asked(chosen: AxisErrors, errors: AxisErrors, wanted: Wanted) -> ErrorTable:
    """The table in machine coordinates, at its targets or at equal steps, with the current one."""
    both = not np.array_equal(*chosen.means)
    frame = wanted.frame
    if frame.reverse and wanted.direction == "forward":
        # Forward of the machine is reverse of the readings.
        chosen = replace(chosen, means=np.vstack([errors.means[1], errors.means[1]]))
    table, current = frame.table(chosen, both), wanted.current
    at = table.at
    if current is not None:
        inside = (current.at > at[0]) & (current.at < at[-1])
        at = np.unique(np.round(np.concatenate([at, current.at[inside]]), 6))
    if wanted.positions is not None:
        low, high, step = wanted.positions
        at = np.asarray(low + step * np.arange(round((high - low) / step) + 1))
        if at[0] < table.at[0] - SAME_PLACE or at[-1] > table.at[-1] + SAME_PLACE:
            place = {"path": "--from, --to", "value": f"{at[0]:g} to {at[-1]:g} mm"}
            expected = f"within the targets, {table.at[0]:g} to {table.at[-1]:g} mm of the machine"
            raise error("out-of-range", **place, expected=expected)
    values = table.at_places(at)
    if current is not None:
        values = values + current.at_places(at)
        both = both or current.both
    return replace(table, at=at, forward=values[0], reverse=values[1], both=both)


def _read_back(
    control: Controller, parameters: Parameters, text: str, table: ErrorTable
) -> ErrorTable:
    """What the control will hold; raises InputError where it is not what was asked for."""
    held = control.read_back(text, parameters)
    quantum = control.resolution(table, parameters)
    far = np.abs(held.at - table.at).max() if len(held.at) == len(table.at) else np.inf
    off = np.abs(held.errors - table.errors).max() if np.isfinite(far) else np.inf
    if far > max(quantum, 1e-6) or off > quantum * (0.5 + 1e-6):
        reason = f"read back it is {off:.3g} off what was asked for, more than half of {quantum:g}"
        raise error("not-writable", reason=reason)
    return held


def _moves(errors: AxisErrors, applied: FloatArray) -> tuple[Move, ...]:
    """Moves to targets over the whole length, and to those of the largest and least change."""
    T = len(errors.targets)
    chosen = set(np.linspace(0, T - 1, min(T, MOST_MOVES - 2)).round().astype(int).tolist())
    chosen |= {int(applied.mean(0).argmax()), int(applied.mean(0).argmin())}
    u = np.sqrt(np.diag(errors.of_run() + errors.of_means())).reshape(2, T)
    names = ("forward", "reverse")[: errors.ways]
    found = []
    for way, name in enumerate(names):
        for t in sorted(chosen, reverse=way == 1):
            e, change = float(errors.means[way, t]), float(applied[way, t])
            place = float(errors.targets[t])
            found.append(Move(place, name, e, e - change, e + change, float(u[way, t])))
    return tuple(found)


def _warnings(errors: AxisErrors, component: str, after: Figures | None) -> list[Finding]:
    found = []
    B, test = errors.backlash, errors.varies
    if B is not None and test is not None:
        spread = float(np.ptp(B))
        if spread > VARIES_SHARE * abs(float(B.mean())) and test.p < VARIES_P:
            facts = {"component": component, "p": test.p, "range_um": spread / UM}
            found.append(finding("backlash-varies", **facts, mean_um=float(B.mean()) / UM))
    if after is None:
        facts = {"quantity": "figures after compensation", "names": [component]}
        found.append(finding("not-estimable", **facts, reason="one run shows no scatter"))
    return found


def verify(
    result: CompensateResult,
    applied: FloatArray,
    position: FloatArray,
    way: IntArray,
    value: FloatArray,
    run: IntArray,
) -> Verified:
    """The verdict of readings (n,) of the verification moves: reading = e - t + k t + offset.

    k by generalised least squares; 0: the table worked, 1: no effect, 2: wrong sign. The covariance
    is that of the first means and of the new runs. `applied` (2, T): t at the targets. Of a table
    that is noise itself k shrinks by the share of noise in its variance, which is added to u.

    Raises InputError for readings away from the targets, or too few.
    """
    errors = result.errors
    assert errors is not None
    at = np.abs(position[:, None] - errors.targets).argmin(1)
    away = np.abs(position - errors.targets[at]) > SAME_PLACE
    if away.any():
        expected = "readings at the targets of the first test"
        where = f"{position[int(np.argmax(away))]:g} mm is no target"
        raise error("not-applicable", reason=where, expected=expected)
    index = ((way < 0).astype(int) if errors.ways == 2 else 0) * len(errors.targets) + at
    t, e = applied.reshape(-1)[index], errors.means.reshape(-1)[index]
    if len(np.unique(index)) < 3 or len(t) < 4 or np.ptp(t) == 0:
        what = "a verdict needs four readings, at three places where the table differs"
        raise error("too-little-data", what=what)
    cells = np.ix_(index, index)
    V = errors.of_means()[cells] + np.eye(len(t)) * (result.quantum**2 / 12)
    X = np.column_stack([t, np.ones(len(t))])
    dof = min((b.dof for b in errors.blocks), default=float(len(t) - 2))
    for i, block in enumerate(errors.blocks):
        # Lines are shared by a run, what scatters about them is each reading's own.
        C = block.root @ block.root.T
        V = V + (np.eye(len(t)) * C.diagonal().mean() if i else C[cells] * (run[:, None] == run))
    if not errors.blocks:
        left = value - e + t - X @ np.linalg.lstsq(X, value - e + t, rcond=None)[0]
        V = V + np.eye(len(t)) * (left @ left) / (len(t) - 2)
    weighted = np.linalg.solve(V, X)
    C = np.linalg.inv(X.T @ weighted)
    k = float((C @ (weighted.T @ (value - e + t)))[0])
    u = float(np.hypot(np.sqrt(C[0, 0]), _noise_share(errors, index, applied.reshape(-1))))
    half = coverage_factor(0.95, dof) * u
    inside = [name for slope, name in VERDICTS.items() if abs(k - slope) <= half]
    verdict = inside[0] if len(inside) == 1 else "too-small-to-tell" if inside else "partly"
    return Verified(verdict, k, u, (k - half, k + half), _p(k, u, dof))


def _noise_share(errors: AxisErrors, index: IntArray, applied: FloatArray) -> float:
    """The share of the first test's noise in the variance of a table, level aside: at most 1."""
    cells = np.unique(index)
    M = np.eye(len(cells)) - 1.0 / len(cells)
    noise = float(np.trace(M @ errors.of_means()[np.ix_(cells, cells)] @ M))
    return min(1.0, noise / float(applied[cells] @ M @ applied[cells]))


def _p(k: float, u: float, dof: float) -> float:
    """Of the nearest of the three slopes, two-sided."""
    from scipy.special import ndtr, stdtr

    t = -min(abs(k - slope) for slope in VERDICTS) / u
    return float(2 * (ndtr(t) if np.isinf(dof) else stdtr(dof, t)))


def moves_program(result: CompensateResult, feed: float, dwell_s: float, axis: str) -> str:
    """G-code of the verification moves: every target approached from its own side, with an overrun
    at the reversals.
    """
    assert result.errors is not None
    targets = result.errors.targets
    overrun = max(1.0, 0.02 * float(np.ptp(targets)))
    low, high = targets[0] - overrun, targets[-1] + overrun

    def lines(moves: Sequence[Move], begin: float) -> list[str]:
        stops = [f"G1 {axis}{move.command:.4f} F{feed:g}\nG4 P{dwell_s:g}" for move in moves]
        return [f"G1 {axis}{begin:.4f} F{feed:g}", *stops] if moves else []

    ways = {
        name: [m for m in result.moves if m.direction == name] for name in ("forward", "reverse")
    }
    return "\n".join(
        [
            f"(verification of the compensation of {result.component}: read at every dwell)",
            f"(overrun {overrun:g} mm beyond the end targets: check the limits of the axis)",
            "(coordinates of the readings: set the work offset of that test)",
            *("G21", "G90", "G94"),
            *lines(ways["forward"], low),
            *lines(ways["reverse"], high),
            *("M30", ""),
        ]
    )
