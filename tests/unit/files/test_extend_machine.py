"""Effects added to machine files of every layout: nothing else changes, and all is read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support import written_effect

from mtu_cli.files.extend_machine import (
    ExtendedMachine,
    extended_machine,
)
from mtu_cli.files.machine import LoadedMachine, load_machine, machine_from
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml

SOURCE = Source(role="machine", path=Path("m.yaml"), shown="m.yaml", sha256="")
BACKLASH = written_effect(
    name="backlash-x",
    family="backlash",
    axis="x",
    covariate="dir_x",
    says="lost motion at reversal of x; half the reversal value",
    parameters={"lost_motion": (4.1, 1 / 3, "um")},
    covariance=[[1 / 9]],
    equations={"Ex": "lost_motion*dir_x"},
    found={"files": [{"path": "cmm.csv", "sha256": "ab" * 32}], "parts": 21, "p": 1e-6},
)
WEAR = written_effect(
    name="trend-y",
    parameters={"slope": (0.1 + 0.2, 1e-17, "um"), "shift": (-5e22, 0.0, "nm")},
    covariance=[[1e-34, 0.0], [0.0, 0.0]],
    equations={"Ey": "slope*(tool_parts - 12.5) + shift"},
)
HEAD = "schema: mtu/machine/1  # the format\nname: m\ncomponents: {a: {of: x, unit: um}}\n"
TAIL = "equations: {Ex: a}   # mm\n"
OLD = "{name: e, parameters: {h: {value: 2, u: 0.1, unit: um}}, equations: {Ex: h}}"


def load(folder: Path, text: str | bytes) -> LoadedMachine:
    path = folder / "m.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_machine(path)


def checked(old: LoadedMachine, new: ExtendedMachine, effects: list[dict[str, Any]]) -> None:
    """What was written says what was meant, and of the rest what it said."""
    again = machine_from(parse_yaml(new.content.decode("utf-8-sig"), SOURCE))
    assert again.machine == new.machine.machine
    n = len(old.machine.effects)
    assert again.machine.effects[:n] == old.machine.effects
    for entry, effect in zip(again.machine.effects[n:], effects, strict=True):
        given = [(p.value, p.u, p.unit) for p in entry.parameters.values()]
        assert given == [(*p.values(),) for p in effect["parameters"].values()]
        assert entry.covariance == effect.get("covariance")
        assert entry.found == effect.get("found", {})
    rest = {"effects", "covariates"}
    assert again.machine.model_dump(exclude=rest) == old.machine.model_dump(exclude=rest)
    assert again.machine.covariates[: len(old.machine.covariates)] == old.machine.covariates


LAYOUTS = {
    "absent": ("", "", TAIL),
    "no last line end": ("", "", TAIL[:-1]),
    "empty, with a comment": ("", "effects: []\n", "# remark\n" + TAIL),
    "block list": ("", f"effects:\n  - {OLD}\n", "  # remark\n\n" + TAIL),
    "block list with a block text": (
        "covariates: [load]  # c\n",
        "effects:\n  - name: e\n    parameters: {}\n    equations: {Ex: a}\n"
        "    says: |+\n      two\n\n      lines\n\n",
        "# remark\n" + TAIL,
    ),
    "document marks": ("", "", TAIL + "...\n# after the end\n"),
    "beyond ASCII": ("says: µ \U0001f600 é\n", "effects: []\n", TAIL),
}
"""What stands before, within and after the effects of a file."""


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize(("end", "mark"), [("\n", b""), ("\r\n", b"\xef\xbb\xbf"), ("\r", b"")])
def test_all_else_stays(name: str, end: str, mark: bytes, tmp_path: Path) -> None:
    before, own, after = (text.replace("\n", end) for text in LAYOUTS[name])
    head = mark + HEAD.replace("\n", end).encode()
    old = load(tmp_path, head + (before + own + after).encode())
    new = extended_machine(old, [BACKLASH])
    assert new.content.startswith(head + (before + after.partition("...")[0]).encode())
    assert new.content.decode().endswith(after.partition("...")[2])
    assert new.content.count(end.encode()) == new.content.decode().count(
        "\n" if "\n" in end else end
    )
    assert new.warnings == ()
    assert new.parameters == ("backlash-x.lost_motion",)
    checked(old, new, [BACKLASH])


@pytest.mark.parametrize(
    ("text", "lost"),
    [
        ("".join(f"  {line}\n" for line in (HEAD + TAIL).splitlines()), False),
        (HEAD + "covariates: &none []\neffects: *none\n" + TAIL, True),
        (HEAD + f"effects:\n  - {OLD}  # old\n" + TAIL, True),
        (
            '{"schema": "mtu/machine/1", "name": "m", "equations": {"Ex": "a"},\n'
            '"components": {"a": {"of": "x", "unit": "um"}}, "effects": []\n}\n',
            True,
        ),
    ],
)
def test_comments_that_are_lost_are_warned_of(text: str, lost: bool, tmp_path: Path) -> None:
    old = load(tmp_path, text)
    new = extended_machine(old, [BACKLASH, WEAR])
    checked(old, new, [BACKLASH, WEAR])
    assert new.machine.machine.covariates == ["tool_parts"]
    assert [warning.code for warning in new.warnings] == ["machine-written-anew"] * lost


def test_names_get_numbers(tmp_path: Path) -> None:
    text = HEAD + "constants: {lost_motion: 3}\n" + TAIL
    first = extended_machine(load(tmp_path, text), [BACKLASH, BACKLASH])
    assert [effect.name for effect in first.machine.machine.effects] == [
        "backlash-x",
        "backlash-x-2",
    ]
    second = extended_machine(first.machine, [BACKLASH])
    last = second.machine.machine.effects[-1]
    assert last.name == "backlash-x-3"
    assert last.equations == {"Ex": "lost_motion_2*dir_x"}
    assert second.parameters == ("backlash-x-3.lost_motion_2",)
    assert second.content.startswith(first.content)
    effect = written_effect(
        name="e",
        parameters={"a": (1, 0, "um"), "a_2": (2, 0, "um")},
        equations={"Ex": "a*dir_x + 2.0e1*a_2"},
    )
    new = extended_machine(load(tmp_path, HEAD + TAIL), [effect]).machine.machine.effects[0]
    assert new.equations == {"Ex": "a_3*dir_x + 2.0e1*a_2"}
