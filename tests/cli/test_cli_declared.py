"""Every field of a report and every column of a CSV stands in one declaration, which help shows."""

from __future__ import annotations

import csv
from typing import Any

import pytest
from cli_runner import done, mtu, shared

from mtu_cli.reports.document import REPORTS, column_meanings, declaration, meanings
from mtu_cli.reports.fields import Fields, Group, fields_of

GAUGE, IMPEDANCE = ("gum-h1-end-gauge.yaml", "gum-h2-impedance.yaml")
CALLS = {
    "fit-components": ["gilsinn-ling-simulated", "undeclared", "valdes-ring"],
    "predict-points": ["gilsinn-ling", "undeclared --covariance"],
    "lengths": ["gilsinn-ling", "undeclared"],
    "orthogonality": ["gilsinn-ling --trials 20000"],
    "anova": ["gilsinn-ling-parts", "undeclared"],
    "compare": ["gilsinn-ling-parts", "undeclared"],
    "close-loop": ["undeclared"],
    "thermal-fit": ["valdes-ring --model ridge"],
    "correct": ["valdes-ring -c RIDGE"],
    "budget": [f"budgets/{GAUGE} --trials 20000", f"budgets/{IMPEDANCE} --trials 20000"],
    "iso230": ["undeclared", "undeclared --limit dx_x.A=20"],
    "circular": ["../tests/cli/circular-traces.csv"],
    "compensate": ["valdes-ring --component pos_x --for beckhoff"],
    "graph check": ["graphs/axes-a-and-c.yaml"],
    "graph simulate": ["graphs/rotary-axis-a.yaml --trials 1000"],
    "graph sweep": ["graphs/ball-centre.yaml --of P1.z --vary axis_um=1,2,3 --trials 1000"],
}
LEAF = "a figure"


def tree(fields: Fields) -> dict[str, Any]:
    """The keys of a declaration, with how many lists or objects by name stand between; one that is
    declared twice is a fault.
    """
    found: dict[str, Any] = {}
    for each in fields:
        *outer, last = each.path.split(".")
        inner = found
        for key in outer:
            inner = inner.setdefault(key, {})
        if last:
            assert last not in inner, f"{each.path} is declared twice"
            inner[last] = (
                (int(each.many), tree(fields_of(each.fields))) if isinstance(each, Group) else LEAF
            )
    return found


def undeclared(known: Any, value: Any, at: str = "") -> set[str]:
    """Keys of a document that no declaration has."""
    if known is LEAF or value is None:
        return set()
    depth, inner = known if isinstance(known, tuple) else (0, known)
    if depth:
        items = value.values() if isinstance(value, dict) else value
        return {x for item in items for x in undeclared((depth - 1, inner), item, f"{at}[]")}
    # Of an angle the names of a length stand for its own.
    value = {x if x in inner else x.replace("_arcsec", "_um"): item for x, item in value.items()}
    strays = {f"{at}.{name}" for name in value if name not in inner}
    kept = ((name, item) for name, item in value.items() if name in inner)
    return strays | {
        x for name, item in kept for x in undeclared(inner[name], item, f"{at}.{name}")
    }


@pytest.mark.parametrize("command", REPORTS)
def test_every_field_and_column_is_declared_once(command: str) -> None:
    results, row = declaration(command)
    known = tree(results)
    if command == "budget":
        # Of one output its figures stand where `outputs` does for several.
        known |= known["outputs"][1]
    for call in CALLS[command]:
        made = shared(f"{command} configs/{call}")
        assert undeclared(known, made.report["results"]) == set()
        header = next(csv.reader([made.table.partition("\n")[0]]))
        free = ("share_", "coefficient_", "u_coefficient_")
        columns = {name for name, _ in column_meanings(row)}
        assert {x for x in header if not x.startswith(free)} <= columns


@pytest.mark.parametrize("command", sorted({name.partition(" ")[0] for name in REPORTS}))
def test_help_explains_every_field_and_column(command: str) -> None:
    shown = done(mtu("help", command)).stdout
    for name in (each for each in REPORTS if each.partition(" ")[0] == command):
        results, row = declaration(name)
        for key, meaning in [*meanings(results), *column_meanings(row)]:
            assert f"| `{key}` | {meaning.replace('|', chr(92) + '|')} |" in shown
