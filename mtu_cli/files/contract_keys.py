"""Keys that a contract does not know: what was meant by each."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from mtu_cli.errors import closest, did_you_mean
from mtu_cli.files.yaml_commas import decimal_point
from mtu_cli.files.yaml_entries import COLON, as_entry, key_of
from mtu_cli.files.yaml_file import YamlDocument, YamlPath
from mtu_cli.units import UNITS

OTHER_KEYS = {"s_pass": "pass_covariance", "uncertainty": "u", "sigma": "u", "std": "u"}
"""Keys by the names that tables give what they hold."""
KEY_UNITS = {*UNITS, "m", "cm", "in", "inch", "ft", "min", "h", "s", "degC", "degF", "K"}
"""Units at the end of a key."""


def meant(key: str, known: Collection[str]) -> str | None:
    """The known key that an unknown one was probably meant to be."""
    key = key_of(key)
    own = key if key in known else None
    return own or by_other_name(key, known) or _stated_in(key, known) or closest(key, known)


def expected_key(key: str, known: Collection[str]) -> str:
    """What to write instead of an unknown key."""
    entry = as_entry(key)
    if entry is not None and meant(key, known) is not None:
        return f"'{entry}', {COLON}"
    if (other := _stated_in(key, known)) is not None:
        return f"{other!r}: in {_unit(other)}, not {_unit(key)}"
    if (other := by_other_name(key, known)) is not None:
        return f"{other!r}"
    return did_you_mean(key, known)


def by_other_name(key: str, known: Collection[str]) -> str | None:
    """A known key by another name for what it holds, or by its name without the unit."""
    with_unit = [name for name in known if name.rpartition("_")[0] == key]
    units = {_unit(name) for name in with_unit}
    names = [OTHER_KEYS.get(key), *(with_unit if units <= KEY_UNITS else ())]
    found = [name for name in names if name in known]
    return found[0] if len(found) == 1 else None


def _stated_in(key: str, known: Iterable[str]) -> str | None:
    """The key that is known with another unit at its end: not the same number."""
    stem, _, unit = key.rpartition("_")
    for other in known:
        same = other.rpartition("_")[0] == stem
        if same and stem and _unit(other) != unit and {unit, _unit(other)} <= KEY_UNITS:
            return other
    return None


def _unit(key: str) -> str:
    return key.rpartition("_")[2]


def torn_values(
    unknown: Iterable[YamlPath], known: Collection[str], document: YamlDocument
) -> dict[YamlPath, list[str]]:
    """Values of {...} that a comma has torn into keys without values, by the path of each: `in`
    and ``[P1, P2]`` of ``{in: P1, P2}``. `unknown` are the keys of one entry that have no value.
    """
    found: dict[YamlPath, list[str]] = {}
    paths = set(unknown)
    if not paths:
        return found
    parent = next(iter(paths))[:-1]
    entries = _at(document.data, parent)
    owner: YamlPath | None = None
    for key, value in entries.items():
        path = (*parent, key)
        beside = owner is not None and document.line_of(*owner) == document.line_of(*path)
        if path in paths and owner is not None and beside and meant(key, known) is None:
            found.setdefault(owner, [str(entries[str(owner[-1])])]).append(key)
        else:
            owner = path if isinstance(value, (str, int, float)) else None
    return found


@dataclass(frozen=True, slots=True)
class Decimals:
    """Entries without a value whose key follows a number on its line, `10` of ``{arm: 3,10}``; of
    a mapping all are found at once, however many entries are without a value.
    """

    document: YamlDocument
    rests: dict[YamlPath, frozenset[str]] = field(default_factory=dict)

    def point(self, path: YamlPath) -> str | None:
        """What to write instead of the entry at a path, None where it is no such rest."""
        if not path:
            return None
        *parent, key = path
        if tuple(parent) not in self.rests:
            self.rests[tuple(parent)] = frozenset(self._within(tuple(parent)))
        return decimal_point(str(key)) if key in self.rests[tuple(parent)] else None

    def _within(self, parent: YamlPath) -> Iterator[str]:
        before: object = None
        line: int | None = None
        for key, value in _at(self.document.data, parent).items():
            own = self.document.line_of(*parent, key)
            if value is not None:
                before, line = value, own
            elif isinstance(before, (int, float)) and not isinstance(before, bool) and own == line:
                yield key


def _at(data: Any, path: YamlPath) -> Mapping[str, Any]:
    for step in path:
        try:
            data = data[step]
        except (KeyError, IndexError, TypeError):
            return {}
    return data if isinstance(data, dict) else {}
