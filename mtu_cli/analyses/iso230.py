"""Positioning tests by ISO 230-2:2014 and VDI/DGQ 3441, and two uncertainties of every figure.

Readings of one axis are an array (2, m, n): forward and reverse, target, run; nan where there is
none, so that runs may be unequal. Means and deviations s of a target are (..., 2, m); every figure
of these is an array (...).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mtu_cli.files.readings import Readings
from mtu_cli.files.study import InstrumentBudget
from mtu_cli.findings import Finding, error, finding, listed
from mtu_cli.stats.blocks import stream
from mtu_cli.stats.groups import known_mean, occurrence
from mtu_cli.stats.least_squares import FloatArray, quotient
from mtu_cli.stats.outliers import medians, outlying
from mtu_cli.units import LENGTH, SMALL, UM, UNITS

ISO = {
    "A": "bidirectional accuracy of positioning",
    "A_forward": "unidirectional accuracy of positioning, forward",
    "A_reverse": "unidirectional accuracy of positioning, reverse",
    "E": "bidirectional systematic positioning error",
    "E_forward": "unidirectional systematic positioning error, forward",
    "E_reverse": "unidirectional systematic positioning error, reverse",
    "R": "bidirectional repeatability of positioning, the largest R of a target",
    "R_forward": "unidirectional repeatability of positioning, forward",
    "R_reverse": "unidirectional repeatability of positioning, reverse",
    "M": "range of the mean bidirectional positioning error",
    "B": "reversal error, the largest |B| of a target",
    "B_mean": "mean reversal error, forward minus reverse",
}
VDI = {
    "P": "positional uncertainty",
    "Pa": "positional deviation, range of the means",
    "Ps_max": "largest positional scatter 6 s",
    "Ps_mean": "mean positional scatter 6 s",
    "U_max": "largest reversal error",
    "U_mean": "mean reversal error",
}
MEANINGS = ISO | VDI
STANDARDS = {"iso230-2": ISO, "vdi3441": VDI}
WAYS = ("forward", "reverse")
REFERENCE_DEGC = 20.0
TRIALS, TOGETHER = 10_000, 500
"""Trials of either uncertainty, which is then known to 0.7 %, and how many at a time."""
LONG_MM, METRE, FEWEST = 2000.0, 1000.0, 5
"""Axes up to the first have five targets a metre, five in all, and five runs each way."""
CLAUSE, ROTARY_CLAUSE = "ISO 230-2:2014, 5.3.2", "ISO 230-2:2014, 5.3.4"
LEAST_PHASE = 0.15
"""Of a pitch: planned targets keep this distance from its multiples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A figure in mm or rad: `u` by the instrument, `u_sampling` over repeated tests, nan where
    unknown; `k` of U = k u. `size` of its unit, the `limit` asked for, the figure `before`.
    """

    name: str
    value: float
    u: float
    u_sampling: float
    unit: str
    size: float
    k: float = 2.0
    limit: float | None = None
    before: Figure | None = None

    @property
    def U(self) -> float:
        """Expanded uncertainty; nan without a budget."""
        return self.k * self.u

    @property
    def verdict(self) -> str | None:
        """By ISO 14253-1: conforming where value + U is within the limit, nonconforming where
        value - U is beyond, else neither is proven; without U the value alone decides.
        """
        if self.limit is None:
            return None
        value, guard = abs(self.value), 0.0 if math.isnan(self.U) else self.U
        if value - guard > self.limit:
            return "nonconforming"
        return "conforming" if value + guard <= self.limit else "not proven"

    @property
    def difference(self) -> float:
        """Now minus earlier."""
        return math.nan if self.before is None else self.value - self.before.value

    @property
    def differs(self) -> bool | None:
        """Whether the tests differ beyond 2 sqrt(u1^2 + u2^2), 2 sqrt(2) u_sampling of tests alike;
        None where that is not known.
        """
        earlier = self.before.u_sampling if self.before else math.nan
        change, bound = abs(self.difference), 2 * math.hypot(self.u_sampling, earlier)
        return None if math.isnan(change + bound) else change > bound


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What was read along one axis, and its figures by name: `targets` (m,) in mm, of a `rotary`
    axis in deg; `readings` (2, m, n) in mm or rad, of `unit`. `directed`: whether directions are
    stated; `stepped`: whether every target was read to the end before the next; `rows` (2, m, n) of
    the `file`.
    """

    name: str
    unit: str
    rotary: bool
    targets: FloatArray
    readings: FloatArray
    directed: bool = True
    stepped: bool = False
    rows: np.ndarray | None = None
    file: str | None = None
    figures: Mapping[str, Figure] = field(default_factory=dict)

    @property
    def size(self) -> float:
        """Of the unit, in mm or rad."""
        return UNITS[self.unit].to_internal

    @property
    def budgeted(self) -> bool:
        """Whether the budget of an instrument of lengths is about it."""
        return UNITS[self.unit].dimension == LENGTH and not self.rotary

    @property
    def travel(self) -> float:
        """From the first to the last target, mm or deg."""
        return float(np.ptp(self.targets))

    @cached_property
    def of_runs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Number, means and s of the runs, (2, m) each."""
        return statistics(self.readings)


class Plan(NamedTuple):
    """Proposed targets (mm) for a travel and a pitch of its ball screw or scale."""

    length: float
    pitch: float
    targets: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Iso230Result:
    """All axes by name, their warnings, and a plan of targets."""

    axes: Mapping[str, Axis]
    warnings: tuple[Finding, ...] = ()
    plan: Plan | None = None
    standard: str = "iso230-2"

    @property
    def decisions(self) -> list[tuple[Axis, Figure]]:
        """Figures that have a limit."""
        pairs = ((axis, each) for axis in self.axes.values() for each in axis.figures.values())
        return [(axis, each) for axis, each in pairs if each.limit is not None]


def statistics(readings: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Number, mean and s of the runs (last axis); nan where there are none, or one for s. A target
    that reads 0 in every run is where the instrument was zeroed: it carries no scatter.
    """
    count = np.isfinite(readings).sum(axis=-1).astype(np.float64)
    mean = known_mean(readings)
    s = np.sqrt(quotient(np.nansum((readings - mean[..., None]) ** 2, axis=-1), count - 1))
    zeroed = (np.nan_to_num(readings) == 0).all(axis=-1)
    zeroed &= ~zeroed.all(axis=-1, keepdims=True)
    return count, mean, np.where(zeroed, np.nan, s)


def reversal_and_repeatability(
    mean: FloatArray, s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """B (..., m), R of each direction (..., 2, m) and R (..., m): ISO 230-2:2014, 3.

    B_i = mean forward - mean reverse, R_i of a direction = 4 s_i, R_i = max(2 s_i forward +
    2 s_i reverse + |B_i|; R_i forward; R_i reverse).
    """
    B = mean[..., 0, :] - mean[..., 1, :]
    R = 4 * s
    both = 2 * s.sum(axis=-2) + np.abs(B)
    return B, R, np.maximum(both, np.maximum(R[..., 0, :], R[..., 1, :]))


def figures_of(mean: FloatArray, s: FloatArray) -> dict[str, FloatArray]:
    """The figures of ISO 230-2:2014 and VDI/DGQ 3441 (1977) of means and s (..., 2, m), by their
    names; nan where one does not exist. A target without scatter enters A and P by its means alone.

    VDI: U_j = |B_j|, Ps_j = 6 (s_j forward + s_j reverse)/2, Pa the range of the means of both
    directions, P = max(mean_j + (U_j + Ps_j)/2) - min(mean_j - (U_j + Ps_j)/2).
    """
    high, low = np.fmax.reduce, np.fmin.reduce
    B, R_way, R = reversal_and_repeatability(mean, s)
    band, middle = 2 * np.nan_to_num(s), mean.mean(axis=-2)
    scatters = np.where(np.isfinite(s).any(axis=-1), 0.0, np.nan)
    top, bottom = high(mean + band, axis=-1), low(mean - band, axis=-1)
    highest, lowest = high(mean, axis=-1), low(mean, axis=-1)
    two_way = np.where(np.isfinite(B).any(axis=-1), 0.0, np.nan)
    U, Ps = np.abs(B), 3 * s.sum(axis=-2)
    half = (U + np.nan_to_num(Ps)) / 2
    of_both = np.where(np.isfinite(Ps).any(axis=-1), 0.0, np.nan)
    result = {
        "A": top.max(axis=-1) - bottom.min(axis=-1) + two_way + scatters.sum(axis=-1),
        "E": highest.max(axis=-1) - lowest.min(axis=-1) + two_way,
        "R": high(R, axis=-1),
        "M": high(middle, axis=-1) - low(middle, axis=-1),
        "B": high(U, axis=-1),
        "B_mean": known_mean(B),
        "P": high(middle + half, axis=-1) - low(middle - half, axis=-1) + of_both,
        "Ps_max": high(Ps, axis=-1),
        "Ps_mean": known_mean(Ps),
        "U_mean": known_mean(U),
    }
    result |= {"Pa": result["M"], "U_max": result["B"]}
    one_way = {"A": top - bottom + scatters, "E": highest - lowest, "R": high(R_way, axis=-1)}
    result |= {f"{name}_{way}": values[..., i] for name, values in one_way.items()
              for i, way in enumerate(WAYS)}  # fmt: skip
    return {name: result[name] for name in MEANINGS}


def sampling_u(
    count: FloatArray, mean: FloatArray, s: FloatArray, rng: np.random.Generator, trials: int
) -> dict[str, FloatArray]:
    """Standard deviation of every figure over repeated tests: parametric bootstrap.

    Each trial is a test of the same runs: means N(mean_i, s_p^2 / n_i), and s_i^2 = s_p^2
    chi2(n_i - 1)/(n_i - 1), s_p of a direction pooled over its targets. `count`, `mean` and `s`
    are (..., 2, m). To resample the runs themselves would add the scatter a second time to A and R.
    """
    dof = np.where(np.isfinite(s), count - 1, 0.0)
    total = dof.sum(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        pooled = np.sqrt((dof * np.nan_to_num(s) ** 2).sum(axis=-1, keepdims=True) / total)
    estimable = dof > 0
    shape = (trials, *mean.shape)
    # A single run scatters as the others of its direction, where there are any.
    noisy = (estimable | (count == 1)) & np.isfinite(pooled)
    step = np.where(noisy, pooled / np.sqrt(np.maximum(count, 1)), 0.0)
    means = mean + step * rng.standard_normal(shape)
    chi2 = 2 * rng.standard_gamma(np.maximum(dof, 1) / 2, shape)
    s_i = pooled * np.sqrt(chi2 / np.maximum(dof, 1))
    finite = np.isfinite(pooled)[..., 0]
    of_way = {way: finite[..., i] for i, way in enumerate(WAYS)}
    return {
        name: np.where(
            of_way.get(name.rpartition("_")[2], finite.all(axis=-1)), np.std(values, axis=0), np.nan
        )
        for name, values in figures_of(means, np.where(estimable, s_i, np.nan)).items()
    }


def corrected(axis: Axis, budget: InstrumentBudget | None) -> tuple[Axis, list[Finding]]:
    """Readings as of an axis at 20 degC, where the budget says that they are not yet:
    less alpha (T - 20) (x - x_first).
    """
    if budget is None or budget.already_at_20 is not False or not axis.budgeted:
        return axis, []
    rise = (budget.alpha_um_per_m_K or 0.0) * (budget.T_mean_degC - REFERENCE_DEGC)
    expansion = rise * UM / METRE * (axis.targets - axis.targets[0])
    facts = {"component": axis.name, "size": float(expansion[-1] / UM), "rise": rise}
    readings = axis.readings - expansion[:, None]
    return replace(axis, readings=readings), [finding("corrected-to-20", **facts)]


def instrument_u(
    axis: Axis, budget: InstrumentBudget, rng: np.random.Generator, trials: int = TRIALS
) -> dict[str, float]:
    """Standard deviation of every figure of these runs by the instrument's errors, Monte Carlo.

    Of all runs alike, over x from the first target: the device's scale N(0, (U/k)^2), material
    temperature +- T_half_width and expansion +- alpha_half_width of a rectangle, misalignment d of
    a rectangle from 0 to d^2/(2 L) at the end of the travel L. Of each reading alone: drift of a
    rectangle of width E_VE (ISO/TR 230-9, as derived in `mtu help iso230`).
    """
    x = axis.targets - axis.targets[0]
    span = float(x[-1]) or 1.0
    per_metre = UM / METRE
    alpha = budget.alpha_um_per_m_K or 0.0
    rise = abs(budget.T_mean_degC - REFERENCE_DEGC)
    samples: dict[str, list[FloatArray]] = {}
    zeroed = np.isnan(axis.of_runs[2])
    for start in range(0, trials, TOGETHER):
        n = min(TOGETHER, trials - start)
        scale = rng.standard_normal(n) * budget.device_U_um_per_m / budget.k
        scale += rng.uniform(-1, 1, n) * alpha * budget.T_half_width_K
        scale += rng.uniform(-1, 1, n) * rise * budget.alpha_half_width
        bend = rng.uniform(0, 1, n) * budget.alignment_mm**2 / (2 * span**2)
        offset = (scale * per_metre + bend)[:, None, None, None] * x[:, None]
        drift: FloatArray | float = 0.0
        if budget.E_VE_um:
            drift = rng.uniform(-0.5, 0.5, (n, *axis.readings.shape)) * budget.E_VE_um * UM
        _, mean, s = statistics(axis.readings + offset + drift)
        for name, values in figures_of(mean, np.where(zeroed, np.nan, s)).items():
            samples.setdefault(name, []).append(values)
    # What changes the readings of a target alike leaves R and B but for round-off.
    round_off = 8 * np.finfo(float).eps * float(np.nanmax(np.abs(axis.readings)))
    stds = {name: float(np.std(np.concatenate(parts))) for name, parts in samples.items()}
    return {name: 0.0 if u < round_off else u for name, u in stds.items()}


def evaluate(
    axis: Axis, budget: InstrumentBudget | None, k: float, seed: int, index: int,
    limits: Mapping[str, float] | None = None,
) -> Axis:  # fmt: skip
    """The axis with all figures; draws depend on `seed` and its `index` alone. `limits` (``A``, or
    ``dx_x.A`` of one axis, in its unit) are of figures that exist.
    """
    count, mean, s = axis.of_runs
    values, measured = figures_of(mean, s), dict[str, float]()
    sampling = sampling_u(count, mean, s, stream(seed, 1, index), TRIALS)
    if budget is not None and axis.budgeted:
        measured = instrument_u(axis, budget, stream(seed, 2, index))
    figures = {
        name: Figure(
            name=name, value=float(values[name]), u=measured.get(name, math.nan),
            u_sampling=float(u), unit=axis.unit, size=axis.size, k=k,
        )
        for name, u in sampling.items()
    }  # fmt: skip
    for key, limit in (limits or {}).items():
        of, _, name = key.rpartition(".")
        if of in ("", axis.name) and not math.isnan(figures[name].value):
            figures[name] = replace(figures[name], limit=limit * axis.size)
    return replace(axis, figures=figures)


def places_read(readings: Readings) -> tuple[FloatArray, np.ndarray]:
    """Positions (n,) in mm, of rotary axes (column position_deg) in deg, and which these are."""
    degrees, position = readings.covariates.get("position_deg"), readings.position_mm
    if degrees is None or degrees.dtype != np.float64:
        return position, np.zeros(len(readings), bool)
    rotary = np.isnan(position) & np.isfinite(degrees.astype(np.float64))
    return np.where(rotary, degrees, position), rotary


def check_places(readings: Readings, rows: np.ndarray, position: FloatArray) -> None:
    """Raises InputError for a row whose position is missing."""
    if (gaps := np.isnan(position)).any():
        place = readings.place(rows[np.argmax(gaps)]) | {"column": "position_mm"}
        raise error("empty-cell", expected="a position", **place)


def axes_of(readings: Readings) -> tuple[list[Axis], list[Finding]]:
    """What was read at targets by component (and instrument, of several), and a note of the rest.

    Raises InputError for a component with some positions missing.
    """
    position, rotary = places_read(readings)
    roles = np.array([x.role for x in readings.sources])[readings.file_index]
    axes, rest = [], []
    for code, name in enumerate(readings.components):
        mask = readings.code == code
        for role in dict.fromkeys(roles[mask].tolist()):
            rows = np.flatnonzero(mask & (roles == role))
            if np.isnan(position[rows]).all() or not np.ptp(position[rows]):
                rest.append(name)
                continue
            check_places(readings, rows, position[rows])
            label = f"{name} ({role})" if len({*roles[mask]}) > 1 else name
            axes.append(_axis(readings, label, position, bool(rotary[rows[0]]), rows))
    if not axes:
        expected = "readings with position_mm (of rotary axes position_deg)"
        raise error("too-little-data", what="no component was read at targets", expected=expected)
    note = {"quantity": "positioning", "reason": "they were not read at targets"}
    return axes, [finding("not-estimable", names=rest, **note)] if rest else []


def _axis(
    readings: Readings, name: str, position: FloatArray, rotary: bool, rows: np.ndarray
) -> Axis:
    """The readings of `rows` as (direction, target, run)."""
    targets, of = np.unique(np.round(position[rows], 6), return_inverse=True)
    way = (readings.direction[rows] < 0).astype(int)
    cell = way * len(targets) + of
    rank = occurrence(cell)
    values = np.full((2, len(targets), int(rank.max()) + 1), np.nan)
    lines = np.zeros(values.shape, int)
    values[way, of, rank], lines[way, of, rank] = readings.error[rows], readings.row[rows]
    time = readings.time_min[rows]
    moves = np.count_nonzero(np.diff(of[np.argsort(time, kind="stable")]))
    timed = np.isfinite(time).all() and len(set(time.tolist())) == len(rows)
    return Axis(
        name=name,
        unit=SMALL[readings.dimension[rows[0]]].name,
        rotary=rotary,
        targets=targets,
        readings=values,
        rows=lines,
        file=readings.sources[readings.file_index[rows[0]]].shown,
        directed=bool(readings.direction[rows].any()),
        stepped=bool(timed and moves == len(targets) - 1 and rank.any()),
    )


def warnings_of(axis: Axis) -> Iterator[Finding]:
    """What ISO 230-2 asks of a test and this one lacks, figures that do not exist, outliers."""
    count, _, s = axis.of_runs
    unit, of = ("deg", 360.0) if axis.rotary else ("mm", LONG_MM)
    m, least = len(axis.targets), max(FEWEST, math.ceil(FEWEST * axis.travel / METRE))
    fewest, faults = int(count[count > 0].min()), []
    if axis.travel <= of and not axis.rotary and m < least:
        faults.append((f"{m} targets over {axis.travel:g} mm", f"{least} or more (five a metre)"))
    if axis.travel <= of and fewest < FEWEST:
        faults.append((f"{fewest} runs at a target", f"{FEWEST} in each direction"))
    if axis.stepped:
        faults.append(("a step cycle", "the standard test cycle for acceptance"))
    clause = ROTARY_CLAUSE if axis.rotary else CLAUSE
    for what, how in faults:
        facts = {"component": axis.name, "clause": clause, "what": what, "wanted": how}
        yield finding("test-conditions", **facts)
    if missing := [name for name in ISO if math.isnan(axis.figures[name].value)]:
        reason = "single runs have no scatter"
        if not axis.directed:
            reason = "no direction is stated, so all readings count as forward"
        elif not count.any(axis=1).all():
            reason = "read in one direction only"
        yield finding("not-estimable", quantity=listed(missing), names=axis.name, reason=reason)
    lacking = np.isnan(s) & (count > 0)
    if lacking.any() and np.isfinite(s).any():
        places = [f"{x:g} {unit}" for x in axis.targets[lacking.any(axis=0)]]
        reason = "a single run, or the instrument was zeroed there in every run"
        quantity = f"R at {listed(places)}"
        yield finding("not-estimable", quantity=quantity, names=axis.name, reason=reason)
    # Runs far off the others at their target and direction: reported, never left out.
    deviation = axis.readings - medians(axis.readings, 2)
    mask, scatter = outlying(deviation, int((count > 0).sum()))
    if mask.any() and axis.rows is not None:
        lines = tuple(sorted(axis.rows[mask].tolist()))
        far = float(np.abs(deviation[mask]).max()) / axis.size
        yield finding(
            "outlying-value", file=axis.file, row=lines[0], column="error", what=axis.name,
            unit=axis.unit, beside="the other runs", off=far, count=int(mask.sum()),
            s=scatter / axis.size, rows=lines,
        )  # fmt: skip


def evaluate_all(
    readings: Readings,
    *,
    budget: InstrumentBudget | None = None,
    before: Readings | None = None,
    limits: Mapping[str, float] | None = None,
    k: float = 2.0,
    seed: int = 0,
    standard: str = "iso230-2",
) -> Iso230Result:
    """The figures of every component of `readings`, against those `before` and their `limits`."""
    tests, warnings = axes_of(readings)
    axes = {}
    for index, each in enumerate(tests):
        at_20, notes = corrected(each, budget)
        axis = evaluate(at_20, budget, k, seed, index, limits)
        warnings += [*notes, *warnings_of(axis)]
        axes[axis.name] = axis
    if before is not None:
        earlier = {x.name: (i, x) for i, x in enumerate(axes_of(before)[0])}
        if not axes.keys() & earlier.keys():
            expected = f"one of: {listed(axes)}"
            reason = f"the earlier test has none of these axes, but {listed(earlier)}"
            raise error("not-applicable", reason=reason, path="--before", expected=expected)
        for name in axes.keys() & earlier.keys():
            index, each = earlier[name]
            old = evaluate(each, None, k, seed, index).figures
            now = axes[name].figures.items()
            both = {key: replace(figure, before=old[key]) for key, figure in now}
            axes[name] = replace(axes[name], figures=both)
    other = [x.name for x in axes.values() if not x.budgeted]
    if other and budget:
        reason = "the budget of the instrument is of lengths"
        warnings.append(finding("not-estimable", quantity="u", names=other, reason=reason))
    result = Iso230Result(axes=axes, standard=standard)
    pairs = [(f"{x.name} of {axis.name}", x) for axis, x in result.decisions]
    if unknown := [name for name, x in pairs if math.isnan(x.U)]:
        warnings.append(finding("no-uncertainty", names=unknown))
    if unproven := [name for name, x in pairs if x.verdict == "not proven"]:
        warnings.append(finding("not-proven", names=unproven))
    return replace(result, warnings=tuple(warnings))


def plan(length: float, pitch: float) -> Plan:
    """Targets over a travel (mm), five a metre and five in all, that are no multiples of the pitch:
    where they fall within it changes by the golden section, so that a cyclic error is seen
    (ISO 230-2:2014, 5.2: P_i = (i - 1) p + r). Raises InputError for a pitch beyond the travel.
    """
    if pitch > length:
        raise error("out-of-range", path="--pitch", value=f"{pitch:g}", expected="below --plan")
    n = max(FEWEST, math.ceil(FEWEST * length / METRE))
    golden = np.mod((np.arange(n) + 0.5) * (math.sqrt(5.0) - 1) / 2, 1.0)
    phase = LEAST_PHASE + (1 - 2 * LEAST_PHASE) * golden
    turns = np.rint(np.linspace(0.0, length, n) / pitch - phase)
    turns = np.clip(turns, 0.0, np.floor(length / pitch - phase))
    targets = np.sort((turns + phase) * pitch)
    return Plan(length, pitch, np.round(targets, 3))
