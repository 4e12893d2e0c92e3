"""The one reader of CSV tables: typed columns, and every bad cell with its row, column and value.

pandas reads the body once. That no row is short or long is proven by counting separators between
line ends; only where that fails, or cells are quoted, records are taken one by one. Cells are
examined only in columns that are not numeric though they should be.
"""

from __future__ import annotations

import codecs
import csv
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.covariates import SIGN_EXPECTED, direction_sign
from mtu_cli.files.csv_table import (
    LARGEST_INTEGER,
    NO_TIME,
    TIME_EXPECTED,
    WHOLE,
    CellFaults,
    Columns,
    Decimal,
    Table,
    TableSpec,
    TextColumn,
    TimeColumn,
    expectation,
    is_not_finite,
    is_text,
    microseconds,
    number,
)
from mtu_cli.files.headers import check_header
from mtu_cli.files.source import Source, check_text, read_source
from mtu_cli.findings import error, finding, nearest
from mtu_cli.units import UNITS, plain_unit

if TYPE_CHECKING:
    import pandas as pd

Rows = NDArray[np.int64]
Separator = Literal[",", ";"]

GZIP = b"\x1f\x8b"
MAX_INFLATED = 4 << 30
MAX_RATIO = 250
"""Bounds of a compressed file: measured data compress by 3 to 20, a bomb by 1000."""
INFLATED_FREE = 64 << 20
LONGEST_CELL = 1 << 17
SAMPLE_LINES = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class CsvText:
    """A CSV file as text: UTF-8 with plain line ends, comment lines blanked, so that lines still
    count as in an editor. `body` is the offset of the line after the header, `body_row` its row.
    """

    source: Source
    content: bytes
    header: tuple[str, ...]
    header_row: int
    body: int
    body_row: int
    separator: Separator
    decimal: Decimal


def read_table(
    path: Path,
    role: str,
    spec: TableSpec,
    problems: CellFaults | None = None,
    *,
    by_records: bool = False,
) -> Table:
    """Reads a table of `spec`, ``.csv`` or ``.csv.gz``.

    The faults of its cells go to `problems`; without it they are raised. `by_records` takes
    records one by one though the rows are sound: slowly, with the same result.

    Raises InputError for a file without a sound header.
    """
    text = read_text(path, role)
    check_header(text.source, text.header_row, text.header, spec)
    found = CellFaults()
    table = _Body(text, spec, found, by_records).table()
    if not len(table) and not found.listed:
        raise error("no-rows", file=text.source.shown, expected="a row of values below the header")
    if problems is None:
        found.raise_if_any()
    else:
        problems.extend(found)
    return table


def read_text(path: Path, role: str) -> CsvText:
    """A file up to its header.

    Raises InputError for a file that cannot be read, is no UTF-8 text, or holds no table.
    """
    source, content = read_source(path, role)
    if content.startswith(GZIP):
        content = inflated(content, source.shown)
    elif path.suffix.lower() == ".gz":
        raise error("not-gzip", file=source.shown, expected="a .csv.gz file")
    check_text(content, source.shown)
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\r" in content and content.count(b"\r") != content.count(b"\r\n"):
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    content = _without_comments(content)
    start = len(content) - len(content.lstrip())
    start = content.rfind(b"\n", 0, start) + 1
    if not content[start:].strip():
        raise error("no-rows", file=source.shown, expected="a header row")
    row = content.count(b"\n", 0, start) + 1
    line = next(_lines(content, start))
    separator = _separator(line, source, row)
    lines = _counted(content, start)
    try:
        cells = next(csv.reader((each for each, _ in lines), delimiter=separator))
    except csv.Error as fault:
        raise error("row-unreadable", file=source.shown, row=row, reason=str(fault)) from None
    body = start + len(line.encode()) if '"' not in line else _end_of_header(content, start)
    return CsvText(
        source=source,
        content=content,
        header=tuple(cell.strip() for cell in cells),
        header_row=row,
        body=body,
        body_row=content.count(b"\n", 0, body) + 1,
        separator=separator,
        decimal=_decimal(content, body) if separator == ";" else ".",
    )


def _counted(content: bytes, start: int) -> Iterator[tuple[str, int]]:
    for line in _lines(content, start):
        start += len(line.encode())
        yield line, start


def _end_of_header(content: bytes, start: int) -> int:
    """Where the header ends whose quoted names may hold line ends."""
    quotes = 0
    for line, end in _counted(content, start):
        quotes += line.count('"')
        if quotes % 2 == 0:
            return end
    return len(content)


def inflated(raw: bytes, shown: str) -> bytes:
    """Unpacked gzip data, members one after the other; what follows them is padding.

    Raises InputError for damaged data, and where they unpack to more than data ever do.
    """
    bound = min(MAX_INFLATED, INFLATED_FREE + MAX_RATIO * len(raw))
    parts: list[bytes] = []
    try:
        while raw.startswith(GZIP):
            inflater = zlib.decompressobj(wbits=31)
            parts.append(inflater.decompress(raw, bound + 1 - sum(map(len, parts))))
            if sum(map(len, parts)) > bound:
                reason = f"it unpacks to more than {bound} bytes"
                raise error("not-readable", file=shown, reason=reason)
            if not inflater.eof:
                raise error("not-readable", file=shown, reason="the compressed data end too early")
            raw = inflater.unused_data
    except zlib.error as fault:
        raise error("not-readable", file=shown, reason=f"damaged gzip data ({fault})") from None
    content = b"".join(parts)
    if not content:
        raise error("not-readable", file=shown, reason="it is empty once unpacked")
    return content


def _without_comments(content: bytes) -> bytes:
    """Blanks lines that start with #, unless the line is the inside of a quoted cell."""
    if b"#" not in content or not (content.startswith(b"#") or b"\n#" in content):
        return content
    lines = content.split(b"\n")
    quoted = False
    for i, line in enumerate(lines):
        if line.startswith(b"#") and not quoted:
            lines[i] = b""
        elif b'"' in line and line.count(b'"') % 2:
            quoted = not quoted
    return b"\n".join(lines)


def _lines(content: bytes, start: int) -> Iterator[str]:
    """The lines of a text from an offset on, with their ends."""
    while start < len(content):
        end = content.find(b"\n", start) + 1 or len(content)
        yield content[start:end].decode()
        start = end


def _separator(line: str, source: Source, row: int) -> Separator:
    if re.match(r"[{\[]|---|[A-Za-z_]+:\s|sep=", line.strip()):
        kind = "JSON" if line[0] in "{[" else "a line for a spreadsheet or YAML"
        raise error(
            "not-a-table", file=source.shown, row=row, kind=kind, value=line.strip(),
            expected="a CSV file: a header row, and rows of values below it",
        )  # fmt: skip
    bare = re.sub(r'"[^"]*"', "", line)
    if bare.count(";") and bare.count(";") >= bare.count(","):
        return ";"
    other = next((sign for sign in "\t|" if sign in bare.strip()), None)
    if "," not in bare and other is not None:
        name = {"\t": "tabs", "|": "'|'"}[other]
        raise error(
            "other-separator", file=source.shown, row=row, separator=name, value=line.strip(),
            expected="commas or semicolons",
        )  # fmt: skip
    return ","


def _decimal(content: bytes, body: int) -> Decimal:
    """The decimal sign of a file with semicolons: the one most of its numbers have."""
    sample = "".join(islice(_lines(content, body), SAMPLE_LINES))
    commas, points = (len(re.findall(rf"(?<![\d.,])[+-]?\d*{s}\d", sample)) for s in (",", r"\."))
    return "," if commas > points else "."


class _Body:
    """The rows of a text while they become typed columns."""

    def __init__(
        self, text: CsvText, spec: TableSpec, problems: CellFaults, by_records: bool
    ) -> None:
        self.text, self.spec, self.problems = text, spec, problems
        self.rows = None if by_records else self._sound_rows()
        self.quoted = self.rows is None
        if self.rows is None:
            self.rows, self.frame = self._by_records()
        else:
            self.frame = self._by_pandas()

    def table(self) -> Table:
        """The typed table."""
        columns = Columns()
        for name in self.text.header:
            self._column(name, columns)
        return Table(
            source=replace(self.text.source, rows=len(self._editor_rows)),
            header=self.text.header,
            header_row=self.text.header_row,
            rows=self._editor_rows,
            columns=columns,
            covariates=tuple(name for name in self.text.header if not self.spec.named(name)),
            sound=not self.problems.listed,
        )

    @property
    def _editor_rows(self) -> Rows:
        return self.rows if self.rows is not None else np.zeros(0, np.int64)

    def _names(self, *kinds: str) -> list[str]:
        return [name for name in self.text.header if self.spec.kind(name) in kinds]

    # Rows.

    def _sound_rows(self) -> Rows | None:
        """The editor rows of the records; None where cells are quoted, or a row has another number
        of cells than the header.
        """
        text = self.text
        if len(text.header) < 2 or text.content.find(b'"', text.body) >= 0:
            return None
        if text.content.startswith(codecs.BOM_UTF8, text.body):  # pandas would take it away
            return None
        signs = text.separator.encode() + b"\n"
        marks = text.content[text.body :].translate(None, _all_but(signs))
        of_row = signs[:1] * (len(text.header) - 1) + b"\n"
        count = len(marks) // len(of_row)
        if count and marks == of_row * count and text.content.endswith(b"\n"):
            return np.arange(text.body_row, text.body_row + count)
        body = np.frombuffer(text.content, np.uint8, offset=text.body)
        if not len(body):
            return np.zeros(0, np.int64)
        ends = np.flatnonzero(body == ord("\n"))
        starts = np.concatenate([[0], ends + 1])
        starts = starts[starts < len(body)]
        if np.diff(np.append(starts, len(body))).max() > LONGEST_CELL:
            return None
        commas = (body == ord(text.separator)).view(np.uint8)
        counts = np.add.reduceat(commas, starts, dtype=np.int64)
        odd = np.flatnonzero(counts != len(text.header) - 1)
        if any(self._line(starts, i).strip() for i in odd.tolist()):
            return None
        return np.delete(np.arange(text.body_row, text.body_row + len(starts)), odd)

    def _line(self, starts: Rows, i: int) -> bytes:
        at = self.text.body + int(starts[i])
        return self.text.content[at : self.text.content.find(b"\n", at) + 1 or None]

    def _by_pandas(self, only: str | None = None) -> pd.DataFrame:
        """The body; texts as categories, or the column `only` as the texts that stand there."""
        import pandas as pd

        options: dict[str, Any] = {}
        if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1):
            # Later versions read numbers exactly by themselves and warn of the option.
            options["float_precision"] = "round_trip"
        frame: pd.DataFrame = pd.read_csv(
            BytesIO(self.text.content[self.text.body :]),
            sep=self.text.separator,
            decimal=self.text.decimal,
            header=None,
            names=[*self.text.header],
            usecols=None if only is None else [only],
            index_col=False,
            dtype=dict.fromkeys(self._names("text", "time", "sign"), "category")
            if only is None
            else object,
            keep_default_na=False,
            na_values=[""],
            quoting=csv.QUOTE_NONE,
            low_memory=False,
            **options,
        )
        return frame

    def _by_records(self) -> tuple[Rows, pd.DataFrame]:
        """Records one by one; those with too few or too many cells are faults and left out."""
        import pandas as pd

        text, wanted = self.text, len(self.text.header)
        rows: list[int] = []
        kept: list[list[str]] = []
        reader = csv.reader(_lines(text.content, text.body), delimiter=text.separator, strict=True)
        while True:
            row = text.body_row + reader.line_num
            try:
                cells = next(reader)
            except StopIteration:
                break
            except csv.Error as fault:
                self._fault("row-unreadable", row, reason=str(fault))
                break
            if not cells or (len(cells) == 1 and not cells[0].strip() and wanted > 1):
                continue
            if len(cells) != wanted:
                code = "short-row" if len(cells) < wanted else "long-row"
                expected = f"{wanted}, as in the header"
                if code == "long-row" and any(map(_half_a_number, cells, cells[1:])):
                    expected += "; decimal commas need semicolons between the columns"
                shown = text.separator.join(cells)
                self._fault(code, row, cells=len(cells), value=shown, expected=expected)
                continue
            rows.append(row)
            kept.append(cells)
        columns = zip(*kept, strict=True) if kept else ((),) * wanted
        frame = pd.DataFrame(
            {
                name: pd.Series([cell if cell.strip() else None for cell in cells], dtype=object)
                for name, cells in zip(text.header, columns, strict=True)
            }
        )
        return np.array(rows, np.int64), frame

    # Columns.

    def _column(self, name: str, columns: Columns) -> None:
        kind, values = self.spec.kind(name), self.frame[name]
        numeric = values.dtype.kind in "iuf"
        if kind == "number":
            columns.numbers[name] = self._numbers(name, values)
        elif kind == "covariate" and numeric and self._finite(values):
            columns.numbers[name] = values.to_numpy(np.float64)
        else:
            categories = getattr(values, "cat", None)
            texts = values if categories is None else categories.categories
            if not self.quoted and texts.dtype.kind in "iufb":
                # pandas makes numbers of texts that look like them, and part 007 into part 7.
                values = self._by_pandas(name)[name]
            codes, labels = _factorized(values)
            if kind == "covariate":
                self._covariate(name, codes, labels, columns)
                return
            empty = np.flatnonzero(codes < 0)
            if not self.spec.empty_allowed(name):
                self._cells(name, empty, "empty-cell", None, self.spec.says.get(name, "a text"))
            if kind == "time":
                columns.times[name] = self._times(name, codes, labels)
            elif kind == "sign":
                columns.numbers[name] = self._signs(name, codes, labels)
            else:
                columns.texts[name] = self._texts(name, codes, labels)

    def _finite(self, values: pd.Series[Any]) -> bool:
        return not np.isinf(values.to_numpy(np.float64)).any()

    def _numbers(self, name: str, values: pd.Series[Any]) -> NDArray[np.float64]:
        """A column of numbers; nan where a cell is empty or at fault."""
        if values.dtype.kind not in "iuf" or not self._finite(values):
            if not self.quoted and values.dtype.kind in "fb":
                values = self._by_pandas(name)[name]
            codes, labels = _factorized(values)
            known = [number(label, self.text.decimal) for label in labels]
            for code, label in enumerate(labels):
                value = known[code]
                if value is None or not np.isfinite(value):
                    known[code] = None
                    what = (
                        "not-finite" if is_not_finite(label, self.text.decimal) else "not-a-number"
                    )
                    says = self.spec.says.get(name) or expectation(label, self.text.decimal)
                    self._cells(name, np.flatnonzero(codes == code), what, label, says)
            found = np.array([*(np.nan if v is None else v for v in known), np.nan])[codes]
            empty = np.flatnonzero(codes < 0)
        else:
            found = values.to_numpy(np.float64)
            empty = np.flatnonzero(np.isnan(found))
        if not self.spec.empty_allowed(name):
            self._cells(name, empty, "empty-cell", None, self.spec.says.get(name, "a number"))
        if name in WHOLE and name in self.spec.numbers:
            large = np.flatnonzero(np.abs(found) > LARGEST_INTEGER)
            for i in large.tolist():
                expected = f"a whole number, at most {LARGEST_INTEGER:.0f} in size"
                self._cells(name, np.array([i]), "out-of-range", f"{found[i]:g}", expected)
            found = np.where(np.abs(found) > LARGEST_INTEGER, np.nan, found)
        return found

    def _covariate(self, name: str, codes: Rows, labels: list[str], columns: Columns) -> None:
        """Numbers where every cell that is not empty is one, else texts."""
        decimal = self.text.decimal
        if any(is_text(label, decimal) for label in labels):
            columns.texts[name] = TextColumn(codes.astype(np.int32), tuple(labels))
            return
        known = [number(label, decimal) for label in labels]
        for code, label in enumerate(labels):
            if is_not_finite(label, decimal):
                known[code] = None
                rows = np.flatnonzero(codes == code)
                self._cells(name, rows, "not-finite", label, "a finite number, or an empty cell")
        columns.numbers[name] = np.array([*(np.nan if v is None else v for v in known), np.nan])[
            codes
        ]

    def _texts(self, name: str, codes: Rows, labels: list[str]) -> TextColumn:
        if name in self.spec.units:
            # The sign for micro and the Greek letter look alike.
            labels = [
                plain_unit(label) if plain_unit(label) in UNITS else label for label in labels
            ]
            unique = list(dict.fromkeys(labels))
            codes = np.array([*(unique.index(label) for label in labels), -1])[codes]
            labels = unique
        return TextColumn(codes.astype(np.int32), tuple(labels))

    def _times(self, name: str, codes: Rows, labels: list[str]) -> TimeColumn:
        values, aware = microseconds(labels)
        for code, label in enumerate(labels):
            if values[code] == NO_TIME:
                self._cells(name, np.flatnonzero(codes == code), "not-a-time", label, TIME_EXPECTED)
        if len(aware) > 1:
            expected = "all times with an offset, or none"
            self._fault("times-mixed", int(self._editor_rows[0]), column=name, expected=expected)
        return TimeColumn(np.append(values, NO_TIME)[codes], True in aware)

    def _signs(self, name: str, codes: Rows, labels: list[str]) -> NDArray[np.float64]:
        known = [direction_sign(label) for label in labels]
        for code, label in enumerate(labels):
            if known[code] is None:
                rows = np.flatnonzero(codes == code)
                meant = nearest(label, ("forward", "reverse"))
                self._cells(name, rows, "not-a-direction", label, SIGN_EXPECTED, meant)
        return np.array([*(np.nan if v is None else float(v) for v in known), np.nan])[codes]

    # Faults.

    def _fault(self, code: str, row: int, **place: Any) -> None:
        self.problems.add(finding(code, file=self.text.source.shown, row=row, **place))

    def _cells(
        self,
        name: str,
        at: Rows,
        code: str,
        value: str | None,
        expected: str | None,
        meant: tuple[str, ...] = (),
    ) -> None:
        """One fault for each of the cells `at`; beyond the first thousands they are counted."""
        room = max(0, self.problems.room())
        for row in self._editor_rows[at[:room]].tolist():
            self._fault(code, row, column=name, value=value, expected=expected, meant=meant)
        self.problems.uncounted += max(0, len(at) - room)


def _factorized(values: pd.Series[Any]) -> tuple[Rows, list[str]]:
    """Codes (n,) of stripped labels in the order of appearance; -1 where a cell is empty."""
    import pandas as pd

    if isinstance(values.dtype, pd.CategoricalDtype):
        known = values.cat.codes.to_numpy()
        codes, order = pd.factorize(np.where(known < 0, -1, known), use_na_sentinel=False)
        names = [*values.cat.categories, ""]
        plain = [str(names[i]).strip() for i in order]
    else:
        codes, labels = pd.factorize(values.astype(object))
        plain = [str(label).strip() for label in labels]
    unique = list(dict.fromkeys(label for label in plain if label))
    if unique == plain:
        return np.asarray(codes, np.int64), plain
    place = {label: i for i, label in enumerate(unique)}
    return np.array([*(place.get(label, -1) for label in plain), -1])[codes], unique


def _all_but(signs: bytes) -> bytes:
    return bytes(set(range(256)) - set(signs))


def _half_a_number(left: str, right: str) -> bool:
    """Whether two neighbouring cells may be one number with a decimal comma."""
    return left.strip().lstrip("+-").isdigit() and right.strip().isdigit()
