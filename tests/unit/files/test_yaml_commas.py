"""Decimal commas in lists, which YAML reads as more numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.budget import load_budget
from mtu_cli.files.machine import load_machine
from mtu_cli.files.part import load_part
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml


def odd(items: str) -> list[tuple[int, str]]:
    """Index and text of the odd number of a list, if there is one."""
    source = Source(role="machine", path=Path("m.yaml"), shown="m.yaml", sha256="")
    found = parse_yaml(f"µ: {{a: [{items}]}}\n", source).odd_numbers
    assert set(found) <= {("µ", "a")}
    return [(item.index, item.text) for item in found.values()]


@pytest.mark.parametrize(
    ("items", "index", "text"),
    [
        ("50,0021, 50,0024, 50,0019", 0, "50,0021"),
        ("50,21, 50,24", 0, "50,21"),
        ("50,121, 50,124", 0, "50,121"),
        ("50,0021", 0, "50,0021"),
        ("2, 0,03", 1, "0,03"),
        ("-1, -1,5", 1, "-1,5"),
        ("1.5, 1,5e-3", 1, "1,5e-3"),
        ("50,21,\n 50,24", 0, "50,21"),
        ("1, 007", 1, "007"),
        ("215,0, 214,0, 215,0", 0, "215,0"),
        ("10,0, 20", 0, "10,0"),
    ],
)
def test_a_decimal_comma_is_seen(items: str, index: int, text: str) -> None:
    assert odd(items) == [(index, text)]


@pytest.mark.parametrize(
    "items",
    ["1,2,3", "1, 2, 3", "1 ,2 ,3", "50,21", "0.1,0.2, 0.3", "1,2,3,\n 4,5,6", "1, 2,\n 3, 4",
     "1,\n 2", "a,1, b", "'1','2', '3'", "[1,2], [3,4]", "0, 0.0, -0", "0.03, 10", "[1], 2,3",
     "1, 0,0"],
)  # fmt: skip
def test_lists_without_one(items: str) -> None:
    assert odd(items) == []


def test_every_contract_refuses_it_where_numbers_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    budget = "schema: mtu/budget/1\nname: b\nequation: a + b\ninputs:\n"
    path.write_text(f"{budget}  a: {{readings: [50,0021, 50,0024]}}\n  b: {{value: x}}\n")
    with pytest.raises(InputError) as caught:
        load_budget(path)
    first, other = caught.value.findings
    assert str(first).endswith(
        "f.yaml:5: inputs.a.readings[0]: a comma ends a number of a list: '50,0021'; expected "
        "50.0021 with a decimal point"
    )
    assert other.path == "inputs.b.value"
    machine = "schema: mtu/machine/1\nname: m\ncomponents: {a: {of: x, unit: um, coefficients:\n"
    path.write_text(machine + "  [2, 0,3]}}\nequations: {Ex: a}\n")
    with pytest.raises(
        InputError, match=r"4: components.a.coefficients\[1\]: a comma .*; expected 0\.3 with"
    ):
        load_machine(path)


def test_names_that_are_numbers_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "schema: mtu/part/1\nname: p\n"
        "features: {1: {x_mm: 0, y_mm: 0}, 2: {x_mm: 9, y_mm: 0}, 3: {x_mm: 0, y_mm: 9}}\n"
        "orthogonality: [{id: xy, row: [1,2], column: [1, 3]}, {id: yx, row: [2,1, 3], column: "
        "[1, 3]}]\n"
    )
    assert [list(item.row) for item in load_part(path).part.orthogonality] == [
        ["1", "2"],
        ["2", "1", "3"],
    ]
