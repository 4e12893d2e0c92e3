"""Faults of contracts: all at once, with line, path, value and expectation, by their codes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import BeforeValidator, Field

from mtu_cli.files.contract import Contract, Faults, IdText, Name, Number, check_contract, wrong
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml
from mtu_cli.findings import Finding, InputError


def _even(value: object) -> object:
    if value == 3:
        raise wrong("an even number", "name-taken", taken="odd")
    return value


class Entry(Contract):
    from_: IdText = Field(alias="from")
    size_mm: Annotated[Number, Field(gt=0)] = 1.0


class Thing(Contract):
    schema_: Literal["mtu/thing/1"] = Field(alias="schema")
    name: str
    kind: Literal["round", "square"] | None = None
    count: Annotated[int, BeforeValidator(_even)] = 0
    covariance: list[list[Number]] | None = None
    dof: float = 1.0
    entries: list[Entry] = Field(default=[])
    by_name: dict[Name, Entry] = Field(default={})


SOURCE = Source(role="thing", path=Path("t.yaml"), shown="t.yaml", sha256="")
SOUND = "schema: mtu/thing/1\nname: n\n"


def faults(text: str) -> tuple[Finding, ...]:
    with pytest.raises(InputError) as caught:
        check_contract(parse_yaml(text, SOURCE), Thing, "thing")
    return caught.value.findings


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("nmae: 1", "unknown-name", "t.yaml:3: nmae: unknown key: 'nmae'; did you mean 'name'?"),
        ("kind: rond", "unknown-name", "kind: unknown value: 'rond'; did you mean 'round'?"),
        ("count: 1.5", "wrong-value", "count: wrong value: '1.5'; expected a whole number"),
        ("count: 3", "name-taken", "it is odd: '3'; expected an even number"),
        ("entries: {from: a}", "wrong-value", "expected a list"),
        ("entries: [{}]", "missing-key", "entries[0]: the key 'from' is missing"),
        ("entries: [{from: a, form: a}]", "unknown-name", "'form'; did you mean 'from'?"),
        ("entries: [{from: 1, size_mm: 0}]", "wrong-value", "expected a number above 0"),
        ("entries: [{from: 1, size_mm: '5'}]", "wrong-value", "without quotes or unit"),
        ("by_name: {a: {from: 2.5}}", "wrong-value", "by_name.a.from: wrong value: '2.5'"),
        ("by_name: {\"a\\nb\": {from: 2}}", "wrong-type", "not a name: 'a\\nb'; expected a"),
        ("dof: .inf", "wrong-value", "dof: wrong value: 'Infinity'; expected a finite number"),
        ("covariance: [[1e31]]", "out-of-range", "covariance[0][0]: out of range: '1e+31'"),
    ],
)  # fmt: skip
def test_every_kind_of_fault(line: str, code: str, words: str) -> None:
    (found,) = faults(SOUND + line)
    assert found.code == code
    assert words in found.message
    assert found.line == 3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1]", "t.yaml:1: not a thing file"),
        ("name: n", "the key 'schema' is missing"),
        ("schema: mtu/part/1", "not a thing file: 'mtu/part/1'"),
        ("schema: mtu/thing/2", "'mtu/thing/2'; expected mtu/thing/1"),
    ],
)
def test_files_of_another_kind(text: str, words: str) -> None:
    (found,) = faults(text)
    assert words in found.message


def test_a_check_sees_the_sound_rest_of_a_faulty_file() -> None:
    text = (
        "schema: mtu/thing/1\nname: 5\ncount: 2\nextra: 1\n"
        "entries: [{from: a}, {from: b, size_mm: -1}, {from: c, size_mm: 1e31}]\n"
        "by_name: {x: {from: a}, y: 3}\n"
    )
    seen: list[Thing] = []

    def check(thing: Thing, own: Faults) -> None:
        seen.append(thing)
        own.unknown(("by_name", "x"), "x", own.keys("by_name"), "entry")
        own.add(("entries", 0, "from"), "appears-twice", value="a", what="the entry")

    with pytest.raises(InputError) as caught:
        check_contract(parse_yaml(text, SOURCE), Thing, "thing", check)
    thing = seen[0]
    assert thing.name is None
    assert thing.count == 2
    assert [item and item.from_ for item in thing.entries] == ["a", None, None]
    assert list(thing.by_name) == ["x"]
    found = [(item.line, item.path, item.code) for item in caught.value.findings]
    assert found == sorted(found, key=lambda item: item[0] or 0)
    assert {path for _, path, _ in found} == {
        "name", "extra", "entries[1].size_mm", "entries[2].size_mm", "by_name.y", "by_name.x",
        "entries[0].from",
    }  # fmt: skip
