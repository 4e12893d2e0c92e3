"""CSV tables as rows of texts, to read what a command wrote and to write what it shall read."""

from __future__ import annotations

import csv
from pathlib import Path

Rows = list[dict[str, str]]


def rows_of(text: str) -> Rows:
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def write(path: Path, rows: Rows) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path
