"""What is random in a graph: probed coordinates and points, and uncertain constants."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mtu_cli.files.graph_contract import Graph, Probing, Transition
from mtu_cli.model.graph.nominal import Values, correlation_matrix, start_value
from mtu_cli.stats.distributions import Distribution, shape_moments
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.workspace import Workspace
from mtu_cli.units import UM

PROBING = ("u1_axis", "u2_probe", "u3_perpendicular")
"""Sources of the scatter of a probing, in the terms of Stryczek."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """One independent group of inputs: a probed place, a constant, or correlated constants.

    `size` c of `places` (one name for each row, or one for all of a point). `factor` F (c, c),
    F F' = sum of the covariances (c, c) by source in `sources`.
    """

    places: tuple[str, ...]
    size: int
    factor: FloatArray
    sources: tuple[tuple[str, FloatArray], ...]
    distribution: str = "normal"

    @property
    def diagonal(self) -> bool:
        return bool(np.count_nonzero(self.factor - np.diag(np.diag(self.factor))) == 0)


def probing_of(graph: Graph, item: Transition) -> tuple[Probing, int]:
    """Uncertainties and number of probings of one `meas`: its own, or else the graph's."""
    own = item.uncertainty.model_dump(exclude_none=True) if item.uncertainty else {}
    probing = graph.uncertainty.model_copy(update=own)
    return probing, graph.repeats if item.repeats is None else item.repeats


def noises(graph: Graph, wanted: Collection[str]) -> list[Noise]:
    """The random inputs among the places `wanted`; normal ones first, in the file's order."""
    measured = (item for item in graph.transitions if item.do == "meas")
    found = [_probed(graph, item) for item in measured if item.out[0] in wanted]
    correlated = list(
        dict.fromkeys(name for pair in graph.correlations for name in pair[:2] if name in wanted)
    )
    if correlated:
        found.append(_correlated(graph, correlated))
    for name, place in graph.places.items():
        if name in wanted and place.u and name not in correlated:
            found.append(_constant(name, place.u, place.distribution))
    found = [item for item in found if np.any(item.factor)]
    return sorted(found, key=lambda item: item.distribution != "normal")


def _probed(graph: Graph, item: Transition) -> Noise:
    """u_w = sqrt(u1^2 + u2^2 + u3^2) along the direction of probing, u1 across (Stryczek, eq. (1)
    and what follows it). n probings of one place share what the axis and the surface do to
    them: their mean has u2/sqrt(n). The factor is the symmetric root of the covariance.
    """
    probing, n = probing_of(graph, item)
    squares = [
        (probing.axis_um * UM) ** 2,
        (probing.probe_um * UM) ** 2 / n,
        (probing.perpendicular_um * UM) ** 2,
    ]
    point = graph.places[item.out[0]].kind == "point"
    along = np.outer(item.along, item.along) if point and item.along else np.eye(1)
    across = np.eye(len(along)) - along
    u_w, u1 = np.sqrt(sum(squares)), np.sqrt(squares[0])
    shapes = (np.eye(len(along)), along, along)
    return Noise(
        places=(item.out[0],),
        size=len(along),
        factor=u_w * along + u1 * across,
        sources=tuple(
            (name, square * shape)
            for name, square, shape in zip(PROBING, squares, shapes, strict=True)
        ),
    )


def _constant(name: str, u: float, distribution: str) -> Noise:
    return Noise(
        places=(name,),
        size=1,
        factor=np.array([[u]]),
        sources=((name, np.array([[u * u]])),),
        distribution=distribution,
    )


def _correlated(graph: Graph, names: Sequence[str]) -> Noise:
    """Constants with their covariance; to a source goes its row, as in c_i sum_j c_j u_ij."""
    u = np.array([graph.places[name].u or 0.0 for name in names])
    covariance = correlation_matrix(graph, names) * np.outer(u, u)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.clip(values, 0.0, None)) @ vectors.T
    rows = []
    for i, name in enumerate(names):
        half = np.zeros_like(covariance)
        half[i] += covariance[i] / 2
        half[:, i] += covariance[:, i] / 2
        rows.append((name, half))
    return Noise(places=tuple(names), size=len(names), factor=root, sources=tuple(rows))


class Inputs:
    """All random inputs as one vector of k coordinates, and how to draw it.

    `mean` (k,), `u` (k,) the standard uncertainty of each, `rows` where each group stands,
    `normal` whether all are. X = mean + F z with z of mean 0, variance 1, independent.
    """

    def __init__(self, graph: Graph, wanted: Collection[str]) -> None:
        self.noises = noises(graph, wanted)
        ends = np.cumsum([0, *(item.size for item in self.noises)])
        self.rows = [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]
        self.k = int(ends[-1])
        self.normal = all(item.distribution == "normal" for item in self.noises)
        self.mean = np.zeros(self.k)
        self.scale = np.zeros(self.k)
        self.u = np.zeros(self.k)
        self._mixed = [
            (item.factor, rows)
            for item, rows in zip(self.noises, self.rows, strict=True)
            if not item.diagonal
        ]
        self._at: dict[str, int | slice] = {}
        for item, rows in zip(self.noises, self.rows, strict=True):
            values = [start_value(graph.places[name]).ravel() for name in item.places]
            self.mean[rows] = np.concatenate(values)
            self.scale[rows] = np.diag(item.factor) if item.diagonal else 1.0
            self.u[rows] = np.sqrt(np.sum(item.factor**2, axis=1))
            for i, name in enumerate(item.places):
                alone = len(values[i]) == 1
                self._at[name] = rows.start + i if alone else rows
        self._fixed = {
            name: start_value(graph.places[name]) for name in wanted if name not in self._at
        }

    @property
    def factor(self) -> FloatArray:
        """F (k, k) of all inputs."""
        found = np.zeros((self.k, self.k))
        for item, rows in zip(self.noises, self.rows, strict=True):
            found[rows, rows] = item.factor
        return found

    def values(self, X: FloatArray) -> Values:
        """The start places, from X (k, m); what is not random stands still."""
        m = X.shape[1]
        found: Values = {name: X[at] for name, at in self._at.items()}
        for name, value in self._fixed.items():
            found[name] = np.broadcast_to(value, (*value.shape[:-1], m))
        return found

    def draw(self, rng: np.random.Generator, m: int, work: Workspace) -> FloatArray:
        """z (k, m): independent, of mean 0 and variance 1."""
        z = work.array("z", (self.k, m))
        normal = sum(item.size for item in self.noises if item.distribution == "normal")
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
        z *= self.scale[:, None]
        z += self.mean[:, None]
        return z


def _standardised(kind: Literal["rectangular", "triangular"]) -> Distribution:
    """The shape with a variance of 1 (JCGM 101:2008, 6.4)."""
    return Distribution(kind=kind, u=1.0, half_width=shape_moments(kind)[0] ** -0.5)


_SHAPES = {
    "rectangular": _standardised("rectangular"),
    "triangular": _standardised("triangular"),
}
