"""`mtu schema`."""

from __future__ import annotations

import json

from mtu_cli.cli.options import Options
from mtu_cli.files.schemas import json_schema


def run(options: Options) -> None:
    """Prints the JSON Schema of a contract."""
    print(json.dumps(json_schema(options.kind), indent=2))
