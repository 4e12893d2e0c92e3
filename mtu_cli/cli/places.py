"""Messages that say where a file is that lies outside the working folder.

Reports name such a file without its folder, wherever they are made; the files of many machines are
called the same, and whoever reads a message has to find the one that is meant.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from mtu_cli.cli.options import Options
from mtu_cli.files.source import given_path, resolved, shown_path
from mtu_cli.files.study import load_study
from mtu_cli.findings import Finding, InputError


@contextmanager
def placed_faults(options: Options) -> Iterator[None]:
    """Raises the InputError of a call anew, with the whole paths of its files."""
    try:
        yield
    except InputError as error:
        found = whole_paths(options)
        if not found:
            raise
        # One object may stand for millions of cells, and is told once as long as it is one.
        made: dict[int, Finding] = {}
        for problem in error.findings:
            if id(problem) not in made:
                made[id(problem)] = _placed(problem, found)
        raise InputError([made[id(problem)] for problem in error.findings]) from None


def _placed(problem: Finding, found: Mapping[str, str]) -> Finding:
    file = None if problem.file is None else placed_text(problem.file, found)
    facts = {
        name: placed_text(value, found) if isinstance(value, str) else value
        for name, value in problem.facts.items()
    }
    return replace(problem, file=file, facts=facts)


def whole_paths(options: Options) -> dict[str, str]:
    """The path of each file that the call or its study names and messages would call by its bare
    name. Of two that are called the same neither is there.
    """
    found: dict[str, set[Path]] = {}
    for path in _named(options):
        found.setdefault(shown_path(path), set()).add(Path(os.path.abspath(path)))
    here = resolved(Path())
    single = {name: paths.pop() for name, paths in found.items() if len(paths) == 1}
    return {
        name: given_path(path)
        for name, path in single.items()
        if name == path.name and resolved(path.parent) != here
    }


def _named(options: Options) -> Iterator[Path]:
    for value in options.values.values():
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, Path):
                yield item
    study = options.values.get("study")
    if not isinstance(study, Path):
        return
    path = study / "mtu.yaml" if study.is_dir() else study
    yield path
    try:
        files = load_study(path, there=False).files
    except InputError:
        return
    for paths in files.values():
        yield from paths


def placed_text(text: str, found: Mapping[str, str]) -> str:
    """A message with whole paths for bare names; what it quotes stays as the user wrote it."""
    if not found:
        return text
    names = "|".join(re.escape(name) for name in sorted(found, key=len, reverse=True))
    bare = re.compile(rf"(?<![\w./\\'\"-])({names})(?![\w/'\"-]|\.\w)")
    return bare.sub(lambda match: found[match[1]], text)
