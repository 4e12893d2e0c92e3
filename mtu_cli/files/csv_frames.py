"""The body of a CSV file as frames of pandas' C engine, block by block on all cores."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

from mtu_cli.files.csv_text import CsvText
from mtu_cli.files.in_order import in_order

if TYPE_CHECKING:
    import pandas as pd

MARK = "\x02mtu\x02"
"""A text in a first row of every block that is no row of the file.

pandas makes numbers of a category whose texts all look like numbers, and part 007 into part 7;
among them one text that does not look like a number keeps all of them as they are written.
"""
_BLOCK = 8 << 20
_PIECE = 1 << 20


class Suspect(Exception):  # noqa: N818  # not an error: a reason to read cell by cell
    """The table may be faulty: only the slow reader can say what, and where."""


def frames(
    text: CsvText, dtypes: dict[str, Any], usecols: list[str] | None = None
) -> Iterator[pd.DataFrame]:
    """The body in frames, in order; columns of dtype "category" hold texts, MARK among them.

    Raises Suspect for what pandas cannot read, and for a cell beyond the header's last column.
    """
    import pandas as pd

    try:
        yield from in_order(partial(_frame, text, dtypes, usecols), _blocks(text))
    except (ValueError, OverflowError, pd.errors.ParserError, pd.errors.EmptyDataError):
        raise Suspect from None


def _blocks(text: CsvText) -> list[slice]:
    """Pieces of the body that end with a line, and not within a quoted cell."""
    content, end = text.content, len(text.content)
    quoted = content.find(b'"', text.body) >= 0
    found = []
    start = text.body
    while start < end:
        stop = _line_end(content, min(start + _BLOCK, end))
        while quoted and content.count(b'"', start, stop) % 2 and stop < end:
            stop = _line_end(content, stop)
        # The start tells most often: copying a block only to look at it is slow.
        if not (content[start : start + 100].isspace() and content[start:stop].isspace()):
            found.append(slice(start, stop))
        start = stop
    return found


def _line_end(content: bytes, at: int) -> int:
    stop = content.find(b"\n", at) + 1
    return stop if stop > 0 else len(content)


def _frame(
    text: CsvText, dtypes: dict[str, Any], usecols: list[str] | None, block: slice
) -> pd.DataFrame:
    import pandas as pd

    marks = (_mark(dtypes.get(name)) for name in text.header)
    first = text.separator.join(marks).encode() + b"\n"
    options: dict[str, Any] = {}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1):
        # Later versions read numbers exactly by themselves and warn of the option.
        options["float_precision"] = "round_trip"
    # Looked up once each: pandas goes through all its types for every name of one.
    types = {kind: pd.api.types.pandas_dtype(kind) for kind in set(dtypes.values())}
    # A first row of as many cells as the header's makes any longer one below it an error.
    source: Any = _Fed(first, text.content, block)
    frame = pd.read_csv(
        source,
        sep=text.separator,
        decimal=text.decimal,
        header=None,
        names=[*text.header],
        usecols=usecols,
        index_col=False,
        dtype={name: types[kind] for name, kind in dtypes.items()},
        keep_default_na=False,
        na_values=[""],
        encoding="utf-8",
        low_memory=False,
        **options,
    )
    found: pd.DataFrame = frame.iloc[1:]
    return found


def _mark(dtype: object) -> str:
    return {"category": MARK, "float64": "0"}.get(str(dtype), "")


class _Fed:
    """A file for pandas: a first line, then bytes in pieces of a size of its own choice.

    For every piece a thread waits for the lock of the interpreter: the quarter of a megabyte
    that pandas asks for is little. It makes room for a cell a byte: all at once is too much.
    """

    def __init__(self, first: bytes, content: bytes, block: slice) -> None:
        view = memoryview(content)[block]
        pieces = (bytes(view[at : at + _PIECE]) for at in range(0, len(view), _PIECE))
        self._pieces = chain([first], pieces)

    def read(self, _size: int = -1) -> bytes:
        return next(self._pieces, b"")

    def __iter__(self) -> Iterator[bytes]:
        return self._pieces
