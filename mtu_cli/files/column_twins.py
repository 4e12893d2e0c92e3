"""Columns that may be meant as one of the contract: by their letters, or as a count."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mtu_cli.files.contracts import Notice
from mtu_cli.files.csv_header import DRIFT, may_count
from mtu_cli.files.csv_table import Table, TableSpec

COUNTS = ("repeat", "pass")


def column_twins(tables: Iterable[Table], spec: TableSpec) -> Iterator[Notice]:
    """One warning a column: of `error` and `Error` the first alone is read, and a reader of the
    table may take the other for it; a `Run` may be the repeat, or the pass.
    """
    for table in tables:
        counts = [name for name in COUNTS if name in spec.names][:1]
        if table.source.role != DRIFT and not {*counts} & {*table.header}:
            yield from _counted(table, counts)
        named = {name.casefold(): name for name in table.header if spec.named(name)}
        for other in table.covariates:
            own = named.get(other.casefold())
            if own is not None:
                text = (
                    f"{table.source.shown}, row {table.header_row}: the column {other!r} is not "
                    f"used as {own!r}, from which it differs by capital letters alone: remove it, "
                    "or give it a name of its own"
                )
                yield Notice(code="columns-alike", message=text)


def _counted(table: Table, counts: list[str]) -> Iterator[Notice]:
    for other in table.covariates:
        if may_count(other):
            for own in counts:
                text = (
                    f"{table.source.shown}, row {table.header_row}: the column {other!r} is not "
                    f"used as {own!r}: rename it where it numbers these"
                )
                yield Notice(code="column-not-used", message=text)
