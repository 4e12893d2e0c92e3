"""What is wrong with the machine of a shop day: an effect of a stated size."""

from dataclasses import dataclass, field

import numpy as np

from shop_day.day import Floats, ShopDay
from shop_day.noise import SIGMA


@dataclass(frozen=True, kw_only=True)
class Shape:
    """An effect before it is scaled: `columns` (k, P, H, 2) weighed by `weights` (k,).

    `name` as in the library, None for what no family describes. `exact`: the columns are those
    of the family, not only like them.
    """

    name: str | None
    columns: Floats
    weights: Floats
    covariate: str | None = None
    searched: dict[str, float] = field(default_factory=dict)
    exact: bool = True


@dataclass(frozen=True, kw_only=True)
class Truth:
    """An effect as it stands in the data.

    `name` as in the library, None where no family describes it; `family` as it was asked for.
    `errors` (P, H, 2) um, with mean zero along each axis; `level` (2,) um is the mean that was
    taken out, so that errors + level = sum of coefficients * columns. `columns` (k, P, H, 2) are
    the family's own at the true searched parameters: of dir, of mm/1000 from the centre for
    scales and angles (coefficients in um/m), of K, of counts, or of normed shapes. `noise_factor`
    (H,) multiplies the standard deviation of the cells, None where that of the scatter is the
    same everywhere. `exact`: False where the shape is only like that of the named family.
    """

    family: str
    name: str | None
    covariate: str | None
    searched: dict[str, float]
    errors: Floats
    level: Floats
    columns: Floats
    coefficients: Floats
    noise_factor: Floats | None = None
    exact: bool = True

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes that it affects."""
        return tuple(int(a) for a in np.flatnonzero(np.any(self.errors != 0, axis=(0, 1))))


def scaled(family: str, shape: Shape, amplitude: float, sign: float) -> Truth:
    """The effect whose root mean square over the axes it affects is amplitude * sigma.

    sigma is the standard deviation of one averaged coordinate, 3.6 um.
    """
    raw = np.einsum("k,kpha->pha", shape.weights, shape.columns)
    level = raw.mean(axis=(0, 1))
    centred = raw - level
    size = np.mean(centred**2, axis=(0, 1))
    affected = size > 1e-24
    centred[..., ~affected] = 0.0
    rms = np.sqrt(size[affected].mean()) if affected.any() else np.inf
    factor = sign * amplitude * SIGMA / rms
    return Truth(
        family=family,
        name=shape.name,
        covariate=shape.covariate,
        searched=shape.searched,
        errors=factor * centred,
        level=factor * level,
        columns=shape.columns,
        coefficients=factor * shape.weights,
        exact=shape.exact,
    )


def scatter_only(day: ShopDay, family: str, noise_factor: Floats) -> Truth:
    """An effect on the scatter of cells, none on their mean."""
    return Truth(
        family=family,
        name=family,
        covariate=None,
        searched={},
        errors=np.zeros((day.P, day.H, 2)),
        level=np.zeros(2),
        columns=np.zeros((0, day.P, day.H, 2)),
        coefficients=np.zeros(0),
        noise_factor=noise_factor,
    )


def column(day: ShopDay, axis: int, values: Floats) -> Floats:
    """One column (1, P, H, 2) that acts along one axis; `values` broadcast to (P, H)."""
    found = np.zeros((1, day.P, day.H, 2))
    found[0, ..., axis] = values
    return found


def columns(day: ShopDay, axis: int, *values: Floats) -> Floats:
    """Several such columns, (k, P, H, 2)."""
    return np.concatenate([column(day, axis, item) for item in values])


def both(day: ShopDay, along_x: Floats, along_y: Floats) -> Floats:
    """One column (1, P, H, 2) that acts along x and y with one coefficient."""
    return column(day, 0, along_x) + column(day, 1, along_y)
