"""Independent sources of uncertainty: what is drawn together, and its degrees of freedom.

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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.analyses.budget.correlation import clusters, uncorrelatable
from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.files.budget import LoadedBudget
from mtu_cli.findings import Finding, InputError
from mtu_cli.stats.distributions import NORMAL_DOF, Distribution
from mtu_cli.stats.least_squares import FloatArray

ROUNDING = 1e-13


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Deviations of the inputs `rows` that are drawn together, with `covariance`.

    `members`: their distributions, one for each row.
    """

    how: Literal["alone", "normal", "copula"]
    rows: tuple[int, ...]
    members: tuple[Distribution, ...]
    covariance: FloatArray

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
        found = float(own @ self.covariance @ own)
        # Of fully correlated inputs that cancel, rounding is all that is left.
        negligible = ROUNDING * float(own**2 @ np.diag(self.covariance))
        return 0.0 if found <= negligible else found

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
        found = float(own @ joint @ own)
        return 0.0 if found <= ROUNDING * float(own**2 @ drawn) else found

    def dof(self, gradient: FloatArray) -> float:
        """Degrees of freedom of that variance; infinite where no member counts."""
        finite = [
            item.dof
            for row, item in zip(self.rows, self.members, strict=True)
            if gradient[row] != 0.0
        ]
        return min(finite, default=math.inf)


def independent_sources(
    loaded: LoadedBudget, inputs: Sequence[InputQuantity], covariance: FloatArray
) -> tuple[Source, ...]:
    """All sources of uncertainty of a budget.

    Raises InputError for correlated inputs of several contributions that are not all normal:
    which of them the coefficient belongs to is then not stated.
    """
    linked = _stated_links(loaded, inputs)
    sources: list[Source] = []
    joined: set[int] = set()
    problems: list[Finding] = []
    for members in clusters(linked):
        if all(inputs[i].u == 0.0 for i in members):
            continue
        joined.update(members)
        problems += _several(loaded, [inputs[i] for i in members])
        sources.append(_correlated(members, inputs, covariance))
    if problems:
        raise InputError(problems)
    for number in range(len(loaded.budget.simultaneous)):
        rows = [
            i
            for i, item in enumerate(inputs)
            if i not in joined and any(part.group == number for part in item.parts)
        ]
        if rows:
            sources.append(_simultaneous(rows, inputs, covariance))
    sources += _alone(inputs, joined)
    return tuple(sources)


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
    members: Sequence[int], inputs: Sequence[InputQuantity], covariance: FloatArray
) -> Source:
    normal = all(inputs[i].normal for i in members)
    found = tuple(
        Distribution(kind="normal", u=inputs[i].u, dof=inputs[i].dof)
        if inputs[i].normal
        else inputs[i].parts[0].distribution
        for i in members
    )
    return Source(
        how="normal" if normal else "copula",
        rows=tuple(members),
        members=found,
        covariance=covariance[np.ix_(members, members)],
    )


def _simultaneous(
    rows: Sequence[int], inputs: Sequence[InputQuantity], covariance: FloatArray
) -> Source:
    found = [
        next(part.distribution for part in inputs[i].parts if part.group is not None) for i in rows
    ]
    joint = covariance[np.ix_(rows, rows)].copy()
    # Type B contributions stand apart: only the scatter of the readings is shared.
    np.fill_diagonal(joint, [item.u**2 for item in found])
    return Source(how="normal", rows=tuple(rows), members=tuple(found), covariance=joint)


def _alone(inputs: Sequence[InputQuantity], joined: set[int]) -> list[Source]:
    return [
        Source(
            how="alone",
            rows=(i,),
            members=(part.distribution,),
            covariance=np.array([[part.distribution.u**2]]),
        )
        for i, item in enumerate(inputs)
        if i not in joined
        for part in item.parts
        if part.group is None
    ]


def _several(loaded: LoadedBudget, members: Sequence[InputQuantity]) -> list[Finding]:
    why = "it has several contributions, not all normal"
    expected = "two inputs, their sum in the equation, and the correlation of one of them"
    return [
        uncorrelatable(loaded, [item.name], why, expected)
        for item in members
        if not item.normal and len(item.parts) > 1
    ]
