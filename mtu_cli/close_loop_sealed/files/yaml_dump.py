"""Plain data as YAML 1.2 text, which the one reader gives back to the last digit."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import yaml

from mtu_cli.files.yaml_scalars import plain_scalar

_NO_FOLDING = 1 << 30
_ESCAPED = re.compile("[\x00-\x1f\x7f-\xa0\u2028\u2029\ufeff]")

_NO_YAML = re.compile("[\x7f-\xa0\u2028\u2029\ufeff\ufffe\uffff]")
"""What JSON takes as it is, and YAML for a line end or for no sign at all."""


class _Block(dict[str, Any]):
    """A mapping with an entry a line; all other collections stand on one line."""


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    # The library quotes what YAML 1.1 takes for a number; the reader knows others: 1e-6, 0o17.
    style = '"' if _ESCAPED.search(text) or plain_scalar(text) != text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


def _block(dumper: yaml.SafeDumper, data: _Block) -> yaml.MappingNode:
    return dumper.represent_mapping("tag:yaml.org,2002:map", data.items(), flow_style=False)


_Dumper.add_representer(str, _text)
_Dumper.add_multi_representer(float, yaml.SafeDumper.represent_float)
_Dumper.add_representer(_Block, _block)


def _dumped(data: Any) -> str:
    return yaml.dump(
        data,
        Dumper=_Dumper,
        default_flow_style=True,
        sort_keys=False,
        width=_NO_FOLDING,
        allow_unicode=True,
    )


def block_lines(data: Mapping[str, Any], depth: int = 1) -> list[str]:
    """A mapping as lines without line ends: mappings down to `depth` levels below it an entry
    a line, all else on the line of its key.
    """
    return _dumped(_blocks(data, depth)).splitlines()


def _blocks(data: Any, depth: int) -> Any:
    if not isinstance(data, Mapping) or not data or depth < 0:
        return data
    return _Block({key: _blocks(value, depth - 1) for key, value in data.items()})


def flow_text(data: Any, *, quoted: bool = False) -> str:
    """A value on one line; `quoted` writes it as JSON, which is YAML too."""
    if quoted:
        text = json.dumps(data, ensure_ascii=False, allow_nan=False)
        return _NO_YAML.sub(lambda sign: f"\\u{ord(sign[0]):04x}", text)
    # In a list, since a lone scalar would end with a document mark.
    return _dumped([data]).strip().removeprefix("[").removesuffix("]")
