"""The features of a part as arrays, and what the predictions of them must warn of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import Finding, InputError, finding
from mtu_cli.model.design import of_feature, without_coordinate
from mtu_cli.model.machine_model import AXES, MachineModel
from mtu_cli.model.prediction import Prediction
from mtu_cli.stats.least_squares import FloatArray

FEW_DOF = 3.0
BELOW_THREE = "fewer than 3 effective ones"
NO_U = "a source with two or fewer, so that no standard uncertainty exists"


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
            reason = f"the machine fixes {axis} at {value:g} mm; nominal lengths have it"
            facts = {"what": f"the part's {axis}", "names": [f"{axis}_mm"], "reason": reason}
            warnings.append(finding("not-used", **facts))
    return ids, points, warnings


def _check_coordinates(
    part: LoadedPart, model: MachineModel, ids: Sequence[str], points: FloatArray
) -> None:
    found = without_coordinate(model, points)
    if found is None:
        return
    lacking, problem = found
    name = ids[lacking[0]]
    place = {"file": part.source.shown, "line": part.line_of("features", name)}
    raise InputError(of_feature(problem, name, len(lacking) - 1, path=f"features.{name}", **place))


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
        others = f" (and {len(points) - 1} more)" if len(points) > 1 else ""
        warnings.append(
            finding(
                "outside-measured-range",
                what=f"feature {points[0]!r} at {members[0][1]:g} mm{others}",
                names=[name for name, _ in members],
                low=low,
                high=high,
                unit="mm",
            )
        )
    return warnings


def dof_warnings(what: Sequence[str], dof: FloatArray) -> list[Finding]:
    """Fewer than three effective degrees of freedom: Student's t has no variance there."""
    few = [name for name, value in zip(what, dof, strict=True) if value < FEW_DOF]
    return [finding("few-degrees-of-freedom", names=few, how=BELOW_THREE)] if few else []
