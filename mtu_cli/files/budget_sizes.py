"""Numbers of a budget file whose squares a computer cannot hold: variances are squares."""

from __future__ import annotations

from mtu_cli.files.budget_contract import Budget, Contribution
from mtu_cli.files.contracts import Findings, present
from mtu_cli.files.yaml_file import YamlPath

LARGEST = 1e150
SMALLEST = 1e-150
WIDTHS = ("u", "half_width", "U", "top", "inexact")
LOCATIONS = ("value", "low", "high")
EXPECTED = f"{SMALLEST:g} to {LARGEST:g}, in another unit"


def check_sizes(budget: Budget, findings: Findings) -> None:
    """Every number of every input: none too large, no width but 0 too small."""
    for name, item in (budget.inputs or {}).items():
        path: YamlPath = ("inputs", name)
        _contribution(item, path, findings)
        for index, part in present(item.contributions):
            _contribution(part, (*path, "contributions", index), findings)
        readings = present(item.readings)
        for index, reading in readings:
            _large(reading, (*path, "readings", index), findings)
        values = [reading for _, reading in readings]
        if values:
            _small(max(values) - min(values), (*path, "readings"), findings, "their range")


def _contribution(item: Contribution, path: YamlPath, findings: Findings) -> None:
    for key in (*LOCATIONS, *WIDTHS):
        value = getattr(item, key, None)
        if value is not None:
            _large(value, (*path, key), findings)
            if key in WIDTHS:
                _small(value, (*path, key), findings)
    if item.low is not None and item.high is not None:
        _small(item.high - item.low, (*path, "low"), findings, "`high` - `low`")
    if item.U is not None and item.k is not None and SMALLEST <= item.U <= LARGEST:
        _large(item.U / item.k, (*path, "k"), findings, "U/k")
        _small(item.U / item.k, (*path, "k"), findings, "U/k")


def _large(value: float, path: YamlPath, findings: Findings, named: str = "the number") -> None:
    if abs(value) > LARGEST:
        what = f"{named} is too large to calculate with"
        findings.add(path, what, value=value, expected=EXPECTED)


def _small(value: float, path: YamlPath, findings: Findings, named: str = "the number") -> None:
    if 0.0 < value < SMALLEST:
        what = f"{named} is too small to calculate with: its square is lost"
        findings.add(path, what, value=value, expected=EXPECTED)
