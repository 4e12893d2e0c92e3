"""A diameter or length of one part before and after the correction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mtu_cli.analyses.correct.scatter import PointScatter
from mtu_cli.model.settings import PROBABILITY
from mtu_cli.stats.coverage import coverage_factor, welch_satterthwaite

Kind = Literal["circle", "sphere", "length"]
Sides = tuple[float, float]
"""(before, after) the correction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """A diameter or length of one part before and after the correction; mm.

    `reference` is the calibrated diameter or nominal length (nan: none) with expanded
    uncertainty `U_reference` (k = 2, nan: not given), `form` the range of the radial residuals
    (nan for lengths). `u`, `dof` are those of the corrected size. `repeat` is None in a mean
    over repeats, whose scatter `s_repeats` (after, nan for one) has. `points` is their
    number, `sensitivity` the sum of the squared gradients of the size in their coordinates; `k` the
    coverage factor of `U`.
    """

    kind: Kind
    id: str
    part: str
    operation: str
    repeat: int | None
    temperature: float
    size: Sides
    form: Sides
    reference: float
    U_reference: float
    u: float
    dof: float
    points: int
    sensitivity: float
    s_repeats: float = float("nan")
    k: float = 2.0
    repeats: tuple[Size, ...] = ()

    @property
    def error(self) -> Sides:
        """Measured minus reference, before and after; nan without a reference."""
        return self.size[0] - self.reference, self.size[1] - self.reference

    @property
    def u_error(self) -> float:
        """Standard uncertainty of the error after: the correction's and the calibration's."""
        return float(np.hypot(self.u, self._u_reference))

    @property
    def _u_reference(self) -> float:
        return 0.0 if np.isnan(self.U_reference) else self.U_reference / 2

    @property
    def dof_error(self) -> float:
        """Effective degrees of freedom of `u_error` (JCGM 100, eq. (G.2b))."""
        return welch_satterthwaite(
            np.array([self.u**2, self._u_reference**2]), np.array([self.dof, np.inf])
        )

    @property
    def interval95(self) -> Sides:
        """The 95 % interval of the corrected size."""
        half = coverage_factor(PROBABILITY, self.dof) * self.u
        return self.size[1] - half, self.size[1] + half

    @property
    def error_interval95(self) -> Sides:
        """The 95 % interval of the error after, the calibration's uncertainty included."""
        half = coverage_factor(PROBABILITY, self.dof_error) * self.u_error
        return self.error[1] - half, self.error[1] + half

    @property
    def U(self) -> float:
        """Expanded uncertainty k u of the corrected size, mm (JCGM 100, eq. (18))."""
        return self.k * self.u

    @property
    def E_n(self) -> float:  # ISO 13528
        """The error after over its expanded uncertainty, k u and that of the calibration; nan
        where neither is known (ISO 13528, 9.7).
        """
        expanded = float(np.hypot(self.U, np.nan_to_num(self.U_reference)))
        return self.error[1] / expanded if expanded > 0 else float("nan")

    @property
    def reduction_percent(self) -> float:
        """100 (1 - |after|/|before|) (Valdes et al., Tables 1 and 2); nan without an error."""
        before, after = self.error
        return 100 * (1 - abs(after) / abs(before)) if before else float("nan")

    @property
    def reduction_shown(self) -> float | None:
        """The reduction; None where the error before is within the uncertainty of that after."""
        return self.reduction_percent if abs(self.error[0]) > self.u_error else None


def mean_size(repeats: Sequence[Size]) -> Size:
    """The mean over the repeats of one part.

    Its uncertainty by the machine is the mean of theirs: what the machine did to a part, its
    state and each visit, is in every repeated measurement of it (coefficients are in any case),
    so that no mean over repeats makes it smaller. Where the machine itself repeated the
    measurement this is an upper bound.
    """
    first = repeats[0]
    after = np.array([item.size[1] for item in repeats])
    known = np.array([item.temperature for item in repeats])
    return Size(
        kind=first.kind,
        id=first.id,
        part=first.part,
        operation=first.operation,
        repeat=None,
        temperature=float(known.mean()),
        size=(float(np.mean([item.size[0] for item in repeats])), float(after.mean())),
        form=(
            float(np.mean([item.form[0] for item in repeats])),
            float(np.mean([item.form[1] for item in repeats])),
        ),
        reference=float(np.mean([item.reference for item in repeats])),
        U_reference=first.U_reference,
        u=float(np.mean([item.u for item in repeats])),
        dof=min(item.dof for item in repeats),
        points=first.points,
        sensitivity=float(np.mean([item.sensitivity for item in repeats])),
        s_repeats=float(after.std(ddof=1)) if len(after) > 1 else float("nan"),
        repeats=tuple(repeats),
    )


def with_scatter(size: Size, scatter: PointScatter | None) -> Size:
    """The size with the scatter of its points, which repeats that show it average out; the form
    of a ring is the same in every repeat.
    """
    if scatter is None:
        return size
    n = max(len(size.repeats), 1) if scatter.origin == "repeats" else 1
    u, dof = scatter.added(np.array([size.u]), np.array([size.dof]), size.sensitivity / n)
    return replace(
        size,
        u=float(u[0]),
        dof=float(dof[0]),
        repeats=tuple(with_scatter(item, scatter) for item in size.repeats),
    )
