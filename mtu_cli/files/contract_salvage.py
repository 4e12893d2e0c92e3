"""What is sound of a document that is faulty in parts."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
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
        found, value = _attempt(_whole(model, name), data[key])
        values[name] = value if found else _salvage_items(model, name, data[key])
    return model.model_construct(**values)


def _salvage_items(model: type[BaseModel], name: str, data: Any) -> Any:
    origin = get_origin(model.model_fields[name].annotation)
    if origin is dict:
        pairs = data.items() if isinstance(data, dict) else ()
        tried = ((key, _attempt(_item(model, name), item)) for key, item in pairs)
        return {key: value for key, (found, value) in tried if found}
    if origin is list:
        items = data if isinstance(data, list) else ()
        return [_attempt(_item(model, name), item)[1] for item in items]
    return None


# Made once for every field: to make one takes ten times as long as to ask it.
@cache
def _whole(model: type[BaseModel], name: str) -> TypeAdapter[Any]:
    """Of a field's value."""
    info = model.model_fields[name]
    whole: Any = Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
    return TypeAdapter(whole)


@cache
def _item(model: type[BaseModel], name: str) -> TypeAdapter[Any]:
    """Of the values of a field's mapping, or of the items of its list."""
    return TypeAdapter(get_args(model.model_fields[name].annotation)[-1])


def _attempt(adapter: TypeAdapter[Any], data: Any) -> tuple[bool, Any]:
    try:
        return True, adapter.validate_python(data, strict=True)
    except ValidationError:
        return False, None
