"""CSV files that are larger than memory: a few megabytes of whole records at a time."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from mtu_cli.files.byte_count import count_byte
from mtu_cli.files.csv_frames import Suspect
from mtu_cli.files.csv_text import (
    GZIP,
    CsvText,
    check_suffix,
    inflated,
    plain_lines,
    with_header,
)
from mtu_cli.files.source import RunningDigest, Source, check_text, shown_path

_BLOCK = 4 << 20
_PIECE = 1 << 20
_MOST_HELD = 64 << 20
_NEWLINE = ord("\n")


def text_blocks(path: Path, role: str) -> Iterator[CsvText]:
    """The texts of consecutive rows of a CSV file; the first starts with the header.

    All of them share `source` and `digest`, which is complete after the last. Read piece by
    piece, not mapped: mapped pages count as memory of the process, and packed files are read
    in the same way.

    Raises InputError, OSError or Suspect for a file that only reading it as a whole can judge.
    """
    digest = RunningDigest()
    source = Source(role=role, path=path, shown=shown_path(path), sha256="")
    head: CsvText | None = None
    row = 1
    for content in _whole_records(_unpacked(path, source.shown, digest), source.shown):
        if head is None:
            text = head = with_header(content, source, digest)
        else:
            newlines = count_byte(content, _NEWLINE)
            text = replace(head, content=content, body=0, body_row=row, newlines=newlines)
        row = text.body_row + text.newlines
        if text is head or not content.isspace():
            yield text


def _unpacked(path: Path, shown: str, digest: RunningDigest) -> Iterator[bytes]:
    if not path.is_file():
        # A pipe gives its bytes once, a device without end.
        raise Suspect
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(len(GZIP))
        check_suffix(path, start, shown)
        file.seek(0)
        raw = _pieces(file.read, digest)
        yield from inflated(raw, size, shown) if start == GZIP else raw


def _pieces(read: Callable[[int], bytes], digest: RunningDigest) -> Iterator[bytes]:
    while piece := read(_PIECE):
        digest.update(piece)
        yield piece


def _whole_records(pieces: Iterator[bytes], shown: str) -> Iterator[bytes]:
    """Plain lines in blocks that end with a line, and not within a quoted cell."""
    parts: list[bytes] = []
    size = 0
    mark = codecs.BOM_UTF8
    for piece in pieces:
        parts.append(piece)
        size += len(piece)
        if size < _BLOCK:
            continue
        held = b"".join(parts).removeprefix(mark)
        mark = b""
        lines = held.rfind(b"\n") + 1
        whole = held[:lines]
        check_text(whole, shown)
        # Quotes of comments open no cell: comments go before quotes are counted.
        plain = plain_lines(whole)
        end = _last_record(plain)
        if end and not plain[:end].isspace():
            yield plain[:end]
        elif size > _MOST_HELD:
            raise Suspect
        else:
            end = 0
        parts = [plain[end:], held[lines:]]
        size = sum(map(len, parts))
    held = b"".join(parts).removeprefix(mark)
    check_text(held, shown)
    if held:
        yield plain_lines(held)


def _last_record(content: bytes) -> int:
    """The offset after the last line end that no quoted cell surrounds, 0 where there is none."""
    end = content.rfind(b"\n") + 1
    if content.find(b'"') < 0:
        return end
    quotes = content.count(b'"', 0, end)
    while end and quotes % 2:
        before = content.rfind(b"\n", 0, end - 1) + 1
        quotes -= content.count(b'"', before, end)
        end = before
    return end
