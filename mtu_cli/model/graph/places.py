"""The places: what is random in them to start with, and their coordinates as outputs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.files.graph_contract import COORDINATES, Graph, Place, Transition
from mtu_cli.findings import error, suggestion
from mtu_cli.model.graph.constructions import cross, dot
from mtu_cli.model.graph.transitions import Values
from mtu_cli.stats.distributions import Distribution, shape_moments
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.workspace import Workspace
from mtu_cli.units import UM

PROBING = ("u1_axis", "u2_probe", "u3_perpendicular")
"""Sources of the scatter of a probing, in the terms of Stryczek."""


def start_value(place: Place) -> FloatArray:
    """Nominal of a measured place, or value of a constant, for one trial: (1,) or (3, 1)."""
    if place.nominal_mm is not None:
        nominal = np.array(place.nominal_mm)
        return nominal[:, None] if len(nominal) == 3 else nominal
    return np.array([math.nan if place.value is None else place.value])


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """One coordinate of a place; `index` is its number among those of the place."""

    place: str
    coordinate: str
    index: int
    kind: str
    unit: str

    def __str__(self) -> str:
        single = self.coordinate == "value"
        return self.place if single else f"{self.place}.{self.coordinate}"


def outputs_of(
    names: Iterable[str], places: Mapping[str, Place], units: Mapping[str, str]
) -> tuple[Output, ...]:
    """The outputs behind names such as ``P1``, ``P1.x`` or ``d_AC``, each once.

    Raises InputError for a place or coordinate that there is not.
    """
    outputs: dict[tuple[str, int], Output] = {}
    for text in names:
        name, wanted = (text, "") if text in places else text.rpartition(".")[::2]
        if name not in places:
            near = suggestion(name or text, places)
            raise error("unknown-name", what="place", value=text, **near)
        kind = places[name].kind
        if wanted and wanted not in COORDINATES[kind]:
            hint = f"one of: {', '.join(f'{name}.{item}' for item in COORDINATES[kind])}"
            raise error("unknown-name", what="coordinate", value=text, expected=hint)
        for index, coordinate in enumerate(COORDINATES[kind]):
            unit = units[name]
            if kind in ("line", "plane", "frame"):
                turned = "rad" if kind == "frame" else "1"
                unit = "mm" if coordinate in "xyz" else turned
            if wanted in ("", coordinate):
                given = {"place": name, "coordinate": coordinate, "kind": kind, "unit": unit}
                outputs[name, index] = Output(**given, index=index)
    return tuple(outputs.values())


def read(
    values: Values, outputs: Sequence[Output], nominal: Values, into: FloatArray | None = None
) -> FloatArray:
    """Outputs (n, m) of the places' arrays; frames are compared with their `nominal`."""
    m = next(iter(values.values())).shape[-1]
    rows = np.empty((len(outputs), m)) if into is None else into
    turned: dict[str, FloatArray] = {}
    for row, item in zip(rows, outputs, strict=True):
        value = values[item.place]
        if item.kind == "frame" and item.index >= 3:
            if item.place not in turned:
                turned[item.place] = _rotation(value, nominal[item.place])
            row[:] = turned[item.place][item.index - 3]
        else:
            row[:] = value.reshape(-1, m)[item.index]
    return rows


def _rotation(frame: FloatArray, nominal: FloatArray) -> FloatArray:
    """Rotation (3, m) rad about the nominal axes: (1/2) sum a_i x b_i of nominal axes a_i and
    actual ones b_i, which is the axis times the sine of the angle.
    """
    axes = np.broadcast_to(nominal[1:], (3, 3, frame.shape[-1]))
    total = cross(axes[0], frame[1]) + cross(axes[1], frame[2]) + cross(axes[2], frame[3])
    total *= 0.5
    return np.stack([dot(axis, total) for axis in axes])


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """One independent group of c inputs: a probed place, a constant, or correlated constants.

    `places`: one name for each row, or one for all of a point. `factor` F (c, c), F F' = sum of
    the covariances (c, c) by source in `sources`.
    """

    places: tuple[str, ...]
    factor: FloatArray
    sources: tuple[tuple[str, FloatArray], ...]
    distribution: str = "normal"

    @property
    def diagonal(self) -> bool:
        """Whether its inputs are independent."""
        return bool(np.count_nonzero(self.factor - np.diag(np.diag(self.factor))) == 0)


def noises(graph: Graph, wanted: Collection[str]) -> list[Noise]:
    """The random inputs among the places `wanted`; normal ones first, in the file's order."""
    measured = (item for item in graph.transitions if item.do == "meas")
    groups = [_probed(graph, item) for item in measured if item.out[0] in wanted]
    correlated = list(
        dict.fromkeys(name for pair in graph.correlations for name in pair[:2] if name in wanted)
    )
    if correlated:
        groups.append(_correlated(graph, correlated))
    for name, place in graph.places.items():
        if name in wanted and place.u and name not in correlated:
            u, kind = np.array([[place.u]]), place.distribution
            known = ((name, u * u),)
            groups.append(Noise(places=(name,), factor=u, sources=known, distribution=kind))
    groups = [item for item in groups if np.any(item.factor)]
    return sorted(groups, key=lambda item: item.distribution != "normal")


def _probed(graph: Graph, item: Transition) -> Noise:
    """u_w = sqrt(u1^2 + u2^2 + u3^2) along the direction of probing, u1 across (Stryczek, eq. (1)
    and what follows it). n probings of one place share what the axis and the surface do to
    them: their mean has u2/sqrt(n). The factor is the symmetric root of the covariance.
    """
    stated = item.uncertainty.model_dump(exclude_unset=True) if item.uncertainty else {}
    probing = graph.uncertainty.model_copy(update=stated)
    n = graph.repeats if item.repeats is None else item.repeats
    u1, u2, u3 = (UM * u for u in (probing.axis_um, probing.probe_um, probing.perpendicular_um))
    squares = np.array([u1**2, u2**2 / n, u3**2])
    point = graph.places[item.out[0]].kind == "point"
    along = np.outer(item.along, item.along) if point and item.along else np.eye(1)
    everywhere = np.eye(len(along))
    shapes = zip(PROBING, squares, (everywhere, along, along), strict=True)
    return Noise(
        places=(item.out[0],),
        factor=np.sqrt(squares.sum()) * along + u1 * (everywhere - along),
        sources=tuple((name, square * shape) for name, square, shape in shapes),
    )


def _correlated(graph: Graph, names: Sequence[str]) -> Noise:
    """Constants with their covariance; to a source goes its row, as in c_i sum_j c_j u_ij."""
    u = np.array([graph.places[name].u or 0.0 for name in names])
    covariance = correlation_matrix(graph, names) * np.outer(u, u)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.clip(values, 0.0, None)) @ vectors.T
    rows = np.eye(len(u))[:, :, None] * covariance / 2
    sources = zip(names, rows + rows.transpose(0, 2, 1), strict=True)
    return Noise(places=tuple(names), factor=root, sources=tuple(sources))


def correlation_matrix(graph: Graph, names: Sequence[str]) -> FloatArray:
    """Correlations (n, n) of some constants; those with others leave these as they are."""
    at = {name: i for i, name in enumerate(names)}
    matrix = np.eye(len(names))
    for first, second, r in graph.correlations:
        if first in at and second in at:
            matrix[at[first], at[second]] = matrix[at[second], at[first]] = r
    return matrix


class Inputs:
    """All random inputs as one vector of k coordinates, and how to draw it.

    `mean` (k,), `u` (k,) the standard uncertainty of each, `factor` F (k, k), `rows` where each
    group stands, `normal` whether all are. X = mean + F z with z of mean 0, variance 1,
    independent.
    """

    def __init__(self, graph: Graph, wanted: Collection[str]) -> None:
        self.noises = noises(graph, wanted)
        ends = np.cumsum([0, *(len(item.factor) for item in self.noises)])
        self.rows = [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]
        self.k = int(ends[-1])
        self.normal = all(item.distribution == "normal" for item in self.noises)
        self.mean, self.u, self._scale = np.zeros(self.k), np.zeros(self.k), np.ones(self.k)
        self._mixed: list[tuple[FloatArray, slice]] = []
        self._at: dict[str, int | slice] = {}
        for item, rows in zip(self.noises, self.rows, strict=True):
            values = [start_value(graph.places[name]).ravel() for name in item.places]
            self.mean[rows] = np.concatenate(values)
            self.u[rows] = np.sqrt(np.sum(item.factor**2, axis=1))
            if item.diagonal:
                self._scale[rows] = np.diag(item.factor)
            else:
                self._mixed.append((item.factor, rows))
            for i, name in enumerate(item.places):
                self._at[name] = rows.start + i if len(values[i]) == 1 else rows
        self._fixed = {
            name: start_value(graph.places[name]) for name in wanted if name not in self._at
        }

    @property
    def factor(self) -> FloatArray:
        """F (k, k) of all inputs."""
        factor = np.zeros((self.k, self.k))
        for item, rows in zip(self.noises, self.rows, strict=True):
            factor[rows, rows] = item.factor
        return factor

    def values(self, X: FloatArray) -> Values:
        """The start places, from X (k, m); what is not random stands still."""
        values: Values = {name: X[at] for name, at in self._at.items()}
        for name, value in self._fixed.items():
            values[name] = np.broadcast_to(value, (*value.shape[:-1], X.shape[1]))
        return values

    def draw(self, rng: np.random.Generator, m: int, work: Workspace) -> FloatArray:
        """z (k, m): independent, of mean 0 and variance 1."""
        z = work.array("z", (self.k, m))
        normal = sum(len(item.factor) for item in self.noises if item.distribution == "normal")
        rng.standard_normal(out=z[:normal])
        for item, rows in zip(self.noises, self.rows, strict=True):
            if item.distribution != "normal":
                for row in z[rows]:
                    _SHAPES[item.distribution].draw(rng, row, work)
        return z

    def scaled(self, z: FloatArray) -> FloatArray:
        """X = mean + F z (k, m), in the place of z: a second array would not stay in cache."""
        for factor, rows in self._mixed:
            z[rows] = factor @ z[rows]
        z *= self._scale[:, None]
        z += self.mean[:, None]
        return z


def _standardised(kind: Literal["rectangular", "triangular"]) -> Distribution:
    """The shape with a variance of 1 (JCGM 101:2008, 6.4)."""
    return Distribution(kind=kind, u=1.0, half_width=shape_moments(kind)[0] ** -0.5)


_SHAPES = {
    "rectangular": _standardised("rectangular"),
    "triangular": _standardised("triangular"),
}
