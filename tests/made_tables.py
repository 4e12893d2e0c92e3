"""Readings and points made in memory, as if they had been read from one file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from mtu_cli.files.readings import Points, Readings
from mtu_cli.files.source import Source
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import SMALL, UNITS

Column = Any
"""One value for all rows, or one a row."""


def source(role: str) -> Source:
    return Source(role=role, path=Path(f"{role}.csv"), shown=f"{role}.csv", sha256="", rows=None)


def remembering(rng: np.random.Generator, shape: int | tuple[int, ...], r: float) -> Any:
    """Stationary noise of variance 1 along the first axis, with autocorrelation r^k."""
    e = rng.standard_normal(shape)
    e[1:] *= np.sqrt(1 - r**2)
    return lfilter([1.0], [1.0, -r], e, axis=0)


def made_readings(
    error: FloatArray,
    components: Sequence[str] = ("dx_x",),
    *,
    code: Column = 0,
    position: Column = np.nan,
    dimension: Column = 1,
    passes: Column = None,
    direction: Column = 0,
    cycle: Column = None,
    time: Column = np.nan,
    covariates: Mapping[str, NDArray[Any]] | None = None,
    role: str = "lbb",
) -> Readings:
    """Readings `error` in mm or rad of `components`; `passes` and `cycle` None: not given."""
    n = len(error)
    cycles, number = ((), -1) if cycle is None else np.unique(cycle, return_inverse=True)

    def column(value: Column, kind: type) -> NDArray[Any]:
        return np.broadcast_to(np.asarray(value, kind), n).copy()

    return Readings(
        components=tuple(components),
        code=column(code, np.int64),
        position_mm=column(position, np.float64),
        error=np.asarray(error),
        unit=column([[*UNITS].index(SMALL[x].name) for x in np.ravel(dimension)], np.int8),
        dimension=column(dimension, np.int8),
        pass_number=column(-1 if passes is None else passes, np.int64),
        has_pass=column(passes is not None, np.bool_),
        direction=column(direction, np.int8),
        cycles=tuple(map(str, cycles)),
        cycle=column(number, np.int64),
        time_min=column(time, np.float64),
        covariates=dict(covariates or {}),
        file_index=column(0, np.int64),
        row=np.arange(n) + 2,
        sources=(source(role),),
    )


def made_points(
    part: Sequence[str],
    feature: NDArray[np.int64],
    features: Sequence[str],
    measured: FloatArray,
    nominal: FloatArray,
    *,
    repeat: Column = -1,
    operation: Sequence[str] | None = None,
    time: Column = np.nan,
    direction: Column = np.nan,
    covariates: Mapping[str, NDArray[Any]] | None = None,
) -> Points:
    """Points of the parts of these names, which were made in the order in which they appear."""
    n, parts, operations = len(part), [*dict.fromkeys(part)], [*dict.fromkeys(operation or ())]
    number = np.array([parts.index(name) for name in part])
    codes = [operations.index(name) for name in operation] if operation else np.full(n, -1)
    return Points(
        parts=tuple(parts),
        part=number,
        features=tuple(features),
        feature=feature,
        operations=tuple(operations),
        operation=np.asarray(codes),
        measured=measured,
        nominal=nominal,
        repeat=np.broadcast_to(np.asarray(repeat, np.int64), n).copy(),
        time_min=np.broadcast_to(np.asarray(time, np.float64), n).copy(),
        sequence=number + 1,
        direction=np.broadcast_to(direction, (n, 3)).copy(),
        covariates=dict(covariates or {}),
        file_index=np.zeros(n, np.int64),
        row=np.arange(n) + 2,
        sources=(source("cmm"),),
    )
