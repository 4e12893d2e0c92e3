"""Sound CSV tables through the C engine of pandas, chunk by chunk into whole arrays."""

from __future__ import annotations

import csv
from collections.abc import Collection
from itertools import islice
from typing import TYPE_CHECKING, Any

from mtu_cli.files.csv_cells import NO_TIME, is_text, microseconds
from mtu_cli.files.csv_frames import MARK, Suspect, frames
from mtu_cli.files.csv_table import (
    LARGEST_INTEGER,
    WHOLE,
    Columns,
    Kind,
    TableSpec,
    TextColumn,
    TimeColumn,
)
from mtu_cli.files.csv_text import CsvText, lines_from
from mtu_cli.files.sign_words import direction_sign

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

_SNIFFED_ROWS = 20
NUMBERS = ("number", "sign", "covariate")
"""Kinds of columns that pandas is to read as numbers, unless their first rows hold texts."""


def read_fast(text: CsvText, spec: TableSpec) -> tuple[int, Columns]:
    """The number of rows and all columns.

    Raises Suspect at the first sign of a fault: a cell that is no number, an empty cell
    where none may be, a row that is longer than the header. Rows that are too short are not
    seen here: the caller counts separators.
    """
    kinds = {name: spec.kind(name) for name in text.header}
    if not {"covariate", "sign"}.isdisjoint(kinds.values()):
        seen = _first_texts(text)
        kinds |= {name: "text" for name in seen if kinds[name] in ("covariate", "sign")}
    capacity = text.newlines + 1
    numeric = [name for name, kind in kinds.items() if kind in NUMBERS]
    numbers, vectors = _number_stores(numeric, spec, capacity)
    texts = {name: _Texts(capacity) for name, kind in kinds.items() if kind == "text"}
    times = {name: _Times(capacity) for name, kind in kinds.items() if kind == "time"}
    count = 0
    for frame in frames(text, _dtypes(kinds)):
        found = dict(frame.items())
        for name in [name for name in numbers if found[name].dtype.kind not in "iuf"]:
            if kinds[name] != "covariate":
                raise Suspect
            del numbers[name]
        for column in (numbers, texts, times):
            for name, store in column.items():
                store.add(found[name], count)
        count += len(frame)
    late = [name for name in text.header if name not in (*numbers, *texts, *times)]
    texts |= _read_texts(text, late, capacity)
    columns = Columns(
        numbers={name: store.whole(count) for name, store in numbers.items()},
        texts={name: store.whole(count) for name, store in texts.items()},
        times={name: store.whole(count) for name, store in times.items()},
        vectors={
            names: _filled(values, names, numbers, count) for names, values in vectors.items()
        },
    )
    _to_signs(columns, spec)
    _check_cells(columns, spec)
    return count, columns


def _dtypes(kinds: dict[str, Kind]) -> dict[str, Any]:
    """What pandas is told of the columns; it finds out by itself what a covariate is."""
    found = {"number": "float64", "sign": "float64", "text": "category", "time": "category"}
    return {name: found[kind] for name, kind in kinds.items() if kind != "covariate"}


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


def _read_texts(text: CsvText, names: list[str], capacity: int) -> dict[str, _Texts]:
    """Columns that turned out to be texts, read again as they are written.

    Raises Suspect for one that holds numbers or blanks alone, or what is not finite.
    """
    found = {name: _Texts(capacity) for name in names}
    count = 0
    if found:
        for frame in frames(text, dict.fromkeys(names, "category"), names):
            for name, store in found.items():
                store.add(frame[name], count)
            count += len(frame)
    for store in found.values():
        # To pandas whole numbers beyond 64 bits are objects, and blanks texts: they are numbers
        # and empty cells all the same.
        if not any(is_text(label, text.decimal) for label in store.index):
            raise Suspect
    return found


def _number_stores(
    numeric: Collection[str], spec: TableSpec, capacity: int
) -> tuple[dict[str, _Numbers], dict[tuple[str, ...], NDArray[np.float64]]]:
    """A store for each column of numbers; those of a vector are rows of one array (k, n)."""
    import numpy as np

    vectors = {
        names: np.empty((len(names), capacity))
        for names in spec.vectors
        if any(name in numeric for name in names)
    }
    places = {
        name: values[index]
        for names, values in vectors.items()
        for index, name in enumerate(names)
        if name in numeric
    }
    stores = {name: _Numbers(capacity, places.get(name)) for name in numeric}
    return stores, vectors


def _filled(
    values: NDArray[np.float64], names: tuple[str, ...], given: dict[str, _Numbers], count: int
) -> NDArray[np.float64]:
    for index, name in enumerate(names):
        if name not in given:
            values[index, :count] = float("nan")
    return values[:, :count].T


class _Numbers:
    def __init__(self, capacity: int, values: NDArray[np.float64] | None) -> None:
        self.capacity = capacity
        self.values = values
        self.first: NDArray[np.float64] | None = None

    def add(self, column: pd.Series[Any], start: int) -> None:
        import numpy as np

        values = column.to_numpy()
        if self.values is None and start == 0:
            # Most often the only one: then it need not be copied.
            self.first = np.asarray(values, np.float64)
            return
        if self.values is None:
            self.values = np.empty(self.capacity)
        if self.first is not None:
            self.values[:start] = self.first
            self.first = None
        self.values[start : start + len(values)] = values

    def whole(self, count: int) -> NDArray[np.float64]:
        import numpy as np

        if self.first is not None:
            return self.first
        return np.empty(0) if self.values is None else self.values[:count]


class _Texts:
    def __init__(self, capacity: int) -> None:
        import numpy as np

        self.codes = np.empty(capacity, np.int32)
        self.index: dict[str, int] = {}

    def add(self, column: pd.Series[Any], start: int) -> None:
        import numpy as np

        codes, labels = column.cat.codes.to_numpy(), column.cat.categories.tolist()
        index = self.index
        stripped = ["" if label == MARK else label.strip() for label in labels]
        lookup = [index.setdefault(label, len(index)) if label else -1 for label in stripped]
        # Code -1, an empty cell, picks the last entry.
        self.codes[start : start + len(column)] = np.array([*lookup, -1], np.int32)[codes]

    def whole(self, count: int) -> TextColumn:
        return _by_appearance(self.codes[:count], tuple(self.index))


def _by_appearance(codes: NDArray[np.int32], labels: tuple[str, ...]) -> TextColumn:
    """Labels in the order of their first row; the parser hands them over sorted."""
    import numpy as np
    import pandas as pd

    if len(labels) < 2:
        return TextColumn(codes, labels)
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


def _to_signs(columns: Columns, spec: TableSpec) -> None:
    """Numbers in place of the texts of columns that hold signs in words.

    Raises Suspect for a text that is no sign.
    """
    import numpy as np

    for name in spec.signs & columns.texts.keys():
        text = columns.texts.pop(name)
        signs = [direction_sign(label) for label in text.labels]
        if None in signs:
            raise Suspect
        columns.numbers[name] = np.array([*signs, np.nan], np.float64)[text.codes]


def _check_cells(columns: Columns, spec: TableSpec) -> None:
    import numpy as np

    for name, values in columns.numbers.items():
        if not _finite(values, spec.empty_allowed(name)):
            raise Suspect
        if name in spec.signs and not ((np.abs(values) == 1.0) | np.isnan(values)).all():
            raise Suspect
        if name in WHOLE and name in spec.numbers:
            ends = values.min(initial=0.0), values.max(initial=0.0)
            if max(-ends[0], ends[1]) > LARGEST_INTEGER:
                raise Suspect
    for name, text in columns.texts.items():
        if not spec.empty_allowed(name) and (text.codes < 0).any():
            raise Suspect
    for time in columns.times.values():
        if (time.microseconds == NO_TIME).any():
            raise Suspect


def _finite(values: NDArray[np.float64], empty_allowed: bool) -> bool:
    """Whether no number is infinite and, unless cells may be empty, none is nan."""
    import numpy as np

    # Both are nan where any number is: two looks at the numbers, and no array of answers.
    ends = values.min(initial=0.0), values.max(initial=0.0)
    if np.isfinite(ends).all():
        return True
    return empty_allowed and not np.isinf(values).any()
