"""The propagation of uncertainty through a graph: to first order, and as a Monte Carlo model.

Everything random enters at a place: the scatter of a probing, or a constant with its uncertainty.
All of them are one vector X = mean + F z of k inputs, z independent of mean 0 and variance 1; every
place is an array of trials of it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

import numpy as np

from mtu_cli.files.graph_contract import Graph
from mtu_cli.model.graph.net import MeasurementGraph, Output, start_value
from mtu_cli.model.graph.transitions import Values, rotation
from mtu_cli.stats.blocks import Draws, Quantiles, Workspace
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.coverage import t_quantile
from mtu_cli.stats.distributions import Distribution, Kind, shape_moments
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

LARGEST = 1e150
"""Beyond it the square of a value is not finite."""
ROUNDING = 256 * float(np.finfo(np.float64).eps)
"""Share of the largest coordinate below which a nominal is 0, and a difference no derivative."""
STILL = 1e-13
"""Scatter below this share of the dimensions is rounding: the output does not vary."""
KEPT_BYTES = 16 << 20
PROBING = ("u1_axis", "u2_probe", "u3_perpendicular")
"""Sources of the scatter of a probing, in the terms of Stryczek."""


class Noise(NamedTuple):
    """A probed place or a constant: c inputs with their `covariances` (c, c) by source."""

    place: str
    covariances: dict[str, FloatArray]
    kind: Kind = "normal"


def noises(graph: Graph, names: Collection[str]) -> list[Noise]:
    """The random inputs among the places `names`; normal ones first, in the file's order.

    Of a probing: u_w = sqrt(u1^2 + u2^2 + u3^2) along its direction, u1 across (Stryczek, eq. (1)
    and the text below it). n probings of one place share the errors of the axis and the surface:
    their mean has u2/sqrt(n).
    """
    groups = []
    for item in graph.transitions:
        name = item.out[0]
        if item.do != "meas" or name not in names:
            continue
        stated = item.uncertainty.model_dump(exclude_unset=True) if item.uncertainty else {}
        probing = graph.uncertainty.model_copy(update=stated)
        n = graph.repeats if item.repeats is None else item.repeats
        u1, u2, u3 = (UM * u for u in (probing.axis_um, probing.probe_um, probing.perpendicular_um))
        point = graph.places[name].kind == "point"
        along = np.outer(item.along, item.along) if point and item.along else np.eye(1)
        parts = (u1**2 * np.eye(len(along)), u2**2 / n * along, u3**2 * along)
        groups.append(Noise(name, dict(zip(PROBING, parts, strict=True))))
    for name, place in graph.places.items():
        if name in names and place.u:
            groups.append(Noise(name, {name: np.array([[place.u**2]])}, place.distribution))
    groups = [item for item in groups if any(map(np.any, item.covariances.values()))]
    return sorted(groups, key=lambda item: item.kind != "normal")


class GraphTrials:
    """n `outputs` of a graph, and what stands behind them, as a function of its k random inputs, of
    `mean` (k,), `input_u` (k,) and `factor` F (k, k). To first order: `nominal` (n,), `gradient`
    (n, k) with respect to the inputs, `u` (n,). As a Monte Carlo model: m simulation cycles a
    block, every place of a cycle from one draw of the inputs. The first-order form is drawn along
    and serves as control variate: of the whole distribution where all inputs are normal, of the
    mean and u where some are not.
    """

    def __init__(self, graph: MeasurementGraph, outputs: Iterable[Output]) -> None:
        self.graph, self.outputs = graph, tuple(outputs)
        self.names = tuple(map(str, self.outputs))
        start, self.steps = graph.needed(self.outputs)
        places, self._rows = graph.graph.places, dict[str, slice]()
        self.noises = noises(graph.graph, start)
        factors = [covariance_root(np.sum([*x.covariances.values()], axis=0)) for x in self.noises]
        self.k = sum(map(len, factors))
        self.mean, self.factor, at = np.zeros(self.k), np.zeros((self.k, self.k)), 0
        for item, F in zip(self.noises, factors, strict=True):
            rows = self._rows[item.place] = slice(at, at := at + len(F))
            self.mean[rows] = start_value(places[item.place]).ravel()
            # The symmetric root: F F' = C.
            self.factor[rows, rows] = F
        self._fixed = {n: start_value(places[n]) for n in start if n not in self._rows}
        # Of variance 1 (JCGM 101:2008, 6.4).
        self._shapes = [
            Distribution(kind=x.kind, u=1.0, half_width=shape_moments(x.kind)[0] ** -0.5)
            for x in self.noises
            if x.kind != "normal"
        ]
        self.input_u = np.sqrt(np.sum(self.factor**2, axis=1))
        # What rounding is a share of: the part's largest coordinate for a length, 1 for a ratio.
        part = float(np.max(np.abs(self.mean), initial=1.0))
        self.sizes = np.array([1.0 if x.unit in ("1", "rad") else part for x in self.outputs])
        self.nominal, self.gradient = self._derivatives()
        self._linear = self.gradient @ self.factor
        with np.errstate(over="ignore", invalid="ignore"):
            self.u = np.sqrt(np.sum(self._linear**2, axis=1))
        u = self.u[:, None]
        self.linear_mean, self.linear_variance = self.nominal, self.u**2
        self.linear_quantiles: Quantiles | None = None
        if not self._shapes:
            self.linear_quantiles = lambda p: u * t_quantile(p, np.inf)
        self._work = Workspace()
        # glibc returns memory to the system beyond twice the largest block freed so far
        # (mallopt(3), M_MMAP_THRESHOLD), and every page of it costs a fault when it is allocated
        # again: a third of the time. One large block, freed and never touched, moves that bound,
        # and the memory that one block of trials frees stays for the next.
        np.empty(KEPT_BYTES, dtype=np.uint8)

    def _derivatives(self) -> tuple[FloatArray, FloatArray]:
        """Nominal outputs and their derivatives, by central differences over one standard
        uncertainty of each input, all in one batch (JCGM 100:2008, 5.1.3, note 2). Where one of
        both has no finite value it is 0, and the trials show whether the output has one.
        """
        k, u = self.k, self.input_u
        X = np.repeat(self.mean[:, None], 2 * k + 1, axis=1)
        X[:, 1 : k + 1] += np.diag(u)
        X[:, k + 1 :] -= np.diag(u)
        with np.errstate(all="ignore"):
            values = self.run(X)
            half = 0.5 * (values[:, 1 : k + 1] - values[:, k + 1 :])
        nominal, change = values[:, 0].copy(), np.where(np.isfinite(half), half, 0.0)
        nominal[np.abs(nominal) <= ROUNDING * self.sizes] = 0.0
        floor = ROUNDING * np.maximum(np.abs(nominal), self.sizes)
        change[np.abs(change) <= floor[:, None]] = 0.0
        return nominal, np.divide(change, u, out=np.zeros_like(change), where=u > 0)

    def shares(self, *, by_place: bool = False) -> dict[str, FloatArray]:
        """Shares (n,) of the first-order variance by source: c C_s c' of the covariance C_s that
        the source has over c C c', nan where that is 0 (JCGM 100:2008, 5.1.2); `by_place`: by the
        place where they come in.
        """
        result: dict[str, FloatArray] = {}
        total = np.where(self.u > 0, self.u, np.nan) ** 2
        for item in self.noises:
            c = self.gradient[:, self._rows[item.place]]
            for source, covariance in item.covariances.items():
                name = item.place if by_place else source
                with np.errstate(over="ignore", invalid="ignore"):
                    part = np.einsum("ni,ij,nj->n", c, covariance, c) / total
                result[name] = result.get(name, 0.0) + part
        return result

    def run(self, X: FloatArray, into: FloatArray | None = None) -> FloatArray:
        """Outputs (n, m) for inputs X (k, m); frames are compared with their nominal."""
        values, m = Values(), X.shape[1]
        for name, of in self._rows.items():
            values[name] = X[of] if of.stop - of.start > 1 else X[of.start]
        for name, value in self._fixed.items():
            values[name] = np.broadcast_to(value, (*value.shape[:-1], m))
        for step in self.steps:
            step.run(values)
        rows = np.empty((len(self.outputs), m)) if into is None else into
        for name in {item.place for item in self.outputs if item.kind == "frame"}:
            frame = values[name]
            values[name] = np.concatenate([frame[0], rotation(frame, self.graph.nominal[name])])
        for row, item in zip(rows, self.outputs, strict=True):
            row[:] = values[item.place].reshape(-1, m)[item.index]
        return rows

    def inputs(self, rng: np.random.Generator, m: int) -> tuple[FloatArray, FloatArray]:
        """z (k, m), independent, of mean 0 and variance 1, and the inputs X = mean + F z."""
        z, normal = self._work.array("z", (self.k, m)), self.k - len(self._shapes)
        rng.standard_normal(out=z[:normal])
        for row, shape in zip(z[normal:], self._shapes, strict=True):
            shape.draw(rng, row, self._work)
        X = np.matmul(self.factor, z, out=self._work.array("X", z.shape))
        X += self.mean[:, None]
        return z, X

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (outputs, m)."""
        n = len(self.names)
        z, X = self.inputs(rng, m)
        linear = np.matmul(self._linear, z, out=self._work.array("linear", (n, m)))
        linear += self.linear_mean[:, None]
        with np.errstate(all="ignore"):
            values = self.run(X, self._work.array("values", (n, m)))
        # What is not a number compares as neither.
        if not (values.max() < LARGEST and values.min() > -LARGEST):
            values[~(np.abs(values) < LARGEST)] = np.nan
        for i in np.flatnonzero(self.u == 0.0):
            if np.all(np.abs(values[i] - self.nominal[i]) <= STILL * self.sizes[i]):
                values[i] = self.nominal[i]
        return Draws(values=values, linear=linear)
