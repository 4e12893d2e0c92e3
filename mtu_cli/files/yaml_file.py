"""The one YAML reader: plain data, and the line of every value.

Scalars are those of the YAML 1.2 core schema: ``1e-6`` is a number, ``no`` and ``12:30`` are
texts. Every key of a mapping is text as it is written, so that a feature may be called ``007`` or
``no``. What nobody can read in one way alone (a key that appears twice, a merge key, a decimal
comma in a list) is an error, and so is what would grow without bounds.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from mtu_cli.files.source import Source, a_file, check_text, read_source
from mtu_cli.findings import Finding, InputError, error, finding

MAX_BYTES = 10_000_000
MAX_NODES = 500_000
"""Values of a document, aliases expanded."""
MAX_DEPTH = 60
MAX_DIGITS = 300
"""Longer integers are read as floats: no quantity needs them, and they take quadratic time."""

Scalar = str | int | float | bool | None
YamlPath = tuple[str | int, ...]

_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ufffe\uffff]")
_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_WORDS = {"": None, "~": None} | {
    form: value
    for word, value in (("null", None), ("true", True), ("false", False))
    for form in (word, word.capitalize(), word.upper())
}
_TIGHT, _SPACED = re.compile(r"[0-9],[0-9]"), re.compile(r"[0-9],[ \t]+[-+.0-9]")
_IDLE_ZERO = re.compile(r"(?<![\w.+-])[-+]?0[0-9]")
_CORE, _PLAIN, _TEXT = "tag:yaml.org,2002:", "plain", "text"

EXPECTED = {
    "mapping values are not allowed": "one `key: value` a line, or quotes around a text with ': '",
    "could not find expected ':'": "`key: value`, or a text indented below its key",
    "did not find expected key": "one `key: value` a line, all of a mapping in the same column",
    "did not find expected '-'": "a dash before every entry of a list",
    "did not find expected ',' or ']'": "a comma between two entries, or the ']'",
    "did not find expected ',' or '}'": "a comma between two entries, or the '}'",
    "block sequence entries are not allowed": "the list on lines of its own below its key",
    "found unknown escape": r"single quotes: within double ones a \ has another meaning",
    "found unexpected end of stream": "a quotation mark at the end of the text, as at its start",
}
"""What is expected, by how the parser's words begin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class YamlDocument:
    """Plain data of a YAML file, and the line, counted from 1, of each value by its path.

    The line of a mapping's entry is that of its key. `odd_numbers`, by the path of their list,
    are errors unless the list holds texts, which the contract knows. `content` are the bytes of
    the file, none where the text came from elsewhere.
    """

    source: Source
    data: Any
    lines: Mapping[YamlPath, int]
    odd_numbers: Mapping[YamlPath, Finding] = field(default_factory=dict)
    content: bytes = b""

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value, or of the nearest value around it that the file holds."""
        around = (path[:length] for length in range(len(path), -1, -1))
        return next((self.lines[place] for place in around if place in self.lines), None)

    def at(self, *path: str | int) -> Any:
        """The value at a path; None where there is none."""
        data = self.data
        for step in path:
            try:
                data = data[step]
            except (KeyError, IndexError, TypeError):
                return None
        return data


def path_text(path: YamlPath) -> str:
    """A path as text.

    >>> path_text(("lengths", 0, "from"))
    'lengths[0].from'
    """
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return "".join(steps).removeprefix(".")


def shown_value(value: object) -> str:
    """A value as it would be written in a YAML file."""
    if isinstance(value, str):
        return value
    text = json.dumps(value, ensure_ascii=False, default=str)
    return re.sub(r"(?<![\w\"])(-?)(Infinity|NaN)\b", _not_finite_text, text)


def _not_finite_text(found: re.Match[str]) -> str:
    return f"{found[1]}.{'inf' if found[2] == 'Infinity' else 'nan'}"


def plain_scalar(text: str) -> Scalar:
    """The value of a scalar without quotes (YAML 1.2.2, 10.3.2).

    >>> [plain_scalar(text) for text in ("1e-6", "0x1F", "no", "null", "-.inf")]
    [1e-06, 31, 'no', None, -inf]
    """
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        based = text[:2] in ("0o", "0x")
        if len(text) > MAX_DIGITS:
            return math.inf if based else float(text)
        return int(text, 0) if based else int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    return float(text.replace(".", "")) if _NOT_FINITE.fullmatch(text) else text


def read_yaml(path: Path, role: str) -> YamlDocument:
    """A YAML file as plain data with lines.

    Raises InputError for everything that stops it: see `read_source`, `parse_yaml`.
    """
    source, content = read_source(path, role, max_bytes=MAX_BYTES)
    check_text(content, source.shown)
    return replace(parse_yaml(content.decode("utf-8-sig"), source), content=content)


def parse_yaml(text: str, source: Source) -> YamlDocument:
    """YAML text as plain data with lines.

    Raises InputError, with the line, for text that is no YAML, tags beyond the core schema, keys
    that appear twice, merge keys, an alias inside its own anchor, more than one document, more
    than 60 levels, or more than 500 000 values once aliases are expanded.
    """
    root = composed(text, source)
    builder = _Builder(text, source.shown)
    data = builder.value(root, (), root.start_mark.line + 1)
    if builder.findings:
        raise InputError(builder.findings)
    return YamlDocument(source=source, data=data, lines=builder.lines, odd_numbers=builder.odd)


def composed(text: str, source: Source) -> yaml.Node:
    """The nodes of a YAML text, whose marks count its characters."""
    try:
        root = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as fault:
        raise _not_yaml(fault, text, source.shown) from None
    except (yaml.YAMLError, RecursionError) as fault:
        control = _CONTROL.search(text)
        line = None if control is None else text.count("\n", 0, control.start()) + 1
        why = (str(fault).splitlines() or ["unknown fault"])[0]
        raise error("not-yaml", reason=why, file=source.shown, line=line) from None
    if root is None:
        expected = a_file(source.role)
        raise error("no-values", file=source.shown, expected=expected)
    return root


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Leaves the meaning of plain scalars to `plain_scalar`."""

    def resolve(self, kind: Any, value: str, implicit: Any) -> str:
        if kind is yaml.ScalarNode:
            return _PLAIN if implicit[0] else _TEXT
        return _CORE + ("map" if kind is yaml.MappingNode else "seq")


def _not_yaml(fault: yaml.MarkedYAMLError, text: str, shown: str) -> InputError:
    mark = fault.problem_mark or fault.context_mark
    problem = fault.problem or "unknown fault"
    # A text whose end is missing is at fault where it begins.
    if problem.startswith(("found unexpected end", "could not find")) and fault.context_mark:
        mark = fault.context_mark
    line = None if mark is None else mark.line + 1
    if "nesting depth" in str(fault):
        return error("too-deep", most=MAX_DEPTH, file=shown, line=line)
    lines = text.splitlines()
    faulty = lines[line - 1] if line is not None and line <= len(lines) else ""
    expected = next((own for start, own in EXPECTED.items() if problem.startswith(start)), None)
    if "\t" in faulty[: len(faulty) - len(faulty.lstrip())]:
        expected = "spaces, not tabs, for indentation"
    why = f"{problem} ({fault.context})" if fault.context else problem
    if "another document" in problem:
        why, expected = "a second document starts here", "one document in a file"
    return error("not-yaml", reason=why, file=shown, line=line, expected=expected)


class _Builder:
    """Values and lines of a tree of nodes; collects what the whole file has of faults."""

    def __init__(self, text: str, shown: str) -> None:
        self.text = text
        self.shown = shown
        self.lines: dict[YamlPath, int] = {}
        self.odd: dict[YamlPath, Finding] = {}
        self.findings: list[Finding] = []
        self.open: set[int] = set()
        self.nodes = 0

    def value(self, node: yaml.Node, path: YamlPath, line: int) -> Any:
        """The value of a node whose place is `line`."""
        self.nodes += 1
        if self.nodes > MAX_NODES:
            # Aliases stand for lines far above: the entry that holds them is at fault.
            at = self.lines.get(path[:1], line)
            raise error("too-many-values", most=MAX_NODES, file=self.shown, line=at)
        if len(path) > MAX_DEPTH:
            raise error("too-deep", most=MAX_DEPTH, file=self.shown, line=line)
        if id(node) in self.open:
            raise error("alias-in-itself", file=self.shown, line=line)
        self.lines[path] = line
        if isinstance(node, yaml.ScalarNode):
            return self.scalar(node, line)
        found: Any = None
        own = "map" if isinstance(node, yaml.MappingNode) else "seq"
        if node.tag != _CORE + own:
            self.add("yaml-tag", line, tag=node.tag.replace(_CORE, "!!"))
        self.open.add(id(node))
        if isinstance(node, yaml.MappingNode):
            found = {
                key: self.value(item, (*path, key), at) for key, item, at in self.entries(node)
            }
        elif isinstance(node, yaml.SequenceNode):
            found = [
                self.value(item, (*path, i), item.start_mark.line + 1)
                for i, item in enumerate(node.value)
            ]
            self.commas(node, found, path, line)
        self.open.discard(id(node))
        return found

    def entries(self, node: yaml.MappingNode) -> Iterator[tuple[str, yaml.Node, int]]:
        first: dict[str, int] = {}
        for key, item in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise error("odd-key", file=self.shown, line=line, expected="a plain key")
            self.scalar(key, line)
            name = str(key.value)
            if name == "<<":
                raise error("merge-key", file=self.shown, line=line, expected="the keys in full")
            if name in first:
                self.add("duplicate-key", line, key=name, lines=sorted({first[name], line}))
            first.setdefault(name, line)
            yield name, item, line

    def scalar(self, node: yaml.ScalarNode, line: int) -> Scalar:
        if node.tag in (_TEXT, _CORE + "str"):
            return str(node.value)
        value = plain_scalar(node.value)
        kind = node.tag.removeprefix(_CORE)
        types = {"null": type(None), "bool": bool, "int": int, "float": float}
        if kind == "float" and type(value) is int:
            return float(value)
        if node.tag != _PLAIN and type(value) is not types.get(kind):
            self.add("yaml-tag", line, tag=node.tag.replace(_CORE, "!!"))
        return value

    def commas(self, node: yaml.SequenceNode, items: list[Any], path: YamlPath, line: int) -> None:
        """Decimal commas in a list of numbers: ``[50,0021, 50,0024]`` would be four of them.

        Where some commas have a blank behind them, those between digits are decimal ones; and no
        number of its own begins with an idle zero.
        """
        if (
            not node.flow_style
            or not items
            or not all(type(item) in (int, float) for item in items)
        ):
            return
        text = self.text[node.start_mark.index : node.end_mark.index]
        if (_TIGHT.search(text) and _SPACED.search(text)) or _IDLE_ZERO.search(text):
            self.odd[path] = finding(
                "decimal-comma", file=self.shown, line=line, path=path_text(path), value=text,
                expected="decimal points, and a blank behind each comma between two numbers",
            )  # fmt: skip

    def add(self, code: str, line: int, **facts: Any) -> None:
        self.findings.append(finding(code, file=self.shown, line=line, **facts))
