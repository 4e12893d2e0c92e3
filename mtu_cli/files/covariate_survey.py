"""What single blocks of long files cannot tell: which covariates are texts, when time starts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mtu_cli.files.csv_file import table_from
from mtu_cli.files.csv_frames import Suspect
from mtu_cli.files.csv_header import check_header
from mtu_cli.files.csv_stream import text_blocks
from mtu_cli.files.csv_table import ProblemList, Table, TableSpec
from mtu_cli.files.csv_text import CsvText
from mtu_cli.files.in_order import in_order
from mtu_cli.files.source import Source


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """What holds for all blocks of all files; arrays of files in their order.

    `specs` name as texts the covariates that are texts anywhere in their file, `covariates`
    are those of all files, `texts` those that are texts in any. `earliest` is the first time,
    in microseconds, None where no times are given. `sources` lack rows and hash.
    """

    sources: tuple[Source, ...]
    specs: tuple[TableSpec, ...]
    covariates: tuple[str, ...]
    texts: frozenset[str]
    earliest: int | None


def survey(files: Sequence[tuple[Path, str]], spec: TableSpec) -> Survey:
    """Looks at the headers of (path, role), and through files whose header does not tell all.

    Temperatures and minutes tell all by their names: such files are read once. Dates, and
    covariates that may be numbers or texts, take a reading of their own.

    Raises Suspect, or InputError, where only reading the files as a whole can say what is
    wrong.
    """
    heads = [_head(path, role, spec) for path, role in files]
    dated = ["time" in head.header for head in heads]
    if any(dated) and any("time_min" in head.header for head in heads):
        raise Suspect
    texts: list[frozenset[str]] = []
    earliest: int | None = None
    aware: set[bool] = set()
    for (path, role), head in zip(files, heads, strict=True):
        free = {name for name in head.header if spec.kind(name) == "covariate"}
        found: set[str] = set()
        for table in _tables(path, role, spec) if free or "time" in head.header else ():
            found |= free.intersection(table.columns.texts)
            for column in table.columns.times.values():
                first = int(column.microseconds.min())
                earliest = first if earliest is None else min(earliest, first)
                aware.add(column.aware)
        texts.append(frozenset(found))
    if len(aware) > 1:
        raise Suspect
    names = (name for head in heads for name in head.header if not spec.named(name))
    return Survey(
        sources=tuple(head.source for head in heads),
        specs=tuple(_with_texts(spec, found) for found in texts),
        covariates=tuple(dict.fromkeys(names)),
        texts=frozenset().union(*texts),
        earliest=earliest,
    )


def _head(path: Path, role: str, spec: TableSpec) -> CsvText:
    for text in text_blocks(path, role):
        check_header(text, spec)
        return text
    raise Suspect


def _tables(path: Path, role: str, spec: TableSpec) -> Iterator[Table]:
    def read(text: CsvText) -> Table:
        problems = ProblemList()
        table = table_from(text, spec, problems)
        if problems.listed:
            raise Suspect
        return table

    return (table for table in in_order(read, text_blocks(path, role)) if len(table))


def _with_texts(spec: TableSpec, names: frozenset[str]) -> TableSpec:
    return replace(spec, texts=spec.texts | names, may_be_empty=spec.may_be_empty | names)
