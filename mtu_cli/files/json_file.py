"""JSON reports as bytes, and back."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mtu_cli.files.source import Source, check_text, read_source
from mtu_cli.findings import error, shorten

MAX_BYTES = 1 << 30


def report_bytes(document: Mapping[str, Any]) -> bytes:
    """A report as UTF-8 bytes: keys in the order given, floats to the last digit.

    Mappings stand one key a line, lists of records one record a line, other lists on one
    line, so that a report can be read and compared line by line. numpy scalars and arrays
    are written as numbers and lists.

    Raises ValueError for a number that is not finite and TypeError for what JSON cannot
    hold: both are faults of the calling program.
    """
    return (_written(document, "", "report") + "\n").encode()


def _written(value: Any, indent: str, place: str) -> str:
    deeper = indent + "  "
    if isinstance(value, Mapping) and value:
        lines = [
            f"{deeper}{_compact(str(key))}: {_written(item, deeper, f'{place}.{key}')}"
            for key, item in value.items()
        ]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    value = value.tolist() if hasattr(value, "tolist") else value
    try:
        if isinstance(value, (list, tuple)) and any(map(_is_compound, value)):
            return "[\n" + ",\n".join(deeper + _compact(item) for item in value) + f"\n{indent}]"
        return _compact(value)
    except (TypeError, ValueError) as fault:
        raise type(fault)(f"{place}: {fault}") from None


def _is_compound(value: Any) -> bool:
    return isinstance(value, (Mapping, list, tuple)) or getattr(value, "ndim", 0) > 0


def _compact(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"JSON cannot hold a {type(value).__name__}")


def read_json(path: Path, role: str) -> tuple[Source, Any]:
    """The values of a JSON file.

    Raises InputError for a file that cannot be read (see `read_source`), text that is not
    JSON (with line and column), NaN or Infinity, a key that appears twice in one object.
    """
    source, content = read_source(path, role, max_bytes=MAX_BYTES)
    check_text(content, source.shown)
    text = content.decode("utf-8-sig")
    place: dict[str, Any] = {"file": source.shown}
    try:
        data = json.loads(
            text,
            parse_constant=_number,
            parse_int=_number,
            parse_float=_number,
            object_pairs_hook=_without_duplicates,
        )
    except json.JSONDecodeError as fault:
        place |= {"line": fault.lineno, "column": fault.colno}
        why = fault.msg.lower().removesuffix(" starting at")
        if not text[: fault.pos].strip():
            why, place["expected"] = "it is no JSON", f"a {role} report, as -o FILE.json writes it"
        raise error("not-readable", reason=why, **place) from None
    except (RecursionError, ValueError) as fault:
        why = "it is nested too deeply" if isinstance(fault, RecursionError) else str(fault)
        raise error("not-readable", reason=why, **place) from None
    return source, data


def _number(text: str) -> int | float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{shorten(text)} is no finite number")
    return int(text) if text.removeprefix("-").isdecimal() else value


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) < len(pairs):
        name = next(key for key, n in Counter(key for key, _ in pairs).items() if n > 1)
        raise ValueError(f"the key {name!r} appears twice in one object")
    return values
