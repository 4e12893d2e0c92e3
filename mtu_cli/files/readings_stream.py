"""Readings of files that are larger than memory, block by block."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.errors import InputError
from mtu_cli.files import joined
from mtu_cli.files.copied_files import FEWEST_COPIED, reading_marks
from mtu_cli.files.covariate_survey import Survey, survey
from mtu_cli.files.csv_file import numbers_at_all, table_from
from mtu_cli.files.csv_frames import Suspect
from mtu_cli.files.csv_stream import text_blocks
from mtu_cli.files.csv_table import ProblemList, Table, TableSpec
from mtu_cli.files.csv_text import CsvText
from mtu_cli.files.doubled import copied_files, lasting_marks, tells_repeats_apart
from mtu_cli.files.drift_notes import OUT_OF_ORDER
from mtu_cli.files.in_order import in_order
from mtu_cli.files.mixed_cells import MixedCells
from mtu_cli.files.mixed_units import UnitRows
from mtu_cli.files.reading_cells import Travels
from mtu_cli.files.reading_sizes import may_be_mistaken
from mtu_cli.files.readings import (
    SPEC,
    ComponentLike,
    Readings,
    assemble,
    check_cells,
    read_readings,
)
from mtu_cli.files.row_marks import AllMarks, in_ascending_order
from mtu_cli.files.small_readings import SmallReadings
from mtu_cli.files.source import DRIFT, Digest, RunningDigest, Source

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Marks = NDArray[np.uint64]


def stream_readings(
    files: Sequence[tuple[Path, str]],
    components: Mapping[str, ComponentLike] | None,
    travels: Travels | None = None,
) -> ReadingsStream:
    """All readings of `files`, (path, role), in their order, some ten thousand at a time.

    Holds what `read_readings` holds, with its checks and messages, in bounded memory: 8 bytes
    a reading where rows could stand twice (16 with several files), and some blocks. Files with
    dates, or with covariates that are neither temperatures nor known numbers, are read twice.

    A file at fault, or too odd for single blocks (drifts that most machines do not have, as of a
    probe that stands off), is read as a whole; a fault that shows late is raised after the blocks
    before it.

    Raises InputError with all problems, as `read_readings` does, while it is iterated over.
    """
    if not files:
        raise ValueError("no files to read")
    return ReadingsStream(files, components, travels)


class ReadingsStream(Iterator[Readings]):
    """Blocks of readings in the order of the files and rows, once through.

    Codes mean the same in all blocks. `components` are the machine's, read or not, in its
    order; without a machine, and for `cycles`, a later block may know more than an earlier
    one. `sources` of a block lack rows and hash.
    """

    def __init__(
        self,
        files: Sequence[tuple[Path, str]],
        components: Mapping[str, ComponentLike] | None,
        travels: Travels | None = None,
    ) -> None:
        self._files = tuple(files)
        self._machine = components
        self._travels = travels or {}
        self._components = _Labels(components or ())
        self._cycles = _Labels(())
        self._blocks = self._all()
        self._sources: tuple[Source, ...] = ()
        self._out_of_order: set[int] = set()
        self._units = UnitRows()
        self._small = SmallReadings()
        self._mixed = MixedCells(SPEC)

    def __next__(self) -> Readings:
        return next(self._blocks)

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files with rows and hash, once all blocks are read; none before."""
        return self._sources

    def _all(self) -> Iterator[Readings]:
        """All blocks; the last waits for what the files as a whole tell, which goes with it."""
        done = 0
        held = None
        try:
            for block in self._sound():
                if held is not None:
                    yield held
                    done += len(held)
                held = block
            if held is not None:
                of_all = (*self._units.notes(), *self._small.notes(), *self._mixed.notes())
                yield replace(held, notes=(*held.notes, *of_all))
        except (Suspect, InputError, OSError):
            whole = read_readings(self._files, self._machine, for_fit=False, travels=self._travels)
            self._sources = whole.sources
            if done < len(whole):
                yield self._rest(whole, done)

    def _sound(self) -> Iterator[Readings]:
        """Raises Suspect, InputError or OSError where reading as a whole has to tell."""
        known = survey(self._files, SPEC)
        sources: list[Source] = []
        marks: list[Marks] = []
        for index, (path, role) in enumerate(self._files):
            file = _File()
            copied = array("Q")
            work = partial(_checked, known.specs[index], self._machine, self._travels)
            for block in in_order(work, text_blocks(path, role)):
                file.add(block)
                if len(block.table):
                    self._units.add(block.table)
                    self._small.add(block.table)
                    self._mixed.add(block.table)
                    readings = self._readings(block.table, index, known)
                    if len(self._files) > 1:
                        copied.frombytes(reading_marks(readings).tobytes())
                    yield readings
            sources.append(file.finished(known.sources[index]))
            marks.append(in_ascending_order(copied))
        if len({source.sha256 for source in sources}) < len(sources):
            raise Suspect
        if len(marks) > 1 and copied_files(marks, FEWEST_COPIED):
            raise Suspect
        self._sources = tuple(sources)

    def _readings(self, table: Table, index: int, known: Survey) -> Readings:
        problems = ProblemList()
        found = assemble([table], self._machine, problems)
        if problems.listed:
            raise Suspect
        times = table.columns.times.get("time")
        minutes = found.time_min
        if times is not None and known.earliest is not None:
            minutes = (times.microseconds - known.earliest) / joined.MINUTE
        # Of times out of order each block knows other rows: one row of a file is enough.
        told = index in self._out_of_order
        notes = tuple(n for n in found.notes if not (told and n.code == OUT_OF_ORDER))
        if any(note.code == OUT_OF_ORDER for note in notes):
            self._out_of_order.add(index)
        return replace(
            self._recoded(found, found),
            notes=notes,
            time_min=minutes,
            covariates=joined.covariates([table], known.covariates, known.texts),
            file_index=np.broadcast_to(np.int64(index), len(table)),
            sources=known.sources,
            roles=tuple(role for _, role in self._files),
        )

    def _rest(self, whole: Readings, done: int) -> Readings:
        """What is left of readings of which some were given already."""
        values = {item.name: getattr(whole, item.name) for item in fields(whole)}
        arrays: dict[str, Any] = {
            name: value[done:] for name, value in values.items() if isinstance(value, np.ndarray)
        }
        covariates = {name: values[done:] for name, values in whole.covariates.items()}
        return self._recoded(replace(whole, **arrays, covariates=covariates), whole)

    def _recoded(self, readings: Readings, labels: Readings) -> Readings:
        code = self._components.recoded(labels.components, readings.code)
        cycle = self._cycles.recoded(labels.cycles, readings.cycle)
        return replace(
            readings,
            components=self._components.labels,
            code=code,
            cycles=self._cycles.labels,
            cycle=cycle,
        )


class _Labels:
    """Texts and their codes, which stay as they are when more texts come."""

    def __init__(self, known: Iterable[str]) -> None:
        self._index = {label: code for code, label in enumerate(known)}

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(self._index)

    def recoded(self, labels: Sequence[str], codes: NDArray[Any]) -> NDArray[Any]:
        index = self._index
        lookup = [index.setdefault(label, len(index)) for label in labels]
        if lookup == list(range(len(lookup))):
            return codes
        found: NDArray[np.int64] = np.array([*lookup, -1], np.int64)[codes]
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Block:
    """Sound rows, and their marks where equal rows would be one row twice.

    `numeric` tells for each covariate of texts what `numbers_at_all` found.
    """

    table: Table
    digest: Digest | RunningDigest
    marks: Marks | None
    numeric: dict[str, tuple[bool, bool]]


def _checked(
    spec: TableSpec,
    components: Mapping[str, ComponentLike] | None,
    travels: Travels,
    text: CsvText,
) -> _Block:
    """The rows of a text; raises Suspect where any of them is at fault, or may be."""
    problems = ProblemList()
    table = table_from(text, spec, problems)
    check_cells(table, components, problems)
    if problems.listed or (
        table.source.role == DRIFT and may_be_mistaken(table, components, travels)
    ):
        raise Suspect
    return _Block(
        table=table,
        digest=text.digest,
        marks=lasting_marks(table) if tells_repeats_apart(table) else None,
        numeric={
            name: numbers_at_all(column.labels, text.decimal)
            for name, column in table.columns.texts.items()
            if SPEC.kind(name) == "covariate" and column.labels
        },
    )


class _File:
    """What its blocks tell of a file as a whole."""

    def __init__(self) -> None:
        self._rows = 0
        self._marks = AllMarks()
        self._numeric: dict[str, tuple[bool, bool]] = {}
        self._digest: Digest | RunningDigest | None = None

    def add(self, block: _Block) -> None:
        self._rows += len(block.table)
        self._digest = block.digest
        if block.marks is not None:
            self._marks.add(block.marks)
        for name, (any_is, all_are) in block.numeric.items():
            before = self._numeric.get(name, (False, True))
            self._numeric[name] = (before[0] or any_is, before[1] and all_are)

    def finished(self, source: Source) -> Source:
        """The file with rows and hash; raises Suspect where it is not sound as a whole."""
        doubled = self._marks.any_twice()
        unsound = any(all(found) for found in self._numeric.values())
        if self._digest is None or not self._rows or doubled or unsound:
            raise Suspect
        return replace(source, rows=self._rows, sha256=self._digest.hexadecimal())
