"""What the readings say of every component: lines, scatter, tests, and what stays undetermined."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mtu_cli.analyses.observability import NotDetermined, not_estimable, observability
from mtu_cli.findings import Finding, finding
from mtu_cli.model.estimates import (
    ComponentEstimate,
    Estimates,
    JointPasses,
    from_centre,
    to_centre,
)
from mtu_cli.model.estimation import ComponentFit, InstrumentFit
from mtu_cli.model.fit import MachineFit
from mtu_cli.model.passes import Passes
from mtu_cli.stats.family import significant
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import FTest, Shift
from mtu_cli.stats.positive_part import positive_part

NOTHING = 1e-9
"""Share of the figures beside it below which a scatter is the rounding of their sums."""
Coefficient = tuple[float, float | None] | None
Scatter = tuple[float | None, float | None]
Test = Callable[[InstrumentFit], FTest | Shift | None]
TESTS: dict[str, Test] = {
    "drift": lambda item: item.scatter,
    "trend": lambda item: item.trend,
    "lack_of_fit": lambda item: item.lack_of_fit,
    "reversal": lambda item: item.reversal,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tested:
    """A test: F or the size of a shift as `value` with its `u` (None of F), p, degrees of
    freedom; `significant` among all components (Bonferroni). `size` is that of the component's
    unit.
    """

    value: float
    u: float | None
    p: float
    dof: int | tuple[int, int]
    significant: bool
    size: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Passes there and back, each as (file, number, direction), in time."""

    role: str
    passes: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, kw_only=True)
class Component:
    """One component as the report has it: all that predictions need, and what people ask.

    `fit` is None where the component is known from the machine file only.
    """

    name: str
    says: str | None
    estimate: ComponentEstimate
    fit: ComponentFit | None
    significant: Mapping[str, set[str]]

    @property
    def size(self) -> float:
        """Of its unit in mm or rad."""
        return self.estimate.unit.to_internal

    @property
    def size2(self) -> float:
        """Its square."""
        return self.size**2

    @property
    def source(self) -> str:
        """Where it is known from."""
        return "machine file" if self.fit is None else "readings"

    @property
    def n(self) -> int | None:
        """Number of readings."""
        return None if self.fit is None else sum(len(item.error) for item in self.fit.instruments)

    @property
    def passes_read(self) -> int | None:
        """Number of passes of the readings; None where one instrument has none."""
        counts = [len(item.keys_read) for item in self.fit.instruments] if self.fit else []
        return sum(counts) if counts and all(counts) else None

    @property
    def runs(self) -> tuple[Run, ...] | None:
        """The passes of each run there and back; None where no passes are given."""
        found = [
            Run(role=item.role, passes=tuple((f + 1, n, way) for f, n, way in keys))
            for item in (() if self.fit is None else self.fit.instruments)
            if item.read is not None
            for keys in runs_of(item.read)
        ]
        return tuple(found) or None

    @property
    def runs_read(self) -> int | None:
        """Number of runs there and back."""
        return None if self.runs is None else len(self.runs)

    @property
    def one(self) -> InstrumentFit | None:
        """The fit of the one instrument that read it; None for none or several."""
        alone = self.fit is not None and len(self.fit.instruments) == 1
        return self.fit.instruments[0] if self.fit is not None and alone else None

    @property
    def pass_center(self) -> float:
        """Position (mm) at which the pass-to-pass intercept is stated: 0 without readings; with
        several instruments the mean of all their readings.
        """
        if self.fit is None:
            return 0.0
        if self.one is not None:
            return float(self.one.fit.center)
        return float(np.concatenate([item.position for item in self.fit.instruments]).mean())

    @cached_property
    def pass_covariance(self) -> FloatArray:
        """D (q, q) of the intercept at `pass_center` and the slope, as a covariance.

        q is 2, or 1 for a constant. The moment estimate less its negative part, which stands for
        passes that differ by less than repeatability alone would make them.
        """
        if self.one is not None:
            return self._padded(self.one.fit.D)
        D = self.pass_covariance_moment
        return D if np.linalg.eigvalsh(D)[0] >= 0 else positive_part(D)

    @cached_property
    def pass_covariance_moment(self) -> FloatArray:
        """The unbiased D (q, q) that predictions use, at `pass_center`; it may have a negative
        part.
        """
        if self.one is not None:
            return self._padded(self.one.fit.D_moment)
        return to_centre(self.pass_center, self.estimate.pass_covariance)

    @property
    def half_differences(self) -> FloatArray | None:
        """The mean square S_h (q, q) of runs there and back at `pass_center`; None without runs."""
        if self.one is not None:
            halves = self.one.fit.half_differences
            return None if halves is None else self._padded(halves)
        halves = self.estimate.half_differences
        return None if halves is None else to_centre(self.pass_center, halves)

    @property
    def run_covariance(self) -> FloatArray | None:
        """K (q, q) of runs there and back at `pass_center`, of several instruments; else None."""
        K = self.estimate.run_covariance
        return None if K is None else to_centre(self.pass_center, K)

    def _padded(self, D: FloatArray) -> FloatArray:
        """Where some pass has one position only the level varies from pass to pass, not the
        slope.
        """
        q = min(2, len(self.estimate.coefficients))
        whole = np.zeros((q, q))
        whole[: len(D), : len(D)] = D
        return whole

    @property
    def s_pass(self) -> float:
        """Pass-to-pass standard deviation at `pass_center`."""
        return float(np.sqrt(self.pass_covariance[0, 0]))

    @property
    def dof(self) -> int | None:
        """Of the straight fit to all readings of the one instrument."""
        return None if self.one is None else int(self.one.fit.plain.dof)

    @property
    def r2(self) -> float | None:
        """Share of the variance that the polynomial explains."""
        return None if self.one is None else r2_of(self.one)

    @property
    def agreement_p(self) -> float | None:
        """p that the instruments agree."""
        return None if self.fit is None else self.fit.agreement_p

    @property
    def u(self) -> FloatArray:
        """Standard uncertainties of the coefficients."""
        u: FloatArray = np.sqrt(np.diag(self.estimate.covariance))
        return u

    @cached_property
    def tests(self) -> dict[str, Tested]:
        """By name, of the one instrument."""
        return {} if self.one is None else self.tests_of(self.one)

    def tests_of(self, item: InstrumentFit) -> dict[str, Tested]:
        """By name, those that the readings allow."""
        made = {name: test(item) for name, test in TESTS.items()}
        return {
            name: _tested(each, f"{self.name}\n{item.role}" in self.significant[name], self.size)
            for name, each in made.items()
            if each is not None
        }

    @property
    def instruments(self) -> tuple[Instrument, ...]:
        """Every instrument that read it."""
        known = () if self.fit is None else self.fit.instruments
        return tuple(Instrument(item=item, component=self) for item in known)

    @property
    def label(self) -> str:
        """Its name."""
        return self.name

    @property
    def of(self) -> str | None:
        """Its axis."""
        return self.estimate.of

    def coefficient(self, power: int) -> Coefficient:
        """A coefficient and its u."""
        return _coefficient(self.estimate.coefficients, self.estimate.covariance, power)

    @property
    def scatter(self) -> Scatter:
        """s_repeat and s_pass, each only where the readings separate it from the other."""
        fits = () if self.fit is None else self.fit.instruments
        level = float(self.estimate.coefficients[0])
        return _scatter(self.estimate.s_repeat, self.s_pass, level, fits)


@dataclass(frozen=True, slots=True, kw_only=True)
class Instrument:
    """One instrument's readings of a component."""

    item: InstrumentFit
    component: Component

    @property
    def size(self) -> float:
        """Of the component's unit."""
        return self.component.size

    @property
    def size2(self) -> float:
        """Its square."""
        return self.component.size2

    @property
    def label(self) -> str:
        """Its role, below the name of the component."""
        return f"  {self.item.role}"

    @property
    def of(self) -> str:
        """Stated with the component."""
        return ""

    @property
    def source(self) -> str:
        """Where it is known from."""
        return "readings"

    @property
    def estimate(self) -> ComponentEstimate:
        """Of the component, for its unit."""
        return self.component.estimate

    @property
    def agreement_p(self) -> None:
        """Stated with the component."""

    def coefficient(self, power: int) -> Coefficient:
        """A coefficient and its u."""
        return _coefficient(self.item.fit.plain.coefficients, self.item.fit.covariance, power)

    @property
    def scatter(self) -> Scatter:
        """As of the component, at the place that the component's own is of."""
        fit, b = self.item.fit, self.item.fit.plain.coefficients
        T = from_centre(fit.center, len(b), len(fit.D))
        D = to_centre(self.component.pass_center, T @ fit.D @ T.T)
        s_pass = float(np.sqrt(max(D[0, 0], 0.0)))
        return _scatter(self.s_repeat, s_pass, float(b[0]), [self.item])

    @property
    def n_passes(self) -> int | None:
        """Of the mean square between passes."""
        return self.item.fit.n_passes if self.item.fit.separated else None

    @property
    def s(self) -> float:
        """Residual standard deviation, all readings as repeats."""
        return float(np.sqrt(self.item.fit.plain.s2))

    @property
    def s_repeat(self) -> float:
        """Repeatability of one visit."""
        return float(np.sqrt(self.item.fit.s2))

    @property
    def tests(self) -> dict[str, Tested]:
        """By name."""
        return self.component.tests_of(self.item)

    @property
    def r2(self) -> float | None:
        """Share of the variance that the polynomial explains."""
        return r2_of(self.item)

    @property
    def passes_read(self) -> int | None:
        """Number of passes of the readings; None where no pass is given."""
        return len(self.item.keys_read) or None

    @property
    def runs_read(self) -> int | None:
        """Number of runs there and back."""
        return None if self.item.read is None else len(runs_of(self.item.read))


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedPasses:
    """Components that share passes; `units` (K, K) are products of their units' sizes,
    `correlation` is that of the passes' levels and slopes (`correlation_of`), repeatability
    included: nan of passes without any scatter.
    """

    group: JointPasses
    units: FloatArray
    correlation_of: tuple[str, ...]
    correlation: FloatArray


@dataclass(frozen=True, kw_only=True)
class FitResult:
    """All components of a machine, those of the machine file too."""

    machine: str
    fit: MachineFit
    estimates: Estimates
    components: Mapping[str, Component]
    joint: tuple[SharedPasses, ...]
    coverage_factor: float = 2.0

    @cached_property
    def observability(self) -> tuple[NotDetermined, ...]:
        """What the data do not determine, and which readings would."""
        return tuple(observability(self.fit, self.estimates))

    @property
    def says(self) -> dict[str, str]:
        """The meaning of components in words."""
        return {name: item.says for name, item in self.components.items() if item.says}

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Why figures are not estimable, and what trends rest on."""
        noted = not_estimable(self.observability)
        several = [x.name for x in self.components.values() if x.fit and len(x.fit.instruments) > 1]
        if several:
            reason = "several instruments: see `instruments`"
            noted.append(
                finding("not-estimable", quantity="dof and r2", names=several, reason=reason)
            )
        # Of trends through several files without times the order of the files is their time.
        of_files = [
            name
            for name, component in self.fit.components.items()
            if any(x.trend is not None and x.trend_of_files for x in component.instruments)
        ]
        if of_files:
            noted.append(finding("order-of-files", names=of_files, expected="a column time"))
        return tuple(noted)


def fit_result(
    machine: str,
    fit: MachineFit,
    estimates: Estimates,
    *,
    says: Mapping[str, str] | None = None,
    coverage_factor: float = 2.0,
) -> FitResult:
    """The figures of a fit; `estimates` holds the components of the machine file too."""
    flags = {name: _significant(fit, test) for name, test in TESTS.items()}
    return FitResult(
        machine=machine,
        fit=fit,
        estimates=estimates,
        components={
            name: Component(
                name=name,
                says=(says or {}).get(name),
                estimate=estimate,
                fit=fit.components.get(name),
                significant=flags,
            )
            for name, estimate in estimates.components.items()
        },
        joint=tuple(_shared(fit, estimates, group) for group in estimates.joint),
        coverage_factor=coverage_factor,
    )


def runs_of(read: Passes) -> list[list[tuple[int, int, int]]]:
    """The passes of each run, runs and passes in time."""
    in_time = np.argsort(read.order, kind="stable")
    return [[read.keys[g] for g in in_time if read.runs[g] == run] for run in np.unique(read.runs)]


def r2_of(item: InstrumentFit) -> float | None:
    """Share of the readings' variance that the polynomial explains; None for a constant."""
    about_mean = float(((item.error - item.error.mean()) ** 2).sum())
    if len(item.fit.plain.coefficients) < 2 or about_mean == 0:
        return None
    return float(1.0 - item.fit.plain.rss / about_mean)


def _significant(fit: MachineFit, test: Test) -> set[str]:
    """``component\\nrole`` of those that are significant among all of their kind."""
    p_values = {
        f"{name}\n{item.role}": made.p
        for name, component in fit.components.items()
        for item in component.instruments
        if (made := test(item)) is not None
    }
    return set(significant(p_values))


def _tested(test: FTest | Shift, among_all: bool, size: float) -> Tested:
    if isinstance(test, FTest):
        df = (test.df_numerator, test.df_denominator)
        return Tested(value=test.F, u=None, p=test.p, dof=df, significant=among_all, size=1.0)
    return Tested(
        value=test.value, u=test.u, p=test.p, dof=test.dof, significant=among_all, size=size
    )


def _coefficient(b: FloatArray, C: FloatArray, power: int) -> Coefficient:
    """None beyond the degree; u None where the machine file states none."""
    if power >= len(b):
        return None
    u = float(np.sqrt(C[power, power]))
    return float(b[power]), u if u > 0 else None


def _scatter(
    s_repeat: float, s_pass: float, level: float, items: Sequence[InstrumentFit]
) -> Scatter:
    """`items` are the instruments, none of a component of the machine file."""
    fits = [item.fit for item in items]
    s_pass = 0.0 if s_pass <= NOTHING * max(s_repeat, abs(level)) else s_pass
    repeated = not fits or any(not fit.separated or fit.within_dof > 0 for fit in fits)
    several = any(fit.separated for fit in fits) if fits else s_pass > 0
    return s_repeat if repeated else None, s_pass if several else None


def _shared(fit: MachineFit, estimates: Estimates, group: JointPasses) -> SharedPasses:
    sizes = np.concatenate(
        [
            np.full(width, estimates.components[name].unit.to_internal)
            for name, width in zip(group.components, group.widths, strict=True)
        ]
    )
    names: list[str] = []
    columns = []
    for name in group.components:
        # Of the passes' lines from their mean by direction.
        deviations = fit.components[name].instruments[0].fit.deviations
        names += [f"{name} {what}" for what in ("level", "slope")[: deviations.shape[1]]]
        columns.append(deviations)
    joined = np.column_stack(columns)
    norms = np.linalg.norm(joined, axis=0)
    norms[norms == 0] = np.nan
    return SharedPasses(
        group=group,
        units=np.outer(sizes, sizes),
        correlation_of=tuple(names),
        correlation=(joined / norms).T @ (joined / norms),
    )
