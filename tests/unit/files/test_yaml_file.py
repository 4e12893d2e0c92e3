"""YAML 1.2 scalars, lines, and everything that could hang or mislead."""

import math
import time
from pathlib import Path

import pytest
from budget_examples import loaded

from mtu_cli.analyses.budget.inputs import InputQuantity, inputs_of
from mtu_cli.files.effects import EffectLibrary, load_effects
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import MAX_BYTES, YamlDocument, parse_yaml, read_yaml, shown_value
from mtu_cli.findings import Finding, InputError
from mtu_cli.model.effect_library import effect_library
from mtu_cli.stats.distributions import Distribution

LADDER = [f"a{i}: &a{i} [*a{i - 1}]" for i in range(1, 3000)]


def load(text: str) -> YamlDocument:
    source = Source(role="machine", path=Path("m.yaml"), shown="m.yaml", sha256="")
    return parse_yaml(text, source)


def message(text: str) -> str:
    with pytest.raises(InputError) as caught:
        load(text)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6), ("-1E3", -1000.0), (".5", 0.5), ("2.", 2.0), ("012", "012"),
        ("0xff", "0xff"), ("+3", 3), ("12:30:00", "12:30:00"), ("1_000", "1_000"), ("yes", "yes"),
        ("no", "no"), ("Off", "Off"), ("y", "y"), ("true", True), ("False", False), ("~", None),
        ("", None), ("null", None), ("2024-05-03", "2024-05-03"), ("'1'", "1"),
        ("=", "="), ("-.INF", -math.inf), ("1e400", math.inf),
        ("9" * 100_000, math.inf),
    ],
)  # fmt: skip
def test_scalars_of_the_core_schema(text: str, value: object) -> None:
    found = load(f"a: {text}").data["a"]
    assert found == value
    assert type(found) is type(value)


def test_values_are_shown_as_they_are_written() -> None:
    assert math.isnan(load("a: .nan").data["a"])
    assert shown_value([1, {"a": None}, "µ"]) == '[1, {"a": null}, "µ"]'
    assert shown_value("µ") == "µ"


def test_keys_are_text_as_written() -> None:
    assert load("{007: 1, no: 2, 1e3: 3, '9': 4}").data == {"007": 1, "no": 2, "1e3": 3, "9": 4}


def test_lines_of_keys_and_items() -> None:
    document = load("# head\na: 1\nb:\n  - 2\n  - c: >\n      text\nd: &p {x: 1}\ne: *p\n")
    assert document.data == {"a": 1, "b": [2, {"c": "text\n"}], "d": {"x": 1}, "e": {"x": 1}}
    found = [document.line_of(*path) for path in ((), ("a",), ("b",), ("b", 0), ("b", 1, "c"))]
    assert found == [2, 2, 3, 4, 5]
    assert document.line_of("b", 1, "missing", "deeper") == 5
    assert document.line_of("e") == 8
    assert document.at("b", 1, "c") == "text\n"
    assert document.at("b", "c") is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\nb: 'c\nd: 2\n", "m.yaml:2: cannot be read: no YAML: found unexpected end"),
        ("a: 1\nb: *x", "m.yaml:2: cannot be read: no YAML: found undefined alias"),
        ("\n".join(" " * i + "k:" for i in range(99)), "m.yaml:61: more than 60 levels"),
        ("a:\n\t- b", "m.yaml:2: cannot be read: no YAML: found character that cannot start"),
        ("a: 1\nb: \x07", "m.yaml:2: cannot be read: no YAML: unacceptable character"),
        ("[a]: 1", "m.yaml:1: a list, mapping or tag as a key is not"),
        ("# nothing", "m.yaml: holds no values; expected a machine file"),
        ("\n".join(["a0: &a0 [x]", *LADDER]), "more than 60 levels"),
    ],
)
def test_faults(text: str, words: str) -> None:
    assert words in message(text)


@pytest.mark.parametrize(
    ("items", "odd"),
    [
        ("50,21, 50,24", True), ("50,21, 1", True), ("1,2,3", False),
        ("1,2,\n    3,4", False), ("1.05, 0.2, 0", False), ("1, 2, 10", False),
        ("-0.1,0.25", False),
    ],
)  # fmt: skip
def test_decimal_commas_in_a_list(items: str, odd: bool) -> None:
    text = f"µ: {{a: [{items}]}}\n"
    if odd:
        assert "µ.a: a comma within a number is not accepted" in message(text)
    else:
        assert load(text)


def test_bytes_are_bounded_and_begin_with_a_mark_or_not(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="expected at most 10000000 bytes"):
        read_yaml(tmp_path / "m.yaml", "machine")
    (tmp_path / "m.yaml").write_bytes("\ufeffa: 1\r\nb: 2\r\n".encode())
    document = read_yaml(tmp_path / "m.yaml", "machine")
    assert document.data == {"a": 1, "b": 2}
    assert document.line_of("b") == 2


# Budget files: what they accept, and every fault with its line, all at once.


SUM = "equation: a + b\ninputs:\n  b: {value: 1, u: 0.1}\n"


def findings(text: str) -> list[Finding]:
    with pytest.raises(InputError) as raised:
        loaded(text)
    return list(raised.value.findings)


def quantity(entry: str) -> InputQuantity:
    found = inputs_of(loaded(SUM + f"  a: {entry}\n")).quantities
    return next(item for item in found if item.name == "a")


def contribution(entry: str) -> Distribution:
    (part,) = quantity(entry).parts
    return part.distribution


# JCGM 101, 6.4.3: u^2 = a^2/3 + d^2/9, and nu = (a/d)^2 / 2.
CURVILINEAR = math.sqrt(1 / 3 + 0.25 / 9)


@pytest.mark.parametrize(
    ("entry", "u", "dof"),
    [
        ("value: 0, u: 0.3", 0.3, math.inf),
        ("value: 0, u: 0.3, dof: 7, distribution: t", 0.3, 7.0),
        ("value: 0, U: 0.6, k: 2", 0.3, math.inf),
        ("low: -1, high: 1, distribution: triangular", 6**-0.5, math.inf),
        ("value: 0, half_width: 2, top: 1, distribution: trapezoidal", (5 / 6) ** 0.5, math.inf),
        ("half_width: 1, inexact: 0.5, distribution: curvilinear-trapezoidal", CURVILINEAR, 2.0),
        ("half_width: 1, dof: 2, distribution: curvilinear-trapezoidal", CURVILINEAR, 2.0),
    ],
)
def test_standard_uncertainties(entry: str, u: float, dof: float) -> None:
    value = "" if "value" in entry or "low" in entry else "value: 0, "
    found = contribution(f"{{{value}{entry}}}")
    assert found.u == pytest.approx(u)
    assert found.dof == pytest.approx(dof)


# An entry, and code and place of each of its faults.
FAULTY = [
    ("{low: 2, high: 1, distribution: rectangular}", "wrong-value", ".low"),
    ("{value: 1, low: 2, distribution: rectangular}", "incomplete", ".low"),
    ("{value: 1, readings: [1, 2]}", "exclusive", ".value"),
    ("{value: 1.2, low: 0, high: 2, distribution: rectangular}", "wrong-value", ".value"),
    ("{value: 1, half_width: 1}", "no-limits", ""),
    ("{readings: [1, 2], dof: 9}", "incomplete", ".dof"),
    ("{value: 1, half_width: 1, distribution: arcsine, dof: 0.2}", "wrong-value", ".dof"),
    ("{value: 1, half_width: 1, distribution: trapezoidal, top: 2}", "wrong-value", ".top"),
    ("{value: 1, u: 1, dof: 5, distribution: curvilinear-trapezoidal, inexact: 0.1}",
     "exclusive", ".dof"),
    ("{value: 1, contributions: [{says: x}]}", "missing-key", ".contributions[0]"),
    ("{value: 1, distribution: arcsine}", "incomplete", ".distribution"),
    ("{value: 1.0e308, u: 1}", "wrong-value", ".value"),

]  # fmt: skip


@pytest.mark.parametrize(("entry", "code", "place"), FAULTY)
def test_faults_of_an_input(entry: str, code: str, place: str) -> None:
    found = findings(SUM + f"  a: {entry}\n")
    assert found[0].code == code
    assert (found[0].line, found[0].path) == (6, f"inputs.a{place}")
    assert {each.path for each in found} <= {f"inputs.a{place}", "inputs.a.readings"}


def test_all_faults_at_once() -> None:
    found = findings(
        """\
        equation: a + lenght*c
        inputs:
          a: {value: 1, u: -1}
          length: {value: 2, u: 1, half_width: 3}
          c: {value: 1, u: 1, distribution: normall}
          sin: 3
          2x: 4
        correlations: [[a, d, .5], [a, a, .1], [a, c, 1.5], [c, a, .2], [c, length], [sin, a, .2]]
        coverage: {probability: 0.95, k: 2}
        """
    )
    assert [each.line for each in found] == [3, 5, 6, 7, 8, 9, *[10] * 6, 11]
    codes = [each.code for each in found]
    for code in (
        "unknown-name", "exclusive", "name-taken", "wrong-correlation",
        "appears-twice", "wrong-value",
    ):  # fmt: skip
        assert code in codes


@pytest.mark.parametrize(
    ("more", "codes"),
    [
        ("simultaneous: [[V, I]]", ["wrong-count"]),
        ("simultaneous: [[V, T]]", ["incomplete"]),
        ("simultaneous: [[V, W], [W, V]]", ["appears-twice", "appears-twice"]),
        ("simultaneous: [[V, W]]\ncorrelations: [[V, W, 0.2]]", ["exclusive"]),
        ("simultaneous: [[V, X]]", ["unknown-name"]),
    ],
)
def test_faults_of_simultaneous_readings(more: str, codes: list[str]) -> None:
    readings = "V: {readings: [1, 2, 3]}, W: {readings: [2, 1, 3]}, I: {readings: [1, 2]}"
    text = f"equation: V/I + T + W\ninputs: {{{readings}, T: {{value: 1, u: 1}}}}\n{more}\n"
    assert [each.code for each in findings(text)] == codes


def warnings(entry: str) -> list[tuple[str, int | None]]:
    return [(each.code, each.line) for each in loaded(SUM + f"  a: {entry}\n").warnings]


def test_warnings() -> None:
    assert not warnings("{value: 1, u: 1}")
    assert not warnings("9.81")
    assert not warnings("{value: 1, u: 0}")
    assert warnings("{value: 1}") == [("no-uncertainty", 6)]
    assert warnings("{readings: [1, 1, 1]}") == [("no-uncertainty", 6)]
    assert not warnings("{readings: [1, 1, 1], half_width: 0.5, distribution: rectangular}")
    unused = loaded("equation: a\ninputs:\n  a: {value: 1, u: 1}\n  b: {value: 1, u: 1}\n")
    assert [each.message for each in unused.warnings] == [
        "b.yaml:6: inputs.b: the input 'b' is in no equation"
    ]


# Effects files: what is accepted, and every fault with its line, path and code.


HEAD = "schema: mtu/effects/1\neffects:\n"


def effects_of(tmp_path: Path, text: str) -> EffectLibrary:
    (tmp_path / "e.yaml").write_text(HEAD + text, encoding="utf-8")
    return load_effects(tmp_path / "e.yaml")


def faults(tmp_path: Path, text: str) -> tuple[Finding, ...]:
    with pytest.raises(InputError) as caught:
        effects_of(tmp_path, text)
    return caught.value.findings


def family(
    equations: str = "{Ex: k*x}", parameters: str = "{k: um/m}", more: str = "", name: str = "f"
) -> str:
    """A family on lines 3 (name), 4 (says), 5 (parameters) and 6 (equations) of its file."""
    lines = [f"- family: {name}", "  says: s"]
    lines += [f"  parameters: {parameters}", f"  equations: {equations}"]
    return "\n".join([*lines, *(f"  {line}" for line in more.splitlines())]) + "\n"


def test_a_family_is_named_by_the_axes_of_its_equations(tmp_path: Path) -> None:
    (found,) = effects_of(
        tmp_path, family('{"E{a}": "k*dir_{a}"}', "{k: um}", name="play")
    ).families
    assert found.label == "play-{a}"
    (form,) = found.forms
    assert form.symbols == ("k", "dir_{a}")
    assert form.parameters == {"k": "um"}


@pytest.mark.parametrize(
    ("equations", "column"),
    [
        ("{Ex: k*speed}", 3),
        ('{Ex: "k*({a} - {q0})"}', 10),
        ("{Ex: k*x*k}", 4),
        ("{Ex: k*x + 0.001}", 1),
        ("{Ex: k*(x}", 5),
        ("{Ex: k}", 1),
        ('{Ex: "k*({a} - {a0})**2"}', 1),
        ('{Ex: "k*{a}*dir_{b}*{b}"}', 1),
        ('{Ex: "k*{b}*exp({a})"}', 11),
        ("{Ex: k*x*log(T_a_degC)}", 9),
        ('{Ex: "k*{each}"}', 3),
        ("{Ex: k*x*chosen}", 5),
        ("{Ex: k*foo(x)}", 3),
        ("{E1: k*x}", None),
        ('{"E{each}": "k*{each}", Ex: k*x}', None),
        ("{}", None),
    ],
)
def test_faults_of_equations(tmp_path: Path, equations: str, column: int | None) -> None:
    found = faults(tmp_path, family(equations))
    assert {item.line for item in found} == {6}
    assert column in [item.column for item in found]


PERIOD = "{Ex: k*x*sin(p)}"


@pytest.mark.parametrize(
    ("text", "line", "path", "code"),
    [
        (family(parameters="{k: um/m, j: um}"), 5, "[0].parameters.j", "not-applicable"),
        (family("{Ex: x*x}", "{x: um}"), 5, "[0].parameters.x", "name-taken"),
        (family('{Ex: "2k*x"}', "{2k: um/m}"), 5, "[0].parameters.2k", "wrong-type"),
        (family(name="Ball screw"), 3, "[0].family", "wrong-value"),
        (family(more="kind: scatter"), 7, "[0].kind", "wrong-value"),
        (family(more="kind: outlier"), 3, "[0]", "missing-key"),
        (family(more="over: feature"), 6, "[0].equations", "not-applicable"),
        (family(more="search: {p: {from: 1, to: 2}}"), 7, "[0].search.p", "not-applicable"),
        (family(PERIOD, more="search: {p: {to: span}}"), 7, "[0].search.p", "missing-key"),
        (family(PERIOD, more="search: {p: {of: x, to: reach}}"), 7, "[0].search.p.to",
         "unknown-name"),
        (family(PERIOD, more="search: {p: {of: w, from: 1, to: 2}}"), 7, "[0].search.p.of",
         "unknown-name"),
        (family("{Ex: k*x*chosen*sin(p)}", more="over: part\nsearch: {p: {from: 1, to: 2}}"), 8,
         "[0].search", "misplaced"),
        ("- family: f\n  says: s\n", 3, "[0]", "missing-key"),
        (family() + family(), 7, "[1]", "appears-twice"),
        (family('{Ex: "k*{b}"}'), 3, "[0]", "incomplete"),
        ("- 5\n", 3, "[0]", "wrong-value"),
        (family(more="separates: wait for {a}"), 7, "[0].separates", "unknown-name"),
        (family(more="name: f-{T}"), 7, "[0].name", "unknown-name"),
        (family(more='sentence: "{A} grows by {Value}"'), 7, "[0].sentence", "unknown-name"),
        (family(more='sentence: "{ value } {}"'), 7, "[0].sentence", "unknown-name"),
    ],
)  # fmt: skip
def test_other_faults(tmp_path: Path, text: str, line: int, path: str, code: str) -> None:
    found = [(item.line, item.path, item.code) for item in faults(tmp_path, text)]
    assert (line, f"effects{path}", code) in found


def test_all_faults_of_a_file_at_once(tmp_path: Path) -> None:
    found = faults(tmp_path, family("{Ex: k*speed}") + family("{Ey: k**2}", name="g"))
    assert [item.line for item in found] == [6, 10]


def test_names_of_built_in_families_and_of_other_files_are_taken(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(HEAD + family(name="backlash"))
    (tmp_path / "b.yaml").write_text(HEAD + family())
    for names_of in ([tmp_path / "a.yaml"], [tmp_path / "b.yaml"] * 2):
        with pytest.raises(InputError) as caught:
            effect_library(names_of)
        assert [item.code for item in caught.value.findings] == ["name-taken"]
    with pytest.raises(InputError, match="no such file"):
        effect_library([tmp_path / "none.yaml"])


@pytest.mark.parametrize("name", ["{" * 200_000, "a{b" * 50_000])
def test_a_very_long_name_costs_nothing(tmp_path: Path, name: str) -> None:
    """Names of parameters are searched for braces: in linear time, whatever they are."""
    start = time.process_time()
    faults(tmp_path, family(parameters=f"{{? '{name}' : um}}", equations=f"{{Ex: '{name}'}}"))
    assert time.process_time() - start < 5.0
