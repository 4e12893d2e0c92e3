"""JSON reports as bytes, and back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mtu_cli.files.source import Source, check_text, read_source
from mtu_cli.findings import error, shorten

MAX_BYTES = 1 << 30
MAX_DIGITS = 300
"""Of a whole number; those of reports count readings."""


def report_bytes(document: Mapping[str, Any]) -> bytes:
    """A report as UTF-8 bytes: keys in the order given, floats to the last digit.

    Mappings stand one key a line, lists of records one record a line, other lists on one
    line, so that a report can be read and compared line by line. numpy scalars and arrays
    are written as numbers and lists.

    Raises ValueError for a number that is not finite and TypeError for what JSON cannot
    hold: both are faults of the calling program.
    """
    return (_written(_plain(document, "report"), "") + "\n").encode()


def _plain(value: Any, place: str) -> Any:
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{place} is {value}: a report holds null and a warning instead")
        return float(value)
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{place}.{key}") for key, item in value.items()}
    # A matrix has millions of these: a place is named only where one is at fault.
    if type(value) is list and set(map(type, value)) == {float} and all(map(math.isfinite, value)):
        return value
    if isinstance(value, (list, tuple)):
        return [_plain(item, f"{place}[{index}]") for index, item in enumerate(value)]
    if hasattr(value, "tolist"):
        return _plain(value.tolist(), place)
    raise TypeError(f"{place} is a {type(value).__name__}: JSON cannot hold it")


def _written(value: Any, indent: str) -> str:
    deeper = indent + "  "
    if isinstance(value, dict) and value:
        lines = [
            f"{deeper}{_compact(key)}: {_written(item, deeper)}" for key, item in value.items()
        ]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, (dict, list)) for item in value):
        lines = [deeper + _compact(item) for item in value]
        return "[\n" + ",\n".join(lines) + f"\n{indent}]"
    return _compact(value)


def _compact(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def read_json(path: Path, role: str) -> tuple[Source, Any]:
    """The values of a JSON file.

    Raises InputError for a file that cannot be read (see `read_source`), text that is not
    JSON (with line and column), NaN or Infinity, a key that stands twice in one object.
    """
    source, content = read_source(path, role, max_bytes=MAX_BYTES)
    check_text(content, source.shown)
    text = content.decode("utf-8-sig")
    try:
        data = json.loads(
            text,
            parse_constant=_refuse_constant,
            parse_int=_whole_number,
            parse_float=_finite_number,
            object_pairs_hook=_without_duplicates,
        )
    except json.JSONDecodeError as fault:
        bare = not text[: fault.pos].strip()
        why = "it is no JSON" if bare else fault.msg.lower().removesuffix(" starting at")
        expected = f"a {role} report, as -o FILE.json writes it" if bare else None
        where = {"file": source.shown, "line": fault.lineno, "column": fault.colno}
        raise error("not-json", reason=why, expected=expected, **where) from None
    except RecursionError:
        raise error("not-json", reason="nested too deeply", file=source.shown) from None
    except ValueError as fault:
        raise error("not-json", reason=str(fault), file=source.shown) from None
    return source, data


def _whole_number(text: str) -> int:
    digits = len(text.removeprefix("-"))
    if digits > MAX_DIGITS:
        raise ValueError(f"a whole number of {digits} digits is too large")
    return int(text)


def _finite_number(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(f"{shorten(text)} is too large for a number")
    return value


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number of JSON")


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [key for key, _ in pairs]
        twice = next(key for key in names if names.count(key) > 1)
        raise ValueError(f"the key {twice!r} stands twice in one object")
    return found
