"""Calls that are at fault: options, values, gates, reports of another machine."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from cli_runner import SMALL, TRUTH, done, mtu, prepared, refused
from support import CONFIGS, PAPER

OUTPUTS = ["-o", "out.json", "--csv", "out.csv", "--plot", "out.png"]


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A copy of the small study."""
    return prepared(tmp_path / "work")


def test_all_settings_out_of_range_are_told_at_once(work: Path) -> None:
    values = {"--k": "nan", "--digits": "5", "--seed": "-1", "--correlation": "some"}
    values |= {"--trials": "999", "--threads": "0"}
    call = [word for pair in values.items() for word in pair]
    found = refused(work, "lengths", *call, *OUTPUTS).removeprefix("mtu: ").splitlines()
    assert len(found) == len(values)
    begun = {line.partition("; expected ")[0] for line in found}
    assert begun == {f"{option}: out of range: '{value}'" for option, value in values.items()}


@pytest.mark.parametrize(
    ("call", "shown"),
    [
        (["fit-components", SMALL], r"(?m)^\S+ .*?± (\S+)"),
        (["compare", CONFIGS / "undeclared"], r"± (\d\S*)"),
        (["anova", CONFIGS / "undeclared"], r"(?m)^\d+-\d+ +\d+ +\S+ +\S+ +\S+ +(\S+)"),
        (["predict-points", PAPER], r"(?m)^\d+ .*?(\S+) +\S+ +\["),
        (["budget", CONFIGS / "budgets" / "gum-h1-end-gauge.yaml", "--trials", 4000],
         r"order +\S+ +(\S+) +nm"),
        (["graph", "simulate", CONFIGS / "graphs" / "bore-to-bore.yaml", "--trials", 4000],
         r"(\S+) +\["),
    ],
    ids=lambda item: item[0] if isinstance(item, list) else "",
)  # fmt: skip
def test_tables_show_the_digits_of_u_that_are_asked_for(call: list[Any], shown: str) -> None:
    found = re.findall(shown, done(mtu(*call, "--digits", 3)).stdout)
    assert found
    for u in found:
        figures = u.partition("e")[0].replace(".", "").lstrip("0")
        # An integer may end in zeros, as in 1250 for 1.25e3.
        assert len(figures) == 3 or ("." not in u and len(figures) > 3), u


def test_the_other_ends_of_the_ranges(work: Path) -> None:
    values = {"--k": "inf", "--digits": "0", "--trials": "9" * 20, "--threads": "1025"}
    call = [word for pair in values.items() for word in pair]
    found = refused(work, "orthogonality", *call, *OUTPUTS).splitlines()
    assert {line.removeprefix("mtu: ").split(": out")[0] for line in found} == set(values)
    message = refused(work, "lengths", "--k", "0", "--seed", "9" * 5000)
    assert "--seed" in message


def test_a_factor_that_looks_like_a_percentage_is_asked_about(work: Path) -> None:
    meant = "so U is 95 u: it is a factor and no probability; expected 2 for about 95 %"
    told = done(mtu("fit-components", "--k", "95", "-q", cwd=work)).stderr
    assert f"warning: --k is 95, {meant} [factor-like-probability]" in told
    study = (work / "mtu.yaml").read_text()
    assert "settings: {" in study
    stated = "settings: {coverage_factor: 95, "
    (work / "mtu.yaml").write_text(re.sub(r"settings: {(coverage_factor: 2, )?", stated, study))
    told = done(mtu("fit-components", "-q", cwd=work)).stderr
    assert f"settings.coverage_factor of mtu.yaml is 95, {meant}" in told


def test_a_factor_that_looks_like_a_probability_is_asked_about(work: Path) -> None:
    told = done(mtu("fit-components", "--k", "0.95", "-o", "a.json", "-q", cwd=work)).stderr
    assert "warning: --k is 0.95, so U is 0.95 u: it is a factor and no probability; " in told
    codes = [item["code"] for item in json.loads((work / "a.json").read_text())["warnings"]]
    assert "factor-like-probability" in codes
    for k in ("1", "0.5", "12.7"):
        assert "probability" not in done(mtu("fit-components", "--k", k, cwd=work)).stderr


@pytest.mark.parametrize(
    "call",
    [
        ["--seed", "1.5"],
        ["--threads"],
        ["--thread", "1"],
        ["study.yaml", "another.yaml"],
    ],
    ids=" ".join,
)
def test_values_of_the_wrong_kind(call: list[str], work: Path) -> None:
    message = refused(work, "lengths", *OUTPUTS, *call)
    assert call[0] in message or "another.yaml" in message


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["--k", "2,5"], "invalid value for '--k': Input should be a valid number"),
        (["--trials", "1e4"], "invalid value for '--trials': Input should be a valid integer"),
        (["--seed", ""], "invalid value for '--seed'"),
        (["-p", ""], "invalid value for '-p' / '--part': it names no file"),
        (["--lbb", "lbb.csv", "--lbb", ""], "invalid value for '--lbb': it names no file"),
        (["-o", "new/"], "invalid value for '-o' / '--out': it names no file"),
        (["--plot", "new/a.png/"], "invalid value for '--plot': it names no file"),
    ],
)
def test_numbers_and_names_that_are_none(call: list[str], words: str, work: Path) -> None:
    assert words in refused(work, "lengths", *call)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["lengths", "--outptu", "a"], "no such option: --outptu (Possible options: --out"),
        (["--at", "T=1"], "no such option: --at"),
        (["graph", "draw", "--to"], "option '--to' requires an argument"),
        (["close-loop", "--fail-if", ""], "unknown gate: ''; expected suspicious or found or"),
        (["lengths", "--out", "-q"], "-q: -o does not write a file without an ending; expected"),
        (["graph", "sweep", "g.yaml"], "missing option '--vary'"),
        (["schema"], "missing argument 'KIND'"),
        (["lengths", "a", "b"], "got unexpected extra argument(s) (b)"),
        (["graph", "chek"], "no such command 'chek'. Did you mean 'check' (see mtu graph --help)"),
        (["predict"], "no such command 'predict'. Did you mean 'predict-points'"),
        (["lengths", "--at", "-o"], "--at: not NAME=VALUE: '-o'"),
        (["\u65e5\u672c" * 40], "no such command '\u65e5\u672c"),
        (["lengths", "--a\x1b[31m\n"], "no such option: --a\\x1b[31m"),
    ],
    ids=lambda value: ascii(" ".join(value)[:20]) if isinstance(value, list) else "",
)
def test_calls_that_are_none_are_told_in_one_line(call: list[str], words: str, work: Path) -> None:
    message = refused(work, *call, env={"COLUMNS": "30"})
    assert message.startswith(f"mtu: {words}")
    assert len(message.splitlines()) == 1


def test_help_is_shown_beside_arguments_too_many(work: Path) -> None:
    assert "Usage: mtu lengths" in done(mtu("lengths", "a", "b", "--help", cwd=work)).stdout


def test_all_bad_covariates_are_told_at_once(work: Path) -> None:
    bad = ["T", "=1", "T_a_degC=", "a\x07=1"]
    words = {
        "warm": "a number",
        "1_0": "a number",
        "\uff12": "a number",
        "23,5": "a number with a decimal point",
        "23.5 degC": "a number alone, without its unit",
    }
    vast = ["nan", "-inf", "1e400"]
    values = [*words, *vast]
    given = [*bad, *(f"T_a_degC={value}" for value in values), "dir_x=1", "dir_x=-1"]
    call = [word for text in given for word in ("--at", text)]
    found = refused(work, "lengths", *call, *OUTPUTS).removeprefix("mtu: ").splitlines()
    assert len(found) == len(given) - 1
    for line, text in zip(found, bad, strict=False):
        assert line.startswith(f"--at: not NAME=VALUE: {text!r}; expected --at T_02_degC=23.5, say")
    assert found[len(bad) : -1] == [
        *(
            f"--at T_a_degC: not a number: {text!r}; expected {hint}"
            for text, hint in words.items()
        ),
        *(f"--at T_a_degC: not a finite number: {value!r}" for value in vast),
    ]
    assert found[-1] == "--at dir_x appears twice: 'dir_x=-1'"


SHARE = "a probability from 0 to below 1, such as 0.01 for 1 %"


@pytest.mark.parametrize(
    ("command", "gate", "expected"),
    [
        ("lengths", "nonconforming", "suspicious or nonconforming=0.01"),
        ("lengths", "drift", "suspicious or nonconforming=0.01"),
        ("anova", "nonconforming=0.1", "suspicious or unusual"),
        ("fit-components", "drifts", "suspicious or drift"),
    ],
)
def test_unknown_gates(command: str, gate: str, expected: str, work: Path) -> None:
    message = refused(work, command, "--fail-if", gate, *OUTPUTS)
    assert message == f"mtu: unknown gate: '{gate}'; expected {expected}\n"


@pytest.mark.parametrize("share", ["1.5", "1", "nan", "ab", "0,01", "1_0", ""])
def test_a_gate_with_no_share(share: str, work: Path) -> None:
    message = refused(work, "lengths", "--fail-if", f"nonconforming={share}", *OUTPUTS)
    if share == "0,01":
        # Commas stand between gates.
        assert message.startswith("mtu: unknown gate: '01'; expected suspicious or noncon")
        return
    told = f"--fail-if nonconforming: out of range: 'nonconforming={share}'"
    assert message == f"mtu: {told}; expected {SHARE}\n"


@pytest.mark.parametrize(
    ("command", "known"),
    [
        ("lengths", "nonconforming=0.01"),
        ("fit-components", "drift"),
        ("anova", "unusual"),
        ("compare", "biased"),
        ("close-loop", "found"),
    ],
)
def test_of_several_gates_the_unknown_one_is_told(command: str, known: str, work: Path) -> None:
    message = refused(work, command, "--fail-if", f"{known},drifts", *OUTPUTS)
    assert message.startswith("mtu: unknown gate: 'drifts'; expected ")
    assert len(message.splitlines()) == 1


@pytest.mark.parametrize("gates", [",", "found,"])
@pytest.mark.parametrize("command", ["lengths", "anova", "compare", "close-loop"])
def test_a_gate_without_a_name_is_refused(command: str, gates: str, work: Path) -> None:
    """Of a script's variable that is not set: the command would run without its gate."""
    assert "unknown gate: ''; expected " in refused(work, command, "--fail-if", gates, *OUTPUTS)


def test_two_limits_of_nonconforming_parts_are_refused(work: Path) -> None:
    gates = "nonconforming=0.01,nonconforming=0.05"
    message = refused(work, "lengths", "--fail-if", gates, *OUTPUTS)
    assert message.startswith("mtu: --fail-if nonconforming appears twice")


SIMULATE = ["simulate", "--write-lbb", "out-lbb.csv", "--write-cmm", "out-cmm.csv"]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (["--positions", "0:140"], "--positions: not LOW:HIGH:COUNT: '0:140'"),
        (["--positions", "0:inf:8"], "--positions: not a finite number: 'inf'"),
        (["--positions", "x=0:ab:8"], "--positions: not a number: 'ab'; expected a number"),
        (
            ["--positions", "0:9:8.0"],
            "--positions: not a whole number: '8.0'",
        ),
        (["--positions", "0::8"], "--positions: not LOW:HIGH:COUNT: '0::8'"),
        (
            ["--positions", "0:1:2:3"],
            "--positions: not LOW:HIGH:COUNT: '0:1:2:3'; expected 0:140",
        ),
        (["--positions", "100:0:3"], "--positions: out of range: '100:0:3'; expected LOW below"),
        (["--positions", "x=5:5:3"], "--positions: out of range: '5:5:3'; expected LOW below"),
        (["--positions", "0:100:1"], "'0:100:1'; expected a COUNT from 2 to 10000"),
        (["--effect", "0.004*dir_x"], "--effect: not NAME: EQUATION: '0.004*dir_x'"),
        (
            ["--covariate", "T_a_degC 20"],
            "--covariate: not NAME: EQUATION: 'T_a_degC 20'; expected 'T_spindle_degC: 20 + ",
        ),
        (["--effect", "Ez: 0.004"], "--effect: unknown equation: 'Ez'; expected one of: Ex, Ey"),
        (["--effect", "Ex: 0.004*dirx"], "unknown name at column 11: 'dirx'"),
        (
            ["--effect", "Ex: 0.0004*(T_spindle_degC-20)"],
            "dir_y, or a covariate (--covariate 'T_spindle_degC: ...')",
        ),
        (["--effect", "Ex: 0.004*"], "--effect Ex: unexpected end of the equation at column 11"),
        (
            ["--effect", "Ex: 1/(x - x)"],
            "has no finite value at x = 0 in part 1 at feature 'A'",
        ),
        (
            ["--effect", "Ex: x*(T_a_degC - 20)", "--covariate", "T_a_degC: 20"],
            "--effect Ex: this term is mm*K, not a length (mm) at column 5: 'x*(T_a_degC - 20)'; "
            "expected a number before it",
        ),
        (["--effect", "Ex: exp(-time_min)"], "--effect Ex: the argument of exp is a time (min)"),
        (["--scatter", "Ex: x*y"], "--scatter Ex: this term is mm^2, not a length"),
        (
            ["--covariate", "T_a_degC: 20 + time_min"],
            "--covariate T_a_degC: this term is a time (min), not a temperature "
            "(degC) at column 16: 'time_min'",
        ),
        (["--covariate", "load: x + time_min"], "what is added is a time (min), not a length"),
        (
            ["--covariate", "x_mm: 1"],
            "--covariate: the name is taken: it is a column of the points: 'x_mm: 1'",
        ),
        (
            ["--covariate", "dir_x: 1"],
            "--covariate: the name is taken",
        ),
        (["--covariate", "T_a_degC: 20 + t"], "unknown name at column 16: 't'"),
        (["--covariate", "a: 1", "--covariate", "a: 2"], "a column of the points: 'a: 2'"),
        (["--minutes", "inf"], "'--minutes': Input should be less than or equal to 1000000"),
        (["--parts", "1000000000"], "'--parts': Input should be less than or equal to 10000"),
        (["--passes", "1000000000"], "'--passes': Input should be less than or equal to 10000"),
        (["--cmm-u-um", "nan"], "invalid value for '--cmm-u-um'"),
        (
            ["--operation", ""],
            "--operation: not a name: ''; expected a text on one line",
        ),
        (
            ["--operation", " "],
            "--operation: not a name: ' '; expected a text on one line",
        ),
        (["--operation", "a\nb"], "--operation: not a name: 'a"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_faulty_simulations(call: list[str], words: str, work: Path) -> None:
    assert words in refused(work, *SIMULATE, *call)


def test_unknown_schema_and_command(work: Path) -> None:
    message = refused(work, "schema", "machin")
    assert message.startswith("mtu: unknown schema: 'machin'; did you mean 'machine'?")
    message = refused(work, "lenghts")
    assert message == "mtu: no such command 'lenghts'. Did you mean 'lengths' (see mtu --help)\n"


@pytest.fixture(scope="module")
def fitted() -> dict[str, Any]:
    """The components report of the small study."""
    found: dict[str, Any] = json.loads(done(mtu("fit-components", SMALL, "-o", "-")).stdout)
    return found


def test_components_reports_that_are_not_sound(work: Path, fitted: dict[str, Any]) -> None:
    components = fitted["results"]["components"]
    components["dx_x"] |= {"s_repeat": -1.0, "unit": "inch"}
    components["ez_x"]["covariance"][0][0] = -1.0
    components["dy_y"] |= {"degree": 3}
    components["dy_y"]["pass_dof"] = 0.0
    components["axy"] |= {"pass_covariance": [[1.0, 0.0], [0.0, 1.0]]}
    (work / "range.json").write_text(json.dumps(fitted))
    assert "range.json: results.components.dx_x.s_repeat: " in refused(
        work, "lengths", "-c", "range.json", *OUTPUTS
    )
    components["dx_x"]["s_repeat"] = 1.0
    group = fitted["results"]["joint_pass_covariance"][0]
    group["widths"][0] = 1
    (work / "sizes.json").write_text(json.dumps(fitted))
    found = refused(work, "lengths", "-c", "sizes.json", *OUTPUTS)
    for words in (
        "results.components.dx_x.unit: unknown unit: 'inch'",
        "results.components.ez_x.covariance: a variance is negative",
        "results.components.dy_y.pass_dof: an estimate without degrees of freedom",
        "results.components.dy_y.coefficients: 2 entries; expected 4",
        "results.components.axy.pass_covariance: not 1 x 1",
        "results.joint_pass_covariance[0].widths: wrong value",
    ):
        assert words in found


def test_a_components_report_of_another_machine(work: Path) -> None:
    done(mtu("fit-components", "-o", "fit.json", "-q", cwd=work))
    text = (
        (work / "machine.yaml")
        .read_text()
        .replace("dy_y", "dz_y")
        .replace("ez_x: {of: x", "ez_x: {of: y")
    )
    (work / "other.yaml").write_text(text)
    found = refused(
        work, "lengths", "-m", "other.yaml", "-p", "part.yaml", "-c", "fit.json", *OUTPUTS
    )
    assert (
        "fit.json: results.components.ez_x: contradicts other.yaml: 'of x in arcsec'; expected of y"
        in found
    )
    assert "fit.json: results.components.dy_y: unknown component in other.yaml: 'dy_y'" in found
    shown = refused(work, "lengths", "-c", "fit.json", "-o", "fit.json")
    assert shown.startswith("mtu: fit.json: not overwritten, as it is an input")


def test_a_component_that_no_equation_uses_is_told(tmp_path: Path) -> None:
    """Nothing of it is simulated, and a fit without readings of it says that none are needed."""
    known = "{of: x, unit: um, coefficients: [1, 0.01], s_repeat: 0.5}"
    equations = "schema: mtu/machine/1\nname: m\nequations: {Ex: a}\n"
    (tmp_path / "m.yaml").write_text(equations + f"components:\n  a: {known}\n  b: {known}\n")
    call = ["-m", "m.yaml", "--passes", "5", "--positions", "0:100:5", "--write-lbb", "l.csv"]
    result = done(mtu("simulate", *call, cwd=tmp_path))
    assert result.stderr.startswith(
        "warning: m.yaml:6: components.b: the component 'b' is in no equation"
    )
    assert "b," not in (tmp_path / "l.csv").read_text("utf-8")
    fitted = "  a: {of: x, unit: um}\n  b: {of: x, unit: um}\n"
    (tmp_path / "m.yaml").write_text(equations + "components:\n" + fitted)
    message = refused(tmp_path, "fit-components", "-m", "m.yaml", "--lbb", "l.csv")
    assert "or coefficients here; or no such component, as no equation uses it" in message


def test_a_study_has_no_truth_to_simulate_without_readings(work: Path) -> None:
    message = refused(work, *SIMULATE, "-m", TRUTH)
    assert message.startswith("mtu: the part file is missing; expected -p FILE")
