"""The one reader of CSV tables: typed columns, and every bad cell with its row, column and value.

pandas reads the body once, in chunks. That no row is short or long is proven by counting separators
between line ends; only where that fails, or cells are quoted, records are taken one by one. Of a
chunk of a column that is not numeric each different cell is looked at once.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.files.headers import (
    EXCLUSIVE,
    CellFaults,
    Column,
    Decimal,
    File,
    Ints,
    Table,
    TableSpec,
    check_header,
    joined,
    number,
    perhaps_equal,
    stacked,
)
from mtu_cli.files.source import Source, check_text, read_source
from mtu_cli.findings import collected, counted, error, finding
from mtu_cli.units import plain_unit

if TYPE_CHECKING:
    import pandas as pd

GZIP = b"\x1f\x8b"
SAMPLE_BYTES = 1 << 15
CHUNK = 1 << 16
"""Rows."""
PIECE = 1 << 20
"""Bytes that are looked through at once."""


Converted = tuple[bytes, list[int], Mapping[str, str]]
"""A CSV that was made of an instrument's file, with the line of each row and the headings of
columns in that."""
Convert = Callable[[Source, bytes], Converted | None]
"""Makes a CSV of an instrument's file; None of what is a CSV."""


def read_tables(
    files: Sequence[tuple[Path, str]],
    spec: TableSpec,
    faults: CellFaults,
    convert: Convert | None = None,
    *,
    parts: bool = False,
) -> Table:
    """The rows of all (path, role) in one table; what is wrong with cells goes to `faults`.

    Reported, too: a file that is read twice, times that contradict each other, and equal rows of a
    file. Files that are `parts` of one CSV are compared by their rows alone.

    Raises InputError where no file has a sound header, and ValueError without files.
    """
    tables: list[Table] = []
    for path, role in files:
        with collected(faults.add):
            tables.append(read_table(path, role, spec, faults, convert))
    if not tables:
        faults.raise_if_any()
        raise ValueError("no files to read")
    table = joined(tables)
    _check_files(table, faults)
    if not faults.listed:
        _check_equal_rows(table, faults, parts)
    return table


def _check_files(table: Table, faults: CellFaults) -> None:
    """Files that are read twice, and times that contradict each other."""
    first: dict[str, File] = {}
    dated_files = [file for file in table.files if "time" in file.header]
    for file in table.files:
        place: dict[str, Any] = {"file": file.source.shown}
        original = first.setdefault(file.source.sha256, file)
        if original is not file:
            name = original.source.shown
            faults.add(finding("copied-rows", other=name, expected="each file once", **place))
        elif dated_files and "time_min" in file.header:
            expected = "one of them in all files"
            faults.add(finding("exclusive", names=EXCLUSIVE, expected=expected, **place))
        elif dated_files and len(file.aware | dated_files[0].aware) > 1:
            place |= {"column": file.headings.get("time", "time"), "other": "the other times"}
            expected = "all times of all files with an offset from UTC, or none"
            faults.add(finding("contradicts", expected=expected, **place))


def _check_equal_rows(table: Table, faults: CellFaults, parts: bool) -> None:
    """Rows equal to an earlier one of their CSV, where a pass, a repeat or a time is stated."""
    keys = [*table.numbers.values(), *(column.codes for column in table.texts.values())]
    keys = keys if parts else [*keys, table.file_index]
    flags = [table.has(name) for name in ("pass", "repeat", *EXCLUSIVE)]
    first: dict[tuple[object, ...], int] = {}
    for i in np.flatnonzero(perhaps_equal(keys) & np.logical_or.reduce(flags)).tolist():
        cells = tuple(None if key[i] != key[i] else key[i].item() for key in keys)
        earlier = first.setdefault(cells, i)
        if earlier != i:
            original = table.place(earlier)
            other = f"row {original['row']}"
            if table.file_index[earlier] != table.file_index[i]:
                other += f" of {original['file']}"
            place = {**table.place(i), "expected": "each row once"}
            faults.add(finding("copied-rows", other=other, **place))


# Files.


def read_table(
    path: Path, role: str, spec: TableSpec, faults: CellFaults, convert: Convert | None = None
) -> Table:
    """Reads a table of `spec`, ``.csv`` or ``.csv.gz``; what is wrong with cells goes to `faults`.

    Raises InputError for a file without a sound header.
    """
    file = read_header(path, role, convert)
    check_header(file.source, file.header_row, file.header, spec)
    kinds = {name: spec.column(name) for name in file.header}
    rows, records = _sound_rows(file), None
    if rows is None:
        rows, records = _one_by_one(file, faults)
    file.source = replace(file.source, rows=len(rows))
    if not len(rows) and all(item.file != file.source.shown for item in faults.listed):
        expected = "a row of values below the header"
        raise error("empty-file", file=file.source.shown, what="rows", expected=expected)
    row_numbers = rows
    if file.lines is not None:
        row_numbers = np.array(file.lines, np.int64)[rows - file.header_row - 1]
    table = Table(files=(file,), rows=row_numbers, file_index=np.zeros(len(rows), np.int64))
    numbers = {name: np.empty(len(rows)) for name in kinds}
    texts = {name: list[tuple[Ints, list[str]]]() for name in kinds}
    text_columns = {name for name, column in kinds.items() if column.kind == "text"}
    first = 0
    for frame in _frames(file, kinds, records):
        part = slice(first, first := first + len(frame))
        for name, column in kinds.items():
            if column.numeric and frame[name].dtype.kind in "iuf":
                numbers[name][part] = frame[name]
                continue
            codes, labels = _labelled(frame[name], column)
            if column.kind in ("text", "free"):
                texts[name].append((codes, labels))
            # Of a free column one cell that is no number makes texts of all.
            if column.kind == "free" and any(number(x, file.decimal) is None for x in labels if x):
                text_columns.add(name)
            if column.kind != "free" or name not in text_columns:
                numbers[name][part] = np.array([column.value(x, file) for x in labels])[codes]
    lines = cache(lambda: file.content.decode().split("\n"))
    described = cache(lambda cell, name: kinds[name].fault(name, cell, file.decimal))

    def fault(i: int, name: str) -> dict[str, Any]:
        # A cell as the file has it: its float may be another number.
        row = records[i] if records else lines()[rows[i] - 1].split(file.separator)
        return described(row[file.header.index(name)].strip(), name)

    for name, column in kinds.items():
        values, labelled = numbers.pop(name), texts.pop(name)
        if name in text_columns:
            table.texts[name] = stacked(labelled)
        if name in text_columns and column.kind == "free":
            continue
        odd = column.excludes(values)
        if odd.any():
            faults.cells(table, odd, name, partial(fault, name=name))
            values = np.where(np.isinf(values), np.nan, values)
        if name not in text_columns:
            table.numbers[name] = values
    file.content = b""
    return table


def read_header(path: Path, role: str, convert: Convert | None = None) -> File:
    """A file, read up to its header.

    Raises InputError for a file that cannot be read, is no UTF-8 text, or holds no table.
    """
    source, content = read_source(path, role)
    lines: list[int] | None = None
    headings: Mapping[str, str] = {}
    if convert and (converted := convert(source, content)):
        content, lines, headings = converted
    if content.startswith(GZIP):
        content = inflated(content, source.shown)
    elif path.suffix.lower() == ".gz" and lines is None:
        raise error("not-readable", file=source.shown, reason="it is not compressed by gzip")
    check_text(content, source.shown)
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"#" in content:
        content = re.sub(rb"^#.*$", b"", content, flags=re.MULTILINE)
    if (filled := re.search(rb"\S", content)) is None:
        raise error("empty-file", file=source.shown, what="rows", expected="a header row")
    start = content.rfind(b"\n", 0, filled.start()) + 1
    body = content.find(b"\n", start) + 1 or len(content)
    line, row = content[start:body].decode(), content.count(b"\n", 0, start) + 1
    place = {"file": source.shown, "row": row}
    decimal: Decimal = "."
    bare, facts = re.sub(r'"[^"]*"', "", line), {"value": line.strip(), **place}
    if re.match(r"[{\[]|---|[A-Za-z_]+:\s|sep=", line.strip()):
        expected = "a header row, and rows of values below it"
        raise error("other-table", kind="no table", expected=expected, **facts)
    if "," not in bare and ";" not in bare and re.search(r"[\t|]", bare.strip()):
        reason = "the columns are separated by tabs or bars"
        raise error("not-readable", reason=reason, expected="commas or semicolons", **facts)
    separator = ";" if ";" in bare and bare.count(";") >= bare.count(",") else ","
    if separator == ";":  # numbers have the decimal sign of most of them
        sample = content[body : body + SAMPLE_BYTES].decode(errors="ignore")
        signs = re.findall(r"(?<![\d.,])[+-]?\d*([.,])\d", sample)
        decimal = "," if 2 * signs.count(",") > len(signs) else "."
    try:
        header = next(csv.reader([line], delimiter=separator, strict=True))
    except csv.Error as fault:
        raise error("not-readable", reason=str(fault), **place) from None
    return File(
        source=source,
        content=content,
        header=tuple(cell.strip() for cell in header),
        header_row=row,
        body=body,
        separator=separator,
        decimal=decimal,
        lines=lines,
        headings=headings,
    )


def inflated(raw: bytes, file: str) -> bytes:
    """Unpacked gzip data; raises InputError for damaged data."""
    try:
        return gzip.decompress(raw)
    except (EOFError, OSError, zlib.error) as fault:
        raise error("not-readable", file=file, reason=f"damaged gzip data ({fault})") from None


# Rows and columns.


def _sound_rows(file: File) -> Ints | None:
    """The editor rows of the records; None where cells are quoted or rows are not as long."""
    content, body, columns = file.content, file.body, len(file.header)
    # pandas would take a second byte order mark away.
    if content.find(b'"', body) >= 0 or content.startswith(codecs.BOM_UTF8, body):
        return None
    signs = file.separator.encode() + b"\n"
    text_bytes = bytes({*range(256)} - {*signs})
    pieces = (content[i : i + PIECE] for i in range(body, len(content), PIECE))
    marks = b"".join(piece.translate(None, text_bytes) for piece in pieces)
    marks += b"" if content.endswith(b"\n") else b"\n"
    counts = np.diff(np.flatnonzero(np.frombuffer(marks, np.uint8) == signs[1]), prepend=-1)
    odd = np.flatnonzero(counts != columns)
    if len(odd):
        lines = content[body:].split(b"\n")
        if any(lines[i].strip() for i in odd.tolist()):
            return None
    return np.delete(np.arange(len(counts)) + file.header_row + 1, odd)


def _one_by_one(file: File, faults: CellFaults) -> tuple[Ints, list[list[str]]]:
    """Editor rows and cells; records with too few or too many cells are faults and left out."""
    width, rows, records = len(file.header), list[int](), list[list[str]]()
    csv.field_size_limit(max(csv.field_size_limit(), len(file.content)))
    lines = StringIO(file.content[file.body :].decode(), newline="\n")
    reader = csv.reader(lines, delimiter=file.separator, strict=True)
    place: dict[str, Any] = {"file": file.source.shown, "row": file.header_row + 1}
    try:
        for cells in reader:
            if len(cells) == width:
                rows.append(place["row"])
                records.append(cells)
            elif len(cells) > 1 or "".join(cells).strip():
                expected = f"{width}, as in the header"
                if len(cells) > width and cells[-1].strip() and file.separator == ",":
                    expected += "; decimal commas need semicolons between the columns"
                facts = {"value": file.separator.join(cells), "expected": expected}
                count = counted(len(cells), "cell")
                faults.add(finding("row-length", cells=count, **facts, **place))
            place["row"] = file.header_row + 1 + reader.line_num
    except csv.Error as fault:
        place["expected"] = 'a closing "' if "unexpected end" in str(fault) else None
        faults.add(finding("not-readable", reason=str(fault), **place))
    return np.array(rows, np.int64), records


def _frames(
    file: File, kinds: Mapping[str, Column], records: list[list[str]] | None
) -> Iterator[pd.DataFrame]:
    """The rows in chunks: a cell that is no number makes texts of its chunk alone."""
    import pandas as pd

    if records is not None:
        yield pd.DataFrame(records, columns=[*file.header], dtype=object)
        return
    options: dict[str, Any] = {}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1):
        # Later versions read numbers exactly by themselves and warn of the option.
        options["float_precision"] = "round_trip"
    body = BytesIO(file.content)
    body.seek(file.body)
    with pd.read_csv(
        body,
        sep=file.separator,
        decimal=file.decimal,
        header=None,
        names=[*file.header],
        index_col=False,
        dtype={name: str for name, column in kinds.items() if not column.numeric},
        keep_default_na=False,
        na_values=[""],
        quoting=csv.QUOTE_NONE,
        low_memory=False,
        chunksize=CHUNK,
        **options,
    ) as reader:
        yield from reader


def _labelled(values: pd.Series[Any], column: Column) -> tuple[Ints, list[str]]:
    """Cells, stripped: `labels[codes[i]]`, the last of them empty."""
    import pandas as pd

    codes, labels = pd.factorize(values.astype(object))
    cells = [str(label).strip() for label in labels]
    if column.texts is not None:
        # The sign for micro and the Greek letter look alike.
        cells = [cell if cell in column.texts else plain_unit(cell) for cell in cells]
    return codes, [*cells, ""]
