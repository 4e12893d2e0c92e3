"""Rows of a CSV file as a text editor counts them, and its separators, without parsing it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mtu_cli.files.byte_count import count_byte
from mtu_cli.files.csv_text import CELL_LIMIT, CsvText

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Positions = NDArray[np.int64]

_CHUNK = 8 << 20
_QUOTE, _NEWLINE, _RETURN = 34, 10, 13


def editor_rows(text: CsvText, count: int, *, complete: bool = False) -> Positions | None:
    """The editor row at which each of `count` records starts, (count,).

    `complete` where it is known that no record has fewer cells than the header.

    None where the records found here are not `count` records of as many cells as the header, or
    a cell may be too long: the file then needs a reader that looks at every character.
    """
    import numpy as np

    content, body = text.content, text.body
    separators = count * (len(text.header) - 1)
    if content.find(b'"', body) < 0:
        if count_byte(content, ord(text.separator), body) != separators:
            return None
        if _a_line_is_long(content, body):
            return None
        end = _end(content, body)
        if not complete and not _no_row_is_longer(text, np.zeros(0, np.int64)):
            return None
        if text.newlines - content.count(b"\n", end) + 1 == count:
            return np.arange(text.body_row, text.body_row + count, dtype=np.int64)
        quotes = np.zeros(0, np.int64)
    else:
        quotes = _positions(content, body, _QUOTE)
        if not _well_placed(text, quotes):
            return None
        if _outside(content, body, ord(text.separator), quotes) != separators:
            return None
        if not _no_row_is_longer(text, quotes):
            return None
    newlines = _positions(content, body, _NEWLINE)
    ends = _record_ends(content, body, newlines, quotes)
    if len(ends) and int(np.diff(ends, prepend=-1).max()) > CELL_LIMIT:
        return None
    lines = _record_lines(content, body, newlines, ends)
    return lines + text.body_row if len(lines) == count else None


def _end(content: bytes, body: int) -> int:
    """The offset after the last line that is not blank."""
    end = len(content)
    while end > body and content[end - 1] in b" \t\r\n":
        end -= 1
    return end


def _positions(content: bytes, body: int, byte: int) -> Positions:
    """Offsets from `body` of every `byte`, found chunk by chunk to keep the masks small."""
    import numpy as np

    found = []
    for start in range(body, len(content), _CHUNK):
        size = min(_CHUNK, len(content) - start)
        chunk = np.frombuffer(content, np.uint8, size, start)
        found.append(np.flatnonzero(chunk == byte) + (start - body))
    return np.concatenate(found) if found else np.zeros(0, np.int64)


def _well_placed(text: CsvText, quotes: Positions) -> bool:
    """Whether quotes enclose whole cells alone; the parser takes more, and rows with it."""
    import numpy as np

    if len(quotes) % 2:
        return False
    size = len(text.content) - text.body
    view = np.frombuffer(text.content, np.uint8, size, text.body)
    opened, closed = quotes[::2], quotes[1::2]
    before = np.where(opened > 0, view[np.maximum(opened - 1, 0)], _NEWLINE)
    after = np.where(closed + 1 < size, view[np.minimum(closed + 1, size - 1)], _NEWLINE)
    ends = [ord(text.separator), _NEWLINE]
    # A quote within a cell stands doubled: the cell closes and opens again.
    again = np.zeros(len(opened) + 1, bool)
    again[1:-1] = opened[1:] == closed[:-1] + 1
    opens = np.isin(before, ends) | again[:-1]
    closes = np.isin(after, [*ends, _RETURN]) | again[1:]
    return bool(opens.all() and closes.all())


def _outside(content: bytes, body: int, byte: int, quotes: Positions) -> int:
    import numpy as np

    count = 0
    for start in range(body, len(content), _CHUNK):
        size = min(_CHUNK, len(content) - start)
        chunk = np.frombuffer(content, np.uint8, size, start)
        at = np.flatnonzero(chunk == byte) + (start - body)
        count += int((np.searchsorted(quotes, at) % 2 == 0).sum())
    return count


def _no_row_is_longer(text: CsvText, quotes: Positions) -> bool:
    """Whether no row has more separators than the header.

    The total is right already; a row that is longer by empty cells, which the parser cannot
    tell from nothing, could make up for one that is shorter.
    """
    import numpy as np

    content, body, sign = text.content, text.body, ord(text.separator)
    ends = [text.separator.encode() + b"\n"]
    if b"\r" in content:
        ends.append(text.separator.encode() + b"\r\n")
    if all(content.find(end, body) < 0 for end in ends):
        return True
    carried = 0
    for start in range(body, len(content), _CHUNK):
        size = min(_CHUNK, len(content) - start)
        chunk = np.frombuffer(content, np.uint8, size, start)
        at = np.flatnonzero((chunk == sign) | (chunk == _NEWLINE))
        if len(quotes):
            at = at[np.searchsorted(quotes, at + (start - body)) % 2 == 0]
        breaks = np.flatnonzero(chunk[at] == _NEWLINE)
        counts = np.diff(breaks, prepend=-1 - carried) - 1
        if len(counts) and int(counts.max()) >= len(text.header):
            return False
        carried = len(at) - 1 - int(breaks[-1]) if len(breaks) else carried + len(at)
    return carried < len(text.header)


def _a_line_is_long(content: bytes, body: int) -> bool:
    """Whether any line has more bytes than a cell may have characters, in jumps of that length."""
    at = body
    while len(content) - at > CELL_LIMIT:
        found = content.rfind(b"\n", at, at + CELL_LIMIT + 1)
        if found < 0:
            return True
        at = found + 1
    return False


def _record_ends(content: bytes, body: int, newlines: Positions, quotes: Positions) -> Positions:
    """The offset from `body` of the line end of every record, blank ones among them."""
    import numpy as np

    ends = newlines
    if len(quotes):
        # A line end between an odd number of quotes and the next belongs to a cell.
        ends = newlines[np.searchsorted(quotes, newlines) % 2 == 0]
    if len(content) > body + (int(ends[-1]) + 1 if len(ends) else 0):
        ends = np.append(ends, len(content) - body)
    return ends


def _record_lines(content: bytes, body: int, newlines: Positions, ends: Positions) -> Positions:
    """The 0-based line from `body` on at which each record that is not blank starts."""
    import numpy as np

    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    view = np.frombuffer(content, np.uint8, len(content) - body, body)
    blank = ends == starts
    first = view[np.where(blank, 0, starts)]
    candidates = ~blank & np.isin(first, np.frombuffer(b" \t\r", np.uint8))
    for index in np.flatnonzero(candidates):
        line = content[body + int(starts[index]) : body + int(ends[index])]
        blank[index] = not line.strip()
    lines: Positions = np.searchsorted(newlines, starts[~blank])
    return lines
