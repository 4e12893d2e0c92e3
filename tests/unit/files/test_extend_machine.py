"""Effects added to machine files of every layout: nothing else changes, and all is read back."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtu_cli.files.extend_machine import (
    ExtendedMachine,
    WrittenEffect,
    extended_machine,
)
from mtu_cli.files.machine import LoadedMachine, load_machine, machine_from
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml
from mtu_cli.findings import InputError

SOURCE = Source(role="machine", path=Path("m.yaml"), shown="m.yaml", sha256="")
BACKLASH = WrittenEffect(
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
WEAR = WrittenEffect(
    name="trend-y",
    parameters={"slope": (0.1 + 0.2, 1e-17, "um"), "shift": (-5e22, 0.0, "nm")},
    covariance=[[1e-34, 0.0], [0.0, 0.0]],
    equations={"Ey": "slope*(tool_parts - 12.5) + shift"},
)
LINES = """\
- name: backlash-x
  family: backlash
  axis: x
  covariate: dir_x
  says: lost motion at reversal of x; half the reversal value
  parameters:
    lost_motion: {value: 4.1, u: 0.3333333333333333, unit: um}
  covariance: [[0.1111111111111111]]
  equations:
    Ex: lost_motion*dir_x
  found:
    files: [{path: cmm.csv, sha256: %s}]
    parts: 21
    p: 1.0e-06
""" % ("ab" * 32)
HEAD = "schema: mtu/machine/1  # the format\nname: m\ncomponents: {a: {of: x, unit: um}}\n"
TAIL = "equations: {Ex: a}   # mm\n"
OLD = "{name: e, parameters: {h: {value: 2, u: 0.1, unit: um}}, equations: {Ex: h}}"


def load(folder: Path, text: str | bytes) -> LoadedMachine:
    path = folder / "m.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_machine(path)


def indented(by: int = 2) -> str:
    return "".join(" " * by + line + "\n" for line in LINES.splitlines())


def checked(old: LoadedMachine, new: ExtendedMachine, effects: list[WrittenEffect]) -> None:
    """What was written says what was meant, and of the rest what it said."""
    again = machine_from(parse_yaml(new.content.decode("utf-8-sig"), SOURCE))
    assert again.machine == new.machine.machine
    n = len(old.machine.effects)
    assert again.machine.effects[:n] == old.machine.effects
    for entry, effect in zip(again.machine.effects[n:], effects, strict=True):
        given = [(p.value, p.u, p.unit) for p in entry.parameters.values()]
        assert given == list(effect.parameters.values())
        assert entry.covariance == effect.covariance
        assert entry.found == effect.found
    rest = {"effects", "covariates"}
    assert again.machine.model_dump(exclude=rest) == old.machine.model_dump(exclude=rest)
    assert again.machine.covariates[: len(old.machine.covariates)] == old.machine.covariates


NEW = indented()
LAYOUTS = {
    "absent": (HEAD + TAIL, HEAD + TAIL + "effects:\n" + NEW),
    "no last line end": (HEAD + TAIL[:-1], HEAD + TAIL + "effects:\n" + NEW),
    "empty, with a comment": (
        HEAD + "effects: []     # what was found\n" + TAIL,
        HEAD + "effects:     # what was found\n" + NEW + TAIL,
    ),
    "empty, at the end": (HEAD + TAIL + "effects: [ ]", HEAD + TAIL + "effects:\n" + NEW),
    "block list": (
        HEAD + f"effects:\n  - {OLD}  # old\n  # remark\n\n" + TAIL,
        HEAD + f"effects:\n  - {OLD}  # old\n" + NEW + "  # remark\n\n" + TAIL,
    ),
    "block list without indent": (
        HEAD + f"effects: # - these\n# - and\n- {OLD}\n" + TAIL,
        HEAD + f"effects: # - these\n# - and\n- {OLD}\n" + LINES + TAIL,
    ),
    "block list with a block text": (
        HEAD + "effects:\n  - name: e\n    parameters: {}\n    equations: {Ex: a}\n"
        "    says: |+\n      two\n\n      lines\n\n# remark\n" + TAIL,
        HEAD + "effects:\n  - name: e\n    parameters: {}\n    equations: {Ex: a}\n"
        "    says: |+\n      two\n\n      lines\n\n" + NEW + "# remark\n" + TAIL,
    ),
    "document marks": (
        "%YAML 1.2\n---\n" + HEAD + TAIL + "...\n# after the end\n",
        "%YAML 1.2\n---\n" + HEAD + TAIL + "effects:\n" + NEW + "...\n# after the end\n",
    ),
    "all indented": (
        "".join(f"  {line}\n" for line in (HEAD + TAIL).splitlines()),
        "".join(f"  {line}\n" for line in (HEAD + TAIL).splitlines())
        + "  effects:\n"
        + indented(4),
    ),
    "beyond ASCII": (
        HEAD + "says: µ \U0001f600 é\neffects: []\n" + TAIL,
        HEAD + "says: µ \U0001f600 é\neffects:\n" + NEW + TAIL,
    ),
}


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize(("end", "mark"), [("\n", b""), ("\r\n", b"\xef\xbb\xbf"), ("\r", b"")])
def test_layouts_stay(name: str, end: str, mark: bytes, tmp_path: Path) -> None:
    before, after = (text.replace("\n", end) for text in LAYOUTS[name])
    old = load(tmp_path, mark + before.encode())
    new = extended_machine(old, [BACKLASH])
    assert new.content == mark + after.encode()
    assert new.warnings == ()
    assert new.parameters == ("backlash-x.lost_motion",)
    checked(old, new, [BACKLASH])


@pytest.mark.parametrize(
    "text",
    [
        HEAD + "covariates: &none []\neffects: *none\n" + TAIL,
        HEAD + "effects:\n  []\n" + TAIL.replace("Ex: a", "Ex: a, Ey: 0"),
        HEAD + TAIL + "notes: |\n  a text without a line end",
        '{"schema": "mtu/machine/1", "name": "m", "equations": {"Ex": "a"},\n'
        '"components": {"a": {"of": "x", "unit": "um"}}, "effects": []\n}\n',
    ],
)
def test_other_layouts_are_kept_or_written_anew(text: str, tmp_path: Path) -> None:
    old = load(tmp_path, text)
    new = extended_machine(old, [BACKLASH, WEAR])
    checked(old, new, [BACKLASH, WEAR])
    assert new.machine.machine.covariates == ["tool_parts"]
    for warning in new.warnings:
        assert warning.code == "machine-written-anew"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "covariates: [tool_parts]\n"),
        ("covariates: []\n", "covariates: [tool_parts]\n"),
        ("covariates: [load]  # c\n", "covariates: [load, tool_parts]  # c\n"),
        ("covariates:\n- load\n", "covariates:\n- load\n- tool_parts\n"),
        ("covariates: [tool_parts]\n", "covariates: [tool_parts]\n"),
    ],
)
def test_covariates_that_are_new(before: str, after: str, tmp_path: Path) -> None:
    old = load(tmp_path, HEAD + before + TAIL)
    new = extended_machine(old, [WEAR, BACKLASH])
    checked(old, new, [WEAR, BACKLASH])
    text = new.content.decode()
    assert after in text
    assert text.startswith(HEAD + after * bool(before) + TAIL + "effects:\n  - name: trend-y\n")
    assert new.warnings == ()


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
    effect = WrittenEffect(
        name="e",
        parameters={"a": (1, 0, "um"), "a_2": (2, 0, "um")},
        equations={"Ex": "a*dir_x + 2.0e1*a_2"},
    )
    new = extended_machine(load(tmp_path, HEAD + TAIL), [effect]).machine.machine.effects[0]
    assert new.equations == {"Ex": "a_3*dir_x + 2.0e1*a_2"}


def test_no_effects_no_change(tmp_path: Path) -> None:
    old = load(tmp_path, HEAD + TAIL)
    assert extended_machine(old, []).content == (HEAD + TAIL).encode()


def test_numbers_that_json_has_not_are_null(tmp_path: Path) -> None:
    effect = WrittenEffect(
        name="e",
        parameters={"p": (1, 0, "um")},
        equations={"Ex": "p"},
        found={"p_familywise": math.nan, "rows": [math.inf, 1]},
    )
    new = extended_machine(load(tmp_path, HEAD + TAIL), [effect])
    assert new.machine.machine.effects[0].found == {"p_familywise": None, "rows": [None, 1]}


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"equations": {"Ex": "p*p"}}, "not-writable"),
        ({"parameters": {"p": (1, -1, "um")}}, "not-writable"),
        ({"covariate": "a", "equations": {"Ex": "p*a"}}, "name-taken"),
    ],
)
def test_effects_that_no_machine_can_hold(
    changes: dict[str, Any], code: str, tmp_path: Path
) -> None:
    given: dict[str, Any] = {"parameters": {"p": (1, 0, "um")}, "equations": {"Ex": "p"}}
    with pytest.raises(InputError) as caught:
        extended_machine(load(tmp_path, HEAD + TAIL), [WrittenEffect(name="e", **given | changes)])
    assert {item.code for item in caught.value.findings} == {code}


LOOKS_LIKE = (
    "1e-6", "0o17", "0x1F", "007", "no", "NULL", "~", ".inf", "-.5", "12:30", "2024-05-03", "- a",
    "a: b", "a #b", "&a", "*a", "!!int 1", "%a", "@", "`", "|", ">", "{a}", "[a", "'", '"', " a ",
    "a\nb", "\n", "\t", "\x85", "\u2028", "\ufeff", "\x07", "---", "...", "?", "=", "true", "",
)  # fmt: skip
texts = st.one_of(st.sampled_from(LOOKS_LIKE), st.text(max_size=12))
numbers = st.one_of(
    st.integers(-(10**40), 10**40), st.floats(allow_nan=False, allow_infinity=False)
)
values: st.SearchStrategy[Any] = st.recursive(
    st.one_of(texts, numbers, st.booleans(), st.none()),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text("ab1-", max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)


@settings(max_examples=100, deadline=None)
@given(found=st.dictionaries(st.text("ab1-", min_size=1, max_size=5), values, max_size=4))
def test_whatever_was_found_is_read_back(found: dict[str, Any]) -> None:
    """Equal in kind too: 1 is neither 1.0 nor true."""
    for rest in (TAIL, TAIL + f"effects: [{OLD}]\n", TAIL + f"effects:\n- {OLD}\n"):
        text = HEAD + rest
        old = machine_from(replace(parse_yaml(text, SOURCE), content=text.encode()))
        effect = WrittenEffect(
            name="e1", parameters={"p": (1, 0, "um")}, equations={"Ex": "p"}, found=found
        )
        try:
            new = extended_machine(old, [effect])
        except InputError as fault:
            # Names that no table can show, and numbers that are too large.
            codes = {item.code for item in fault.findings}
        else:
            codes = {"not-writable"}
            assert repr(new.machine.machine.effects[-1].found) == repr(found)
        assert codes == {"not-writable"}
