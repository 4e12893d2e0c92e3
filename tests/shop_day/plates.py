"""Plates with a grid of holes: warm parts on a machine that grows, and axes that are short alike.

Errors are measured minus nominal (P, H, 2), um.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from shop_day.day import Floats

WARM = 0.8
"""Standard deviations of warm parts, and of features on them, um."""


@dataclass(frozen=True, kw_only=True)
class Plate:
    """`places` (H, 2) mm; what was logged of each part (P,); `scale` and `growth` in um/mm and
    um/mm/K from 20 degC, of one `axis` or (None) of both alike.
    """

    places: Floats
    errors: Floats
    scale: float
    growth: float = 0.0
    axis: int | None = None
    logged: dict[str, Floats] = field(default_factory=dict)

    def true(self, places: Floats, degC: float = 20.0) -> Floats:
        """Mean errors (n, 2) at other places and another temperature."""
        longer = (self.scale + self.growth * (degC - 20)) * places
        return longer if self.axis is None else longer * (np.arange(2) == self.axis)

    def write_csv(self, path: Path) -> None:
        """With the nominals in it."""
        lines = [",".join(["part,feature,nominal_x_mm,nominal_y_mm,x_mm,y_mm", *self.logged])]
        for p, part in enumerate(self.errors):
            more = [f"{values[p]:.6g}" for values in self.logged.values()]
            for h, (x, y) in enumerate(self.places.tolist()):
                measured = [f"{q + e / 1000:.6f}" for q, e in zip((x, y), part[h], strict=True)]
                cells = [str(p + 1), f"h{h + 1}", repr(x), repr(y), *measured, *more]
                lines.append(",".join(cells))
        path.write_text("\n".join(lines) + "\n")


def warm_plate(rng: np.random.Generator, *, scaled: bool) -> Plate:
    """Sixteen parts at 24 to 28 degC: an axis grows, and beside it may have a scale."""
    parts = 16
    X, Y = np.meshgrid([20.0, 90.0, 150.0, 210.0, 300.0, 410.0], [15.0, 100.0, 230.0, 290.0])
    places = np.stack([X.ravel(), Y.ravel()], axis=1)
    a, sign = int(rng.integers(2)), float(rng.choice([-1, 1]))
    growth = 1e-3 * sign * rng.uniform(6, 14)
    scale = 1e-3 * float(rng.choice([-1, 1])) * rng.uniform(8, 20) * scaled
    T = np.round(rng.uniform(24, 28, parts), 2)
    errors = warm_scatter(rng, parts, len(places))
    errors[..., a] += (scale + growth * (T[:, None] - 20)) * places[:, a]
    return Plate(
        places=places, errors=errors, scale=scale, growth=growth, axis=a,
        logged={"T_scale_degC": T},
    )  # fmt: skip


def warm_scatter(rng: np.random.Generator, parts: int, features: int) -> Floats:
    of_parts = rng.normal(0, WARM, (parts, 1, 2))
    return np.asarray(of_parts + rng.normal(0, WARM, (parts, features, 2)))


def short_plate(rng: np.random.Generator) -> Plate:
    """4 to 10 parts whose axes are short, or long, alike."""
    parts, spacing = int(rng.integers(4, 11)), float(rng.uniform(40, 110))
    X, Y = np.meshgrid(20 + spacing * np.arange(5), 20 + spacing * np.arange(4))
    places = np.stack([X.ravel(), Y.ravel()], axis=1)
    scale = 1e-3 * float(rng.choice([-1, 1])) * rng.uniform(15, 40)
    errors = rng.normal(0, 2.0, (parts, len(places), 2)) + rng.normal(0, 1.0, (parts, 1, 2))
    return Plate(places=places, errors=errors + scale * places, scale=scale)
