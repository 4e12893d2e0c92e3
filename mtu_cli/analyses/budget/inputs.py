"""Inputs of a budget: quantities, their covariance, and the independent sources behind them.

A contribution that nothing is correlated with is a source of its own. Inputs with stated
correlations, and readings that were taken together, are one source each connected set:

- all normal or t: jointly normal with their covariance, scaled to a multivariate t where they
  share their degrees of freedom (JCGM 102:2011, 5.3.2), which keeps the stated coefficients and
  gives each input the t of JCGM 101:2008, 6.4.9; each by a scale of its own where they do not;
- some bounded (rectangular, ...): a Gaussian copula with the stated correlation, before inputs of
  finite degrees of freedom are scaled, each by a scale of its own.

For Welch-Satterthwaite a source is one term with the variance g' V g. Its degrees of freedom
are those its members share: n - 1 for n simultaneous readings, of which g' V g is a sample
variance of the combined readings. Where they differ the smallest is taken, on the safe side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.files.budget import Contribution, Input, LoadedBudget
from mtu_cli.findings import Finding, InputError, finding, listed
from mtu_cli.stats.covariance import correlation_of, factor_of
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.distributions import (
    NORMAL_DOF,
    Distribution,
    Kind,
    dof_of_inexact,
    inexact_of,
    largest_covariance,
    marginal,
    normal_correlation,
    shape_moments,
)
from mtu_cli.stats.least_squares import FloatArray

NOT_DEFINITE = 1e-9
"""An eigenvalue of a correlation matrix below minus this is no rounding."""
ROUNDING = 1e-13
SHOWN_PAIRS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One contribution to an input: type A from readings, else type B; independent of others.

    `group`: the simultaneous readings it stems from, by their number in the file. `place`: the key
    of the input that holds it; empty where the input's own keys do.
    """

    distribution: Distribution
    type_a: bool
    group: int | None = None
    says: str = ""
    place: str = ""

    def label(self, name: str) -> str:
        """What it is called beside others of the input `name`."""
        own = self.place or "width"
        said = f" '{self.says}'" if self.says and self.says != own else ""
        return f"the {own}{said} of {name}"


@dataclass(frozen=True, slots=True, kw_only=True)
class InputQuantity:
    """An input: estimate `value` and its contributions; `readings` (n,) where it has some."""

    name: str
    value: float
    unit: str
    says: str
    parts: tuple[Part, ...]
    readings: FloatArray | None = None

    @property
    def u(self) -> float:
        """Standard uncertainty: each contribution counted once, JCGM 100:2008, 4.3.10."""
        return math.sqrt(math.fsum(part.distribution.u**2 for part in self.parts))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom of the contributions together, GUM eq. (G.2b)."""
        items = [part.distribution for part in self.parts]
        if len(items) == 1:
            return items[0].dof
        return welch_satterthwaite(
            np.array([item.u**2 for item in items]), np.array([item.dof for item in items])
        )

    @property
    def least_dof(self) -> float:
        """Of the t distributions among the contributions."""
        items = [part.distribution for part in self.parts]
        return min((item.dof for item in items if not item.bounded), default=math.inf)

    @property
    def excess(self) -> float:
        """Fourth cumulant over u^4; cumulants of independent contributions add."""
        if self.u == 0.0:
            return 0.0
        return math.fsum(
            part.distribution.excess * (part.distribution.u / self.u) ** 4 for part in self.parts
        )

    @property
    def normal(self) -> bool:
        """Whether every contribution is normal or Student's t."""
        return not any(part.distribution.bounded for part in self.parts)

    @property
    def kind(self) -> str:
        """How it is distributed, in a word or two."""
        kinds = list(dict.fromkeys(part.distribution.kind for part in self.parts))
        return " + ".join(kinds) if kinds else "exact"

    @property
    def type(self) -> str:
        """A, B or A+B, JCGM 100:2008, 3.3.4; empty for an exact value."""
        return "+".join(sorted({"A" if part.type_a else "B" for part in self.parts}))


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Deviations of the inputs `rows` that are drawn together, with `covariance`.

    `members`: their distributions, one for each row. `factor` (n, rank): what turns independent
    normals into normal deviations of theirs; bounded members have unit variance there. Empty of a
    source that is drawn alone.
    """

    how: Literal["alone", "normal", "copula"]
    rows: tuple[int, ...]
    members: tuple[Distribution, ...]
    covariance: FloatArray
    factor: FloatArray

    @property
    def common_dof(self) -> bool:
        """Whether all members have the same degrees of freedom."""
        return len({item.dof for item in self.members}) == 1

    @property
    def is_normal(self) -> bool:
        """Whether its deviations are jointly normal, to all that few degrees of freedom add."""
        return self.how != "copula" and all(
            not item.bounded and item.dof >= NORMAL_DOF for item in self.members
        )

    @property
    def is_t(self) -> bool:
        """Whether its deviations are jointly t: every sum of them is a t."""
        return self.how != "copula" and self.common_dof and not self.members[0].bounded

    @property
    def is_simple(self) -> bool:
        """Whether its part of a first-order form is one term of a known distribution."""
        return self.how == "alone" or self.is_t

    def variance(self, gradient: FloatArray) -> float:
        """g' V g (first order) of the source for a gradient over all inputs."""
        own = gradient[list(self.rows)]
        value = float(own @ self.covariance @ own)
        # Of fully correlated inputs that cancel, rounding is all that is left.
        negligible = ROUNDING * float(own**2 @ np.diag(self.covariance))
        return 0.0 if value <= negligible else value

    def drawn_variance(self, gradient: FloatArray) -> float:
        """Variance of the same sum as it is drawn; nan where a t of two degrees of freedom or fewer
        has none.

        With a scale S of its own a member i varies by u_i^2 E(S_i^2), and two of them together by
        V_ij E(S_i) E(S_j): the covariance is that of what is scaled.
        """
        own = gradient[list(self.rows)]
        if self.is_t:
            inflation = self.members[0].drawn_variance / self.members[0].u ** 2
            return self.variance(gradient) * inflation
        # What is not in the sum need not have a variance.
        counted = np.flatnonzero(own)
        members = [self.members[i] for i in counted]
        drawn = np.array([item.drawn_variance for item in members])
        if np.isnan(drawn).any():
            return math.nan
        own, joint = own[counted], self.covariance[np.ix_(counted, counted)]
        mean_scale = np.array([item.mean_scale for item in members])
        joint *= np.outer(mean_scale, mean_scale)
        np.fill_diagonal(joint, drawn)
        value = float(own @ joint @ own)
        return 0.0 if value <= ROUNDING * float(own**2 @ drawn) else value

    def dof(self, gradient: FloatArray) -> float:
        """Degrees of freedom of that variance; infinite where no member counts."""
        pairs = zip(self.rows, self.members, strict=True)
        return min((item.dof for row, item in pairs if gradient[row] != 0.0), default=math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """All inputs in the order of the file, `covariance` (n, n) of their estimates, `sources`."""

    quantities: tuple[InputQuantity, ...]
    covariance: FloatArray
    sources: tuple[Source, ...]

    @property
    def u(self) -> FloatArray:
        """Standard uncertainties (n,)."""
        return np.array([item.u for item in self.quantities])


def inputs_of(loaded: LoadedBudget) -> Inputs:
    """The inputs of a budget.

    Raises InputError for correlations that no inputs can have.
    """
    groups = {
        name: index for index, group in enumerate(loaded.budget.simultaneous) for name in group
    }
    quantities = tuple(
        _quantity(name, item, groups.get(name)) for name, item in loaded.budget.inputs.items()
    )
    covariance = _covariance(loaded, quantities)
    sources = _sources(loaded, quantities, covariance)
    return Inputs(quantities=quantities, covariance=covariance, sources=sources)


def _quantity(name: str, item: Input, group: int | None) -> InputQuantity:
    parts = []
    value = item.value
    readings = None
    if item.readings is not None:
        readings = np.array(item.readings, dtype=np.float64)
        # Of equal readings the mean would be off by its rounding, which is no scatter.
        alike = bool(np.all(readings == readings[0]))
        value = item.readings[0] if alike else math.fsum(item.readings) / len(readings)
        s = float(np.std(readings - value, ddof=1))
        scatter = Distribution(kind="t", u=s / math.sqrt(len(readings)), dof=len(readings) - 1.0)
        parts.append(
            Part(distribution=scatter, type_a=True, group=group, says="readings", place="readings")
        )
    elif value is None:
        value = item.middle
    for index, stated in enumerate((item, *item.contributions)):
        if (shape := _distribution(stated)) is not None:
            says = (stated.says or "") if index else ""
            place = f"contributions[{index - 1}]" if index else ""
            parts.append(Part(distribution=shape, type_a=False, says=says, place=place))
    return InputQuantity(
        name=name,
        value=math.nan if value is None else value,
        unit=item.unit or "",
        says=item.says or "",
        parts=tuple(part for part in parts if part.distribution.u > 0.0),
        readings=readings,
    )


def _distribution(item: Contribution) -> Distribution | None:
    """The distribution that an entry of a budget file states; None where it states no width.

    A rectangle (triangle, ...) with finite degrees of freedom keeps the u of its stated limits,
    as in GUM H.1; the curvilinear trapezoid has the (larger) one of its own, JCGM 101:2008,
    6.4.3: u^2 = a^2/3 + d^2/9.
    """
    dof = math.inf if item.dof is None else item.dof
    kind: Kind = item.distribution or "normal"
    u, half, top, inexact = item.standard, item.half, item.top or 0.0, item.inexact
    if u is None and (half is None or kind in ("normal", "t")):
        return None
    if kind in ("normal", "t"):
        return Distribution(kind=kind, u=u or 0.0, dof=dof)
    if half is None:
        half = _half_width(kind, u or 0.0, dof, top, inexact)
    share = inexact_of(dof) if inexact is None else (inexact / half if half > 0.0 else 0.0)
    if u is None:
        second = shape_moments(kind, top / half if half > 0.0 else 0.0)[0]
        own = kind == "curvilinear-trapezoidal"
        u = half * math.sqrt(second * (1.0 + share**2 / 3.0 if own else 1.0))
    return Distribution(
        kind=kind,
        u=u,
        dof=dof if inexact is None else dof_of_inexact(share),
        half_width=half,
        top=top,
        inexact=share,
    )


def _half_width(kind: Kind, u: float, dof: float, top: float, inexact: float | None) -> float:
    if kind == "trapezoidal":
        # u^2 = (a^2 + top^2)/6, JCGM 101:2008, 6.4.4.
        return math.sqrt(max(6.0 * u**2 - top**2, 0.0))
    if kind == "curvilinear-trapezoidal":
        if inexact is not None:
            return math.sqrt(max(3.0 * (u**2 - inexact**2 / 9.0), 0.0))
        return u * math.sqrt(3.0 / (1.0 + inexact_of(dof) ** 2 / 3.0))
    return u / math.sqrt(shape_moments(kind)[0])


def _covariance(loaded: LoadedBudget, inputs: Sequence[InputQuantity]) -> FloatArray:
    """V (n, n) of the inputs' estimates, in the products of their units.

    A stated coefficient r(x_i, x_j) belongs to the whole of both inputs: r u(x_i) u(x_j),
    whatever they are made of. Readings x_ik, x_jk taken together give
    s(mean_i, mean_j) = sum (x_ik - mean_i)(x_jk - mean_j) / (n (n - 1)), GUM eq. (17), for
    their type A parts alone.

    Raises InputError where the coefficients belong to no joint distribution; they are never
    altered.
    """
    place = {item.name: i for i, item in enumerate(inputs)}
    u = np.array([item.u for item in inputs])
    covariance = np.diag(u**2)
    for group in loaded.budget.simultaneous:
        rows = [place[name] for name in group]
        readings = np.array([inputs[i].readings for i in rows], dtype=np.float64)
        apart = readings - readings.mean(axis=1, keepdims=True)
        n = readings.shape[1]
        joint = apart @ apart.T / (n * (n - 1))
        np.fill_diagonal(joint, u[rows] ** 2)
        covariance[np.ix_(rows, rows)] = joint
    for first, second, r in loaded.budget.correlations:
        i, j = place[first], place[second]
        covariance[i, j] = covariance[j, i] = r * u[i] * u[j]
    stated = np.nan_to_num(correlation_of(covariance))
    problems = []
    for members in _clusters(stated):
        values, vectors = np.linalg.eigh(stated[np.ix_(members, members)])
        if values[0] >= -NOT_DEFINITE * len(members):
            continue
        # The pairs that pull the quadratic form of the worst direction below zero.
        w = vectors[:, 0]
        pull = [
            (w[a] * w[b] * stated[i, j], i, j)
            for a, i in enumerate(members)
            for b, j in enumerate(members[:a])
            if stated[i, j] != 0.0
        ]
        worst = sorted(pull)[:SHOWN_PAIRS]
        pairs = [f"{inputs[j].name}-{inputs[i].name} {stated[i, j]:.6g}" for _, i, j in worst]
        why = f"the smallest eigenvalue of the correlation matrix is {values[0]:.4g}"
        expected = "a matrix without negative eigenvalues"
        problems.append(_uncorrelatable(loaded, pairs, why, expected))
    if problems:
        raise InputError(problems)
    return covariance


def _uncorrelatable(
    loaded: LoadedBudget, names: Sequence[str], why: str, expected: str, value: str | None = None
) -> Finding:
    """That inputs cannot be correlated as the file states."""
    reason = f"{listed(names)} cannot be correlated like this: {why}"
    line, file = loaded.line_of("correlations"), loaded.source.shown
    place = {"file": file, "line": line, "path": "correlations", "value": value}
    return finding("wrong-correlation", reason=reason, expected=expected, **place)


def _clusters(linked: FloatArray) -> list[list[int]]:
    """Indices in connected sets of two or more: `linked` (n, n) is not zero between neighbours."""
    waiting, clusters = set(range(len(linked))), []
    while waiting:
        members, front = [], [min(waiting)]
        waiting.discard(front[0])
        while front:
            i = front.pop()
            members.append(i)
            near = [j for j in sorted(waiting) if linked[i, j] != 0.0]
            waiting.difference_update(near)
            front += near
        if len(members) > 1:
            clusters.append(sorted(members))
    return clusters


def _sources(
    loaded: LoadedBudget, inputs: Sequence[InputQuantity], covariance: FloatArray
) -> tuple[Source, ...]:
    """All sources of uncertainty of a budget.

    Raises InputError for correlated inputs of several contributions that are not all normal:
    which of them the coefficient belongs to is then not stated; and for coefficients that are
    impossible with the inputs' distributions.
    """
    clusters = [
        members
        for members in _clusters(_stated_links(loaded, inputs))
        if any(inputs[i].u > 0.0 for i in members)
    ]
    joined = {i for members in clusters for i in members}
    several = "it has several contributions, not all normal"
    expected = "two inputs, their sum in the equation, and the correlation of one of them"
    problems = [
        _uncorrelatable(loaded, [inputs[i].name], several, expected)
        for i in sorted(joined)
        if not inputs[i].normal and len(inputs[i].parts) > 1
    ]
    if problems:
        raise InputError(problems)
    sources = [_correlated(loaded, members, inputs, covariance, problems) for members in clusters]
    if problems:
        raise InputError(problems)
    for number in range(len(loaded.budget.simultaneous)):
        shared = {
            i: part.distribution
            for i, item in enumerate(inputs)
            for part in item.parts
            if i not in joined and part.group == number
        }
        if shared:
            joint = covariance[np.ix_(list(shared), list(shared))].copy()
            # Type B contributions stand apart: only the scatter of the readings is shared.
            np.fill_diagonal(joint, [item.u**2 for item in shared.values()])
            sources.append(_source("normal", shared, shared.values(), joint, factor_of(joint)))
    for i, item in enumerate(inputs):
        for part in item.parts if i not in joined else ():
            if part.group is None:
                square = np.array([[part.distribution.u**2]])
                sources.append(_source("alone", [i], [part.distribution], square, np.zeros((0, 0))))
    return tuple(sources)


def _source(
    how: Literal["alone", "normal", "copula"],
    rows: Iterable[int],
    members: Iterable[Distribution],
    covariance: FloatArray,
    factor: FloatArray,
) -> Source:
    return Source(
        how=how, rows=tuple(rows), members=tuple(members), covariance=covariance, factor=factor
    )


def _stated_links(loaded: LoadedBudget, inputs: Sequence[InputQuantity]) -> FloatArray:
    """Which inputs are correlated as a whole, (n, n); simultaneous readings of one join in."""
    place = {item.name: i for i, item in enumerate(inputs)}
    linked = np.zeros((len(inputs), len(inputs)))
    stated = set()
    for first, second, r in loaded.budget.correlations:
        if r != 0.0:
            linked[place[first], place[second]] = linked[place[second], place[first]] = 1.0
            stated |= {first, second}
    for group in loaded.budget.simultaneous:
        if stated & set(group):
            rows = [place[name] for name in group]
            linked[np.ix_(rows, rows)] = 1.0
    return linked


def _correlated(
    loaded: LoadedBudget,
    rows: Sequence[int],
    inputs: Sequence[InputQuantity],
    covariance: FloatArray,
    problems: list[Finding],
) -> Source:
    normal = all(inputs[i].normal for i in rows)
    members = [
        Distribution(kind="normal", u=inputs[i].u, dof=inputs[i].dof)
        if inputs[i].normal
        else inputs[i].parts[0].distribution
        for i in rows
    ]
    joint = covariance[np.ix_(rows, rows)]
    if normal:
        return _source("normal", rows, members, joint, factor_of(joint))
    names = [inputs[i].name for i in rows]
    rho = _normals_behind(loaded, names, members, joint, problems)
    scale = np.array([1.0 if item.bounded else item.u for item in members])
    return _source("copula", rows, members, joint, scale[:, None] * factor_of(rho))


def _normals_behind(
    loaded: LoadedBudget,
    names: Sequence[str],
    members: Sequence[Distribution],
    covariance: FloatArray,
    problems: list[Finding],
) -> FloatArray:
    """The correlation matrix of the normals behind correlated inputs that are not all normal.

    Adds to `problems` what is impossible with their distributions.
    """
    marginals = [marginal(item) for item in members]
    rho = np.eye(len(marginals))
    possible = True
    for a, b in zip(*np.nonzero(np.tril(covariance, -1)), strict=True):
        wanted = float(covariance[a, b])
        r = normal_correlation(marginals[a], marginals[b], wanted)
        if r is not None:
            rho[a, b] = rho[b, a] = r
            continue
        possible = False
        unit = math.sqrt(covariance[a, a] * covariance[b, b])
        # Rounded towards 0, so that what it says can be had.
        most = math.floor(1e6 * largest_covariance(marginals[a], marginals[b]) / unit) / 1e6
        why, expected = (
            "their distributions allow no coefficient so large",
            f"-{most:g} to {most:g}",
        )
        pair = names[b], names[a]
        problems.append(_uncorrelatable(loaded, pair, why, expected, f"{wanted / unit:.9g}"))
    least = float(np.linalg.eigvalsh(rho)[0])
    if least < -NOT_DEFINITE * len(rho) and possible:
        why = f"the smallest eigenvalue of their Gaussian copula is {least:.4g}"
        expected = "smaller coefficients, or normal distributions"
        problems.append(_uncorrelatable(loaded, names, why, expected))
    return rho
