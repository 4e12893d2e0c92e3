"""YAML 1.2 scalars, lines, and everything that could hang or mislead."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from mtu_cli.close_loop_sealed.files.yaml_dump import flow_text
from mtu_cli.errors import InputError
from mtu_cli.files.shown_values import shown_value
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import MAX_BYTES, YamlDocument, parse_yaml, read_yaml
from mtu_cli.files.yaml_scalars import NotFinite


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
        ("1e-6", 1e-6),
        ("-1E3", -1000.0),
        (".5", 0.5),
        ("2.", 2.0),
        ("012", 12),
        ("0o14", 12),
        ("0xff", 255),
        ("+3", 3),
        ("12:30:00", "12:30:00"),
        ("1_000", "1_000"),
        ("yes", "yes"),
        ("no", "no"),
        ("on", "on"),
        ("Off", "Off"),
        ("y", "y"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("null", None),
        ("2024-05-03", "2024-05-03"),
        ("'1'", "1"),
        ("!!str 1", "1"),
        ("!!float 1", 1.0),
        ("=", "="),
    ],
)
def test_scalars_of_the_core_schema(text: str, value: object) -> None:
    found = load(f"a: {text}").data["a"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "value"),
    [(".inf", math.inf), ("-.INF", -math.inf), (".nan", math.nan), ("-1e400", -math.inf),
     ("!!float 1e400", math.inf)],
)  # fmt: skip
def test_what_is_not_finite_keeps_its_text(text: str, value: float) -> None:
    found = load(f"a: {text}").data["a"]
    assert isinstance(found, NotFinite)
    assert found == value or (math.isnan(found) and math.isnan(value))
    assert shown_value(found) == text.removeprefix("!!float ")
    assert flow_text([found]).startswith("[")
    assert shown_value([1, found, "a"]) == f'[1, {text.removeprefix("!!float ")}, "a"]'


def test_a_very_long_integer_costs_nothing() -> None:
    assert load("a: " + "9" * 100_000).data == {"a": math.inf}


def test_keys_are_text_as_written() -> None:
    assert load("{007: 1, no: 2, 1e3: 3, '9': 4}").data == {"007": 1, "no": 2, "1e3": 3, "9": 4}


def test_lines_of_keys_and_items() -> None:
    document = load("# head\na: 1\nb:\n  - 2\n  - c: >\n      text\n")
    assert document.data == {"a": 1, "b": [2, {"c": "text\n"}]}
    assert dict(document.lines) == {
        (): 2,
        ("a",): 2,
        ("b",): 3,
        ("b", 0): 4,
        ("b", 1): 5,
        ("b", 1, "c"): 5,
    }
    assert document.line_of("b", 1, "missing", "deeper") == 5


def test_an_alias_stands_for_its_anchor() -> None:
    document = load("a: &p {x: 1}\nb: *p\n")
    assert document.data == {"a": {"x": 1}, "b": {"x": 1}}
    assert document.line_of("b") == 2


def test_every_duplicate_key_and_tag_is_reported_with_its_lines() -> None:
    text = message("a: 1\nb: {c: 1, c: 2}\nd: !!python/object:os.system x\na: 3\ne: !own [1]\n")
    assert text.splitlines() == [
        "m.yaml:2: key 'c' appears twice in line 2",
        "m.yaml:3: the tag '!!python/object:os.system' is not accepted here; expected plain values",
        "m.yaml:4: key 'a' appears twice: in lines 1 and 4",
        "m.yaml:5: the tag '!own' is not accepted here; expected plain values",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [*a]", "m.yaml:1: the alias *a stands inside its own anchor"),
        ("a: 1\nb: *x", "m.yaml:2: unknown alias *x"),
        ("[" * 5000, "m.yaml:1: values are nested deeper than 60 levels"),
        ("\n".join(" " * i + "k:" for i in range(99)), "m.yaml:61: values are nested deeper"),
        ("a:\n\t- b", "m.yaml:2: not readable as YAML: found character that cannot start"),
        ("a:\n\t- b", "expected spaces, not tabs"),
        ("a: b: c", "or quotes around a text that holds ': '"),
        ("a: [1\nb: 2", "m.yaml:2: not readable as YAML"),
        ("a: [1\nb: 2", "expected a comma between two entries, or the ']' of the bracket opened"),
        ("e:\n  Ex = 2*a\n  Ey: b", "m.yaml:2: not readable as YAML: no `key: value`: 'Ex = 2*a'"),
        ("e:\n  Ex = 2*a\n  Ey: b", "expected 'Ex: 2*a', with a colon and a blank behind the key"),
        ("e:\n  Ex: a\n  Ey = b", "m.yaml:3: not readable as YAML: no `key: value`: 'Ey = b'"),
        ("a:1\nb: 2", "m.yaml:1: not readable as YAML: no `key: value`: 'a:1'; expected 'a: 1'"),
        (
            "a {b: 1, c: 3}\nd: 2",
            "m.yaml:1: not readable as YAML: no `key: value`: 'a {b: 1, c: 3}'",
        ),
        ("b: 1\nname m\na: 2", "m.yaml:2: not readable as YAML: could not find expected ':'"),
        ("a: 'b\nc: 2\n", "m.yaml:1: not readable as YAML: found unexpected end of stream"),
        ('a: "C:\\data"', "expected single quotes"),
        ("a: 1\nb: \x07", "m.yaml:2: not readable as YAML: unacceptable character"),
        ("a: 1\n---\nb: 1", "m.yaml:2: a second document starts here"),
        ("<<: {a: 1}", "m.yaml:1: merge keys (<<) are not part of YAML 1.2"),
        ("[a]: 1", "m.yaml:1: a list or mapping stands as a key"),
        ("a: !!int x", "m.yaml:1: the tag '!!int' is not accepted here"),
        ("# nothing", "m.yaml: the file holds no values; expected a machine file"),
    ],
)
def test_faults(text: str, words: str) -> None:
    assert words in message(text)


def test_an_alias_bomb_is_refused_before_it_expands() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 30)]
    assert "m.yaml:6: more than 500000 values" in message("\n".join(lines))


def test_a_ladder_of_aliases_counts_as_depth() -> None:
    lines = ["a0: &a0 [x]", *(f"a{i}: &a{i} [*a{i - 1}]" for i in range(1, 3000))]
    assert "nested deeper than 60 levels" in message("\n".join(lines))


def test_size_is_bounded(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="expected at most 10000000 bytes"):
        read_yaml(tmp_path / "m.yaml", "machine")


def test_a_byte_order_mark_is_no_content(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_bytes("\ufeffa: 1\r\nb: 2\r\n".encode())
    document = read_yaml(tmp_path / "m.yaml", "machine")
    assert document.data == {"a": 1, "b": 2}
    assert document.line_of("b") == 2


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("mtu_cli.files.yaml_file", ("numpy", "pandas", "pydantic")),
        ("mtu_cli.files.machine", ("pandas", "numpy")),
        ("mtu_cli.files.part", ("pandas", "numpy")),
        ("mtu_cli.files.study", ("pandas", "numpy")),
        ("mtu_cli.files.json_file", ("pandas", "numpy", "pydantic")),
        ("mtu_cli.files.csv_file", ("pandas",)),
    ],
)
def test_modules_import_no_more_than_they_need(module: str, absent: tuple[str, ...]) -> None:
    code = f"import sys, {module}; print([m for m in {absent!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("text", ["a: {}", "{}: 1", "? {}\n: 1", "a: ['{}']"])
def test_a_text_as_long_as_a_book_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text.format("c" * 120_001), "utf-8")
    with pytest.raises(InputError) as caught:
        read_yaml(path, "machine")
    assert "a.yaml:1: a text of 120001 characters" in str(caught.value)
    path.write_text(text.format("c" * 900), "utf-8")
    read_yaml(path, "machine")


def test_a_kind_of_file_with_its_article() -> None:
    source = Source(role="effects", path=Path("e.yaml"), shown="e.yaml", sha256="")
    with pytest.raises(InputError, match="expected an effects file"):
        parse_yaml("# nothing", source)


@pytest.mark.parametrize("note", [">\n  E = F/A was used", "|\n  k:=3", ">\n  a {b: 1}\n\n  # c"])
def test_a_text_below_its_key_is_no_entry_without_its_colon(note: str) -> None:
    """Nor is what stands below it at fault there."""
    line = note.count("\n") + 2
    assert message(f"notes: {note}\nname: a: b\nc: 1").startswith(
        f"m.yaml:{line}: not readable as YAML: mapping values are not allowed"
    )
    assert f"m.yaml:{line}: not readable as YAML: no `key: value`: 'name = a'" in message(
        f"notes: {note}\nname = a\nc: 1"
    )


def test_blanks_without_end_are_looked_at_once() -> None:
    """Seconds each, if every one of them were looked at again."""
    from time import process_time

    from mtu_cli.files.yaml_entries import as_entry
    from mtu_cli.files.yaml_faults import unreadable

    start = process_time()
    assert as_entry("a = b" + " " * 20_000 + "!") is not None
    assert as_entry("x<=3") is None
    error = yaml.MarkedYAMLError(problem="mapping values are not allowed here")
    unreadable(error, "- " * 20_000 + "x", "m.yaml", 1)
    assert process_time() - start < 1.0
