"""What closing the loop found, as one frozen result in internal units (mm, rad, degC, min)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from mtu_cli.analyses.close_loop.experiment import Experiment
from mtu_cli.findings import Finding, listed
from mtu_cli.language import names, parse
from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

Verdict = Literal["none", "named", "class", "unexplained"]
WORST: tuple[Verdict, ...] = ("unexplained", "class", "named", "none")
Kind = Literal["mean", "smooth", "scatter", "offset", "outlier"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """A parameter with its standard uncertainty, degrees of freedom and 95 % interval; `unit` to
    show it in. `role`: own, margin, level, or searched (a change of what was searched).
    """

    name: str
    unit: str
    value: float
    u: float
    dof: float
    interval95: tuple[float, float]
    role: str = "own"


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothTable:
    """A smooth effect as a table component: values (T,) at `at_mm` with their covariance (T, T)
    along `of`; `roughness` (mm^2/mm^3) gives the u between them, `between` (mm^2) more of it.
    """

    of: str
    at_mm: FloatArray
    values: FloatArray
    covariance: FloatArray
    roughness: float
    between: float = 0.0


def component_name(name: str) -> str:
    """What a smooth effect is called in equations."""
    return name.replace("-", "_")


@dataclass(frozen=True, slots=True, kw_only=True)
class Searched:
    """The value of what an effect is not linear in, and its 95 % set, a union of intervals."""

    value: float
    intervals: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundEffect:
    """An effect that the model lacks. `rows` are its own in the covariance of the table.

    `parameters` are its own, `beside` those of its margins, levels and changes of what was
    searched; `covariance` (k, k) over both. `equations` are in these and columns; in those of an
    effect `over` features, parts or operations, which no machine has, `chosen` is 1 on that one; in
    that of a smooth effect its component stands for its `table`. An effect on the scatter has none:
    `ratio` says how much more an operation or a pattern of whole parts scatters. `classes` are the
    names that the data cannot tell apart, itself first, with their posteriors; `aliases` those that
    are the same here whatever the data; `found_at` temperatures
    (degC) that did not change. `sentence` is the template of what it does (`files.effects`).
    """

    name: str
    family: str
    kind: Kind
    axis: str | None
    component: str | None
    covariate: str | None
    says: str
    sentence: str = ""
    separates: str | None
    parameters: tuple[Parameter, ...]
    beside: tuple[Parameter, ...]
    covariance: FloatArray
    rows: tuple[int, ...] = ()
    equations: Mapping[str, str]
    table: SmoothTable | None
    chosen: str | None
    over: str | None = None
    ratio: float | None
    searched: Mapping[str, Searched]
    p_familywise: float
    log_bayes_factor: float | None
    posterior: float | None
    explained_share: float
    classes: tuple[tuple[str, float], ...]
    aliases: tuple[str, ...]
    nameless: float
    found_at: Mapping[str, float] = field(default_factory=dict)
    experiment: Experiment | None = None
    folds: tuple[int, int] = (0, 0)

    @property
    def class_names(self) -> tuple[str, ...]:
        """The names of its class."""
        return tuple(name for name, _ in self.classes)

    @property
    def all_parameters(self) -> tuple[Parameter, ...]:
        """Its parameters in the order of its covariance."""
        return (*self.parameters, *self.beside)

    @property
    def written(self) -> list[int]:
        """Which of its parameters its equations have: a table stands for sizes of its own."""
        used = {name for text in self.equations.values() for name in names(parse(text))}
        return [i for i, parameter in enumerate(self.all_parameters) if parameter.name in used]

    @property
    def several(self) -> tuple[str, ...]:
        """What was searched and has several ranges: each predicts other errors elsewhere."""
        continuous = any(p.role == "searched" for p in self.beside)
        each = self.searched.items() if continuous else ()
        return tuple(name for name, found in each if len(found.intervals) > 1)

    @property
    def not_written(self) -> str:
        """Why a machine is written without it; empty where it is not."""
        if self.over is not None or not self.equations:
            return "no equation of the machine can hold it"
        if self.several and self.table is None:
            return (
                f"several ranges of {listed(self.several)} fit, and each predicts other errors "
                "elsewhere"
            )
        return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A candidate beside the known model alone; `unavailable` says why it could not be tested.

    `minimum_detectable` is the root mean square, over the cells, of an effect that would be found
    four times in five.
    """

    name: str
    family: str
    component: str | None
    p_familywise: float | None
    log_bayes_factor: float | None
    posterior: float | None
    unavailable: str | None
    minimum_detectable: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Errors: root mean square over all coordinates, by axis, 95th percentile and largest of the
    error vector's length, and chi^2 a degree of freedom against the variances left.
    """

    rms: float
    by_axis: Mapping[str, float]
    p95: float
    largest: float
    chi2_per_dof: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Where effects cancel: "right at T = 22.2 degC", "turns about y = 134 mm"; the interval is
    Fieller's. `whole`: all errors along the axis do, not only what `effect` makes of a further
    column or coordinate.
    """

    axis: str
    covariate: str
    value: float
    u: float
    interval95: tuple[float, float] | None
    effect: str = ""
    whole: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class TableResult:
    """One table (all points, or the readings of one component).

    `explained` (P, H, A) is the effects' contribution; `before` and `after` are scores of what was
    `held_out_by` parts or columns (None: in sample), without and with the correction of the machine
    as it is written, or of the average over each class; `floor` the repeatability of one
    coordinate.
    `set_aside` (feature, part, axis, error) are single entries that do not count.
    """

    table: ResidualTable
    verdict: Verdict
    effects: tuple[FoundEffect, ...]
    candidates: tuple[Judged, ...]
    checks: tuple[tuple[str, float], ...]
    fired: tuple[str, ...]
    nameless: bool
    set_aside: tuple[tuple[str, str, str, float], ...]
    explained: FloatArray
    before: Scores
    after: Scores
    after_averaged: Scores
    in_sample_before: Scores
    in_sample_after: Scores
    held_out_by: str | None
    floor: float | None
    crossings: tuple[Crossing, ...]
    covariance: FloatArray
    stopped: bool

    @property
    def nouns(self) -> tuple[str, str]:
        """What rows and columns of the table are called."""
        return ("part", "feature") if self.table.component is None else ("pass", "position")


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseLoopResult:
    """The weakest verdict over all tables, and their results."""

    verdict: Verdict
    tables: tuple[TableResult, ...]
    alpha: float
    datum: str
    warnings: tuple[Finding, ...] = ()

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """The effects of all tables."""
        return tuple(effect for table in self.tables for effect in table.effects)
