"""Values in messages, as they are written in their file."""

from __future__ import annotations

import json
import re

from mtu_cli.files.yaml_scalars import NotFinite

_BARE = "\ue000"
"""Around a text that stands without quotation marks in a list."""
_WRITTEN = re.compile(f'"{_BARE}([^"]*?){_BARE}"')


def shown_value(value: object) -> str:
    """A value as it would be written in the file."""
    if isinstance(value, NotFinite):
        return value.text
    if isinstance(value, str):
        return value
    try:
        text = json.dumps(_marked(value), ensure_ascii=False, default=str)
    except ValueError:
        return str(value)
    return _WRITTEN.sub(r"\1", text)


def _marked(value: object) -> object:
    match value:
        case NotFinite():
            return f"{_BARE}{value.text}{_BARE}"
        case list():
            return [_marked(item) for item in value]
        case dict():
            return {key: _marked(item) for key, item in value.items()}
    return value
