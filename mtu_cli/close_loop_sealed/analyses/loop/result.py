"""What closing the loop found, as one frozen result."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint, NeutralPoint
from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.gross import Gross
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.findings import Finding
from mtu_cli.stats.least_squares import FloatArray

Verdict = Literal["none", "named", "class", "unexplained"]
VERDICTS: tuple[Verdict, ...] = ("none", "named", "class", "unexplained")
DRIFT, FIELD = "unnamed-drift", "unnamed-field"
"""Rivals of every named effect: smooth over the parts, or over the columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """What to do to tell a class apart, and `predicted_d`, the rivals' separation by then in
    standard deviations; `now_d` without it, and `further_d` what the experiment adds:
    predicted_d^2 = now_d^2 + further_d^2.
    """

    do: str
    predicted_d: float
    now_d: float
    further_d: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Otherwise:
    """If candidate `name` stood beside an effect: the effect's `parameter` and the `constant` of
    that, (name, unit, value, u) as in `FoundEffect`; `p` (t test) of none. `at_reference`: the
    parameter is that at 20 degC, where the candidate, of a `covariate`, is not told.
    """

    name: str
    parameter: tuple[str, str, float, float]
    constant: tuple[str, str, float, float]
    p: float
    covariate: str | None = None
    at_reference: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftMean:
    """The mean error `value` (mm) with `u` along an axis beside the effects found; `p` of none."""

    axis: str
    value: float
    u: float
    p: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundEffect:
    """An effect that passed the gate, or that one which did cannot be told without (`same_in_all`).

    `parameters` are (name, unit, value, u), value and standard uncertainty in internal units,
    `unit` to show them in; `intervals` (low, high, effective degrees of freedom) at 95 %;
    `covariance` (k, k) of the parameters, internal units. The last of them are only the constants
    that equations need beside what they say, one along each of the axes `levels`. `equations` are
    empty where the equation language cannot say it: `chosen` is then the feature, part or
    operation.
    `searched` holds the value and 95 % interval of what was searched, `alike` other values that
    are the same on these points, or fit them as well. `class_names` are the
    candidates that this data cannot tell apart (95 % credible set, and what has no name until
    it is out at 1 %), itself first; `aliases` those that are the same on these points whatever
    the data. `rivals` are the other names of a small class, each estimated in its place. `apart`
    are those of `class_names` that a scatter cannot be mistaken for: as likely as it, but other
    findings. `unnamed` is the posterior of drifts and fields without a name in its place.
    `otherwise`: it is told with its u if there is none of these beside it.
    A rival is `without` the offsets found that are not told from 0 beside it; `changed` are the
    other effects that have another size beside it, as they are then.
    `found_at` are temperatures (name, degC) that it may be an effect of and that did not change.
    `inseparable`: no further parts tell its class apart. `folds` counts the held-out folds that
    chose it, or another of its class, of `of_folds`.
    """

    name: str
    family: str
    axis: str | None
    component: str | None
    covariate: str | None
    says: str
    separates: str | None
    kind: str
    chosen: str | None
    equations: dict[str, str]
    parameters: tuple[tuple[str, str, float, float], ...]
    intervals: tuple[tuple[float, float, float], ...]
    covariance: FloatArray
    searched: dict[str, tuple[float, float, float]]
    p_familywise: float
    log_bayes_factor: float
    posterior: float
    explained_share: float
    class_names: tuple[str, ...]
    aliases: tuple[str, ...]
    experiment: Experiment | None
    folds: int
    of_folds: int
    inseparable: bool = False
    alike: tuple[float, ...] = ()
    rivals: tuple[FoundEffect, ...] = ()
    apart: tuple[str, ...] = ()
    unnamed: float = 0.0
    otherwise: tuple[Otherwise, ...] = ()
    levels: tuple[str, ...] = ()
    found_at: tuple[tuple[str, float], ...] = ()
    without: tuple[str, ...] = ()
    changed: tuple[FoundEffect, ...] = ()
    scatter: ScatterSize | None = None

    @property
    def sizes(self) -> tuple[tuple[str, str, float, float], ...]:
        """The parameters without the levels."""
        return self.parameters[: len(self.parameters) - len(self.levels)]

    @property
    def is_hint(self) -> bool:
        """Whether it passed a test and its one size is not told from 0 (95 %)."""
        if len(self.sizes) != 1:
            return False
        low, high, _ = self.intervals[0]
        return low < 0 < high

    @property
    def of_one_axis(self) -> bool:
        """Whether it is a turn or growth of whole parts that one axis alone has: something else,
        which the library has none of.
        """
        return self.scatter is not None and self.scatter.axes_unlike

    @property
    def holds_within(self) -> tuple[str, ...]:
        """Columns that its equations do not have, and beyond whose range it is a guess."""
        own = (o.covariate for o in self.otherwise if o.at_reference and o.covariate is not None)
        return tuple(dict.fromkeys([*own, *(name for name, _ in self.found_at)]))

    @property
    def candidates(self) -> tuple[str, ...]:
        """All that it may be by the data: its class and its aliases, itself first."""
        return tuple(dict.fromkeys([self.name, *self.class_names, *self.aliases]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A candidate at the first look: `minimum_detectable` amplitude (root mean square over the
    cells, mm or rad) that would be found four times in five; `unavailable` says why it could
    not be tested.
    """

    name: str
    family: str
    component: str | None
    p_familywise: float | None
    log_bayes_factor: float | None
    posterior: float | None
    minimum_detectable: float | None
    unavailable: str | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Errors (mm, rad): root mean square over all coordinates, by axis, 95th percentile and
    largest of the error vector's length, and chi^2 a degree of freedom against the null model.
    """

    rms: float
    rms_by_axis: dict[str, float]
    p95: float
    largest: float
    chi2_per_dof: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TableResult:
    """One table (all points, or one component): its residuals (P, H, A) before and after the
    effects, the effects' contribution `explained` (P, H, A), scores held out and in sample.
    `fixed_points` are the places where its effects cancel, `neutral_points` the temperatures;
    `growths_alone` growths that were found without a drift, with where the axis may be fixed;
    `left_means` mean errors beside the effects that were not found.

    `nameless` are smooth drifts or fields that explained as much as the names, or are likely in the
    place of one or beside them. `twofold` are names
    that were found twice, in forms that one cause cannot have at once. `stopped`: the search
    ended at as many causes as were asked for, and more passed.
    `held_out_by` says what was left out in turn; None where nothing could be. Entries that were
    set aside do not count; `held_out_with_gross` are the held-out scores with them, None where
    there are none. `by_column` are the held-out scores after a correction of its own for every
    column, the mean of what the other parts leave there; None where no parts are held out.
    `floor` is the repeatability of one averaged coordinate, None where the data do not tell it.
    """

    table: ResidualTable
    verdict: Verdict
    effects: tuple[FoundEffect, ...]
    candidates: tuple[Judged, ...]
    checks: tuple[tuple[str, float], ...]
    fired: tuple[str, ...]
    gross: tuple[Gross, ...]
    explained: FloatArray
    before: Scores
    after: Scores
    in_sample_before: Scores
    in_sample_after: Scores
    held_out_by: str | None
    folds: int
    floor: float | None
    fixed_points: tuple[FixedPoint, ...]
    nameless: tuple[str, ...] = ()
    neutral_points: tuple[NeutralPoint, ...] = ()
    growths_alone: tuple[FixedPoint, ...] = ()
    left_means: tuple[LeftMean, ...] = ()
    twofold: tuple[str, ...] = ()
    stopped: bool = False
    held_out_with_gross: tuple[Scores, Scores] | None = None
    by_column: Scores | None = None

    @property
    def unexplained_rms(self) -> float | None:
        """What is left in sample where something stays without a name."""
        return self.in_sample_after.rms if self.verdict == "unexplained" else None

    @property
    def without_name(self) -> bool:
        """Whether something that has no name may be there."""
        return bool(self.nameless)

    @property
    def of_one_axis(self) -> tuple[str, ...]:
        """The names nearest to scatters that one axis alone has: none of them is right."""
        return tuple(effect.name for effect in self.effects if effect.of_one_axis)


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseLoopResult:
    """The verdict over all tables; `effects` of all, with their joint `covariance` in the order
    of their parameters, internal units.
    """

    verdict: Verdict
    tables: tuple[TableResult, ...]
    alpha: float
    datum: str
    covariance: FloatArray
    warnings: tuple[Finding, ...] = field(default=())

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """The effects of all tables, in the order found."""
        return tuple(effect for table in self.tables for effect in table.effects)

    @property
    def is_found(self) -> bool:
        """Whether an effect was found that is more than a hint, or something without a name."""
        sure = any(not effect.is_hint for effect in self.effects)
        return self.verdict == "unexplained" or (self.verdict != "none" and sure)
