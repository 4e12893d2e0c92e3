"""What a contract says of the place of a value, and in words what belongs there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from mtu_cli.files.yaml_entries import as_entry
from mtu_cli.files.yaml_file import YamlPath

NAMED_BY = ("id", "name", "feature", "component", "key")
"""Keys that hold the name of an entry where entries stand in a list."""
FILES = (".csv", ".csv.gz", ".txt", ".xlsx", ".json", ".yaml", ".yml")
EXAMPLES: dict[Any, str] = {float: "[1.2, 1.5]", int: "[1, 2]", str: "[first, second]"}
"""Lists by what their items are."""
WORDS = ("says", "notes")
SHOWN_KEYS = 3
LONGEST = 40
"""Characters of an item that a hint repeats."""


def annotation_at(model: type[BaseModel], loc: YamlPath) -> Any:
    """The type of what stands at a path of a contract's document; None where it has none."""
    annotation: Any = model
    for step in loc:
        annotation = _step(annotation, step)
    return _bare(annotation)


def lists_texts(model: type[BaseModel], path: YamlPath) -> bool:
    """Whether the items of a list are texts: a name may look like a number."""
    return annotation_at(model, (*path, 0)) is str


def holds_commas(model: type[BaseModel], path: YamlPath) -> bool:
    """Whether a list or a text that may hold a comma belongs at a path."""
    annotation = annotation_at(model, path)
    if get_origin(annotation) is Literal:
        return any("," in str(item) for item in get_args(annotation))
    return annotation is str or get_origin(annotation) in (list, tuple)


def keys_at(model: type[BaseModel], loc: YamlPath) -> list[str]:
    """The keys that an entry may have."""
    return list(_fields(annotation_at(model, loc)))


def stands_elsewhere(model: type[BaseModel], loc: YamlPath) -> str | None:
    """Where a key belongs that stands in an entry which has no such key, if the contract says."""
    told: Mapping[str, str] = getattr(annotation_at(model, loc[:-1]), "elsewhere", {})
    return told.get(str(loc[-1]))


def expected_list(given: object, annotation: Any) -> str:
    """What to write instead of a value that stands where a list belongs."""
    item = _bare(_step(annotation, 0))
    if isinstance(given, Mapping):
        return _expected_entries(given, item)
    if isinstance(given, str) and given.lower().endswith(FILES) and item is not str:
        return f"a list such as {_example(item)}: no file is read here"
    if isinstance(given, str) and item is str and "," not in given and len(given) <= LONGEST:
        return f"a list: [{given}]"
    return f"a list such as {_example(item)}"


def _expected_entries(given: Mapping[str, object], item: Any) -> str:
    """A list of entries instead of one entry, or of entries by their names."""
    known = _fields(item)
    if not known:
        return f"a list such as {_example(item)}"
    first = next(iter(given), "")
    if first in known:
        return f"a list: a dash before the entry, '- {{{first}: ...}}'"
    name = next((key for key in NAMED_BY if key in known), None)
    own = f"{name}: {first}, " if name else ""
    return f"a list: '- {{{own}...}}' instead of '{first}: {{...}}'"


def _example(item: Any) -> str:
    if get_origin(item) is list:
        return f"[{_example(_bare(_step(item, 0)))}, ...]"
    if known := _fields(item):
        return f"'- {_keys(known)}'"
    if get_origin(item) is Literal:
        return f"[{', '.join(map(str, get_args(item)[:2]))}]"
    return EXAMPLES.get(item, "[..., ...]")


def expected_keys(given: object, annotation: Any) -> str:
    """What to write instead of a value that stands where keys with values belong."""
    if isinstance(given, list):
        if hint := _not_a_list(given):
            return f"keys with values: {hint}"
        if given and all(isinstance(item, dict) and len(item) == 1 for item in given):
            return "keys with values, without the dashes before them"
    if isinstance(given, str) and (entry := as_entry(given)):
        return f"keys with values, such as '{entry}': a colon and a blank behind each key"
    known = _fields(annotation)
    if known:
        return f"keys with values: {_keys(known)}"
    return f"keys with values{_of_every_name(given, annotation)}"


def _of_every_name(given: object, annotation: Any) -> str:
    """How one value for all is written where each name has its own."""
    item = _bare(_step(annotation, ""))
    numbers = item is float or (get_origin(item) is list and _bare(_step(item, 0)) is float)
    plain = isinstance(given, (int, float)) and not isinstance(given, bool)
    if not numbers or not (plain or isinstance(given, list)):
        return ""
    text = str(given)
    return f": {{NAME: {text}}}" if len(text) <= LONGEST else ""


def _keys(known: Mapping[str, bool]) -> str:
    """An entry of a contract, ``{from: ..., to: ...}``: what it must have, else what it may."""
    said = [key for key in known if key not in WORDS]
    named = [key for key in said if known[key]] or said
    more = ", ..." if len(named) > SHOWN_KEYS else ""
    return "{" + ", ".join(f"{key}: ..." for key in named[:SHOWN_KEYS]) + more + "}"


def _not_a_list(given: list[Any]) -> str:
    """What belongs in the place of a list: its first item under its name, where it has one."""
    first = given[0] if given and isinstance(given[0], dict) else {}
    for key in NAMED_BY:
        if isinstance(name := first.get(key), str | int):
            return f"'{name}: {{...}}' instead of '- {{{key}: {name}, ...}}'"
    return ""


def _fields(annotation: Any) -> dict[str, bool]:
    """The keys of an entry, and whether it must have them; none where it is no entry."""
    return {key: info.is_required() for key, _, info in _named_fields(annotation)}


def _named_fields(annotation: Any) -> Iterator[tuple[str, str, Any]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for name, info in annotation.model_fields.items():
            yield info.alias or name, name, info


def _step(annotation: Any, step: str | int) -> Any:
    annotation = _bare(annotation)
    for key, name, info in _named_fields(annotation):
        if step in (key, name):
            return info.annotation
    if get_origin(annotation) is dict:
        return get_args(annotation)[1]
    if get_origin(annotation) is list:
        return get_args(annotation)[0]
    return None


def _bare(annotation: Any) -> Any:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _bare(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return _bare(next(part for part in get_args(annotation) if part is not type(None)))
    return annotation
