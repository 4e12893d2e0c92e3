"""Names of parts and features that are one number written in several ways: 1, 01 and 1.0."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.findings import Finding

if TYPE_CHECKING:
    from mtu_cli.files.points import Points

_NUMBER = re.compile(r"([0-9]++)(?:\.0*+)?", re.ASCII)
"""Zeros before it, and none but zeros behind a point: 1.10 may be the tenth of the first."""
SHOWN = 3


def names_alike(points: Points) -> Iterator[Finding]:
    """One warning of the parts, and one of the features, that a spreadsheet may have renamed: each
    name counts as one of its own.
    """
    for column, names, codes in (
        ("part", points.parts, points.part),
        ("feature", points.features, points.feature),
    ):
        same: dict[str, list[str]] = defaultdict(list)
        for name in names:
            if found := _NUMBER.fullmatch(name):
                same[found[1].lstrip("0") or "0"].append(name)
        alike = [own for own in same.values() if len(own) > 1]
        if not alike:
            continue
        row = int(np.argmax(codes == names.index(alike[0][1])))
        told = [" and ".join(map(repr, own)) for own in alike[:SHOWN]]
        more = f", and {len(alike) - SHOWN} more such" if len(alike) > SHOWN else ""
        text = (
            f"{points.sources[points.file_index[row]].shown}, row {points.row[row]}, column "
            f"{column!r}: {', '.join(told)}{more}: the same number, counted as different {column}s;"
            " give it one name if one is meant"
        )
        yield Notice(code="names-alike", message=text)
