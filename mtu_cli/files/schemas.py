"""JSON Schemas of the YAML contracts, for editors."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from mtu_cli.findings import error, suggestion

KINDS = {
    "machine": ("mtu_cli.files.machine_contract", "Machine"),
    "part": ("mtu_cli.files.part", "Part"),
    "study": ("mtu_cli.files.study", "Study"),
    "budget": ("mtu_cli.files.budget", "Budget"),
    "graph": ("mtu_cli.files.graph_contract", "Graph"),
    "effects": ("mtu_cli.files.effects", "Effects"),
}
"""Module and model of each kind; the modules are imported when asked for."""


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of ``mtu/<kind>/1``; InputError where there is no such."""
    if kind not in KINDS:
        raise error("unknown-name", what="schema", value=kind, **suggestion(kind, KINDS))
    module, name = KINDS[kind]
    schema: dict[str, Any] = getattr(import_module(module), name).model_json_schema(by_alias=True)
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"mtu/{kind}/1"}
    return head | schema | {"title": f"mtu {kind}"}
