"""The one problem: the angle between a row and a column of seven holes, each its own point."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from mtu_cli.model.prediction import Prediction

HOLES = 7
ARCSEC = 206264.80624709636
NAMES = [f"{line}{i}" for line in ("ra", "rc", "ca", "cc") for i in range(HOLES)]
"""Coordinates along and across the row, then along and across the column."""


class Inputs(NamedTuple):
    """28 coordinates in mm, mean and standard uncertainty, all normal and independent."""

    mean: list[float]
    u: list[float]


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


class Text(str):
    """An expression that arithmetic makes a longer one of: the angle as text."""

    def __mul__(self, other: object) -> Text:
        return Text(f"{self}*{other}")

    def __add__(self, other: object) -> Text:
        return Text(f"({self}+{other})")

    def __sub__(self, other: object) -> Text:
        return Text(f"({self}-{other})")

    def __truediv__(self, other: object) -> Text:
        return Text(f"({self})/({other})")

    def __neg__(self) -> Text:
        return Text(f"-({self})")


EXPRESSION = str(angle([Text(name) for name in NAMES]))


def predicted() -> tuple[Prediction, tuple[str, ...], tuple[str, ...]]:
    """Errors of the shipped part of Gilsinn & Ling 2004, and the features of row and column.

    The hole at the corner counts once in the row and once in the column, as two points.
    """
    import numpy as np
    from support import paper_study

    from mtu_cli.model.prediction import predict

    study = paper_study()
    entry = study.part.part.orthogonality[0]
    row, column = tuple(entry.row), tuple(f"column-{name}" for name in entry.column)
    places = study.part.part.places()
    points = np.array([places[name] for name in (*entry.row, *entry.column)])
    return predict(study.model, (*row, *column), points), row, column


def made() -> Inputs:
    """The inputs for everyone, from the prediction: every error on its own, eq. (23)."""
    import numpy as np

    prediction, row, _ = predicted()
    at = prediction.points[:, :2] + prediction.mean.reshape(-1, 2)
    u = np.sqrt(prediction.independent_variance).reshape(-1, 2)
    n = len(row)
    assert 2 * n == len(at) == 2 * HOLES
    mean, spread = (
        np.concatenate([values[:n, 0], values[:n, 1], values[n:, 1], values[n:, 0]]).tolist()
        for values in (at, u)
    )
    return Inputs(mean, spread)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(json.dumps(made()))
