"""What a part will be like: `mtu predict-points`, `mtu lengths`, `mtu orthogonality`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from mtu_cli.analyses.lengths import predict_lengths
from mtu_cli.analyses.orthogonality import predict_orthogonality
from mtu_cli.analyses.predict_points import predict_places
from mtu_cli.analyses.predict_points import predict_points as predict_features
from mtu_cli.cli.emit import Outcome
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.modelled import modelled, one_direction
from mtu_cli.findings import error
from mtu_cli.model.features import grid_of, grid_warnings
from mtu_cli.model.settings import Settings


def predict_points(inputs: Inputs, settings: Settings) -> Outcome:
    """Errors of the features of a part, or of a grid over the machine's travels."""
    from mtu_cli.reports import predict_points as report

    found = modelled(inputs)
    model, grid = found.model, inputs.options.grid
    if grid is None:
        result = predict_features(model, inputs.part, settings, inputs.at)
    else:
        ids, places = grid_of(inputs.machine, model, grid)
        beyond = grid_warnings(inputs.machine, model, grid)
        result = predict_places(model, ids, places, settings, inputs.at, beyond)
    covariance = bool(inputs.options.covariance)
    return Outcome.of(
        report.document(result, settings.digits, grid=bool(grid), with_covariance=covariance),
        warnings=[*found.warnings, *result.warnings],
        gates={
            "nonconforming": lambda limit: _nonconforming(
                zip(result.prediction.ids, result.conformance, strict=True),
                "position_um at a feature",
                limit,
            )
        },
    )


def lengths(inputs: Inputs, settings: Settings) -> Outcome:
    """Feature-to-feature lengths."""
    from mtu_cli.reports import lengths as report

    found = modelled(inputs)
    result = predict_lengths(found.model, inputs.part, settings, inputs.at)
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=[
            *found.warnings,
            *inputs.part.warnings,
            *one_direction(inputs, found.model),
            *result.warnings,
        ],
        gates={
            "nonconforming": lambda limit: _nonconforming(
                [
                    *zip(result.ids, result.conformance, strict=True),
                    ("the whole part", result.joint_conformance),
                ],
                "tolerance_um at a length",
                limit,
            )
        },
    )


class _Probable(Protocol):
    @property
    def probability(self) -> float: ...


def _nonconforming(
    known: Iterable[tuple[str, _Probable | None]], key: str, limit: float
) -> str | None:
    """What does not conform with a probability above `limit`; `key` states a tolerance."""
    checked = {name: 1 - each.probability for name, each in known if each is not None}
    if not checked:
        raise error("gate-undefined", gate="nonconforming", expected=f"{key} of the part")
    above = {name: p for name, p in checked.items() if p > limit}
    if not above:
        return None
    shown = ", ".join(f"{name} {100 * p:.{2 if p < 0.995 else 4}g} %" for name, p in above.items())
    return f"probability of a nonconforming part above {100 * limit:g} %: {shown}"


def orthogonality(inputs: Inputs, settings: Settings) -> Outcome:
    """Right angles between rows and columns of features."""
    from mtu_cli.reports import orthogonality as report

    found = modelled(inputs)
    result = predict_orthogonality(found.model, inputs.part, settings, inputs.at)
    return Outcome.of(
        report.document(result, settings.digits),
        warnings=[
            *found.warnings,
            *one_direction(inputs, found.model),
            *result.warnings,
        ],
        gates={
            "nonconforming": lambda limit: _nonconforming(
                ((each.id, each.conformance) for each in result.angles),
                "tolerance_arcsec at an angle",
                limit,
            )
        },
    )
