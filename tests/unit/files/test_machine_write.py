"""Effects added to machine files of every layout: nothing else changes, and all is read back."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtu_cli.close_loop_sealed.files.machine_write import (
    ExtendedMachine,
    WrittenEffect,
    extended_machine,
)
from mtu_cli.errors import InputError
from mtu_cli.files.machine import LoadedMachine, load_machine, machine_from
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml

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
BACKLASH_LINES = [
    "- name: backlash-x",
    "  family: backlash",
    "  axis: x",
    "  covariate: dir_x",
    "  says: lost motion at reversal of x; half the reversal value",
    "  parameters:",
    "    lost_motion: {value: 4.1, u: 0.3333333333333333, unit: um}",
    "  covariance: [[0.1111111111111111]]",
    "  equations:",
    "    Ex: lost_motion*dir_x",
    "  found:",
    f"    files: [{{path: cmm.csv, sha256: {'ab' * 32}}}]",
    "    parts: 21",
    "    p: 1.0e-06",
]
HEAD = "schema: mtu/machine/1  # the format\nname: m\ncomponents: {a: {of: x, unit: um}}\n"
TAIL = "equations: {Ex: a}   # mm\n"
OLD = "{name: e, parameters: {h: {value: 2, u: 0.1, unit: um}}, equations: {Ex: h}}"


def load(folder: Path, text: str | bytes) -> LoadedMachine:
    path = folder / "m.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_machine(path)


def indented(lines: list[str], by: int = 2, end: str = "\n") -> str:
    return "".join(" " * by + line + end for line in lines)


def checked(old: LoadedMachine, new: ExtendedMachine, effects: list[WrittenEffect]) -> None:
    """What was written says what was meant, and of the rest what it said."""
    text = new.content.decode("utf-8-sig")
    again = machine_from(parse_yaml(text, Source(role="m", path=Path("m"), shown="m", sha256="")))
    assert again.machine == new.machine.machine
    n = len(old.machine.effects)
    assert again.machine.effects[:n] == old.machine.effects
    for entry, effect in zip(again.machine.effects[n:], effects, strict=True):
        given = [(p.value, p.u, p.unit) for p in entry.parameters.values()]
        assert given == list(effect.parameters.values())
        assert entry.covariance == effect.covariance
        assert entry.found == effect.found
        assert (entry.family, entry.axis, entry.says) == (effect.family, effect.axis, effect.says)
    rest = {"effects", "covariates"}
    assert again.machine.model_dump(exclude=rest) == old.machine.model_dump(exclude=rest)
    assert again.machine.covariates[: len(old.machine.covariates)] == old.machine.covariates


NEW = indented(BACKLASH_LINES)
LAYOUTS = {
    "absent": (HEAD + TAIL, HEAD + TAIL + "effects:\n" + NEW),
    "no last line end": (HEAD + TAIL[:-1], HEAD + TAIL + "effects:\n" + NEW),
    "empty, with a comment": (
        HEAD + "effects: []     # what was found\n" + TAIL,
        HEAD + "effects:     # what was found\n" + NEW + TAIL,
    ),
    "empty, at the end": (HEAD + TAIL + "effects: [ ]", HEAD + TAIL + "effects:\n" + NEW),
    "empty, on the next line": (
        HEAD + "effects:\n  []\n" + TAIL,
        HEAD + "effects:\n\n" + NEW + TAIL,
    ),
    "empty, with an anchor": (
        HEAD + "effects: &found []\n" + TAIL,
        HEAD + "effects: &found\n" + NEW + TAIL,
    ),
    "block list": (
        HEAD + f"effects:\n  - {OLD}  # old\n  # remark\n\n" + TAIL,
        HEAD + f"effects:\n  - {OLD}  # old\n" + NEW + "  # remark\n\n" + TAIL,
    ),
    "block list without indent": (
        HEAD + f"effects: # - these\n# - and\n- {OLD}\n" + TAIL,
        HEAD + f"effects: # - these\n# - and\n- {OLD}\n" + indented(BACKLASH_LINES, 0) + TAIL,
    ),
    "block list, far in": (
        HEAD + f"effects: &e\n      -   {OLD}\n" + TAIL,
        HEAD + f"effects: &e\n      -   {OLD}\n" + indented(BACKLASH_LINES, 6) + TAIL,
    ),
    "block list with a block text": (
        HEAD + "effects:\n  - name: e\n    parameters: {}\n    equations: {Ex: a}\n"
        "    says: |+\n      two\n\n      lines\n\n# remark\n" + TAIL,
        HEAD + "effects:\n  - name: e\n    parameters: {}\n    equations: {Ex: a}\n"
        "    says: |+\n      two\n\n      lines\n\n" + NEW + "# remark\n" + TAIL,
    ),
    "quoted key": (
        HEAD + f"'effects':\n  - {OLD}\n" + TAIL,
        HEAD + f"'effects':\n  - {OLD}\n" + NEW + TAIL,
    ),
    "document marks": (
        "%YAML 1.2\n---\n" + HEAD + TAIL + "...\n# after the end\n",
        "%YAML 1.2\n---\n" + HEAD + TAIL + "effects:\n" + NEW + "...\n# after the end\n",
    ),
    "a folded text last": (
        HEAD + TAIL + "notes: >\n  a\n  b\n\n\n# end",
        HEAD + TAIL + "notes: >\n  a\n  b\n\n\neffects:\n" + NEW + "# end",
    ),
    "a text without a line end": (
        HEAD + TAIL + "notes: |\n  text",
        HEAD + TAIL + "effects:\n" + NEW + "notes: |\n  text",
    ),
    "all indented": (
        indented((HEAD + TAIL).splitlines()),
        indented((HEAD + TAIL).splitlines()) + "  effects:\n" + indented(BACKLASH_LINES, 4),
    ),
    "aliases elsewhere": (
        HEAD.replace("{of", "&a {of") + "effects: []\n" + TAIL.replace("}", ", Ey: 0}"),
        HEAD.replace("{of", "&a {of") + "effects:\n" + NEW + TAIL.replace("}", ", Ey: 0}"),
    ),
    "beyond ASCII": (
        HEAD + "says: µ \U0001f600 é\neffects: []\n" + TAIL,
        HEAD + "says: µ \U0001f600 é\neffects:\n" + NEW + TAIL,
    ),
}


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_layouts_stay(name: str, end: str, mark: bytes, tmp_path: Path) -> None:
    before, after = (text.replace("\n", end) for text in LAYOUTS[name])
    old = load(tmp_path, mark + before.encode())
    new = extended_machine(old, [BACKLASH])
    assert new.content == mark + after.encode()
    assert new.warnings == ()
    assert new.parameters == ("backlash-x.lost_motion",)
    checked(old, new, [BACKLASH])


FLOW = "{name: backlash-x, parameters: {p: {value: 1, u: 0.5, unit: um}}, equations: {Ex: p*dir_x}}"
SHORT = WrittenEffect(
    name="backlash-x", parameters={"p": (1, 0.5, "um")}, equations={"Ex": "p*dir_x"}
)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (f"[{OLD}]  # c", f"[{OLD},\n          {FLOW}]  # c"),
        (f"[{OLD},]", f"[{OLD},\n          {FLOW}]"),
        (f"[\n  {OLD}, # a, b\n  ]", f"[\n  {OLD}, # a, b\n          {FLOW}\n  ]"),
        (f"[\n  {OLD} # a, b\n  # c\n ]", f"[\n  {OLD}, # a, b\n  # c\n          {FLOW}\n ]"),
        ("[ # none yet\n ]", f"[ # none yet\n          {FLOW}\n ]"),
        (f"!!seq [{OLD}]", f"!!seq [{OLD},\n                {FLOW}]"),
    ],
)
def test_flow_lists_stay_flow_lists(before: str, after: str, tmp_path: Path) -> None:
    old = load(tmp_path, HEAD + f"effects: {before}\n" + TAIL)
    new = extended_machine(old, [SHORT])
    assert new.content.decode() == HEAD + f"effects: {after}\n" + TAIL
    assert new.warnings == ()
    checked(old, new, [SHORT])


@pytest.mark.parametrize("more", ["", ', "effects": []', f', "effects": [{OLD}]'])
def test_json_stays_json(more: str, tmp_path: Path) -> None:
    text = '{"schema": "mtu/machine/1", "name": "m", "components": {"a": {"of": "x", "unit": "um"}}'
    text += ', "equations": {"Ex": "a"}' + more + "\n}\n"
    old = load(tmp_path, text)
    new = extended_machine(old, [BACKLASH, WEAR])
    checked(old, new, [BACKLASH, WEAR])
    assert new.warnings == ()
    assert new.content.decode().endswith("\n}\n")
    if OLD not in more:
        assert json.loads(new.content)["covariates"] == ["tool_parts"]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("", "covariates: [tool_parts]\n"),
        ("covariates: []\n", "covariates: [tool_parts]\n"),
        ("covariates: [load]  # c\n", "covariates: [load, tool_parts]  # c\n"),
        ("covariates: [load, # a, b\n  ]\n", "covariates: [load, # a, b\n tool_parts\n  ]\n"),
        ("covariates:\n- load\n", "covariates:\n- load\n- tool_parts\n"),
        ("covariates: [tool_parts]\n", "covariates: [tool_parts]\n"),
    ],
)
def test_covariates_that_are_new(before: str, after: str, tmp_path: Path) -> None:
    old = load(tmp_path, HEAD + before + TAIL)
    new = extended_machine(old, [WEAR, BACKLASH])
    checked(old, new, [WEAR, BACKLASH])
    text = new.content.decode()
    if before:
        assert text.startswith(HEAD + after + TAIL + "effects:\n  - name: trend-y\n")
    else:
        assert text.startswith(HEAD + TAIL + "effects:\n  - name: trend-y\n")
        assert text.endswith(after)
    assert new.warnings == ()
    assert new.parameters == ("trend-y.slope", "trend-y.shift", "backlash-x.lost_motion")


def test_names_get_numbers(tmp_path: Path) -> None:
    text = HEAD + "constants: {lost_motion: 3}\n" + TAIL
    first = extended_machine(load(tmp_path, text), [BACKLASH, BACKLASH])
    names = [effect.name for effect in first.machine.machine.effects]
    assert names == ["backlash-x", "backlash-x-2"]
    second = extended_machine(first.machine, [BACKLASH])
    last = second.machine.machine.effects[-1]
    assert last.name == "backlash-x-3"
    assert list(last.parameters) == ["lost_motion_2"]
    assert last.equations == {"Ex": "lost_motion_2*dir_x"}
    assert second.parameters == ("backlash-x-3.lost_motion_2",)
    assert second.content.startswith(first.content)


def test_a_parameter_keeps_clear_of_its_neighbours(tmp_path: Path) -> None:
    effect = WrittenEffect(
        name="e",
        parameters={"a": (1, 0, "um"), "a_2": (2, 0, "um")},
        equations={"Ex": "a*dir_x + 2.0e1*a_2"},
    )
    new = extended_machine(load(tmp_path, HEAD + TAIL), [effect]).machine.machine.effects[0]
    assert list(new.parameters) == ["a_3", "a_2"]
    assert new.equations == {"Ex": "a_3*dir_x + 2.0e1*a_2"}


def test_no_effects_no_change(tmp_path: Path) -> None:
    old = load(tmp_path, HEAD + TAIL)
    assert extended_machine(old, []).content == (HEAD + TAIL).encode()


@pytest.mark.parametrize(
    "text",
    [
        HEAD + "covariates: &none []\neffects: *none\n" + TAIL,
        HEAD + TAIL + f"effects:\n- {OLD[:-1]}, says: b}}\n- name: f\n  parameters: {{}}\n"
        "  equations: {Ex: a}\n  says: |\n    without a line end",
    ],
)
def test_layouts_beyond_are_written_anew(text: str, tmp_path: Path) -> None:
    old = load(tmp_path, text)
    new = extended_machine(old, [BACKLASH, WEAR])
    checked(old, new, [BACKLASH, WEAR])
    assert [item.code for item in new.warnings] == ["machine-written-anew"]
    assert new.warnings[0].message.startswith("m.yaml: effects cannot be added")


def test_texts_that_look_like_something_else(tmp_path: Path) -> None:
    odd = ["1e-6", "0o17", "no", "", "~", "a: b # c", "two\nlines\u2028\x85", "12:30", "{x}", "'"]
    effect = WrittenEffect(
        name="1e5",
        parameters={"p": (1.0, 0.0, "um")},
        equations={"Ex": "p"},
        found={"texts": odd, "007": "x", **{f"k{i}": text for i, text in enumerate(odd)}},
    )
    for text in (HEAD + TAIL, HEAD + TAIL + f"effects: [{OLD}]\n"):
        old = load(tmp_path, text)
        new = extended_machine(old, [effect])
        assert new.machine.machine.effects[-1].name == "1e5"
        checked(old, new, [effect])
        assert new.warnings == ()


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
    ("effect", "words"),
    [
        (
            WrittenEffect(name="e", parameters={"p": (1, 0, "um")}, equations={"Ex": "p*p"}),
            "an effect cannot be written into m.yaml: ",
        ),
        (
            WrittenEffect(name="e", parameters={"p": (1, -1, "um")}, equations={"Ex": "p"}),
            "effects[0].parameters.p.u: an effect cannot be written into m.yaml: wrong value: '-1'",
        ),
        (
            WrittenEffect(
                name="e", covariate="a", parameters={"p": (1, 0, "um")}, equations={"Ex": "p*a"}
            ),
            "the effect 'e' needs a column of a name that is taken in m.yaml: 'a'",
        ),
    ],
)
def test_effects_that_no_machine_can_hold(
    effect: WrittenEffect, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        extended_machine(load(tmp_path, HEAD + TAIL), [effect])
    assert words in str(caught.value)


ENTRIES = {
    "name": ["name: m", "name: 'm'  # name: n", '"name": "m"', "name:\n    m"],
    "notes": ["", "notes: effects", "notes: |\n  effects:\n  - a", "notes: >+\n\n  b\n\n"],
    "components": [
        "components: {a: {of: x, unit: um}}",
        "components:\n  a: &c\n    of: x\n    unit: um\n  b: *c",
        "components: {\n  a: {of: x,\n  unit: um} # }\n }",
    ],
    "equations": ["equations: {Ex: a}", "equations:\n  Ex: a + 2*a", "equations:\n Ex: >-\n  a\n"],
    "covariates": ["", "covariates: []", "covariates: [load]", "covariates:\n- load"],
    "effects": [
        "",
        "effects: []",
        "effects:  []  # none",
        "effects: [\n]",
        f"effects: [{OLD}, ]",
        f"effects:\n  - {OLD} # c\n  # d",
        "effects:\n- equations:\n    Ex: 3*a\n  parameters: {}\n  name: e",
    ],
}


@settings(max_examples=300, deadline=None)
@given(
    data=st.data(),
    order=st.permutations(list(ENTRIES)),
    end=st.sampled_from(["\n", "\r\n"]),
    gap=st.sampled_from(["\n", "\n\n", "\n# effects: [] -\n", "\n# in\n\n"]),
    last=st.sampled_from(["\n", "", "\n\n# end", "\n...\n"]),
    count=st.integers(1, 2),
)
def test_any_arrangement(
    data: st.DataObject, order: list[str], end: str, gap: str, last: str, count: int
) -> None:
    chosen = [data.draw(st.sampled_from(ENTRIES[key])) for key in order]
    chosen = [text for text in ("schema: mtu/machine/1", *chosen) if text]
    text = (gap.join(chosen) + last).replace("\n", end)
    source = Source(role="machine", path=Path("m.yaml"), shown="m.yaml", sha256="")
    old = machine_from(replace(parse_yaml(text, source), content=text.encode()))
    effects = [BACKLASH, WEAR][:count]
    new = extended_machine(old, effects)
    checked(old, new, effects)
    assert new.warnings == ()
    lines = iter(new.content.decode().split(end))
    changed = ("effects:", "covariates:", "]")
    for line in text.split(end):
        assert line.startswith(changed) or line == "" or line in lines, line
