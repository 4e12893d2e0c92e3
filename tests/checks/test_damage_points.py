"""What the checks find of damages to points, parts and machines, and that sound ones pass."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from checks.damage import DRAWS, counted
from checks.damage_points import DAMAGES, Case, draws, written
from mtu_cli import checks
from mtu_cli.files.machine import load_machine
from mtu_cli.files.part import load_part
from mtu_cli.files.readings import read_points
from mtu_cli.findings import InputError

FEWER = {"coefficients in mm": 0}
"""Found of DRAWS, where these are fewer than all."""


@cache
def read_once(load: Callable[[Path], Any], path: Path, content: bytes) -> Any:
    """Of parts and machines few are damaged."""
    return load(path)


def judged(case: Case, folder: Path) -> list[tuple[str, str]]:
    points, part, machine = written(case, folder)
    try:
        loaded = read_once(load_machine, machine, machine.read_bytes())
        places = read_once(load_part, part, part.read_bytes())
        travels = loaded.machine.travels
        found = checks.run("machine", checks.DocumentData(loaded, travels))
        found += checks.run("part", checks.DocumentData(places, travels))
        table = read_points([(points, "cmm")], places.part.places())
        found += checks.run("points", checks.PointsData(table, places, travels))
    except InputError as error:
        found = list(error.findings)
    return [(each.code, each.message) for each in found]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, Case, Case]]:
    return list(draws(tmp_path_factory.mktemp("damage")))


def test_damages_are_found_and_named(drawn: list[tuple[str, Case, Case]], tmp_path: Path) -> None:
    kinds = {kind: damage.words for kind, damage in DAMAGES.items()}
    counts = counted(kinds, ((kind, judged(case, tmp_path)) for kind, _, case in drawn))
    fewer = {kind for kind in DAMAGES if counts[kind]["found"] < FEWER.get(kind, DRAWS)}
    assert not fewer, counts


def test_sound_points_raise_no_alarm(drawn: list[tuple[str, Case, Case]], tmp_path: Path) -> None:
    sound = {id(case): case for _, case, _ in drawn}
    assert [found for case in sound.values() for found in judged(case, tmp_path)] == []
