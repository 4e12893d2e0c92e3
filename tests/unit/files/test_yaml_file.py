"""YAML 1.2 scalars, lines, and everything that could hang or mislead."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import MAX_BYTES, YamlDocument, parse_yaml, read_yaml, shown_value
from mtu_cli.findings import InputError

BOMB = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 30)]
LADDER = [f"a{i}: &a{i} [*a{i - 1}]" for i in range(1, 3000)]


def load(text: str) -> YamlDocument:
    source = Source(role="machine", path=Path("m.yaml"), shown="m.yaml", sha256="")
    return parse_yaml(text, source)


def message(text: str) -> str:
    with pytest.raises(InputError) as caught:
        load(text)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6), ("-1E3", -1000.0), (".5", 0.5), ("2.", 2.0), ("012", "012"),
        ("0xff", "0xff"), ("+3", 3), ("12:30:00", "12:30:00"), ("1_000", "1_000"), ("yes", "yes"),
        ("no", "no"), ("Off", "Off"), ("y", "y"), ("true", True), ("False", False), ("~", None),
        ("", None), ("null", None), ("2024-05-03", "2024-05-03"), ("'1'", "1"),
        ("=", "="), ("-.INF", -math.inf), ("1e400", math.inf),
        ("9" * 100_000, math.inf),
    ],
)  # fmt: skip
def test_scalars_of_the_core_schema(text: str, value: object) -> None:
    found = load(f"a: {text}").data["a"]
    assert found == value
    assert type(found) is type(value)


def test_values_are_shown_as_they_are_written() -> None:
    assert math.isnan(load("a: .nan").data["a"])
    assert shown_value([1, {"a": None}, "µ"]) == '[1, {"a": null}, "µ"]'
    assert shown_value("µ") == "µ"


def test_keys_are_text_as_written() -> None:
    assert load("{007: 1, no: 2, 1e3: 3, '9': 4}").data == {"007": 1, "no": 2, "1e3": 3, "9": 4}


def test_lines_of_keys_and_items() -> None:
    document = load("# head\na: 1\nb:\n  - 2\n  - c: >\n      text\nd: &p {x: 1}\ne: *p\n")
    assert document.data == {"a": 1, "b": [2, {"c": "text\n"}], "d": {"x": 1}, "e": {"x": 1}}
    found = [document.line_of(*path) for path in ((), ("a",), ("b",), ("b", 0), ("b", 1, "c"))]
    assert found == [2, 2, 3, 4, 5]
    assert document.line_of("b", 1, "missing", "deeper") == 5
    assert document.line_of("e") == 8
    assert document.at("b", 1, "c") == "text\n"
    assert document.at("b", "c") is None


def test_every_duplicate_key_and_tag_is_reported_with_its_lines() -> None:
    text = message("a: 1\nb: {c: 1, c: 2}\nd: !!python/object:os.system x\na: 3\ne: !own [1]\n")
    assert text.splitlines() == [
        "m.yaml:2: the key 'c' appears twice; expected it once: it is in line 2 too",
        "m.yaml:3: the tag '!!python/object:os.system' is not accepted",
        "m.yaml:4: the key 'a' appears twice; expected it once: it is in line 1 too",
        "m.yaml:5: the tag '!own' is not accepted",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [*a]", "m.yaml:1: an alias inside its own anchor is not accepted"),
        ("a: 1\nb: 'c\nd: 2\n", "m.yaml:2: cannot be read: no YAML: found unexpected end"),
        ("a: 1\nb: *x", "m.yaml:2: cannot be read: no YAML: found undefined alias"),
        ("\n".join(" " * i + "k:" for i in range(99)), "m.yaml:61: more than 60 levels"),
        ("a:\n\t- b", "m.yaml:2: cannot be read: no YAML: found character that cannot start"),
        ("a: 1\nb: \x07", "m.yaml:2: cannot be read: no YAML: unacceptable character"),
        ("<<: {a: 1}", "m.yaml:1: a merge key (<<) is not accepted"),
        ("[a]: 1", "m.yaml:1: a list, mapping or tag as a key is not"),
        ("# nothing", "m.yaml: holds no values; expected a machine file"),
        ("\n".join(["a0: &a0 [x, x]", *BOMB]), "more than 500000 values"),
        ("\n".join(["a0: &a0 [x]", *LADDER]), "more than 60 levels"),
    ],
)
def test_faults(text: str, words: str) -> None:
    assert words in message(text)


@pytest.mark.parametrize(
    ("items", "odd"),
    [
        ("50,21, 50,24", True), ("50,21, 1", True), ("1,2,3", False),
        ("1,2,\n    3,4", False), ("1.05, 0.2, 0", False), ("1, 2, 10", False),
        ("-0.1,0.25", False),
    ],
)  # fmt: skip
def test_decimal_commas_in_a_list(items: str, odd: bool) -> None:
    text = f"µ: {{a: [{items}]}}\n"
    if odd:
        assert "µ.a: a comma within a number is not accepted" in message(text)
    else:
        assert load(text)


def test_bytes_are_bounded_and_begin_with_a_mark_or_not(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="expected at most 10000000 bytes"):
        read_yaml(tmp_path / "m.yaml", "machine")
    (tmp_path / "m.yaml").write_bytes("\ufeffa: 1\r\nb: 2\r\n".encode())
    document = read_yaml(tmp_path / "m.yaml", "machine")
    assert document.data == {"a": 1, "b": 2}
    assert document.line_of("b") == 2
