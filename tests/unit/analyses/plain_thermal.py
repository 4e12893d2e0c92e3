"""The choice and the held-out errors of thermal models once more, by plain fits of raw rows.

Nothing is compressed, merged or reused: every candidate is fitted from scratch to the rows of
its cycles, for every fold within every fold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from mtu_cli.stats.least_squares import FloatArray

PENALTIES = (0.0, *(10.0**k for k in np.arange(-8.0, 0.6, 0.5)))
WORTH = 0.02


@dataclass(frozen=True, kw_only=True)
class Table:
    """Raw rows: `u` (n, s) rises, `y` (n,), `place` (n,) index, `cycle` (n,)."""

    u: FloatArray
    y: FloatArray
    place: np.ndarray
    cycle: np.ndarray
    scaled: FloatArray

    def of(self, cycles: Sequence[int]) -> Table:
        here = np.isin(self.cycle, cycles)
        return Table(u=self.u[here], y=self.y[here], place=self.place[here],
                     cycle=self.cycle[here], scaled=self.scaled)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Model:
    """Gradients (places, s) and intercepts (places,)."""

    gradients: FloatArray
    intercepts: FloatArray

    def loss(self, rows: Table) -> float:
        modelled = np.sum(rows.u * self.gradients[rows.place], axis=1)
        return float(np.sum((rows.y - self.intercepts[rows.place] - modelled) ** 2))


def solved(X: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(X, y, rcond=None)[0], float)


def ridge_model(rows: Table, degree: int, penalty: float) -> Model:
    """Augmented rows; every column is scaled by its standard deviation about the means."""
    places, s, n = len(rows.scaled), rows.u.shape[1], len(rows.y)
    power = rows.scaled[rows.place][:, None] ** np.arange(degree + 1)
    X = (power[:, :, None] * rows.u[:, None, :]).reshape(n, -1)
    free = (rows.place[:, None] == np.arange(places)).astype(float)
    deviation = np.sqrt(np.mean((X - free @ solved(free, X)) ** 2, axis=0))
    below = np.diag(np.sqrt(n * penalty) * deviation)
    top = np.hstack([free, X])
    bottom = np.hstack([np.zeros((X.shape[1], places)), below])
    b = solved(np.vstack([top, bottom]), np.append(rows.y, np.zeros(X.shape[1])))
    powers = rows.scaled[:, None] ** np.arange(degree + 1)
    return Model(gradients=powers @ b[places:].reshape(degree + 1, s), intercepts=b[:places])


def squares(rows: Table, chosen: Sequence[int]) -> tuple[float, FloatArray, FloatArray]:
    X = np.column_stack([np.ones(len(rows.y)), rows.u[:, list(chosen)]])
    b = solved(X, rows.y)
    e = rows.y - X @ b
    return float(e @ e), b, e


def selected(rows: Table) -> list[int]:
    """Forward 0.05, backward 0.10, with the effective number of the residuals on all sensors."""
    s = rows.u.shape[1]
    e = squares(rows, range(s))[2]
    products = [e[i] * e[i + 1] for i in range(len(e) - 1) if rows.cycle[i] == rows.cycle[i + 1]]
    r = max(float(np.mean(products) / np.mean(e**2)), 0.0)
    number = max(len(e) * (1 - r) / (1 + r), 1.0)

    def p(less: list[int], more: list[int]) -> float:
        left, dof = squares(rows, more)[0], number - len(more) - 1
        F = (squares(rows, less)[0] - left) / left * dof
        return float(f_distribution.sf(F, 1, dof)) if dof > 0 else 1.0

    chosen: list[int] = []
    for _ in range(50):
        others = [j for j in range(s) if j not in chosen]
        if not others:
            return chosen
        best = min(others, key=lambda j: squares(rows, [*chosen, j])[0])
        if p(chosen, [*chosen, best]) >= 0.05:
            return chosen
        chosen.append(best)
        while True:
            exits = {j: p([i for i in chosen if i != j], chosen) for j in chosen}
            worst = max(exits, key=lambda j: exits[j])
            if exits[worst] <= 0.10:
                break
            chosen.remove(worst)
    raise AssertionError("no end")


def stepwise_model(rows: Table, degree: int, penalty: float = 0.0) -> Model:
    """Selection at each place, a polynomial through the places, the intercepts after that."""
    gradients = np.zeros((len(rows.scaled), rows.u.shape[1]))
    parts = []
    for k in range(len(rows.scaled)):
        here = rows.place == k
        parts.append(Table(u=rows.u[here], y=rows.y[here], place=rows.place[here],
                           cycle=rows.cycle[here], scaled=rows.scaled))  # fmt: skip
        chosen = selected(parts[k])
        gradients[k, chosen] = squares(parts[k], chosen)[1][1:]
    powers = rows.scaled[:, None] ** np.arange(degree + 1)
    smooth = powers @ solved(powers, gradients)
    means = [np.mean(part.y - part.u @ smooth[k]) for k, part in enumerate(parts)]
    return Model(gradients=smooth, intercepts=np.array(means))


Maker = Callable[[Table, int, float], Model]
KINDS: dict[str, tuple[Maker, tuple[float, ...]]] = {
    "ridge": (ridge_model, PENALTIES),
    "stepwise": (stepwise_model, (0.0,)),
}


def chosen_by_degree(rows: Table, kind: str) -> list[tuple[float, int, float]]:
    """(held-out sum of squares, degree, best penalty) of every degree."""
    maker, penalties = KINDS[kind]
    cycles = np.unique(rows.cycle)
    found = []
    for degree in range(len(rows.scaled)):
        totals = []
        for penalty in penalties:
            total = 0.0
            for held in cycles:
                model = maker(rows.of([c for c in cycles if c != held]), degree, penalty)
                total += model.loss(rows.of([held]))
            totals.append(total)
        i = int(np.argmin(totals))
        found.append((totals[i], degree, penalties[i]))
    return found


def held_out_errors(rows: Table, kind: str) -> tuple[float, list[float]]:
    """Root mean square over held-out cycles: in all, and by cycle."""
    maker, _ = KINDS[kind]
    cycles = np.unique(rows.cycle)
    total, own = 0.0, []
    for held in cycles:
        others, left = rows.of([c for c in cycles if c != held]), rows.of([held])
        tried = chosen_by_degree(others, kind)
        least = min(score for score, _, _ in tried)
        best = next((d, penalty) for score, d, penalty in tried if score <= least * (1 + WORTH))
        loss = maker(others, *best).loss(left)
        total += loss
        own.append(float(np.sqrt(loss / len(left.y))))
    return float(np.sqrt(total / len(rows.y))), own
