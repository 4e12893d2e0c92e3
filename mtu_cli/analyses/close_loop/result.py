"""What closing the loop found, as one frozen result in internal units (mm, rad, degC, min)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from mtu_cli.findings import Finding
from mtu_cli.language import names, parse
from mtu_cli.model.effect_library import Candidate
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.coverage import t_interval
from mtu_cli.stats.least_squares import BoolArray, FloatArray

WORST = ("unexplained", "class", "named", "none")
"""The verdicts; that on several tables is the first of theirs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Searched:
    """A parameter in which an effect is not linear: its likeliest value and its 95 % set, a union
    of intervals; of a place between values the `places` at equal steps of its posterior.
    """

    name: str
    value: float
    intervals: tuple[tuple[float, float], ...]
    places: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter with its standard uncertainty and degrees of freedom; `unit` to show it in.
    `role`: of the effect (own), of a margin, the level, or a change of what was searched. `row` is
    that of the table's covariance; -1 of the rms of a smooth effect, which has none.
    """

    name: str
    unit: str
    value: float
    u: float
    dof: float
    role: str = "own"
    row: int = -1

    @property
    def interval95(self) -> tuple[float, float]:
        """The 95 % interval (Student's t)."""
        return t_interval(self.value, self.u, max(self.dof, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothEffect:
    """Values (T,) at `knots` (T,) mm along axis `along`, about their line and the features' mean,
    with the covariance (T, T); `roughness` is the variance of the integrated Wiener process per
    mm^3, `between` a variance off the knots. In mm or rad.
    """

    along: str
    knots: FloatArray
    values: FloatArray
    covariance: FloatArray
    roughness: float
    dof: float
    between: float = 0.0


class Experiment(NamedTuple):
    """What to do, and the separation of the rivals in standard deviations after it."""

    do: str
    predicted_d: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundEffect:
    """An effect that the model lacks: the `candidate`, and what the data say of it.

    `parameters` are the effect's, then its margins', levels and changes of what was searched.
    `equations` are in these and columns; where the candidate is `over` features, parts or
    operations, which no machine has, `chosen` is the one for which ``chosen`` is 1; a smooth
    effect's component stands for its `table` of values in mm or rad. An effect on the scatter has
    no equation: `ratio` is that of the standard deviations. `class_names` are those that the data
    cannot separate, itself first, with an effect that is `nameless` if so; `aliases` names whose
    columns span the same, whatever the errors.
    """

    candidate: Candidate
    covariate: str | None = None
    parameters: tuple[Parameter, ...] = ()
    equations: Mapping[str, str]
    table: SmoothEffect | None = None
    chosen: str | None = None
    ratio: float | None = None
    searched: Searched | None = None
    p_familywise: float = 1.0
    log_bayes_factor: float | None = None
    posterior: float | None = None
    explained_share: float = 0.0
    class_names: tuple[str, ...] = ()
    nameless: bool = False
    aliases: tuple[str, ...] = ()
    experiment: Experiment | None = None

    @property
    def name(self) -> str:
        """The name of its candidate."""
        return self.candidate.name

    @property
    def component(self) -> str:
        """What a smooth effect is called in equations."""
        return self.name.replace("-", "_")

    def of_role(self, *roles: str) -> tuple[Parameter, ...]:
        """Its parameters of some roles."""
        return tuple(p for p in self.parameters if p.role in roles)

    @property
    def ambiguous(self) -> bool:
        """Whether several intervals of what was searched fit."""
        several = self.searched is not None and len(self.searched.intervals) > 1
        return several and bool(self.of_role("searched"))

    @property
    def used(self) -> list[str]:
        """The names in its equations, each once."""
        return [*dict.fromkeys(n for text in self.equations.values() for n in names(parse(text)))]

    @property
    def written(self) -> tuple[Parameter, ...]:
        """Those of its parameters that its equations have: a table stands for its sizes."""
        used = self.used
        return tuple(parameter for parameter in self.parameters if parameter.name in used)

    @property
    def not_written(self) -> str:
        """Why a machine is written without it; empty where it is not."""
        if self.candidate.over is not None or not self.equations:
            return "no equation of the machine can hold it"
        if self.ambiguous and self.searched is not None and self.table is None:
            name = self.searched.name
            return f"several ranges of {name} fit, and each predicts other errors elsewhere"
        return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A candidate added to the known model alone; `unavailable` says why it could not be tested.

    `minimum_detectable` is the root mean square, over the cells, of an effect that would be found
    four times in five.
    """

    candidate: Candidate
    p_familywise: float | None
    log_bayes_factor: float | None
    posterior: float | None
    unavailable: str | None
    minimum_detectable: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Errors: root mean square over all coordinates, by axis, 95th percentile and largest of the
    error vector's length, and chi^2 a degree of freedom against the residual variances.
    """

    rms: float
    by_axis: Mapping[str, float]
    p95: float
    largest: float
    chi2_per_dof: float | None


class Crossing(NamedTuple):
    """Where effects cancel: "right at T = 22.2 degC", "turns about y = 134 mm"; the interval is
    Fieller's. `whole`: all errors along the axis do, not only what `effect` makes of a further
    column or coordinate.
    """

    axis: str
    covariate: str
    value: float
    u: float
    interval95: tuple[float, float]
    effect: str = ""
    whole: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class TableResult:
    """One table (all points, or the readings of one component).

    `explained` (P, H, A) is the effects' contribution; `before` and `after` are scores of what was
    `held_out`, such as ``passes``, without and with the correction of the machine
    as it is written, or of the average over each class; `floor` the repeatability of one
    coordinate. `outliers` (P, H, A) are the single entries that were excluded. `covariance` is over
    the sizes of all effects, then the levels of all axes.
    """

    table: ResidualTable
    verdict: str
    effects: tuple[FoundEffect, ...]
    candidates: tuple[Judged, ...]
    checks: tuple[tuple[str, float], ...]
    fired: tuple[str, ...]
    nameless: bool
    outliers: BoolArray
    explained: FloatArray
    before: Scores
    after: Scores
    after_averaged: Scores
    in_sample_before: Scores
    in_sample_after: Scores
    held_out: str
    floor: float | None
    crossings: tuple[Crossing, ...]
    covariance: FloatArray
    stopped: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseLoopResult:
    """The weakest verdict over all tables, and their results."""

    verdict: str
    tables: tuple[TableResult, ...]
    alpha: float
    warnings: tuple[Finding, ...] = ()
