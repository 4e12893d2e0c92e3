"""Which declarations are those of which command: for `mtu help` and for tests."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

from mtu_cli.reports.fields import Fields, described, described_columns

REPORTS = {
    "fit-components": ("fit_components", "RESULTS", "ROW"),
    "predict-points": ("predict_points", "RESULTS", "ROW"),
    "lengths": ("lengths", "RESULTS", "ROW"),
    "orthogonality": ("orthogonality", "RESULTS", "ROW"),
    "anova": ("anova", "RESULTS", "ROW"),
    "compare": ("compare", "RESULTS", "ROW"),
    "thermal-fit": ("thermal_fit", "RESULTS", "ROW"),
    "correct": ("correct", "RESULTS", "ROW"),
    "budget": ("budget", "RESULTS", "ROW"),
    "graph check": ("graph", "CHECK", "STEP"),
    "graph simulate": ("graph", "SIMULATION", "COORDINATE_ROW"),
    "graph sweep": ("graph", "SWEEP", "GRID_ROW"),
}
"""By command: its module, the fields of `results`, those of a row of --csv. Where they depend on
the input (axes, coefficients, units, what is varied), these are of the usual one."""


def declared(command: str) -> tuple[Fields, Fields]:
    """The fields of `results` and of a row of --csv."""
    name, results, row = REPORTS[command]
    module = import_module(f"mtu_cli.reports.{name}")
    return getattr(module, results), getattr(module, row)


def help_text(command: str) -> str:
    """Markdown: what each key of the report and each column of --csv means; of all commands that
    begin with this name.
    """
    known = [name for name in REPORTS if name == command or name.startswith(f"{command} ")]
    return "".join(f"{line}\n" for name in known for line in _lines(name))


def _lines(command: str) -> Iterator[str]:
    results, row = declared(command)
    yield from ("", f"## Report of {command}: `results` of --out", "")
    yield from _listed("key", described(results))
    yield from ("", f"## Columns of --csv of {command}", "")
    yield from _listed("column", described_columns(row))


def _listed(title: str, entries: Iterator[tuple[str, str]]) -> Iterator[str]:
    yield from (f"| {title} | meaning |", "|---|---|")
    for name, meaning in entries:
        yield f"| `{name}` | {meaning.replace('|', chr(92) + '|')} |"
