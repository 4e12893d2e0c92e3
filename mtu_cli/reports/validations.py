"""JCGM 101:2008, clause 8, in reports: fields and warnings shared by all predictions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mtu_cli.findings import Finding, finding
from mtu_cli.reports.document import finite
from mtu_cli.reports.numbers import significant
from mtu_cli.stats.validation import Validation


def validation_fields(found: Validation, unit: str, factor: float) -> dict[str, Any]:
    """`passed` and the differences in `unit`, `factor` internal units each.

    `passed` null: the Monte Carlo had not converged far enough to tell.
    """
    return {
        "passed": found.passed,
        f"d_low_{unit}": finite(found.d_low / factor),
        f"d_high_{unit}": finite(found.d_high / factor),
        f"tolerance_{unit}": finite(found.tolerance / factor),
    }


def validation_warnings(
    names: Sequence[str], found: Sequence[Validation], unit: str, factor: float
) -> list[Finding]:
    """Which first-order intervals the Monte Carlo rejects, and which it could not judge."""
    failed = [i for i, item in enumerate(found) if item.passed is False]
    unknown = [i for i, item in enumerate(found) if item.passed is None]
    warnings = []
    if failed:
        largest = max(max(found[i].d_low, found[i].d_high) for i in failed) / factor
        # A ratio has no unit.
        shown = f"up to {significant(largest)} {unit}".rstrip()
        warnings.append(
            finding("validation-failed", names=[names[i] for i in failed], difference=shown)
        )
    if unknown:
        warnings.append(finding("validation-undecided", names=[names[i] for i in unknown]))
    return warnings


def convergence_warnings(trials: int, converged: bool) -> list[Finding]:
    """A Monte Carlo that ended, as asked or at its largest count, before its goal."""
    if converged:
        return []
    goal = "a fifth of the numerical tolerance (JCGM 101, 7.9.4 and 8.2)"
    return [finding("not-converged", trials=trials, goal=goal)]
