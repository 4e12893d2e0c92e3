"""From the errors of an axis to the table of its control, and the errors that will remain.

Errors e = actual - nominal. With the table t a control moves to nominal - t, so that e - t remains,
after the quantum, the zero rule and the linear interpolation of the control. A new test of as many
runs scatters about that by the uncertainty of the means of the first one and by its scatter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr

from mtu_cli.analyses.axis_errors import AxisErrors, Stated
from mtu_cli.analyses.iso230 import TRIALS, WAYS, figures_of
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import Finding, error, finding
from mtu_cli.formats.control.errors import Controller, ErrorTable, Parameters
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
MOST_STEPS, SAME_STEP = 10_000, 1e-6
"""Of a table with equal steps, and what a step may be off a whole one."""
SAME_PLACE = 1e-3
"""mm or deg: a verification reading this near a target is of that target."""


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


def grid(low: float | None, high: float | None, step: float | None) -> FloatArray:
    """Places (n,) mm from --from to --to by --step; raises InputError for less than all three, and
    for no whole number of steps.
    """
    if low is None or high is None or step is None:
        given = {"--from": low, "--to": high, "--step": step}
        missing = [name for name, value in given.items() if value is None]
        expected = "--from, --to and --step together, or none of them"
        raise error("missing-input", what=f"a value of {' and '.join(missing)}", expected=expected)
    count = (high - low) / step if step > 0 else -1.0
    if not 1 <= count <= MOST_STEPS or abs(count - round(count)) > SAME_STEP:
        value = f"{low:g} to {high:g} by {step:g} mm"
        expected = f"--to above --from by a whole number of steps, at most {MOST_STEPS}"
        raise error("out-of-range", path="--step", value=value, expected=expected)
    return np.asarray(low + step * np.arange(round(count) + 1))


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


def as_read(name: str, control: Controller, table: ErrorTable) -> CompensateResult:
    """A table that was only read, from the file of this name."""
    direction = "both" if table.both else "mean"
    return CompensateResult(
        component=name, controller=control, direction=direction, asked=table, held=table
    )


def compensate(
    errors: AxisErrors, control: Controller, parameters: Parameters, frame: Frame, *,
    component: str = "", direction: str | None = None, places: FloatArray | None = None,
    reference: float | None = None, current: ErrorTable | None = None, seed: int = 1,
    trials: int | None = None,
) -> CompensateResult:  # fmt: skip
    """The table of a control for the errors of an axis, read back, with the errors that remain.

    `places` (n,) mm of its points are machine coordinates (None: those of the targets), `current`
    is the table that was active while measuring. Raises InputError for a table that the format
    cannot hold, or that comes back otherwise.
    """
    two = control.two(parameters)
    direction = direction or ("both" if two and errors.ways == 2 else "mean")
    if direction == "both" and not two:
        reason = f"{control.name} has one column for both directions"
        raise error("not-applicable", reason=reason, expected="--direction mean or forward")
    table = _table(errors, direction, places, frame, current)
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
    if current is not None:
        applied = applied - frame.applied(current, errors.targets)
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
        moves=tuple(_moves(errors, applied)),
        warnings=tuple(warnings),
    )


def named_parameters(
    machine: LoadedMachine, first: Stated, control: Controller, given: Parameters
) -> dict[str, str]:
    """The parameters of a control, those `given` before its own, with the axis and the ISO 230-1
    name of the component where it wants them: its own are those of X, and axes that it numbers are
    counted on from it.

    Raises InputError for an error across its axis, which no table of one axis holds.
    """
    parameters, name, axis = {**control.parameters, **given}, first.name, first.axis
    of_x = "" if "axis" in given else parameters.get("axis", "")
    if of_x.startswith("X"):
        parameters["axis"] = axis.upper() + of_x[1:]
    elif of_x:
        parameters["axis"] = f"{of_x[:-1]}{int(of_x[-1]) + 'xyzabc'.index(axis)}"
    if "error" in parameters and not parameters["error"]:
        component = machine.machine.components.get(name)
        iso_name = "" if first.angle else f"E{first.output}{axis}".upper()
        parameters["error"] = (component and component.iso) or iso_name
    elif first.output != axis and not control.listing:
        reason = f"{name} is an error in {first.output} along {axis}: no table of one axis"
        raise error("not-applicable", reason=reason, expected="--for isg-csv, etalon or table")
    return parameters


def _table(
    errors: AxisErrors,
    direction: str,
    places: FloatArray | None,
    frame: Frame,
    current: ErrorTable | None,
) -> ErrorTable:
    """The table in machine coordinates, at its targets or at equal steps, with the current one."""
    at, values = frame.places(errors.targets), frame.turned(errors.means)
    if direction == "forward":
        values = values[[0, 0]]
    elif direction == "mean":
        values = np.tile(values.mean(0), (2, 1))
    table = ErrorTable(at=at, errors=values, angle=errors.angle, rotary=errors.rotary)
    if current is not None:
        inside = (current.at > at[0]) & (current.at < at[-1])
        at = np.unique(np.round(np.concatenate([at, current.at[inside]]), 6))
    if places is not None:
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
) -> Iterator[Move]:
    """Moves to targets over the whole length, and to those of the largest and least change; or to
    all that were `measured` (2, T), nan elsewhere.
    """
    T = len(errors.targets)
    indices = set(np.linspace(0, T - 1, min(T, MOST_MOVES - 2)).round().astype(int).tolist())
    indices |= {int(applied.mean(0).argmax()), int(applied.mean(0).argmin())}
    u = np.sqrt(np.diag(errors.of_run() + errors.of_means())).reshape(2, T)
    if errors.read and not errors.blocks:
        u = np.full((2, T), np.nan)
    for way, name in enumerate(WAYS[: errors.ways]):
        stops = indices if measured is None else np.flatnonzero(np.isfinite(measured[way])).tolist()
        for t in sorted(stops, reverse=way == 1):
            e, change = float(errors.means[way, t]), float(applied[way, t])
            reading = None if measured is None else float(measured[way, t])
            place = float(errors.targets[t])
            yield Move(place, name, e, e - change, e + change, float(u[way, t]), reading)


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
    moves = tuple(_moves(errors, applied, measured.reshape(2, -1)))
    half = coverage_factor(PROBABILITY, dof) * u
    inside = [name for slope, name in VERDICTS.items() if abs(k - slope) <= half]
    verdict = inside[0] if len(inside) == 1 else "too-small-to-tell" if inside else "partly"
    t_nearest = -min(abs(k - slope) for slope in VERDICTS) / u
    p = float(2 * stdtr(dof, t_nearest))
    misfit = f_test(ratio, 1.0, n - 2, int(dof)) if errors.blocks else None
    warnings = result.warnings
    if misfit is not None and misfit.p < UNLIKE_P:
        facts = {"component": result.component, "ratio": ratio, "p": misfit.p}
        warnings = (*warnings, finding("unlike-first-test", **facts))
    verified = Verified(verdict, k, u, (k - half, k + half), p, misfit)
    return replace(result, moves=moves, verified=verified, warnings=warnings)


def notes(control: Controller, frame: Frame, parameters: Parameters) -> str:
    """What stands beside a table whose format has no comments."""
    values = " ".join(f"{name}={value}" for name, value in parameters.items() if value)
    return f"{control.says}\n{frame.says}\nThis table: {values}.\n"


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
