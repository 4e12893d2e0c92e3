"""Cases by their number: which sample, and what is done to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from fuzz.bytes_damage import damaged_bytes, nudged_bytes
from fuzz.samples import Kind, Sample
from fuzz.table_damage import damaged_table, mildly_damaged_table
from fuzz.tree_damage import damaged_tree, mildly_damaged_tree
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml

SHARES: Mapping[Kind, int] = {
    "readings": 13, "drift": 8, "points": 14, "machine": 11, "part": 6, "study": 5, "effects": 7,
    "budget": 8, "graph": 4, "components": 2, "thermal": 2, "instrument": 10,
    "control": 7, "map": 3,
}  # fmt: skip
"""Of a hundred cases; a graph takes longest."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A damaged sample; `rng` goes on with what the reader or the command is asked for."""

    number: int
    sample: Sample
    content: bytes
    rng: Random


def generator(seed: int, task: str, number: int) -> Random:
    """The random numbers of one case, of their own whatever ran before."""
    return Random(f"{seed} {task} {number}")


def drawn_case(
    samples: Mapping[Kind, Sequence[Sample]], seed: int, number: int, kinds: Sequence[Kind] = ()
) -> Case:
    """Case `number` of the readers, of some `kinds` alone where they are given."""
    rng = generator(seed, "readers", number)
    known = kinds or [*SHARES]
    kind = rng.choices(known, [SHARES[each] for each in known])[0]
    sample = rng.choice(samples[kind])
    return Case(number=number, sample=sample, content=damaged(sample, rng), rng=rng)


def damaged(sample: Sample, rng: Random, mild: float = 0.2) -> bytes:
    """The content of a sample with its structure, its bytes, or both damaged.

    `mild` is the share of those that are damaged but little.
    """
    content = sample.content
    if not sample.structured:
        if rng.random() < 0.6:
            return nudged_bytes(content, rng)
        for _ in range(rng.choice((1, 1, 2, 4))):
            content = damaged_bytes(content, rng)
        return content
    if rng.random() < mild:
        return damaged_structure(sample, rng, mild=True).encode("utf-8", "surrogatepass")
    draw = rng.random()
    if draw < 0.75:
        content = damaged_structure(sample, rng).encode("utf-8", "surrogatepass")
    if draw > 0.6:
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            content = damaged_bytes(content, rng)
    return content


def damaged_structure(sample: Sample, rng: Random, *, mild: bool = False) -> str:
    """The text of a sample that is a table or a tree of values still."""
    text = sample.content.decode()
    if sample.form == "csv":
        return mildly_damaged_table(text, rng) if mild else damaged_table(text, rng)
    tree = mildly_damaged_tree if mild else damaged_tree
    return tree(deepcopy(_values(text)), rng, sample.form)


@cache
def _values(text: str) -> Any:
    source = Source(role="sample", path=Path(), shown="sound", sha256="")
    return parse_yaml(text, source).data
