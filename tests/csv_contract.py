"""A small CSV contract, its reader and its faults, for tests of the files floor."""

from pathlib import Path

import pytest

from mtu_cli.files.csv_file import read_table
from mtu_cli.files.headers import CellFaults, Column, Table, TableSpec
from mtu_cli.findings import InputError

SPEC = TableSpec(
    columns={
        "name": Column("text", required=True),
        "value": Column(required=True),
        "size": Column(may_be_empty=True),
        "time": Column("time"),
        "count": Column("count"),
    }
)


def table(tmp_path: Path, content: str | bytes, name: str = "t.csv") -> Table:
    data = content if isinstance(content, bytes) else content.encode()
    (tmp_path / name).write_bytes(data)
    problems = CellFaults()
    read = read_table(tmp_path / name, "lbb", SPEC, problems)
    problems.raise_if_any()
    return read


def faults(tmp_path: Path, content: str | bytes, name: str = "t.csv") -> list[str]:
    with pytest.raises(InputError) as caught:
        table(tmp_path, content, name)
    return [str(problem).removeprefix(name) for problem in caught.value.findings]


def names(read: Table, column: str = "name") -> list[str]:
    text = read.texts[column]
    return ["" if code < 0 else text.labels[code] for code in text.codes]
