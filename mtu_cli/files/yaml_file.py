"""The one YAML reader: plain data, and the line of every value.

Every key of a mapping is text as it is written, so that a feature may be called ``007`` or ``no``.
What nobody can read in one way alone (a key that appears twice, a tag, a merge key, a decimal comma
in a list) is an error, and so is what would grow without bounds.
"""

from __future__ import annotations

import itertools
import json
import math
import re
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

_WHOLE = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_BROKEN = re.compile(r"[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_WORDS: dict[str, Scalar] = {
    "": None, "~": None, "null": None, "true": True, "false": False,
    ".inf": math.inf, "+.inf": math.inf, "-.inf": -math.inf, ".nan": math.nan,
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class YamlDocument:
    """Plain data of a YAML file, and the line, counted from 1, of each value by its path.

    The line of a mapping's entry is that of its key. `content` are the bytes of the file, none
    where the text came from elsewhere.
    """

    source: Source
    data: Any
    lines: dict[YamlPath, int] = field(default_factory=dict)
    content: bytes = b""

    def reached(self, path: YamlPath) -> tuple[YamlPath, Any]:
        """As much of a path as the file holds, and the value there."""
        data = self.data
        for length, step in enumerate(path):
            steps = data if isinstance(data, dict) else ()
            if step not in (range(len(data)) if isinstance(data, list) else steps):
                return path[:length], data
            data = data[step]
        return path, data

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value, or of the nearest value around it that the file holds."""
        return self.lines.get(self.reached(path)[0])

    def place(self, path: YamlPath) -> dict[str, Any]:
        """File, line and path of a value, for findings."""
        line = self.line_of(*path)
        return {"file": self.source.shown, "line": line, "path": path_text(path) or None}

    def at(self, *path: str | int) -> Any:
        """The value at a path; None where there is none."""
        prefix, value = self.reached(path)
        return value if prefix == path else None


def path_text(path: YamlPath) -> str:
    """A path as text.

    >>> path_text(("lengths", 0, "from"))
    'lengths[0].from'
    """
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return "".join(steps).removeprefix(".")


def shown_value(value: object) -> str:
    """A value on one line: a text as it is, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)


def plain_scalar(text: str) -> Scalar:
    """The value of a scalar without quotes: numbers are those of JSON, 1. and .5; 007 is a text.

    >>> [plain_scalar(text) for text in ("1e-6", "007", "no", "null", "-.inf")]
    [1e-06, '007', 'no', None, -inf]
    """
    if (word := text.lower()) in _WORDS:
        return _WORDS[word]
    if len(text) <= MAX_DIGITS and _WHOLE.fullmatch(text):
        return int(text)
    return float(text) if _BROKEN.fullmatch(text) else text


def read_yaml(path: Path, role: str) -> YamlDocument:
    """A YAML file as plain data with lines.

    Raises InputError for everything that stops it: see `read_source`, `parse_yaml`.
    """
    source, content = read_source(path, role, max_bytes=MAX_BYTES)
    check_text(content, source.shown)
    return replace(parse_yaml(content.decode("utf-8-sig"), source), content=content)


def parse_yaml(text: str, source: Source) -> YamlDocument:
    """YAML text as plain data with lines.

    Raises InputError, with the line, for text that is no YAML, tags, keys that appear twice, merge
    keys, decimal commas in a list, more than one document, or too many levels or values.
    """
    file, root = source.shown, composed(text, source)
    lines, faults = dict[YamlPath, int](), list[Finding]()

    def fault(code: str, at: int, **facts: Any) -> None:
        faults.append(finding(code, file=file, line=at, **facts))

    def value(node: yaml.Node, path: YamlPath, line: int, ancestors: frozenset[int]) -> Any:
        """The value of a node whose `ancestors` are the nodes that contain it."""
        if len(lines) > MAX_NODES:
            # Aliases stand for lines far above: the entry that holds them is at fault.
            at = lines.get(path[:1], line)
            raise error("too-large", most=MAX_NODES, what="values", file=file, line=at)
        if len(path) > MAX_DEPTH:
            raise error("too-large", most=MAX_DEPTH, what="levels", file=file, line=line)
        if node.tag:
            tag = node.tag.replace("tag:yaml.org,2002:", "!!")
            fault("yaml-feature", line, what=f"the tag {tag!r}")
        if id(node) in ancestors:
            fault("yaml-feature", line, what="an alias inside its own anchor")
            return None
        lines[path] = line
        if isinstance(node, yaml.ScalarNode):
            return node.value if node.style else plain_scalar(node.value)
        ancestors, first = ancestors | {id(node)}, dict[str, int]()
        if isinstance(node, yaml.SequenceNode):
            items = [
                value(item, (*path, i), item.start_mark.line + 1, ancestors)
                for i, item in enumerate(node.value)
            ]
            # [50,21, 50,24] is four numbers to YAML and two to some of its users: a list of
            # numbers has blanks behind all of its commas, or behind none.
            marks = [(a.end_mark, b.start_mark) for a, b in itertools.pairwise(node.value)]
            gaps = {b.index - a.index > 1 for a, b in marks if a.line == b.line}
            if node.flow_style and len(gaps) > 1 and all(type(x) in (int, float) for x in items):
                expected = "decimal points, and a blank behind each comma between two numbers"
                place = {"path": path_text(path), "expected": expected}
                fault("yaml-feature", line, what="a comma within a number", **place)
            return items
        result = {}
        for key, item in node.value:
            at, name = key.start_mark.line + 1, str(key.value)
            if not isinstance(key, yaml.ScalarNode) or key.tag or (name == "<<" and not key.style):
                what = "a merge key (<<)" if name == "<<" else "a list, mapping or tag as a key"
                fault("yaml-feature", at, what=what, expected="plain keys")
                continue
            if first.setdefault(name, at) != at or name in result:
                where, expected = f"the key {name!r}", f"it once: it is in line {first[name]} too"
                fault("appears-twice", at, what=where, expected=expected)
            result[name] = value(item, (*path, name), at, ancestors)
        return result

    data = value(root, (), root.start_mark.line + 1, frozenset())
    if faults:
        raise InputError(faults)
    return YamlDocument(source=source, data=data, lines=lines)


def composed(text: str, source: Source) -> yaml.Node:
    """The nodes of a YAML text, whose marks count its characters."""
    place: dict[str, Any] = {"file": source.shown}
    try:
        root = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as fault:
        problem, mark = fault.problem or "unknown fault", fault.problem_mark or fault.context_mark
        # A text whose end is missing is at fault where it begins.
        if problem.startswith(("found unexpected end", "could not find")) and fault.context_mark:
            mark = fault.context_mark
        place["line"] = None if mark is None else mark.line + 1
        if "nesting depth" in str(fault):
            raise error("too-large", most=MAX_DEPTH, what="levels", **place) from None
        raise error("not-readable", reason=f"no YAML: {problem}", **place) from None
    except (yaml.YAMLError, RecursionError) as fault:
        line = text.encode()[: getattr(fault, "position", 0)].count(b"\n") + 1
        why = f"no YAML: {(str(fault).splitlines() or ['nested too deeply'])[0]}"
        raise error("not-readable", reason=why, line=line, **place) from None
    if root is None:
        raise error("empty-file", what="values", expected=a_file(source.role), **place)
    return root


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Gives no tags but those that are written: `plain_scalar` knows what a scalar means."""

    def resolve(self, kind: Any, value: str, implicit: Any) -> str:
        return ""
