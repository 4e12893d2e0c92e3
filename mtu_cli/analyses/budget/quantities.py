"""Input quantities of a budget: estimates and the distributions of their contributions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mtu_cli.files.budget import Contribution, Input, LoadedBudget
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.distributions import (
    Distribution,
    Kind,
    dof_of_inexact,
    inexact_of,
    shape_moments,
)
from mtu_cli.stats.least_squares import FloatArray


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
        types = {"A" if part.type_a else "B" for part in self.parts}
        return "+".join(sorted(types))


def input_quantities(loaded: LoadedBudget) -> tuple[InputQuantity, ...]:
    """The inputs of a budget in the order of the file."""
    groups = {
        name: index for index, group in enumerate(loaded.budget.simultaneous) for name in group
    }
    return tuple(
        _quantity(name, item, groups.get(name)) for name, item in loaded.budget.inputs.items()
    )


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
        found = distribution(stated)
        if found is not None:
            says = (stated.says or "") if index else ""
            place = f"contributions[{index - 1}]" if index else ""
            parts.append(Part(distribution=found, type_a=False, says=says, place=place))
    return InputQuantity(
        name=name,
        value=math.nan if value is None else value,
        unit=item.unit or "",
        says=item.says or "",
        parts=tuple(part for part in parts if part.distribution.u > 0.0),
        readings=readings,
    )


def distribution(item: Contribution) -> Distribution | None:
    """The distribution that an entry of a budget file states; None where it states no width."""
    dof = math.inf if item.dof is None else item.dof
    kind: Kind = item.distribution or "normal"
    u, half = item.standard, item.half
    if kind in ("normal", "t"):
        return None if u is None else Distribution(kind=kind, u=u, dof=dof)
    if u is None and half is None:
        return None
    return _bounded(kind, u, half, dof, item.top or 0.0, item.inexact)


def _bounded(
    kind: Kind,
    u: float | None,
    half: float | None,
    dof: float,
    top: float,
    inexact: float | None,
) -> Distribution:
    """From u or the half-width to both.

    A rectangle (triangle, ...) with finite degrees of freedom keeps the u of its stated limits,
    as in GUM H.1; the curvilinear trapezoid has the (larger) one of its own, JCGM 101:2008,
    6.4.3: u^2 = a^2/3 + d^2/9.
    """
    own = kind == "curvilinear-trapezoidal"
    if half is None:
        half = _half_width(kind, u or 0.0, dof, top, inexact)
    share = inexact_of(dof) if inexact is None else (inexact / half if half > 0.0 else 0.0)
    if u is None:
        second = shape_moments(kind, top / half if half > 0.0 else 0.0)[0]
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
