"""Items appended to lists of a YAML text, all else of which stays as it was written.

Only the lists of the outermost mapping are known here. The text is changed at as few places
as can be: comments, order, line ends and the user's way of writing lists remain.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import yaml

from mtu_cli.close_loop_sealed.files.yaml_dump import block_lines, flow_text
from mtu_cli.files.yaml_file import yaml_events

_BREAK = "\r\n\x85\u2028\u2029"
_LINE_REST = re.compile(f"[^{_BREAK}]*(?:\r\n|[{_BREAK}])?")
_FIRST_BREAK = re.compile("\r\n|\r|\n")
_BEFORE = rf"(?:[&!]\S*+|\s++|\#[^{_BREAK}]*+)*+"
"""What may stand before a value's own signs: anchors, tags, blanks, comments."""
_DASH = re.compile(_BEFORE + "-")
_BRACKET = re.compile(_BEFORE + r"\[")
_COMMA = re.compile(rf"(?:\s++|\#[^{_BREAK}]*+)*+,")


class NotAppendable(Exception):  # noqa: N818  # an answer, not a fault of the text
    """The text is written in a way that items cannot be appended to."""


@dataclass(slots=True)
class _Place:
    """A value of the outermost mapping: [start, end) of its text, properties included.

    `kind` of the value; `inner` the end of the last value inside it.
    """

    kind: str
    start: int
    end: int
    inner: int
    empty: bool = True


@dataclass(slots=True)
class _Outline:
    """Where the values of the outermost mapping stand; `end` of the last one's text.

    `key` is where the last entry starts, `block_text` whether its last value is one: such a
    text holds the line end behind it.
    """

    flow: bool = False
    column: int = 0
    end: int = 0
    key: int = 0
    block_text: bool = False
    close: int = 0
    places: dict[str, _Place] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Splice:
    """Text that replaces [start, end); `whole` lines begin on a new one."""

    start: int
    end: int
    text: str
    whole: bool = False


def with_appended(text: str, additions: Mapping[str, Sequence[Any]]) -> str:
    """`text` with items appended to the lists of its outermost keys, made where they are missing.

    Mappings among the items are written an entry a line where the list is no flow list.

    Raises NotAppendable where a value is no list of its own (an alias), or the text is no
    mapping. The result is not checked: read it again.
    """
    outline = _outline(text)
    found = _FIRST_BREAK.search(text)
    newline = "\n" if found is None else found[0]
    splices: list[_Splice] = []
    missing = {}
    for key, items in additions.items():
        place = outline.places.get(key)
        if not items:
            continue
        if place is None:
            missing[key] = items
        elif place.kind == "flow":
            splices += _to_flow(text, outline, place, items, newline)
        elif place.kind == "block":
            splices.append(_to_block(text, place, items, newline))
        else:
            raise NotAppendable(f"{key!r} is no list of its own")
    splices += _new_keys(text, outline, missing, newline)
    return _applied(text, splices, newline)


def _outline(text: str) -> _Outline:
    outline = _Outline()
    depth, key = 0, None
    for event in yaml_events(text):
        start, end = event.start_mark.index, event.end_mark.index
        column = event.start_mark.column
        if isinstance(event, yaml.CollectionStartEvent):
            if depth == 0:
                outline.flow = bool(event.flow_style)
            elif depth == 1 and key is not None:
                listed = isinstance(event, yaml.SequenceStartEvent)
                kind = ("flow" if event.flow_style else "block") if listed else "other"
                outline.places[key] = _Place(kind, start, end, start)
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
            if depth == 0:
                outline.close = start
            # A block ends where the next token begins: its text ended with its last value.
            elif start < end:
                _reach(outline, key, end, inside=depth > 1)
        elif not isinstance(event, yaml.ScalarEvent | yaml.AliasEvent):
            continue
        elif depth == 1 and key is None:
            key = str(getattr(event, "value", ""))
            outline.column = outline.column if outline.places else column
            outline.key = start
            outline.places[key] = _Place("other", end, end, end)
            continue
        else:
            _reach(outline, key, end, inside=depth > 1)
            outline.block_text = getattr(event, "style", None) in ("|", ">")
        # A value of the outermost mapping is complete.
        if depth == 1 and not isinstance(event, yaml.CollectionStartEvent):
            key = None
    if not outline.places:
        raise NotAppendable("no mapping")
    return outline


def _reach(outline: _Outline, key: str | None, end: int, *, inside: bool) -> None:
    outline.end = end
    if key is not None:
        place = outline.places[key]
        place.end = end
        if inside:
            place.inner, place.empty = end, False


def _line_end(text: str, index: int) -> int:
    """The end of the line in which a value ends; a block text ends where the next line starts."""
    if index > 0 and text[index - 1] in _BREAK:
        return index
    found = _LINE_REST.match(text, index)
    return index if found is None else found.end()


def _lines(items: Sequence[Any], indent: int, newline: str) -> str:
    """Items of a block list, each line with its end."""
    lines = []
    for item in items:
        own = block_lines(item) if isinstance(item, Mapping) else [flow_text(item)]
        lines += [("- " if i == 0 else "  ") + line for i, line in enumerate(own)]
    return "".join(" " * indent + line + newline for line in lines)


def _to_block(text: str, place: _Place, items: Sequence[Any], newline: str) -> _Splice:
    found = _DASH.match(text, place.start)
    if found is None:
        raise NotAppendable("a list without a dash")
    dash = found.end() - 1
    indent = dash - max(text.rfind(sign, 0, dash) for sign in _BREAK) - 1
    at = _line_end(text, place.inner)
    return _Splice(at, at, _lines(items, indent, newline), whole=True)


def _to_flow(
    text: str, outline: _Outline, place: _Place, items: Sequence[Any], newline: str
) -> list[_Splice]:
    found = _BRACKET.match(text, place.start)
    if found is None:
        raise NotAppendable("a list without a bracket")
    opened, close = found.end(), place.end - 1
    mappings = any(isinstance(item, Mapping) for item in items)
    blank = not text[opened:close].strip()
    if blank and mappings and not outline.flow:
        # An empty list has no way of writing yet: the readable one is taken.
        at = _line_end(text, place.end)
        start = opened - 1
        while start > 0 and text[start - 1] in " \t":
            start -= 1
        indent = outline.column + 2
        lines = _lines(items, indent, newline)
        return [_Splice(start, place.end, ""), _Splice(at, at, lines, whole=True)]
    texts = [flow_text(item, quoted=outline.flow) for item in items]
    if blank:
        return [_Splice(opened, close, ", ".join(texts))]
    column = opened - max(text.rfind(sign, 0, opened) for sign in _BREAK) - 1
    last = opened if place.empty else place.inner
    line = newline + " " * column
    return _in_flow(text, last, close, texts, line if mappings else None, place.empty)


def _in_flow(
    text: str, last: int, close: int, texts: Sequence[str], line: str | None, empty: bool
) -> list[_Splice]:
    """Entries between the last value of a flow collection and its closing sign.

    `line` starts a new line where each entry has its own.
    """
    gap = text[last:close].rstrip()
    splices = []
    if not empty and _COMMA.match(text, last, close) is None:
        splices.append(_Splice(last, last, ","))
    if line is None:
        line = "\n " if gap.lstrip(", \t\r\n") else " "
    at = last + len(gap)
    splices.append(_Splice(at, at, line + ("," + line).join(texts)))
    return splices


def _new_keys(
    text: str, outline: _Outline, missing: Mapping[str, Sequence[Any]], newline: str
) -> list[_Splice]:
    if not missing:
        return []
    if outline.flow:
        texts = [
            f'"{key}": {flow_text(list(items), quoted=True)}' for key, items in missing.items()
        ]
        return _in_flow(text, outline.end, outline.close, texts, None, empty=False)
    at = _line_end(text, outline.end)
    if at == len(text) and outline.block_text and text[-1] not in _BREAK:
        at = outline.key - outline.column
    indent = " " * outline.column
    parts = []
    for key, items in missing.items():
        if any(isinstance(item, Mapping) for item in items):
            parts.append(f"{indent}{key}:{newline}{_lines(items, outline.column + 2, newline)}")
        else:
            parts.append(f"{indent}{key}: {flow_text(list(items))}{newline}")
    return [_Splice(at, at, "".join(parts), whole=True)]


def _applied(text: str, splices: Sequence[_Splice], newline: str) -> str:
    done, last = "", 0
    for splice in sorted(splices, key=lambda item: item.start):
        done += text[last : splice.start]
        if splice.whole and done and done[-1] not in _BREAK:
            done += newline
        done += splice.text
        last = splice.end
    return done + text[last:]
