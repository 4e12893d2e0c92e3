"""What is sound of a document that is faulty in parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, ValidationError

from mtu_cli.files.yaml_file import YamlPath

M = TypeVar("M", bound=BaseModel)


def without_unknown(data: Any, error: ValidationError) -> Any:
    """The document less the keys that the contract does not know."""
    unknown = {item["loc"] for item in error.errors() if item["type"] == "extra_forbidden"}

    def copy(value: Any, path: YamlPath) -> Any:
        if isinstance(value, dict):
            entries = ((key, (*path, key), item) for key, item in value.items())
            return {key: copy(item, own) for key, own, item in entries if own not in unknown}
        if isinstance(value, list):
            return [copy(item, (*path, index)) for index, item in enumerate(value)]
        return value

    return copy(data, ())


def salvage(model: type[M], data: Mapping[str, Any]) -> M:
    """The sound part of a document: faulty entries of mappings are left out, faulty items of lists
    and faulty single values are None.
    """
    values: dict[str, Any] = {}
    for name, info in model.model_fields.items():
        key = info.alias or name
        if data.get(key) is None:
            required = info.is_required()
            values[name] = None if required else info.get_default(call_default_factory=True)
            continue
        whole = Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
        found, value = _attempt(whole, data[key])
        values[name] = value if found else _salvage_items(info.annotation, data[key])
    return model.model_construct(**values)


def _salvage_items(annotation: Any, data: Any) -> Any:
    origin = get_origin(annotation)
    if origin is dict:
        item_type = get_args(annotation)[1]
        pairs = data.items() if isinstance(data, dict) else ()
        tried = ((key, _attempt(item_type, item)) for key, item in pairs)
        return {key: value for key, (found, value) in tried if found}
    if origin is list:
        item_type = get_args(annotation)[0]
        items = data if isinstance(data, list) else ()
        return [_attempt(item_type, item)[1] for item in items]
    return None


def _attempt(annotation: Any, data: Any) -> tuple[bool, Any]:
    try:
        return True, TypeAdapter(annotation).validate_python(data, strict=True)
    except ValidationError:
        return False, None
