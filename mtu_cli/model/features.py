"""The features of a part as arrays, and what the predictions of them must warn of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.errors import InputError, Warned, reworded
from mtu_cli.files.features_alike import part_features_alike
from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding
from mtu_cli.model.design import without_coordinate
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.prediction import Prediction
from mtu_cli.stats.least_squares import FloatArray

OTHER_UNIT = 10.0
"""Times the measured range beyond which a place seems to be in another unit."""
FEW_DOF = 3.0


def feature_points(
    part: LoadedPart, model: MachineModel, chosen: Iterable[str] | None = None
) -> tuple[tuple[str, ...], FloatArray, list[Finding]]:
    """Ids, nominal coordinates (n, 3) in mm (nan: not given) and warnings.

    A coordinate that a constant of the machine fixes (its effective z) is the machine's.

    Raises InputError for features without a coordinate that an equation needs.
    """
    places = part.part.places()
    ids = tuple(places) if chosen is None else tuple(dict.fromkeys(chosen))
    points = np.array(
        [[np.nan if value is None else value for value in places[i]] for i in ids],
        dtype=np.float64,
    ).reshape(len(ids), 3)
    _check_coordinates(part, model, ids, points)
    warnings: list[Finding] = []
    for axis, value in model.position_constants().items():
        column = points[:, AXES.index(axis)]
        if (np.isfinite(column) & (np.abs(column - value) > 1e-9)).any():
            warnings.append(
                Warned(
                    code="position-fixed",
                    message=f"the machine fixes {axis} at {value:g} mm; the part's own {axis} "
                    "is used for nominal lengths only",
                )
            )
    warnings += [
        Warned(code=notice.code, message=notice.message)
        for notice in part_features_alike(part.source.shown, ids, points)
    ]
    return ids, points, warnings


def _check_coordinates(
    part: LoadedPart, model: MachineModel, ids: Sequence[str], points: FloatArray
) -> None:
    found = without_coordinate(model, points)
    if found is None:
        return
    lacking, problem = found
    name = ids[lacking[0]]
    more = f" (and {len(lacking) - 1} more features)" if len(lacking) > 1 else ""
    raise InputError(
        replace(
            reworded(problem, f"{problem.text}, of feature {name!r}{more}"),
            file=part.source.shown,
            line=part.line_of("features", name),
            path=f"features.{name}",
        )
    )


def outside_warnings(prediction: Prediction) -> list[Finding]:
    """One warning for all components whose measured range the features leave alike."""
    alike: dict[tuple[float, float, tuple[str, ...]], list[tuple[str, float]]] = {}
    by_component: dict[str, list[tuple[str, float, float, float]]] = {}
    for point, component, position, low, high in prediction.outside:
        by_component.setdefault(component, []).append((point, position, low, high))
    for component, found in by_component.items():
        _, _, low, high = found[0]
        key = (low, high, tuple(point for point, *_ in found))
        alike.setdefault(key, []).append((component, found[0][1]))
    warnings = []
    for (low, high, points), members in alike.items():
        names = ", ".join(name for name, _ in members)
        others = f" and {len(points) - 1} more" if len(points) > 1 else ""
        warnings.append(
            Warned(
                code="outside-measured-range",
                message=f"{names} {'was' if len(members) == 1 else 'were'} measured from "
                f"{low:g} to {high:g} mm; feature {points[0]!r} at {members[0][1]:g} mm{others} "
                "is outside: what was fitted is a guess there"
                + (
                    "; are the positions of its readings, and the features of the part, in mm?"
                    if abs(members[0][1]) > OTHER_UNIT * max(abs(low), abs(high)) > 0
                    else ""
                ),
            )
        )
    return warnings


def dof_warnings(what: Sequence[str], dof: FloatArray) -> list[Finding]:
    """Fewer than three effective degrees of freedom: Student's t has no variance there."""
    few = [name for name, value in zip(what, dof, strict=True) if value < FEW_DOF]
    if not few:
        return []
    return [
        Warned(
            code="few-degrees-of-freedom",
            message=f"fewer than 3 effective degrees of freedom behind {', '.join(few[:6])}"
            f"{' and more' if len(few) > 6 else ''}: use the 95 % interval, not u",
        )
    ]
