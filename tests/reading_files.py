"""Drift readings as the command reads them: all files in one block."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from mtu_cli.files.readings import ComponentLike, Readings, read_readings


def stream_readings(
    files: Sequence[tuple[Path, str]], components: Mapping[str, ComponentLike] | None
) -> Iterator[Readings]:
    yield read_readings(files, components, for_fit=False)
