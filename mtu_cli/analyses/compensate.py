"""From the errors of an axis to the table of its control, and the errors that will remain.

Errors e = actual - nominal. With the table t a control moves to nominal - t, so that e - t remains,
after the quantum, the zero rule and the linear interpolation of the control. A new test of as many
runs scatters about that by the uncertainty of the means of the first one and by its scatter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtr

from mtu_cli.analyses.iso230 import TRIALS, WAYS, figures_of
from mtu_cli.findings import Finding, error, finding
from mtu_cli.formats.control.errors import Controller, ErrorTable, Parameters
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.pass_tests import FTest, f_test
from mtu_cli.units import ANGLE, LENGTH, SMALL, UM, Unit

MOST_MOVES = 7
"""Targets of the verification, in both directions."""
VARIES_SHARE, VARIES_P = 0.25, 0.01
"""Backlash varies where its range is a larger share of its mean, and chance is so improbable."""
UNLIKE_P = 0.05
"""Of verification readings, whatever k, by the scatter of the first test: an upper bound of p."""
VERDICTS = {0.0: "worked", 1.0: "no-effect", 2.0: "wrong-sign"}
SAME_PLACE = 1e-3
"""mm or deg: a verification reading this near a target is of that target."""


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
    ways: int = 1
    runs: int = 1
    blocks: tuple[Block, ...] = ()
    known: FloatArray | None = None
    varies: FTest | None = None
    angle: bool = False
    rotary: bool = False
    read: bool = True

    def plus(self, values: FloatArray, covariance: FloatArray, turns: bool) -> AxisErrors:
        """With what a machine file states of another component or effect at the same targets."""
        means, expected = self.means + values, self.expected + values
        known = covariance if self.known is None else self.known + covariance
        ways = 2 if turns else self.ways
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
        covariance = self.of_run() * (1.0 / self.runs if self.read else 0.0)
        return covariance if self.known is None else covariance + self.known

    def draw(self, trials: int, seed: int) -> FloatArray:
        """What a new test of as many runs differs by (trials, 2, T): each variance over chi-squared
        with its degrees of freedom (the scale of the table's error and of the new test's). Of
        `expected` the backlash of a target has K of its variance in `means`.
        """
        rng, size = stream(seed, 49), self.means.size
        result = np.zeros((trials, size))
        share = np.sqrt((2.0 if self.read else 1.0) / self.runs)
        for root, dof, _ in self.blocks:
            scale = np.ones(trials) if np.isinf(dof) else np.sqrt(dof / rng.chisquare(dof, trials))
            z = rng.standard_normal((trials, root.shape[1]))
            result += share * scale[:, None] * (z @ root.T)
        if self.known is not None:
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


def figures(means: FloatArray, ways: int) -> dict[str, FloatArray]:
    """Systematic figures of ISO 230-2 of means (..., 2, T), mm or rad: E = max - min of both
    directions, B the largest |forward - reverse| (nan of one direction), M the range of the mean of
    both; rms over all of them.
    """
    of = figures_of(means, np.full_like(means, np.nan))
    B = of["B"] if ways == 2 else np.full(means.shape[:-2], np.nan)
    return {"E": of["E"], "B": B, "M": of["M"], "rms": np.sqrt((means**2).mean((-1, -2)))}


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

    def places(self, positions: FloatArray) -> FloatArray:
        """Machine coordinates of rising positions of the readings, rising, too."""
        return self.zero - positions[::-1] if self.reverse else positions + self.zero

    def of_machine(self, places: FloatArray) -> FloatArray:
        """The readings' positions of rising machine coordinates."""
        return self.zero - places[::-1] if self.reverse else places - self.zero

    def turned(self, values: FloatArray) -> FloatArray:
        """Errors (2, n) of the readings' frame in that of the machine, or these in that."""
        return -values[::-1, ::-1] if self.reverse else values

    def applied(self, table: ErrorTable, targets: FloatArray) -> FloatArray:
        """What a table applies (2, T) at targets of the readings."""
        return self.turned(table.at_places(self.places(targets)))


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRequest:
    """How the table is to be: direction, positions (`low`, `high`, `step`, machine coordinates),
    reference, frame, and the table that was active while measuring.
    """

    direction: str | None = None
    positions: tuple[float, float, float] | None = None
    reference: float | None = None
    frame: Frame = Frame()
    current: ErrorTable | None = None

    @property
    def places(self) -> FloatArray | None:
        """Machine positions of its points; None: those of the targets."""
        if self.positions is None:
            return None
        low, high, step = self.positions
        return np.asarray(low + step * np.arange(round((high - low) / step) + 1))


class Move(NamedTuple):
    """A verification move to `command` (mm; deg of a rotary axis) and the errors expected there, mm
    or rad: without the table, with it, and with the wrong sign; `measured` after it.
    """

    command: float
    direction: str
    without: float
    with_table: float
    wrong_sign: float
    u: float
    measured: float | None = None


class Verified(NamedTuple):
    """The slope k of readings on the applied table, and its verdict; `misfit`: chi^2/(n - 2) of the
    readings about that, by the scatter of the first test; None where that shows none.
    """

    verdict: str
    k: float
    u: float
    interval95: tuple[float, float]
    p: float
    misfit: FTest | None


@dataclass(frozen=True, slots=True, kw_only=True)
class CompensateResult:
    """The table of a control. `asked` is its errors before the quantum, `held` as read back from
    `text`; `applied` (2, T) what it changes at the targets of `errors`. `before` and `after`
    (trials,) are figures by name, None where no scatter is known. Of a table that was only read
    there is no `errors`.
    """

    component: str
    controller: Controller
    direction: str
    asked: ErrorTable
    held: ErrorTable
    text: str = ""
    quantum: float = 0.0
    reference: float | None = None
    errors: AxisErrors | None = None
    applied: FloatArray | None = None
    before: dict[str, FloatArray] | None = None
    after: dict[str, FloatArray] | None = None
    moves: tuple[Move, ...] = ()
    verified: Verified | None = None
    warnings: tuple[Finding, ...] = ()

    @property
    def unit(self) -> Unit:
        """Of errors."""
        return SMALL[ANGLE if self.asked.angle else LENGTH]

    @property
    def backlash(self) -> FloatArray | None:
        """Forward minus reverse (T,), mm; None of one direction and of angles."""
        return None if self.errors is None or self.errors.angle else self.errors.backlash


def compensate(
    errors: AxisErrors, control: Controller, parameters: Parameters, request: TableRequest, *,
    component: str = "", seed: int = 1, trials: int | None = None,
) -> CompensateResult:  # fmt: skip
    """The table of a control for the errors of an axis, read back, with the errors that remain.

    Raises InputError for a table that the format cannot hold, or that comes back otherwise.
    """
    two, frame = control.two(parameters), request.frame
    direction = request.direction or ("both" if two and errors.ways == 2 else "mean")
    if direction == "both" and not two:
        reason = f"{control.name} has one column for both directions"
        raise error("not-applicable", reason=reason, expected="--direction mean or forward")
    table = _table(errors, direction, request)
    reference = request.reference
    if reference is None:
        reference = 0.0 if np.any(np.abs(table.at) < SAME_PLACE) else float(table.at[0])
    table = control.zero(table, reference)
    text = control.text(table, parameters, frame.says)
    readback = control.read_back(text, parameters)
    quantum = control.resolution(table, parameters)
    shift = np.abs(readback.at - table.at).max() if len(readback.at) == len(table.at) else np.inf
    gap = np.abs(readback.errors - table.errors).max() if np.isfinite(shift) else np.inf
    if shift > max(quantum, 1e-6) or gap > quantum * (0.5 + 1e-6):
        reason = f"read back it is {gap:.3g} off what was asked for, more than half of {quantum:g}"
        raise error("not-writable", reason=reason)
    applied = frame.applied(readback, errors.targets)
    if request.current is not None:
        applied = applied - frame.applied(request.current, errors.targets)
    before, after, warnings = figures(errors.means, errors.ways), None, list[Finding]()
    B, test = errors.backlash, errors.varies
    if B is not None and test is not None and not errors.angle and test.p < VARIES_P:
        size, mean = float(np.ptp(B)) / UM, float(B.mean()) / UM
        if size > VARIES_SHARE * abs(mean):
            facts = {"component": component, "p": test.p, "range_um": size, "mean_um": mean}
            warnings.append(finding("backlash-varies", **facts))
    if errors.read and errors.ways == 1:
        reason = "readings in one direction or without one: the other is taken to be alike"
        facts = {"quantity": "reversal", "names": [component], "reason": reason}
        warnings.append(finding("not-estimable", **facts))
    if errors.blocks or not errors.read:
        draws = errors.draw(trials or TRIALS, seed)
        after = figures(errors.expected - applied + draws, errors.ways)
    else:
        facts = {"quantity": "figures after compensation", "names": [component]}
        warnings.append(finding("not-estimable", **facts, reason="one run shows no scatter"))
    return CompensateResult(
        component=component,
        controller=control,
        direction=direction,
        asked=table,
        held=readback,
        text=text,
        quantum=quantum,
        reference=control.zero_at(table, reference),
        errors=errors,
        applied=applied,
        before=before,
        after=after,
        moves=_moves(errors, applied),
        warnings=tuple(warnings),
    )


def _table(errors: AxisErrors, direction: str, request: TableRequest) -> ErrorTable:
    """The table in machine coordinates, at its targets or at equal steps, with the current one."""
    frame, current = request.frame, request.current
    at, values = frame.places(errors.targets), frame.turned(errors.means)
    if direction == "forward":
        values = values[[0, 0]]
    elif direction == "mean":
        values = np.tile(values.mean(0), (2, 1))
    table = ErrorTable(at=at, errors=values, angle=errors.angle, rotary=errors.rotary)
    if current is not None:
        inside = (current.at > at[0]) & (current.at < at[-1])
        at = np.unique(np.round(np.concatenate([at, current.at[inside]]), 6))
    if (places := request.places) is not None:
        ends = table.at[[0, -1]]
        at = places
        if at[0] < ends[0] - SAME_PLACE or at[-1] > ends[1] + SAME_PLACE:
            place = {"path": "--from, --to", "value": f"{at[0]:g} to {at[-1]:g} mm"}
            expected = f"within the targets, {ends[0]:g} to {ends[1]:g} mm of the machine"
            raise error("out-of-range", **place, expected=expected)
    values = table.at_places(at)
    if current is not None:
        values = values + current.at_places(at)
    return replace(table, at=at, errors=values, both=not np.array_equal(*values))


def _moves(
    errors: AxisErrors, applied: FloatArray, measured: FloatArray | None = None
) -> tuple[Move, ...]:
    """Moves to targets over the whole length, and to those of the largest and least change; or to
    all that were `measured` (2, T), nan elsewhere.
    """
    T = len(errors.targets)
    indices = set(np.linspace(0, T - 1, min(T, MOST_MOVES - 2)).round().astype(int).tolist())
    indices |= {int(applied.mean(0).argmax()), int(applied.mean(0).argmin())}
    u = np.sqrt(np.diag(errors.of_run() + errors.of_means())).reshape(2, T)
    if errors.read and not errors.blocks:
        u = np.full((2, T), np.nan)
    result = []
    for way, name in enumerate(WAYS[: errors.ways]):
        stops = indices if measured is None else np.flatnonzero(np.isfinite(measured[way])).tolist()
        for t in sorted(stops, reverse=way == 1):
            e, change = float(errors.means[way, t]), float(applied[way, t])
            reading = None if measured is None else float(measured[way, t])
            place = float(errors.targets[t])
            result.append(Move(place, name, e, e - change, e + change, float(u[way, t]), reading))
    return tuple(result)


def verify(
    result: CompensateResult, position: FloatArray, way: IntArray, value: FloatArray, run: IntArray
) -> CompensateResult:
    """With the verdict of readings (n,) of the verification moves: reading = e - t + k t + offset.

    k by generalised least squares, b = (X' V^-1 X)^-1 X' V^-1 y with covariance (X' V^-1 X)^-1
    (Aitken 1935; Seber and Lee 2003, Linear Regression Analysis, 3.10). 0: the table worked, 1: no
    effect, 2: wrong sign. V is that of the first means and of the new runs, times the ratio of
    Birge (1932, Phys. Rev. 40, 207), chi^2/(n - 2), where that is above 1. Of a table that is
    noise itself k shrinks, as a slope on a regressor with errors does, by the share of noise in
    the table's variance (Fuller 1987, Measurement Error Models, 1.1: one minus the reliability
    ratio); that share, at most 1, is added to u. The verdict is what the 95 % interval of k holds
    of 0, 1 and 2, p that of the nearest, two-sided. Readings that no k explains are a warning,
    by chi^2/(n - 2) as F with the fewest degrees of freedom in V, which bounds p from above.

    Raises InputError for readings away from the targets, or too few.
    """
    errors, applied = result.errors, result.applied
    assert errors is not None
    assert applied is not None
    at = np.abs(position[:, None] - errors.targets).argmin(1)
    strays = np.abs(position - errors.targets[at]) > SAME_PLACE
    if strays.any():
        expected = "readings at the targets of the first test"
        where = f"{position[int(np.argmax(strays))]:g} is no target"
        raise error("not-applicable", reason=where, expected=expected)
    index = ((way < 0).astype(int) if errors.ways == 2 else 0) * len(errors.targets) + at
    t, e = applied.reshape(-1)[index], errors.means.reshape(-1)[index]
    places = np.unique(index)
    if len(places) < 3 or len(t) < 4 or np.ptp(t) == 0:
        what = "a verdict needs four readings, at three places where the table differs"
        raise error("too-little-data", what=what)
    n, y, X = len(t), value - e + t, np.column_stack([t, np.ones(len(t))])
    cells = np.ix_(index, index)
    V = errors.of_means()[cells] + np.eye(n) * (result.quantum**2 / 12)
    for block in errors.blocks:
        C = block.root @ block.root.T
        alone = np.eye(n) * C.diagonal().mean()
        V = V + (C[cells] * (run[:, None] == run) if block.shared else alone)
    if not errors.blocks:
        residuals = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
        V = V + np.eye(n) * (residuals @ residuals) / (n - 2)
    weighted = np.linalg.solve(V, X)
    C = np.linalg.inv(X.T @ weighted)
    estimate = C @ (weighted.T @ y)
    residuals = y - X @ estimate
    # Readings that scatter more than in the first test count by their scatter.
    ratio = float(residuals @ np.linalg.solve(V, residuals)) / (n - 2)
    C = C * max(1.0, ratio)
    # Less the level: an offset is fitted.
    M = np.eye(len(places)) - 1.0 / len(places)
    noise = float(np.trace(M @ errors.of_means()[np.ix_(places, places)] @ M))
    share = min(1.0, noise / float(applied.reshape(-1)[places] @ M @ applied.reshape(-1)[places]))
    k, u = float(estimate[0]), float(np.hypot(np.sqrt(C[0, 0]), share))
    dof = min((b.dof for b in errors.blocks), default=float(n - 2))
    measured = np.full(applied.size, np.nan)
    measured[places] = np.bincount(index, value)[places] / np.bincount(index)[places]
    moves = _moves(errors, applied, measured.reshape(2, -1))
    half = coverage_factor(PROBABILITY, dof) * u
    inside = [name for slope, name in VERDICTS.items() if abs(k - slope) <= half]
    verdict = inside[0] if len(inside) == 1 else "too-small-to-tell" if inside else "partly"
    t_nearest = -min(abs(k - slope) for slope in VERDICTS) / u
    p = float(2 * (ndtr(t_nearest) if np.isinf(dof) else stdtr(dof, t_nearest)))
    misfit = f_test(ratio, 1.0, n - 2, int(dof)) if errors.blocks else None
    warnings = result.warnings
    if misfit is not None and misfit.p < UNLIKE_P:
        facts = {"component": result.component, "ratio": ratio, "p": misfit.p}
        warnings = (*warnings, finding("unlike-first-test", **facts))
    verified = Verified(verdict, k, u, (k - half, k + half), p, misfit)
    return replace(result, moves=moves, verified=verified, warnings=warnings)


def moves_program(
    result: CompensateResult, feed: float, dwell_s: float, axis: str, frame: Frame
) -> str:
    """G-code of the verification moves: every target approached from its side, with an overrun
    at the reversals; `feed` in mm/min or deg/min. No work offset turns an axis: one that runs the
    other way than the readings moves in machine coordinates.
    """
    assert result.errors is not None
    targets = result.errors.targets
    place = "deg" if result.errors.rotary else "mm"
    overrun = max(1.0, 0.02 * float(np.ptp(targets)))
    lines = [
        f"(verification of the compensation of {result.component}: read at every dwell)",
        f"(feed {feed:g} {place}/min: it has to be that of the first test)",
        f"(dwell {dwell_s:g} s: G4 P in seconds; where P counts ms it is {1000 * dwell_s:g})",
        f"(overrun {overrun:g} {place} beyond the end targets: check the limits of the axis)",
        "(machine coordinates, without a work offset: the axis runs the other way)"
        if frame.reverse
        else "(coordinates of the readings: set the work offset of that test)",
        *("G21", "G90", "G94"),
    ]
    for way, start in zip(WAYS, (targets[0] - overrun, targets[-1] + overrun), strict=True):
        if stops := [move.command for move in result.moves if move.direction == way]:
            start, *stops = (frame.zero - at if frame.reverse else at for at in (start, *stops))
            lines.append(f"G1 {axis}{start:.4f} F{feed:g}")
            lines += [f"G1 {axis}{at:.4f} F{feed:g}\nG4 P{dwell_s:g}" for at in stops]
    return "\n".join([*lines, "M30", ""])
