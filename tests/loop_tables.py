"""Small tables of residuals and candidates of one's own, and the dense way to judge them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from crossed_tables import Floats, Mask
from effect_tables import grid_places

from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate, Column, Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable


def residuals(
    errors: Floats,
    *,
    there: Mask | None = None,
    flat: bool = False,
    common: Floats | None = None,
    of_part: Floats | None = None,
    **more: object,
) -> ResidualTable:
    """Errors (P, H, A) on a grid of places; `flat`: at places that are not known, so that
    parts have no lines.
    """
    P, H, A = errors.shape
    own = np.ones((P, H), bool) if there is None else there
    places = np.full((H, 3), np.nan) if flat else grid_places(H, jitter=3.0)
    table = ResidualTable(
        axes=("x", "y", "z")[:A],
        component=None,
        unit="um",
        parts=tuple(f"P{i + 1}" for i in range(P)),
        features=tuple(f"H{i + 1}" for i in range(H)),
        errors=np.where(own[:, :, None], errors, np.nan),
        repeats=own.astype(np.int64),
        repeat_variance=np.full(A, np.nan),
        repeat_dof=0,
        places=np.broadcast_to(places, (P, H, 3)).copy(),
        operations=("milled",),
        operation=np.zeros(H, np.int64),
        covariates={},
        common=np.zeros((1, H, A, 0)) if common is None else common,
        of_part=np.zeros((1, H, A, 0)) if of_part is None else of_part,
    )
    return replace(table, **more)  # type: ignore[arg-type]  # fields by name


def candidate(name: str, *members: Sequence[Column], kind: str = "mean") -> Candidate:
    return Candidate(
        name=name,
        family=name,
        axis="x",
        says=name,
        separates=None,
        members=tuple(
            Member(
                columns=tuple(columns),
                parameters=tuple((f"b{j}", "um") for j in range(len(columns))),
                equations={"Ex": "+".join(f"b{j}" for j in range(len(columns)))},
                searched={"grid": float(i)} if len(members) > 1 else {},
                covariate=None,
            )
            for i, columns in enumerate(members)
        ),
        kind=kind,  # type: ignore[arg-type]  # a Kind
    )


def offset(axis: str) -> Candidate:
    return replace(candidate(f"offset-{axis}", kind="offset"), axis=axis, members=())


def prepared_with(table: ResidualTable, *candidates: Candidate) -> Prepared:
    return prepare(table, candidates, table.pass_dof)


def whole_column(column: Column, shape: tuple[int, ...]) -> Floats:
    """The column's table (P, H, A)."""
    found = np.zeros(shape)
    for axis, values in column.items():
        found[:, :, axis] = values
    return found


def gls(X: Floats, y: Floats, V: Floats) -> tuple[Floats, Floats]:
    """Generalised least squares by the normal equations of the dense covariance."""
    W = np.linalg.inv(V)
    C = np.linalg.inv(X.T @ W @ X)
    return np.asarray(C @ X.T @ W @ y, float), np.asarray(C, float)


def crossed(
    rng: np.random.Generator,
    shape: tuple[int, int, int],
    *,
    part: float = 2.0,
    column: float = 1.0,
    noise: float = 1.0,
) -> Floats:
    """Errors with random effects of parts and columns: standard deviations."""
    P, H, A = shape
    found = noise * rng.normal(size=shape) + part * rng.normal(size=(P, 1, A))
    return np.asarray(found + column * rng.normal(size=(1, H, A)))
