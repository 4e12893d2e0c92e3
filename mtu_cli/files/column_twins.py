"""Columns that differ from one of the contract by capital letters only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mtu_cli.files.contracts import Notice
from mtu_cli.files.csv_table import Table, TableSpec


def column_twins(tables: Iterable[Table], spec: TableSpec) -> Iterator[Notice]:
    """One warning a column: of `error` and `Error` the first alone is read, and a reader of the
    table may take the other for it.
    """
    for table in tables:
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
