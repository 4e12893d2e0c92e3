"""What is known of the components: coefficients, their covariance, scatter of future passes."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from mtu_cli.model.thermal import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import Unit


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentEstimate:
    """One component as a polynomial of its axis, in internal units (mm or rad, per mm^k).

    `coefficients` (k,) in ascending powers; `covariance` C (k, k) their covariance, shared by
    all predictions; `pass_covariance` D (k, k) the pass-to-pass covariance, shared by all
    points of one part; `s_repeat` the repeatability of one visit, independent from visit to
    visit. From readings D is the unbiased moment estimate, which may have a negative part:
    clipping it would make every interval too wide where the passes hardly differ.
    `pass_dof` and `repeat_dof` belong to the mean squares behind them (inf: known exactly;
    pass_dof 0: one mean square, with `repeat_dof`, stands behind all of them). `n_passes` is
    given where C is the between-pass mean square over that number. `half_differences` (k, k) is
    the mean square S_h of runs there and back, S = S_m + S_h and C = S_m/runs (see
    `stats.pass_pairs`); None where all passes count as independent. `run_covariance` (k, k) is
    K = S_m - S_h of several instruments, which have no mean square in common; it may have a
    negative part, too.
    `independent_covariance` and `independent_s` are the paper's s^2 (X'X)^-1 and s.
    `position_range` in mm is that of the readings; None where none were fitted, or without `of`.
    """

    name: str
    of: str | None
    unit: Unit
    coefficients: FloatArray
    covariance: FloatArray
    pass_covariance: FloatArray
    s_repeat: float
    pass_dof: float
    repeat_dof: float
    n_passes: int | None = None
    independent_covariance: FloatArray | None = None
    independent_s: float | None = None
    position_range: tuple[float, float] | None = None
    half_differences: FloatArray | None = None
    run_covariance: FloatArray | None = None

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return len(self.coefficients) - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class JointPasses:
    """Components that were read in the same passes, or parameters estimated together.

    `covariance`, `pass_covariance` and `half_differences` (K, K) replace the components' own; K
    counts their coefficients (`widths` of them each) in the order of `components`.
    """

    components: tuple[str, ...]
    widths: tuple[int, ...]
    covariance: FloatArray
    pass_covariance: FloatArray
    pass_dof: float
    n_passes: int | None
    half_differences: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectEstimates:
    """Parameters of a machine's effects, estimated together, in internal units.

    `names` (K,) are ``effect.parameter``; `values` (K,), `covariance` (K, K) over all of them.
    """

    names: tuple[str, ...]
    units: tuple[Unit, ...]
    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimates:
    """All components of a machine, which of them were estimated jointly, and their drifts.

    `effects`: what a report says of the machine's effects, where it says anything.
    """

    components: dict[str, ComponentEstimate]
    joint: tuple[JointPasses, ...] = ()
    thermal: dict[str, ThermalEstimate] = field(default_factory=dict)
    effects: EffectEstimates | None = None


def from_centre(center: float, k: int, q: int) -> FloatArray:
    """T (k, q) from (intercept at the centre, slope) to coefficients at position 0.

    intercept + slope (p - c) = (intercept - c slope) + slope p.
    """
    T = np.zeros((k, q))
    T[0, 0] = 1.0
    if q == 2:
        T[0, 1], T[1, 1] = -center, 1.0
    return T


def to_centre(center: float, D: FloatArray) -> FloatArray:
    """The (q, q) covariance of intercept at the centre and slope from coefficient space."""
    q = min(2, len(D))
    T = np.zeros((q, len(D)))
    T[0] = center ** np.arange(len(D))
    if q == 2:
        T[1] = np.arange(len(D)) * center ** np.maximum(np.arange(len(D)) - 1, 0)
    result: FloatArray = T @ D @ T.T
    return result


def between_passes(estimate: ComponentEstimate) -> FloatArray | None:
    """S (k, k), the mean square between passes that C and D come from; None without one.

    Up to degree 1 every coefficient is the mean of the passes' own, so that S = n C, or
    n C/2 + S_h of runs there and back. Powers
    that the passes have in common are known from within passes: then S = D + s_repeat^2 M,
    where M = n (P'X'X P)^-1 is the error of a pass's own level and slope, P their columns,
    and (P'X'X P)^-1 is the Schur complement of those powers in (X'X)^-1.
    """
    if estimate.n_passes is None:
        return None
    C, D, s = estimate.covariance, estimate.pass_covariance, estimate.independent_s
    k = len(C)
    halves = estimate.half_differences
    # D of few passes may be cut to 0 in all; what differs between the ways of a run is not.
    slopes = k > 1 and bool(D[1, 1] or (halves is not None and halves[1, 1]))
    q = 2 if slopes else 1
    if q == k:
        return from_mean(C, estimate.n_passes, halves)
    S = D.copy()
    if estimate.independent_covariance is not None and s:
        inverse = estimate.independent_covariance / s**2
        scale = np.sqrt(np.diag(inverse))
        R = inverse / np.outer(scale, scale)
        M = R[:q, :q] - R[:q, q:] @ np.linalg.lstsq(R[q:, q:], R[q:, :q], rcond=None)[0]
        S[:q, :q] += estimate.s_repeat**2 * estimate.n_passes * M * np.outer(scale, scale)[:q, :q]
    return S


def covariance_in_run(estimate: ComponentEstimate) -> FloatArray | None:
    """K (k, k), the covariance of level and slope of the passes there and back of one run; None
    where all passes count as independent.
    """
    S, halves = between_passes(estimate), estimate.half_differences
    return estimate.run_covariance if S is None or halves is None else S - 2 * halves


def from_mean(C: FloatArray, n: int, halves: FloatArray | None) -> FloatArray:
    """S (k, k), the mean square between n passes whose mean has the covariance C."""
    return n * C if halves is None else n / 2 * C + halves


def known_component(
    *,
    name: str,
    of: str | None,
    unit: Unit,
    coefficients: FloatArray,
    covariance: FloatArray | None,
    pass_covariance: FloatArray | None,
    pass_center: float | None,
    s_repeat: float | None,
    u_future: float | None,
    dof: float | None,
    pass_dof: float | None,
    repeat_dof: float | None,
) -> ComponentEstimate:
    """A component whose figures a machine file states, in the component's own unit.

    Without a `covariance` the coefficients are taken as known; of `u_future` see `_scatter`.
    """
    f = unit.to_internal
    k = len(coefficients)
    C = np.zeros((k, k)) if covariance is None else np.asarray(covariance, float)
    D, repeat = _scatter(of, min(2, k), pass_covariance, s_repeat, u_future)
    T = from_centre(pass_center or 0.0, k, min(2, k))
    overall = inf if dof is None else float(dof)
    shared = pass_covariance is not None or (of is None and u_future is not None)
    return ComponentEstimate(
        name=name,
        of=of,
        unit=unit,
        coefficients=np.asarray(coefficients, float) * f,
        covariance=C * f**2,
        pass_covariance=T @ D @ T.T * f**2,
        s_repeat=repeat * f,
        pass_dof=(overall if pass_dof is None else float(pass_dof)) if shared else 0.0,
        repeat_dof=overall if repeat_dof is None else float(repeat_dof),
    )


def _scatter(
    of: str | None,
    q: int,
    pass_covariance: FloatArray | None,
    s_repeat: float | None,
    u_future: float | None,
) -> tuple[FloatArray, float]:
    """D (q, q) and s_repeat of a component that a machine file states.

    `u_future`, the standard uncertainty of a future observation, is all that many published
    tables give: it counts as repeatability, independent from point to point, or, without an
    axis, as shared by all points of a part.
    """
    D = np.zeros((q, q)) if pass_covariance is None else np.asarray(pass_covariance, float)
    repeat = 0.0 if s_repeat is None else s_repeat
    if u_future is None:
        return D, repeat
    return (np.array([[u_future**2]]), repeat) if of is None else (D, u_future)
