"""What tables and reports say of features beyond the measured range of a component."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from mtu_cli.model.prediction import Prediction


def components_beyond(prediction: Prediction) -> dict[str, list[str]]:
    """The components beyond their measured range, by feature."""
    found: dict[str, list[str]] = {}
    for point, component, *_ in prediction.outside:
        found.setdefault(point, []).append(component)
    return found


def marked(name: str, features: Iterable[str], beyond: Collection[str]) -> str:
    """The name of a row, with a mark where any feature behind it is among those `beyond`."""
    return f"{name}†" if any(feature in beyond for feature in features) else name


def mark_notes(*predictions: Prediction) -> list[str]:
    """What the mark means, for below a table that has it."""
    if not any(prediction.outside for prediction in predictions):
        return []
    return ["† outside the measured range of a component"]
