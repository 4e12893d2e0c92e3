"""A CSV file as text: decompressed, comments blanked, header and separators known."""

from __future__ import annotations

import codecs
import csv
import re
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal

from mtu_cli.errors import fault
from mtu_cli.files.byte_count import count_byte
from mtu_cli.files.csv_first_line import refuse_no_table, refuse_title
from mtu_cli.files.source import Digest, RunningDigest, Source, check_text, read_bytes

Separator = Literal[",", ";"]
Decimal = Literal[".", ","]
DECIMALS: tuple[Decimal, ...] = (".", ",")

GZIP = b"\x1f\x8b"
MAX_INFLATED = 4 << 30
MAX_RATIO = 250
"""Bounds of a compressed file; measured data compress by 3 to 20, a bomb by 1000."""
_INFLATED_FREE = 64 << 20
CELL_LIMIT = 1 << 17
"""Characters of a cell; a longer one is what follows a quote that is never closed."""
_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class CsvText:
    """The text of a CSV file and where its body starts.

    `content` is UTF-8 without byte order mark, comment lines blanked, so that lines still
    count as in an editor; `body` is the offset after the header, `body_row` the editor row
    of the line there, `newlines` the number of line ends from there on. `source` is without
    the hash, which `digest` works out meanwhile.
    """

    source: Source
    digest: Digest | RunningDigest
    content: bytes
    header: tuple[str, ...]
    header_row: int
    body: int
    body_row: int
    newlines: int
    separator: Separator
    decimal: Decimal


def read_csv_text(path: Path, role: str) -> CsvText:
    """Reads a ``.csv`` or ``.csv.gz`` file up to its header.

    Raises InputError for a file that cannot be read, is no UTF-8 text, has no header, or
    separates its columns by anything but commas or semicolons.
    """
    shown, content = read_bytes(path, role)
    source = Source(role=role, path=path, shown=shown, sha256="")
    digest = Digest(content)
    check_suffix(path, content, shown)
    if content.startswith(GZIP):
        content = b"".join(inflated([content], len(content), shown))
    check_text(content, shown)
    return with_header(plain_lines(content.removeprefix(codecs.BOM_UTF8)), source, digest)


def check_suffix(path: Path, content: bytes, shown: str) -> None:
    """Raises InputError where a file called ``.gz`` does not start as one."""
    if path.suffix.lower() == ".gz" and not content.startswith(GZIP):
        raise fault("is not gzip-compressed", file=shown, expected="a .csv.gz file")


def plain_lines(content: bytes) -> bytes:
    """The text with line ends that end with a line feed, comment lines blanked."""
    if b"\r" in content and content.count(b"\r") != content.count(b"\r\n"):
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return _without_comments(content)


def with_header(content: bytes, source: Source, digest: Digest | RunningDigest) -> CsvText:
    """The text of plain lines that start with a header.

    Raises InputError where there is none, or columns are separated by something else.
    """
    start, row = _first_line(content, source)
    separator = _separator(content, start, row, source)
    header, body, body_row = _header(content, start, row, separator)
    return CsvText(
        source=source,
        digest=digest,
        content=content,
        header=header,
        header_row=row,
        body=body,
        body_row=body_row,
        newlines=count_byte(content, ord("\n"), body),
        separator=separator,
        decimal=_decimal(content, body) if separator == ";" else ".",
    )


def inflated(raw: Iterable[bytes], size: int, shown: str) -> Iterator[bytes]:
    """Unpacks gzip data of `size` bytes that come in pieces; what follows them is padding.

    Raises InputError for damaged data, and where they unpack to more than data ever do.
    """
    bound = min(MAX_INFLATED, _INFLATED_FREE + MAX_RATIO * size)
    total = 0
    held = b""
    inflater = None
    padding = False
    try:
        for piece in raw:
            rest = b"" if padding else held + piece
            held = b""
            while rest and not padding:
                if inflater is None and len(rest) < len(GZIP):
                    held, rest = rest, b""
                elif inflater is None and not rest.startswith(GZIP):
                    padding = True
                else:
                    inflater = inflater or zlib.decompressobj(wbits=31)
                    part = inflater.decompress(rest, _CHUNK)
                    total += len(part)
                    if total > bound:
                        raise fault(f"unpacks to more than {bound} bytes", file=shown)
                    yield part
                    rest = inflater.unused_data if inflater.eof else inflater.unconsumed_tail
                    inflater = None if inflater.eof else inflater
    except zlib.error as error:
        raise fault(f"damaged gzip data: {error}", file=shown) from None
    if inflater is not None:
        raise fault("the compressed data end too early", file=shown)
    if not total:
        raise fault("the file is empty once unpacked", file=shown)


def _without_comments(content: bytes) -> bytes:
    """Blanks lines that start with #, unless the line is the inside of a quoted cell."""
    # Looking for one byte is an order of magnitude faster than for two.
    if b"#" not in content or not (content.startswith(b"#") or b"\n#" in content):
        return content
    parts: list[bytes] = []
    kept = counted = quotes = 0
    at = 0 if content.startswith(b"#") else content.find(b"\n#") + 1
    while at > 0 or (at == 0 and counted == 0 and content.startswith(b"#")):
        quotes += content.count(b'"', counted, at)
        counted = at + 1
        if quotes % 2 == 0:
            end = content.find(b"\n", at)
            end = len(content) if end < 0 else end
            parts.append(content[kept:at])
            kept = counted = end
        at = content.find(b"\n#", counted) + 1
    parts.append(content[kept:])
    return b"".join(parts)


def _first_line(content: bytes, source: Source) -> tuple[int, int]:
    start, row = 0, 1
    while start < len(content):
        end = content.find(b"\n", start)
        end = len(content) if end < 0 else end
        if content[start:end].strip():
            return start, row
        start, row = end + 1, row + 1
    raise fault("holds no header and no rows", file=source.shown, expected="a header row")


_QUOTED = re.compile(r'"[^"]*"')


def _separator(content: bytes, start: int, row: int, source: Source) -> Separator:
    end = content.find(b"\n", start)
    line = content[start : len(content) if end < 0 else end].decode()
    refuse_no_table(line.strip(), row, source)
    bare = _QUOTED.sub("", line)
    if bare.count(";") and bare.count(";") >= bare.count(","):
        return ";"
    if "," in bare or not bare.strip():
        return ","
    if "\t" not in bare:
        refuse_title(line.strip(), row, b"" if end < 0 else content[end + 1 :], source)
    for sign, name in (("\t", "tabs"), ("|", "'|'"), (" ", "spaces")):
        if sign in bare.strip():
            raise fault(
                f"the columns are separated by {name}",
                file=source.shown,
                row=row,
                value=line.strip(),
                expected="commas or semicolons",
            )
    return ","


def lines_from(content: bytes, start: int) -> Iterator[str]:
    """The lines of a text from an offset on, with their ends."""
    while start < len(content):
        end = content.find(b"\n", start) + 1
        end = end if end > 0 else len(content)
        yield content[start:end].decode()
        start = end


def first_rows(text: CsvText, most: int) -> list[list[str]]:
    """The cells of the first lines below the header, of `most` at most, as far as they can be
    read.
    """
    # Comment lines are blank by now.
    lines = filter(str.strip, lines_from(text.content, text.body))
    found: list[list[str]] = []
    with suppress(csv.Error):
        found.extend(csv.reader(islice(lines, most), delimiter=text.separator))
    return found


def _header(
    content: bytes, start: int, row: int, separator: Separator
) -> tuple[tuple[str, ...], int, int]:
    lines = lines_from(content, start)
    used = 0

    def counted() -> Iterator[str]:
        nonlocal used
        for line in lines:
            used += len(line.encode())
            yield line

    reader = csv.reader(counted(), delimiter=separator)
    try:
        cells = next(reader)
    except csv.Error:
        cells = []
    names = tuple(cell.strip() for cell in cells)
    return names, start + used, row + reader.line_num


_SAMPLE_LINES = 500
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_POINT_NUMBER = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?")


def _decimal(content: bytes, body: int) -> Decimal:
    """The decimal sign of a file with semicolons: the one most of its numbers have."""
    commas = points = 0
    for count, line in enumerate(lines_from(content, body)):
        if count >= _SAMPLE_LINES:
            break
        for cell in line.strip().split(";"):
            commas += _COMMA_NUMBER.fullmatch(cell.strip(' "')) is not None
            points += _POINT_NUMBER.fullmatch(cell.strip(' "')) is not None
    if commas == points == 0:
        return "," if content.find(b",", body) >= 0 else "."
    return "," if commas > points else "."
