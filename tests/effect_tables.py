"""Tables of residuals on which the library of effects is tried."""

import numpy as np

from mtu_cli.model.residuals import ResidualTable
from mtu_cli.stats.least_squares import FloatArray


def grid_places(H: int, jitter: float = 0.0, z: float | None = 127.0) -> FloatArray:
    """H places (H, 3) on a square grid, mm; at two heights where `z` is None."""
    n = int(np.ceil(np.sqrt(H)))
    x, y = np.meshgrid(np.linspace(10.0, 140.0, n), np.linspace(15.0, 120.0, n))
    height = np.arange(H) % 2 * 40.0 if z is None else np.full(H, z)
    places = np.stack([x.ravel()[:H], y.ravel()[:H], height], axis=-1)
    places[:, :2] += jitter * np.random.default_rng(3).normal(size=(H, 2))
    return places


def shop_covariates(P: int, H: int) -> dict[str, FloatArray]:
    """What a shop logs: directions, time, temperatures, parts of the tool, a load."""
    draw = np.random.default_rng(4)
    sequence = np.arange(1.0, P + 1)[:, None]
    time = np.cumsum(draw.uniform(10.0, 20.0, (P, 1)), axis=0)
    time -= time[0]
    return {
        "dir_x": np.where(np.arange(P) % 2, 1.0, -1.0)[:, None],
        "dir_y": np.where(np.arange(H) % 3, 1.0, -1.0)[None],
        "time_min": time,
        "sequence": sequence,
        "tool_parts": (np.arange(P) % 8 + 1.0)[:, None],
        "T_spindle_degC": 21.0 + 4.0 * (1.0 - np.exp(-time / 60.0)),
        "T_part_degC": 20.0 + draw.normal(size=(P, H)),
        "load": draw.normal(size=(P, 1)),
    }


def table(
    P: int = 9,
    H: int = 12,
    *,
    axes: tuple[str, ...] = ("x", "y"),
    places: FloatArray | None = None,
    covariates: dict[str, FloatArray] | None = None,
    component: str | None = None,
    unit: str = "um",
    operations: tuple[str, ...] = ("drilled", "milled", "reamed"),
    fitted_degree: int = -1,
) -> ResidualTable:
    """A table without errors: the library looks at everything else."""
    at = grid_places(H) if places is None else places
    A = len(axes)
    return ResidualTable(
        axes=axes,
        component=component,
        unit=unit,
        parts=tuple(f"P{i + 1}" for i in range(P)),
        features=tuple(f"H{i + 1}" for i in range(H)),
        errors=np.zeros((P, H, A)),
        repeats=np.full((P, H), 3),
        places=np.broadcast_to(at, (P, H, 3)).copy(),
        operations=operations,
        operation=np.arange(H) % len(operations),
        covariates=shop_covariates(P, H) if covariates is None else covariates,
        common=np.zeros((1, H, A, 0)),
        of_part=np.zeros((1, H, A, 0)),
        fitted_degree=fitted_degree,
    )


def readings_table(*, name: str = "x", component: str = "dx_x", unit: str = "um") -> ResidualTable:
    """Six passes of a component over seven positions, forward and reverse."""
    P, positions = 6, np.linspace(0.0, 300.0, 7)
    H = 2 * len(positions)
    places = np.full((H, 3), np.nan)
    if name in ("x", "y", "z"):
        places[:, "xyz".index(name)] = np.repeat(positions, 2)
    direction = np.tile([1.0, -1.0], len(positions))[None]
    covariates = {
        "sequence": np.arange(1.0, P + 1)[:, None],
        "time_min": np.array([0.0, 9, 21, 33, 40, 55])[:, None],
    }
    if name in ("x", "y", "z"):
        covariates[f"dir_{name}"] = direction
    return table(
        P,
        H,
        axes=(name,),
        places=places,
        covariates=covariates,
        component=component,
        unit=unit,
        operations=("",),
    )
