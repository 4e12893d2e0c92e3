"""The one problem: the angle between a row and a column of seven holes, each its own point."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from mtu_cli.model.prediction import Prediction

HOLES = 7
ARCSEC = 206264.80624709636


class Found(NamedTuple):
    """Standard uncertainty and ends of the symmetric 95 % interval of the angle, rad."""

    u: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """28 coordinates in mm, `mean` and standard uncertainty `u`, all normal and independent.

    Along and across the row, then along and across the column, seven each.
    """

    mean: tuple[float, ...]
    u: tuple[float, ...]

    @property
    def names(self) -> list[str]:
        """One for each coordinate, fit for expressions."""
        return [f"{line}{i}" for line in ("ra", "rc", "ca", "cc") for i in range(HOLES)]

    def write(self, path: Path) -> None:
        path.write_text(json.dumps(asdict(self)))

    @classmethod
    def read(cls, path: Path) -> Inputs:
        found = json.loads(path.read_text())
        return cls(mean=tuple(found["mean"]), u=tuple(found["u"]))


def angle(coordinates: Sequence[Any]) -> Any:
    """-b1(column) - b1(row), Gilsinn & Ling 2004, eqs. (24)-(26), of whatever can be multiplied.

    As few operations as there can be: packages that record each pay for each.
    """
    ra, rc, ca, cc = (coordinates[i : i + HOLES] for i in range(0, 4 * HOLES, HOLES))
    return -slope(ca, cc) - slope(ra, rc)


def slope(along: Sequence[Any], across: Sequence[Any]) -> Any:
    """b1 = (S ab - S a S b / n) / (S aa - (S a)^2 / n)."""
    total = _sum(along)
    products = _sum([a * b for a, b in zip(along, across, strict=True)])
    squares = _sum([a * a for a in along])
    return (products - total * _sum(across) / HOLES) / (squares - total * total / HOLES)


def _sum(items: Sequence[Any]) -> Any:
    total = items[0]
    for item in items[1:]:
        total = total + item
    return total


def expression(names: Sequence[str]) -> str:
    """The same as text."""

    def one(a: Sequence[str], b: Sequence[str]) -> str:
        products = "+".join(f"{i}*{j}" for i, j in zip(a, b, strict=True))
        squares = "+".join(f"{i}*{i}" for i in a)
        total, other = "+".join(a), "+".join(b)
        return (
            f"(({products})-({total})*({other})/{HOLES})/(({squares})-({total})*({total})/{HOLES})"
        )

    ra, rc, ca, cc = (names[i : i + HOLES] for i in range(0, 4 * HOLES, HOLES))
    return f"-{one(ca, cc)}-{one(ra, rc)}"


def predicted() -> tuple[Prediction, tuple[str, ...], tuple[str, ...]]:
    """Errors of the shipped part of Gilsinn & Ling 2004, and the features of row and column.

    The hole at the corner counts once in the row and once in the column, as two points.
    """
    import numpy as np
    from support import paper_study

    from mtu_cli.model.prediction import predict

    study = paper_study()
    entry = study.part.part.orthogonality[0]
    row = tuple(entry.row)
    column = tuple(f"column-{name}" for name in entry.column)
    places = study.part.part.places()
    points = np.array([places[name] for name in (*entry.row, *entry.column)])
    return predict(study.model, (*row, *column), points), row, column


def made() -> Inputs:
    """The inputs for everyone, from the prediction: every error on its own, eq. (23)."""
    import numpy as np

    prediction, row, column = predicted()
    at = prediction.points[:, :2] + prediction.mean.reshape(-1, 2)
    u = np.sqrt(prediction.independent_variance).reshape(-1, 2)
    n = len(row)
    assert n == len(column) == HOLES

    def in_order(values: Any) -> tuple[float, ...]:
        lines = (values[:n, 0], values[:n, 1], values[n:, 1], values[n:, 0])
        return tuple(float(value) for line in lines for value in line)

    return Inputs(mean=in_order(at), u=in_order(u))


if __name__ == "__main__":
    import sys

    made().write(Path(sys.argv[1]))
