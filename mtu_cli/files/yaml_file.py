"""The one YAML reader: YAML 1.2 scalars, bounded size, a line for every value.

Every mapping key is text as it is written, so that a feature may be called ``007`` or ``no``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from mtu_cli.errors import InputError, Problem, fault
from mtu_cli.files.source import Source, a_file, check_text, read_source
from mtu_cli.files.yaml_commas import Cell, OddNumber, decimal_point, odd_number
from mtu_cli.files.yaml_faults import control_line, unreadable
from mtu_cli.files.yaml_scalars import CORE_TAG, plain_scalar, tagged_scalar
from mtu_cli.findings import Finding

MAX_BYTES = 10_000_000
MAX_NODES = 500_000
MAX_DEPTH = 60
TOO_DEEP = f"values are nested deeper than {MAX_DEPTH} levels"
MAX_TEXT = 120_000
"""Characters of one text: longer names would make tables that no reader of CSV files takes."""

YamlPath = tuple[str | int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class YamlDocument:
    """A YAML file: plain data, and the 1-based line of each value by its path.

    The line of a mapping's entry is its key's; `starts` has that of a value which begins below
    its key's, where it is no mapping or list. `odd_numbers`, by the path of their list, are faults
    that `check_contract` raises together with all that it finds itself. `content` are the bytes of
    the file, none where the text came from elsewhere.
    """

    source: Source
    data: Any
    lines: Mapping[YamlPath, int]
    odd_numbers: Mapping[YamlPath, OddNumber] = field(default_factory=dict)
    starts: Mapping[YamlPath, int] = field(default_factory=dict)
    content: bytes = b""

    def line_of(self, *path: str | int) -> int | None:
        """The line of a value, or of the nearest value around it that the file holds."""
        for length in range(len(path), -1, -1):
            line = self.lines.get(path[:length])
            if line is not None:
                return line
        return None


@dataclass(slots=True)
class _Node:
    """A value while it is composed; `size` and `depth` are those with aliases expanded."""

    line: int
    value: Any = None
    items: list[_Node] | None = None
    entries: dict[str, tuple[int, _Node]] | None = None
    size: int = 1
    depth: int = 1
    anchor: str | None = None
    key: tuple[str, int] | None = None
    cells: list[Cell] | None = None
    odd: OddNumber | None = None

    def is_null(self) -> bool:
        """Whether nothing stands there, as behind `5` in ``{u: 1,5}``."""
        return self.value is None and self.items is None and self.entries is None


def read_yaml(path: Path, role: str) -> YamlDocument:
    """A YAML file as plain data with lines.

    Raises InputError for everything that stops it: see `read_source`, `parse_yaml`.
    """
    source, content = read_source(path, role, max_bytes=MAX_BYTES)
    check_text(content, source.shown)
    return replace(parse_yaml(content.decode("utf-8-sig"), source), content=content)


def parse_yaml(text: str, source: Source) -> YamlDocument:
    """YAML text as plain data with lines.

    Raises InputError, with the line, for text that is no YAML, tags beyond the core schema and
    keys that appear twice (nobody knows which of their values is meant), an alias inside its own
    anchor, more than one document, more than 60 levels, a text of more than 120 000 characters, or
    more than 500 000 values once aliases are expanded.
    """
    shown = source.shown
    try:
        composer = _Composer(shown, text)
        root = composer.compose(yaml_events(text))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        if mark is not None and "nesting depth" in str(error):
            # The parser's own limit, which it may meet before the value that is too deep for us.
            raise fault(TOO_DEEP, file=shown, line=mark.line + 1) from None
        raise unreadable(error, text, shown, None if mark is None else mark.line + 1) from None
    except yaml.YAMLError as error:
        what = f"not readable as YAML: {str(error).splitlines()[0]}"
        raise fault(what, file=shown, line=control_line(text)) from None
    if problems := [*composer.bad_tags, *composer.duplicates]:
        raise InputError(sorted(problems, key=lambda problem: problem.line or 0))
    if root is None:
        raise fault("the file holds no values", file=shown, expected=a_file(source.role))
    data, lines, odd, starts = _expand(root)
    return YamlDocument(source=source, data=data, lines=lines, odd_numbers=odd, starts=starts)


def yaml_events(text: str) -> Iterator[Any]:
    """The parser's events, whose marks count the characters of `text`."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    events: Iterator[Any] = yaml.parse(text, Loader=loader)
    return events


class _Composer:
    """Builds nodes from events without recursion, so that depth is a message, not a crash."""

    def __init__(self, shown: str, text: str) -> None:
        self.shown = shown
        self.text = text
        self.open: list[_Node] = []
        self.anchors: dict[str, _Node] = {}
        self.root: _Node | None = None
        self.documents = 0
        self.total = 0
        self.duplicates: list[Finding] = []
        self.bad_tags: list[Finding] = []

    def compose(self, events: Iterator[Any]) -> _Node | None:
        for event in events:
            match event:
                case yaml.DocumentStartEvent():
                    self._document(event)
                case yaml.ScalarEvent() | yaml.AliasEvent():
                    self._leaf(event)
                case yaml.CollectionStartEvent():
                    self._start(event)
                case yaml.CollectionEndEvent():
                    self._end()
        return self.root

    def _fault(self, what: str, line: int, expected: str | None = None) -> InputError:
        return fault(what, file=self.shown, line=line, expected=expected)

    def _document(self, event: Any) -> None:
        self.documents += 1
        if self.documents > 1:
            line = event.start_mark.line + 1
            raise self._fault("a second document starts here", line, "one document in a file")

    def _leaf(self, event: Any) -> None:
        line = event.start_mark.line + 1
        parent = self.open[-1] if self.open else None
        if parent is not None and parent.entries is not None and parent.key is None:
            self._key(parent, event, line)
        elif isinstance(event, yaml.AliasEvent):
            self._place(self._alias(str(event.anchor), line))
        else:
            node = _Node(line, self._scalar(event, line), anchor=event.anchor)
            self._bound(node, line)
            if parent is not None and parent.cells is not None and _is_number(node.value):
                marks = event.start_mark.index, event.end_mark.index
                parent.cells.append(Cell(str(event.value), *marks))
            self._place(node)

    def _key(self, parent: _Node, event: Any, line: int) -> None:
        if isinstance(event, yaml.AliasEvent):
            raise self._fault("an alias stands as a key", line, "a plain key")
        key = str(event.value)
        if key == "<<":
            raise self._fault("merge keys (<<) are not part of YAML 1.2", line, "the keys in full")
        value = self._scalar(event, line)
        if event.anchor is not None:
            self.anchors[event.anchor] = _Node(line, value)
        entries = parent.entries or {}
        if key in entries:
            first, node = entries[key]
            where = f" in line {line}" if first == line else f": in lines {first} and {line}"
            what = f"key {key!r} appears twice{where}"
            expected = decimal_point(key) if node.is_null() else None
            problem = Problem(what=what, file=self.shown, line=line, expected=expected)
            self.duplicates.append(problem)
        parent.key = (key, line)

    def _scalar(self, event: Any, line: int) -> Any:
        text = str(event.value)
        if len(text) > MAX_TEXT:
            raise self._fault(
                f"a text of {len(text)} characters", line, f"at most {MAX_TEXT} of them"
            )
        if event.tag is None:
            return plain_scalar(text) if event.implicit[0] else text
        fits, value = tagged_scalar(event.tag, text)
        if not fits:
            self._bad_tag(event.tag, line)
        return value

    def _bad_tag(self, tag: str, line: int) -> None:
        what = f"the tag {tag.replace(CORE_TAG, '!!', 1)!r} is not accepted here"
        self.bad_tags.append(
            Problem(what=what, file=self.shown, line=line, expected="plain values")
        )

    def _alias(self, anchor: str, line: int) -> _Node:
        if any(node.anchor == anchor for node in self.open):
            raise self._fault(f"the alias *{anchor} stands inside its own anchor", line)
        if anchor not in self.anchors:
            raise self._fault(
                f"unknown alias *{anchor}", line, f"an anchor &{anchor} above the alias"
            )
        node = self.anchors[anchor]
        self._bound(node, line)
        return node

    def _bound(self, node: _Node, line: int) -> None:
        # An alias counts as all that it stands for, so a bomb is refused before it expands.
        self.total += node.size
        if self.total > MAX_NODES:
            raise self._fault(f"more than {MAX_NODES} values", line, "a smaller file")
        if len(self.open) + node.depth > MAX_DEPTH:
            raise self._fault(TOO_DEEP, line)

    def _start(self, event: Any) -> None:
        line = event.start_mark.line + 1
        mapping = isinstance(event, yaml.MappingStartEvent)
        if event.tag not in (None, "!", CORE_TAG + ("map" if mapping else "seq")):
            self._bad_tag(event.tag, line)
        parent = self.open[-1] if self.open else None
        if parent is not None and parent.entries is not None and parent.key is None:
            raise self._fault("a list or mapping stands as a key", line, "a plain key")
        node = _Node(line, anchor=event.anchor)
        self._bound(node, line)
        if mapping:
            node.entries = {}
        else:
            node.items = []
            node.cells = [] if event.flow_style else None
        self.open.append(node)

    def _end(self) -> None:
        node = self.open.pop()
        if node.cells and len(node.cells) == len(node.items or ()):
            node.odd = odd_number(node.cells, self.text)
        node.cells = None
        self._place(node)

    def _place(self, node: _Node) -> None:
        if node.anchor is not None:
            self.anchors[node.anchor] = node
        parent = self.open[-1] if self.open else None
        if parent is None:
            self.root = node
            return
        parent.size += node.size
        parent.depth = max(parent.depth, node.depth + 1)
        if parent.items is not None:
            parent.items.append(node)
        elif parent.entries is not None and parent.key is not None:
            key, key_line = parent.key
            parent.entries[key] = (key_line, node)
            parent.key = None


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


Places = dict[YamlPath, int]


def _expand(root: _Node) -> tuple[Any, Places, dict[YamlPath, OddNumber], Places]:
    lines: Places = {}
    starts: Places = {}
    odd: dict[YamlPath, OddNumber] = {}

    # Recursion is bounded: MAX_DEPTH holds with aliases expanded.
    def build(node: _Node, path: YamlPath, line: int) -> Any:
        lines[path] = line
        if node.entries is not None:
            return {
                key: build(child, (*path, key), key_line)
                for key, (key_line, child) in node.entries.items()
            }
        if node.odd is not None:
            odd[path] = node.odd
        if node.items is not None:
            return [build(child, (*path, i), child.line) for i, child in enumerate(node.items)]
        if node.line > line and node.value is not None:
            starts[path] = node.line
        return node.value

    return build(root, (), root.line), lines, odd, starts
