"""Inputs of a budget: quantities, their covariance, and the independent sources behind them.

A contribution that nothing is correlated with is one source. Inputs with stated
correlations, and readings that were taken together, are one source each connected set: where all
are normal or t, jointly normal, scaled to a multivariate t of their degrees of freedom (JCGM
102:2011, 5.3.2; JCGM 101:2008, 6.4.9), or each by its scale where these differ; where some
are bounded (rectangular, ...), a Gaussian copula with the stated correlation. For
Welch-Satterthwaite a source is one term g' V g with the smallest degrees of freedom of its members.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.budget import Contribution, Input, LoadedBudget
from mtu_cli.findings import Finding, InputError, finding, listed
from mtu_cli.model.features import NO_U
from mtu_cli.stats.covariance import correlation_of, factor_of
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.distributions import (
    Distribution,
    Kind,
    largest_covariance,
    normal_correlation,
    shape_moments,
)
from mtu_cli.stats.least_squares import FloatArray

NOT_DEFINITE = 1e-9
"""An eigenvalue of a correlation matrix below minus this is no rounding."""
ROUNDING = 1e-13
NOTHING = 1e-150
"""A u whose square a computer cannot hold is 0."""
SHOWN_PAIRS = 6


@dataclass(frozen=True, slots=True)
class Part:
    """One contribution to an input: type A from readings, else type B; independent of others."""

    distribution: Distribution
    says: str = ""
    type_a: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class InputQuantity:
    """An input: estimate `value` and its contributions.

    `u`: each contribution counted once, JCGM 100:2008, 4.3.10. `dof`: effective ones of the
    contributions together, GUM eq. (G.2b). `excess`: fourth cumulant over u^4.
    """

    name: str
    value: float
    unit: str
    parts: tuple[Part, ...]
    u: float
    dof: float
    excess: float

    @property
    def normal(self) -> bool:
        """Whether every contribution is normal or Student's t."""
        return not any(part.distribution.bounded for part in self.parts)

    @property
    def without_u(self) -> bool:
        """Whether a contribution is a t of two degrees of freedom or fewer, which has none."""
        items = [part.distribution for part in self.parts]
        return any(item.dof <= 2.0 and not item.bounded for item in items)

    @property
    def kind(self) -> str:
        """How it is distributed, in a word or two."""
        kinds = dict.fromkeys(part.distribution.kind for part in self.parts)
        return " + ".join(kinds) or "exact"

    @property
    def type(self) -> str:
        """A, B or A+B, JCGM 100:2008, 3.3.4; empty for an exact value."""
        return "+".join(sorted({"A" if part.type_a else "B" for part in self.parts}))


@dataclass(frozen=True, slots=True)
class Source:
    """Deviations of the inputs `rows` that are drawn together, with `covariance`.

    `members`: their distributions, one for each row. `factor` (n, rank): what turns independent
    normals into normal deviations of theirs; bounded members have unit variance there. None of a
    source that is drawn alone.
    """

    rows: list[int]
    members: list[Distribution]
    covariance: FloatArray
    factor: FloatArray | None = None

    @property
    def bounded(self) -> bool:
        """Whether it holds a bounded distribution."""
        return any(item.bounded for item in self.members)

    @property
    def is_t(self) -> bool:
        """Whether its deviations are jointly t: every sum of them is a t."""
        return not self.bounded and len({item.dof for item in self.members}) == 1

    def variance(self, gradient: FloatArray) -> float:
        """g' V g (first order) of the source for a gradient over all inputs."""
        g = gradient[self.rows]
        value = float(g @ self.covariance @ g)
        # Fully correlated inputs that cancel leave rounding alone.
        return 0.0 if value <= ROUNDING * float(g**2 @ np.diag(self.covariance)) else value

    def dof(self, gradient: FloatArray) -> float:
        """Degrees of freedom of that variance; infinite where no member counts."""
        pairs = zip(self.rows, self.members, strict=True)
        return min((item.dof for row, item in pairs if gradient[row] != 0.0), default=math.inf)


@dataclass(frozen=True, slots=True)
class Inputs:
    """All inputs in the order of the file, `covariance` (n, n) of their estimates, `sources`."""

    quantities: tuple[InputQuantity, ...]
    covariance: FloatArray
    sources: list[Source]

    @property
    def correlation(self) -> FloatArray:
        """Their correlation coefficients (n, n), 0 of exact ones."""
        return np.nan_to_num(correlation_of(self.covariance))

    @property
    def u(self) -> FloatArray:
        """Standard uncertainties (n,)."""
        return np.array([item.u for item in self.quantities])

    def findings(self) -> Iterator[Finding]:
        """Inputs that have no u, and what is assumed of correlated ones."""
        if short := [item.name for item in self.quantities if item.without_u]:
            yield finding("few-degrees-of-freedom", names=short, how=NO_U)
        for source in self.sources:
            names = [self.quantities[row].name for row in source.rows]
            if source.factor is not None and source.bounded:
                how, assumed = "all normal", "the Monte Carlo takes a Gaussian copula"
                yield finding("correlated-inputs", names=names, how=how, assumed=assumed)
            if len({item.dof for item in source.members}) > 1:
                how = "of the same degrees of freedom"
                assumed = "Welch-Satterthwaite takes the smallest for all of them, the trials "
                assumed += "each its own, which makes the coefficients smaller"
                yield finding("correlated-inputs", names=names, how=how, assumed=assumed)


def inputs_of(loaded: LoadedBudget) -> Inputs:
    """The inputs of a budget.

    A stated coefficient belongs to the whole of both inputs; readings taken together give that of
    their type A parts alone, GUM eq. (17).

    Raises InputError for correlations that no inputs can have.
    """
    from scipy.sparse.csgraph import connected_components

    file = loaded.budget
    inputs = tuple(_quantity(name, item) for name, item in file.inputs.items())
    place = {item.name: i for i, item in enumerate(inputs)}
    u = np.array([item.u for item in inputs])
    covariance, links = np.diag(u**2), np.zeros((len(u), len(u)))
    for first, second, r in file.correlations:
        i, j = place[first], place[second]
        covariance[i, j] = covariance[j, i] = r * u[i] * u[j]
        links[i, j] = r
    _, label = connected_components(links, directed=False)
    several = np.bincount(label) > 1
    sources: list[Source] = []
    problems: list[Finding] = []
    for number in np.flatnonzero(several):
        rows = np.flatnonzero(label == number).tolist()
        try:
            sources.append(_correlated(rows, [inputs[i] for i in rows], covariance))
        except InputError as fault:
            problems += [each.at(**loaded.place("correlations")) for each in fault.findings]
    if problems:
        raise InputError(problems)
    parts = [(i, x) for i, item in enumerate(inputs) if not several[label[i]] for x in item.parts]
    for group in file.simultaneous:
        # Type B contributions are separate: only the scatter of the readings is shared.
        shared = {i: x for i, x in parts if x.type_a and inputs[i].name in group}
        if not shared:
            continue
        parts = [(i, x) for i, x in parts if shared.get(i) is not x]
        rows, members = list(shared), [part.distribution for part in shared.values()]
        readings = np.array([file.inputs[inputs[i].name].readings for i in rows])
        deviation = readings - readings.mean(axis=1, keepdims=True)
        n = readings.shape[1]
        joint = deviation @ deviation.T / (n * (n - 1))
        np.fill_diagonal(joint, [item.u**2 for item in members])
        sources.append(Source(rows, members, joint, factor_of(joint)))
        off = ~np.eye(len(rows), dtype=bool)
        covariance[np.ix_(rows, rows)] = np.where(off, joint, covariance[np.ix_(rows, rows)])
    for i, part in parts:
        sources.append(Source([i], [part.distribution], np.array([[part.distribution.u**2]])))
    return Inputs(inputs, covariance, sources)


def _quantity(name: str, item: Input) -> InputQuantity:
    parts: list[Part] = []
    value = item.middle if item.value is None else item.value
    if item.readings is not None:
        readings = np.array(item.readings, dtype=np.float64)
        n = len(readings)
        # Of equal readings the mean would be off by its rounding, which is no scatter.
        alike = bool(np.all(readings == readings[0]))
        value = item.readings[0] if alike else math.fsum(item.readings) / n
        s = float(np.std(readings - value, ddof=1))
        scatter = Distribution(kind="t", u=s / math.sqrt(n), dof=n - 1.0)
        parts.append(Part(scatter, "readings", type_a=True))
    type_b = [
        (_distribution(item), ""),
        *((_distribution(x), x.says or "") for x in item.contributions),
    ]
    parts += [Part(shape, says) for shape, says in type_b if shape is not None]
    parts = [part for part in parts if part.distribution.u > NOTHING]
    shapes = [part.distribution for part in parts]
    squares = np.array([each.u**2 for each in shapes])
    u = math.sqrt(math.fsum(squares))
    dof = float(welch_satterthwaite(squares, np.array([each.dof for each in shapes])))
    return InputQuantity(
        name=name,
        value=math.nan if value is None else value,
        unit=item.unit or "",
        parts=tuple(parts),
        u=u,
        dof=shapes[0].dof if len(shapes) == 1 else dof,
        excess=math.fsum(each.excess * (each.u / u) ** 4 for each in shapes),
    )


def _distribution(item: Contribution) -> Distribution | None:
    """The distribution that an entry states; None without a width. With finite degrees of freedom a
    rectangle (triangle, ...) keeps the u of its limits, as in GUM H.1; the curvilinear trapezoid
    has a larger one, JCGM 101:2008, 6.4.3: u^2 = a^2/3 + d^2/9.
    """
    dof = math.inf if item.dof is None else item.dof
    kind: Kind = item.distribution or "normal"
    u, half, top, inexact = item.standard, item.half, item.top or 0.0, item.inexact
    if kind in ("normal", "t"):
        return None if u is None else Distribution(kind=kind, u=u, dof=dof)
    if u is None and half is None:
        return None
    # d/a = Delta u/u = 1/sqrt(2 nu) (JCGM 100:2008, G.4.2; JCGM 101:2008, 9.5.2).
    curved, inexact_u = kind == "curvilinear-trapezoidal", 1.0 / math.sqrt(2.0 * dof)
    if half is None:
        # JCGM 101:2008, 6.4.3 and 6.4.4, turned about.
        square = (u or 0.0) ** 2
        if kind == "trapezoidal":
            square = 6.0 * square - top**2
        elif curved and inexact is not None:
            square = 3.0 * (square - inexact**2 / 9.0)
        else:
            more = 1.0 + inexact_u**2 / 3.0 if curved else 1.0
            square /= shape_moments(kind)[0] * more
        half = math.sqrt(max(square, 0.0))
    share = inexact_u if inexact is None else (inexact / half if half > 0.0 else 0.0)
    if u is None:
        second = shape_moments(kind, top / half if half > 0.0 else 0.0)[0]
        u = half * math.sqrt(second * (1.0 + share**2 / 3.0 if curved else 1.0))
    if inexact is not None:
        dof = 0.5 / share**2 if share else math.inf
    return Distribution(kind=kind, u=u, dof=dof, half_width=half, top=top, inexact=share)


def _correlated(rows: list[int], inputs: Sequence[InputQuantity], covariance: FloatArray) -> Source:
    """The source of the `inputs` at `rows`; raises InputError where there is none."""

    def impossible(named: Sequence[str], why: str, expected: str, **value: str) -> Finding:
        reason = f"{listed(named, SHOWN_PAIRS)} cannot be correlated like this: {why}"
        return finding("wrong-correlation", reason=reason, expected=expected, **value)

    def least_eigenvalue(r: FloatArray) -> float | None:
        """Where it is below 0 by more than rounding."""
        least = float(np.linalg.eigvalsh(r)[0])
        return least if least < -NOT_DEFINITE * len(rows) else None

    names = [item.name for item in inputs]
    expected = "two inputs, their sum in the equation, and the correlation of one of them"
    problems = [
        impossible([item.name], "it has several contributions, not all normal", expected)
        for item in inputs
        if not item.normal and len(item.parts) > 1
    ]
    joint = covariance[np.ix_(rows, rows)]
    r = np.nan_to_num(correlation_of(joint))
    if (least := least_eigenvalue(r)) is not None:
        pairs = [f"{names[a]}-{names[b]} {r[a, b]:.6g}" for a, b in np.argwhere(np.triu(r, 1))]
        why = f"the smallest eigenvalue of the correlation matrix is {least:.4g}"
        problems.append(impossible(pairs, why, "a matrix without negative eigenvalues"))
    if problems:
        raise InputError(problems)
    members = [
        Distribution(kind="normal", u=x.u, dof=x.dof) if x.normal else x.parts[0].distribution
        for x in inputs
    ]
    if not any(item.bounded for item in members):
        return Source(rows, members, joint, factor_of(joint))
    # The correlation matrix of the normals behind inputs that are not all normal.
    rho = np.eye(len(rows))
    for a, b in np.argwhere(np.tril(joint, -1)).tolist():
        target, of = float(joint[a, b]), (members[a], members[b])
        if (coefficient := normal_correlation(*of, target)) is None:
            unit = math.sqrt(joint[a, a] * joint[b, b])
            # Rounded towards 0, so that what it says is possible.
            limit = math.floor(1e6 * largest_covariance(*of) / unit) / 1e6
            why, value = "their distributions allow no coefficient so large", f"{target / unit:.9g}"
            ends = f"-{limit:g} to {limit:g}"
            problems.append(impossible((names[b], names[a]), why, ends, value=value))
        else:
            rho[a, b] = rho[b, a] = coefficient
    if not problems and (least := least_eigenvalue(rho)) is not None:
        why = f"the smallest eigenvalue of their Gaussian copula is {least:.4g}"
        problems.append(impossible(names, why, "smaller coefficients, or normal distributions"))
    if problems:
        raise InputError(problems)
    scale = np.array([1.0 if item.bounded else item.u for item in members])
    return Source(rows, members, joint, scale[:, None] * factor_of(rho))
