"""Sound CSV tables through the C engine of pandas, chunk by chunk into whole arrays."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from itertools import islice
from typing import TYPE_CHECKING, Any

from mtu_cli.files.csv_cells import NO_TIME, is_text, microseconds
from mtu_cli.files.csv_table import Columns, Kind, TableSpec, TextColumn, TimeColumn
from mtu_cli.files.csv_text import CsvText, lines_from

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

_ROWS = 1 << 17
_SNIFFED_ROWS = 20


class Suspect(Exception):  # noqa: N818  # not an error: a reason to read cell by cell
    """The table may be faulty: only the slow reader can say what, and where."""


def read_fast(text: CsvText, spec: TableSpec) -> tuple[int, Columns]:
    """The number of rows and all columns.

    Raises Suspect at the first sign of a fault: a cell that is no number, an empty cell
    where none may be, a row that is longer than the header. Rows that are too short are not
    seen here: the caller counts separators.
    """
    kinds = {name: spec.kind(name) for name in text.header}
    seen = _first_texts(text)
    kinds |= {name: "text" for name in seen if kinds[name] == "covariate"}
    capacity = text.newlines + 1
    numbers = {
        name: _Numbers(capacity) for name, kind in kinds.items() if kind in ("number", "covariate")
    }
    texts = {name: _Texts(capacity) for name, kind in kinds.items() if kind == "text"}
    times = {name: _Times(capacity) for name, kind in kinds.items() if kind == "time"}
    dtypes = _dtypes(kinds, seen)
    count = 0
    for frame in _frames(text, dtypes):
        for name in [name for name in numbers if not _is_numeric(frame[name])]:
            if kinds[name] == "number":
                raise Suspect
            del numbers[name]
        for name in [name for name in texts if _is_converted(frame[name])]:
            del texts[name]
        for column in (numbers, texts, times):
            for name, store in column.items():
                store.add(frame[name], count)
        count += len(frame)
    late = [name for name in text.header if name not in (*numbers, *texts, *times)]
    texts |= _read_texts(text, late, capacity)
    columns = Columns(
        numbers={name: store.whole(count) for name, store in numbers.items()},
        texts={name: store.whole(count) for name, store in texts.items()},
        times={name: store.whole(count) for name, store in times.items()},
    )
    _check_cells(columns, spec)
    return count, columns


def _dtypes(kinds: dict[str, Kind], seen: set[str]) -> dict[str, Any]:
    """What pandas is told of the columns.

    Categories are fast, but pandas turns them into numbers where all look like numbers, and
    part 007 into part 7: they are for columns that are seen to hold other texts.
    """
    found: dict[str, Any] = {}
    for name, kind in kinds.items():
        if kind == "number":
            found[name] = "float64"
        elif kind != "covariate":
            found[name] = "category" if name in seen or kind == "time" else object
    return found


def _first_texts(text: CsvText) -> set[str]:
    """Columns whose first rows hold texts that are neither numbers nor truth values."""
    reader = csv.reader(lines_from(text.content, text.body), delimiter=text.separator)
    found: set[str] = set()
    try:
        for cells in islice(reader, _SNIFFED_ROWS):
            pairs = zip(text.header, cells, strict=False)
            found |= {name for name, cell in pairs if is_text(cell, text.decimal)}
    except csv.Error:
        raise Suspect from None
    return found


def _is_converted(column: pd.Series[Any]) -> bool:
    """Whether pandas has made numbers or truth values of the texts of a category."""
    import pandas as pd

    if not isinstance(column.dtype, pd.CategoricalDtype):
        return False
    categories = column.cat.categories
    return len(categories) > 0 and not isinstance(categories[0], str)


def _is_numeric(column: pd.Series[Any]) -> bool:
    import pandas as pd

    types = pd.api.types
    return types.is_numeric_dtype(column) and not types.is_bool_dtype(column)


def _frames(
    text: CsvText, dtypes: dict[str, Any], usecols: list[str] | None = None
) -> Iterator[pd.DataFrame]:
    """The body in frames; a cell beyond the header's last column is Suspect."""
    import pandas as pd

    stream = io.BytesIO(text.content)
    stream.seek(text.body)
    beyond = "\0"
    options: dict[str, Any] = {}
    if tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1):
        # Later versions read numbers exactly by themselves and warn of the option.
        options["float_precision"] = "round_trip"
    try:
        reader = pd.read_csv(
            stream,
            sep=text.separator,
            decimal=text.decimal,
            header=None,
            names=[*text.header, beyond] if usecols is None else [*text.header],
            usecols=usecols,
            index_col=False,
            dtype=dtypes,
            keep_default_na=False,
            na_values=[""],
            encoding="utf-8",
            chunksize=_ROWS,
            low_memory=False,
            **options,
        )
        with reader:
            for frame in reader:
                if usecols is None and frame[beyond].notna().any():
                    raise Suspect
                yield frame
    except (ValueError, OverflowError, pd.errors.ParserError, pd.errors.EmptyDataError):
        raise Suspect from None


def _read_texts(text: CsvText, names: list[str], capacity: int) -> dict[str, _Texts]:
    """Columns that turned out to be texts, read again as they are written."""
    found = {name: _Texts(capacity) for name in names}
    count = 0
    if found:
        for frame in _frames(text, dict.fromkeys(names, object), names):
            for name, store in found.items():
                store.add(frame[name], count)
            count += len(frame)
    return found


class _Numbers:
    def __init__(self, capacity: int) -> None:
        import numpy as np

        self.values = np.empty(capacity, np.float64)

    def add(self, column: pd.Series[Any], start: int) -> None:
        self.values[start : start + len(column)] = column.to_numpy(dtype="float64")

    def whole(self, count: int) -> NDArray[np.float64]:
        return self.values[:count]


class _Texts:
    def __init__(self, capacity: int) -> None:
        import numpy as np

        self.codes = np.empty(capacity, np.int32)
        self.index: dict[str, int] = {}

    def add(self, column: pd.Series[Any], start: int) -> None:
        import numpy as np
        import pandas as pd

        if isinstance(column.dtype, pd.CategoricalDtype):
            codes, labels = column.cat.codes.to_numpy(), column.cat.categories.tolist()
        else:
            codes, found = pd.factorize(column)
            labels = found.tolist()
        index = self.index
        stripped = [label.strip() for label in labels]
        lookup = [index.setdefault(label, len(index)) if label else -1 for label in stripped]
        # Code -1, an empty cell, picks the last entry.
        self.codes[start : start + len(column)] = np.array([*lookup, -1], np.int32)[codes]

    def whole(self, count: int) -> TextColumn:
        return _by_appearance(self.codes[:count], tuple(self.index))


def _by_appearance(codes: NDArray[np.int32], labels: tuple[str, ...]) -> TextColumn:
    """Labels in the order of their first row; the parser hands them over sorted."""
    import numpy as np
    import pandas as pd

    order = pd.unique(codes[codes >= 0])
    if (order == np.arange(len(order))).all():
        return TextColumn(codes, labels)
    place = np.full(len(labels) + 1, -1, np.int32)
    place[order] = np.arange(len(order), dtype=np.int32)
    return TextColumn(place[codes], tuple(labels[code] for code in order))


class _Times:
    def __init__(self, capacity: int) -> None:
        import numpy as np

        self.values = np.empty(capacity, np.int64)
        self.aware: frozenset[bool] = frozenset()

    def add(self, column: pd.Series[Any], start: int) -> None:
        import numpy as np

        values, aware = microseconds([str(label) for label in column.cat.categories])
        table = np.append(values, NO_TIME)
        self.values[start : start + len(column)] = table[column.cat.codes.to_numpy()]
        self.aware |= aware

    def whole(self, count: int) -> TimeColumn:
        if len(self.aware) != 1:
            raise Suspect
        return TimeColumn(self.values[:count], next(iter(self.aware)))


def _check_cells(columns: Columns, spec: TableSpec) -> None:
    import numpy as np

    for name, values in columns.numbers.items():
        faulty = np.isinf(values) if spec.empty_allowed(name) else ~np.isfinite(values)
        if faulty.any():
            raise Suspect
    for name, text in columns.texts.items():
        if not spec.empty_allowed(name) and (text.codes < 0).any():
            raise Suspect
    for time in columns.times.values():
        if (time.microseconds == NO_TIME).any():
            raise Suspect
