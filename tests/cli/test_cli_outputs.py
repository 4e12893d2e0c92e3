"""What a call writes and says: nothing where it fails, and nothing over what somebody measured."""

import codecs
import csv
import importlib.util
import io
import json
import re
import sys
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from itertools import product
from pathlib import Path
from typing import Any

import html5lib
import jsonschema
import pytest
from cli_runner import PAGES, SMALL, TRUTH, done, listing, mtu, prepared, report, shared, shell
from support import CONFIGS, DATA, PAPER, SIMULATED

from mtu_cli.cli.analyse import fit_components, modelled
from mtu_cli.cli.commands import COMMANDS
from mtu_cli.cli.emit import check_outputs, execute
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.main import main
from mtu_cli.cli.options import Options
from mtu_cli.files.yaml_file import read_yaml
from mtu_cli.findings import Finding, InputError, finding, warning_lines
from mtu_cli.model.effect_library import BUILT_IN
from mtu_cli.model.settings import Settings
from mtu_cli.reports.document import REPORTS, column_meanings, declaration, envelope, meanings
from mtu_cli.reports.fields import Fields, Group, fields_of
from mtu_cli.result import Listing, Result

STUDY = """\
schema: mtu/study/1
machine: machine.yaml
part: part.yaml
lbb: [lbb.csv]
cmm: [cmm.csv]
components: [known.json]
"""
RUN = "not overwritten, as it is an input"
FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")


@pytest.fixture
def work(small: Path) -> Path:
    """A study of all kinds of files, in its folder."""
    (small / "mtu.yaml").write_text(STUDY)
    for name in ("cmm.csv", "lbb.csv", "known.json", "apart.csv"):
        (small / name).write_text("# Synthetic")
    (small / "measured.csv").write_text("# CMM 4\npart;feature;x_mm;y_mm\n1;A;0,1;0\n")
    (small / "link.csv").symlink_to("cmm.csv")
    (small / "x").mkdir()
    return small


@pytest.mark.parametrize(
    ("command", "values", "words"),
    [
        ("anova", {"out": "known.json", "machine": None}, f"known.json: {RUN}"),
        ("predict-points", {"csv": "link.csv"}, f"link.csv: {RUN}"),
        ("fit-components", {"csv": "x/../lbb.csv"}, "lbb.csv: "),
        ("close-loop", {"machine": "m.yaml", "write_machine": "mtu.yaml"}, f"mtu.yaml: {RUN}"),
        ("close-loop", {"machine": "m.yaml", "csv": "m.yaml"}, "m.yaml: --csv does not write"),
        ("simulate", {"write_cmm": "b.csv.gz"}, "--write-cmm does not write .gz"),
        ("anova", {"out": "/"}, "/: a folder, no file"),
        ("anova", {"csv": "measured.csv"}, "not overwritten, as it holds measured points"),
        ("anova", {"out": "a.json", "csv": "apart.csv", "plot": "p.png"}, None),
        ("fit-components", {"out": "known.json"}, None),
        ("simulate", {"write_lbb": "lbb.csv", "write_cmm": "cmm.csv"}, None),
        ("simulate", {"machine": "truth.yaml", "write_cmm": "cmm.csv"}, None),
        ("close-loop", {"write_machine": "new.yaml", "write_components": "new.json"}, None),
    ],
)
def test_what_is_named_or_measured_is_not_overwritten(
    command: str, values: dict[str, Any], words: str | None, work: Path
) -> None:
    """But for what a command is there to make."""
    paths = {name: None if value is None else Path(value) for name, value in values.items()}
    inputs = Inputs(Options(command, paths))
    if words is None:
        check_outputs(inputs)
        return
    with pytest.raises(InputError) as caught:
        check_outputs(inputs)
    (problem,) = caught.value.findings
    assert words in str(problem)


def test_simulate_overwrites_files_of_its_own_alone(small: Path) -> None:
    """Readings and points that somebody has measured do not begin as those of simulate do."""
    target, call = small / "made.csv", ["simulate", ".", "-q", "--write-cmm", "made.csv", "--seed"]
    done(mtu(*call, 1, cwd=small))
    first = target.read_bytes()
    done(mtu(*call, 2, cwd=small))
    second = target.read_bytes()
    assert first != second
    measured = second.partition(b"\n")[2]
    target.write_bytes(measured)
    told = done(mtu(*call, 3, cwd=small), 2).stderr
    assert "not overwritten, as it holds measured points" in told
    assert target.read_bytes() == measured
    for nothing in (b"", codecs.BOM_UTF8 + b" \r\n" * 100_000, b"\n" * 100_000 + second):
        target.write_bytes(nothing)
        done(mtu(*call, 3, cwd=small))
    target.write_bytes(b"\n" * 100_000 + measured)
    done(mtu(*call, 3, cwd=small), 2)
    target.write_bytes(b"RENISHAW\n")
    assert "not overwritten" in done(mtu(*call, 3, cwd=small), 2).stderr


def test_synthetic_readings_are_not_overwritten_by_a_table(small: Path) -> None:
    """What simulate made is data to all other commands."""
    done(mtu("simulate", ".", "-q", "--write-cmm", "made.csv", cwd=small))
    made = (small / "made.csv").read_bytes()
    told = done(mtu("lengths", ".", "--csv", "made.csv", cwd=small), 2).stderr
    assert "not overwritten, as it holds measured points" in told
    assert (small / "made.csv").read_bytes() == made


@FULL
def test_nothing_is_written_where_nothing_can_be_said(small: Path) -> None:
    before = listing(small)
    done(shell(f"cd {small} && mtu lengths --at T_x_degC=20 -q -o r.json 2> /dev/full"), 2)
    said = done(mtu("simulate", "--write-lbb", "l.csv", "--write-cmm", "/dev/full", cwd=small), 2)
    assert said.stderr.startswith("mtu: /dev/full: cannot be written: no space")
    assert said.stdout == ""
    assert listing(small) == before


def test_warnings_are_said_once_and_notes_not_with_quiet(
    small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    note = finding("not-estimable", quantity="u", names=["a"], reason="n")
    assert warning_lines([*[finding("no-formula", reason="m"), note] * 2]) == [
        "warning: no formula: m [no-formula]",
        "note: not estimable: u (a); n [not-estimable]",
    ]
    twice = envelope("lengths", inputs=(), settings=Settings(), results={}, warnings=[note] * 2)
    assert twice["warnings"] == [note.to_dict()]
    for quiet in (True, False):
        options = Options("lengths", {"quiet": quiet})
        execute(options, lambda inputs: Result(inputs, Listing(), [note]))
        assert ("not-estimable" in capsys.readouterr().err) != quiet


def test_readings_that_a_report_was_fitted_to_are_no_news(small: Path) -> None:
    """A warning only where the files are others."""
    fitted = small / "r.json"
    execute(Options("fit-components", {"out": fitted, "quiet": True}), fit_components)

    def unused(values: Mapping[str, Any]) -> list[Finding]:
        found = modelled(Inputs(Options("lengths", {"components": [fitted], **values})))[1]
        return [item for item in found if item.code == "not-used"]

    def names(values: Mapping[str, Any]) -> list[Any]:
        return [item.facts["names"] for item in unused(values)]

    assert names({}) == []
    (small / "new.csv").write_bytes((small / "lbb.csv").read_bytes() + b"# once more\n")
    assert "other files" in unused({"lbb": [Path("new.csv")]})[0].message
    for lbb in (["new.csv"], ["lbb.csv", "new.csv"]):
        assert names({"lbb": [Path(name) for name in lbb]}) == [["new.csv"]]
    with pytest.raises(InputError, match=r"lbb\.cvs: no such file; did you mean 'lbb\.csv'"):
        names({"lbb": [Path("lbb.cvs")]})
    document = json.loads(fitted.read_text())
    # One that close-loop wrote names drift readings, too.
    drift = {"role": "drift", "path": "drift.csv", "sha256": "0"}
    fitted.write_text(json.dumps(document | {"inputs": [*document["inputs"], drift]}))
    assert names({}) == []
    fitted.write_text(json.dumps(document | {"inputs": []}))
    # A report that names no readings may be of these.
    (item,) = unused({})
    assert "other files" not in item.message


@pytest.mark.parametrize("name", ["dir_z=0", "dir_x=2", "dir_*=0.5"])
def test_a_direction_is_forth_or_back(name: str, small: Path) -> None:
    """As a column of points is."""
    text = (small / "machine.yaml").read_text()
    (small / "machine.yaml").write_text(text.replace("Ex: ", "Ex: 0.001*dir_x + "))
    for sign in ("-1", "-", "reverse"):
        assert Inputs(Options("lengths", {"at": [f"dir_*={sign}"]})).at == {"dir_*": -1.0}
    modelled(Inputs(Options("lengths", {"at": ["dir_*=-1"]})))
    words = r"--at dir_[xz]: out of range: '.*'; expected -1 or \+1"
    with pytest.raises(InputError, match=words):
        modelled(Inputs(Options("lengths", {"at": [name]})))


def test_streams_of_text_alone(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a notebook, or of `io.StringIO`."""
    for call, begin in (("lengths -o -", "{"), ("lengths", "The least"), ("lenghts", "")):
        monkeypatch.setattr(sys, "argv", ["mtu", *call.split()])
        out, error = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(error), pytest.raises(SystemExit) as ended:
            main()
        assert out.getvalue().startswith(begin)
        assert ended.value.code == (0 if begin else 2), error.getvalue()


# `--report`: one HTML file that is sound, needs no other, and shows names as they are.


UNDECLARED = CONFIGS / "undeclared"


def sound(path: Path) -> str:
    """The text of a report that is HTML by its grammar, with ids of its own and nothing outside."""
    text = path.read_text("utf-8")
    # The strokes of a picture are most of it, and are read sign by sign.
    html5lib.HTMLParser(strict=True).parse(re.sub(r' d="[-MLQCz \d.\n]*"', "", text))
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids)) > 0
    assert re.findall(r'(?:src|href)="(?!#)', text) == []
    assert "http" not in re.sub(r'xmlns(?::\w+)?="[^"]*"', "", text)
    return text


@pytest.mark.parametrize("call", PAGES)
def test_every_command_writes_one_sound_file(call: str) -> None:
    text, command = sound(shared(call).page), call.partition(" configs/")[0]
    for words in ("<table>", "<svg", "SHA-256", "<h2>Settings</h2>", "mtu 0."):
        assert words in text
    used = text.split("<h2>Settings</h2>")[1]
    assert ("seed " in used) == ("seed" in COMMANDS[command].options.split())


def test_names_are_text_and_a_date_is_given(tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(
        "schema: mtu/part/1\nname: <b>plate</b>\nfeatures:\n"
        "  '<script>alert(1)</script>': {x_mm: 10, y_mm: 20}\n  B: {x_mm: 50, y_mm: 20}\n"
    )
    machine = CONFIGS / "gilsinn-ling" / "machine.yaml"
    call = ["predict-points", "-m", machine, "-p", "part.yaml", "-q", "--report", "r.html"]
    done(mtu(*call, "--date", "1 May 2030", cwd=tmp_path))
    text = sound(tmp_path / "r.html")
    assert "<script" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert "&lt;b&gt;plate&lt;/b&gt;" in text
    assert "1 May 2030" in text


@pytest.mark.skipif(importlib.util.find_spec("weasyprint") is not None, reason="it is installed")
def test_a_pdf_names_the_extra_that_it_needs(tmp_path: Path) -> None:
    found = done(mtu("lengths", UNDECLARED, "-q", "--report", "a.pdf", cwd=tmp_path), 2)
    assert "mtu-cli[pdf]" in found.stderr
    assert list(tmp_path.iterdir()) == []


# Calls that work: every command on the shipped studies, its outputs, and what depends on what.


KEYS = {"schema", "tool", "inputs", "settings", "results", "warnings"}
MAIN = {
    "fit-components": "components",
    "predict-points": "points",
    "lengths": "lengths",
    "orthogonality": "orthogonality",
}
SHIPPED = (
    *("fit-components configs/gilsinn-ling-simulated", "lengths configs/gilsinn-ling-simulated"),
    *("predict-points configs/gilsinn-ling", "orthogonality configs/gilsinn-ling --trials 20000"),
)


@pytest.mark.parametrize("call", SHIPPED)
def test_shipped_studies(call: str) -> None:
    """Tables, report and main table come from one call and agree in what they list."""
    result, document, made, _ = shared(call)
    command = call.partition(" ")[0]
    assert set(document) == KEYS
    assert document["schema"] == f"mtu/{command}/1"
    assert {item["role"] for item in document["inputs"]} >= {"study", "machine"}
    assert all(re.fullmatch("[0-9a-f]{64}", item["sha256"]) for item in document["inputs"])
    told = [f"{x['severity']}: {x['message']} [{x['code']}]" for x in document["warnings"]]
    assert result.stderr.splitlines() == told
    main = document["results"][MAIN[command]]
    rows = made.splitlines()
    assert len(rows) == len(main) + 1
    ids = list(main) if isinstance(main, dict) else [item["id"] for item in main]
    assert [row.split(",")[0] for row in rows[1:]] == ids
    table = result.stdout.partition("\n")[2]
    shown = [line.split()[0] for line in table.splitlines() if line]
    assert [name for name in shown if name in ids] == ids


def test_standard_output_holds_the_report_alone(tmp_path: Path) -> None:
    result = done(mtu("lengths", SIMULATED, "-o", "-", "--plot", tmp_path / "out.svg"))
    assert set(json.loads(result.stdout)) == KEYS
    assert listing(tmp_path).keys() == {"out.svg"}
    table = done(mtu("lengths", SIMULATED, "--csv", "-", "-o", tmp_path / "out.json"))
    assert table.stdout.startswith("id,from,to,nominal_mm,")


def test_quiet(tmp_path: Path) -> None:
    assert done(mtu("lengths", PAPER, "-q")).stdout == ""
    assert done(mtu("simulate", SMALL, "--write-lbb", tmp_path / "x.csv", "-q")).stdout == ""


def test_covariance_is_in_the_report_where_it_is_asked_for() -> None:
    plain = report("predict-points", SMALL)
    full = report("predict-points", SMALL, "--covariance")
    matrix = full["results"].pop("covariance_um2")
    assert full["results"].pop("covariance_rows")[:2] == ["A.x", "A.y"]
    assert plain["results"] == full["results"]
    points = full["results"]["points"]
    assert len(matrix) == 2 * len(points)
    for i, point in enumerate(points):
        assert matrix[2 * i][2 * i] == pytest.approx(point["var_x_um2"], rel=1e-12)
        assert matrix[2 * i + 1][2 * i + 1] == pytest.approx(point["var_y_um2"], rel=1e-12)
        apart = point["independent"]
        assert apart["u_y_um"] ** 2 == pytest.approx(apart["var_y_um2"], rel=1e-12)


def test_the_study_is_found_here_and_above(tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    below = work / "reports" / "2024"
    below.mkdir(parents=True)
    (below.parent / "mtu.yaml").mkdir()
    text = (work / "mtu.yaml").read_text().replace("lbb: [lbb.csv]", "lbb: lbb.csv")
    (work / "mtu.yaml").write_text(text)
    here = done(mtu("lengths", cwd=work))
    assert "\nLengths\n" in here.stdout
    assert done(mtu("lengths", cwd=below)).stdout == here.stdout
    assert done(mtu("lengths", work / "mtu.yaml")).stdout == here.stdout


def test_options_win_over_the_study(tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    text = (work / "part.yaml").read_text().replace("to: C, tolerance_um: 30", "to: B")
    (work / "other.yaml").write_text(text)
    own = report("lengths", cwd=work)
    found = report("lengths", "-p", "other.yaml", "--k", "3", "--seed", "5", cwd=work)
    assert [item["id"] for item in own["results"]["lengths"]] == ["A-C", "A-E"]
    assert [item["id"] for item in found["results"]["lengths"]] == ["A-B", "A-E"]
    assert own["settings"] | {"coverage_factor": 3.0, "seed": 5} == found["settings"]
    before, after = own["results"]["lengths"][1], found["results"]["lengths"][1]
    # Both are rounded once from millimetres.
    assert after["U_um"] == pytest.approx(3 * after["u_um"], rel=1e-15)
    assert (before["u_um"], before["error_um"]) == (after["u_um"], after["error_um"])


def test_a_components_report_stands_for_the_readings(tmp_path: Path) -> None:
    """To the last bit: the report holds all that predictions need."""
    fitted = tmp_path / "components.json"
    done(mtu("fit-components", SIMULATED, "-o", fitted, "-q"))
    for command in ("predict-points", "lengths", "orthogonality"):
        again = report(command, SIMULATED, "-c", fitted)
        assert again["results"] == report(command, SIMULATED)["results"]
        roles = [item["role"] for item in again["inputs"]]
        assert roles == ["study", "machine", "components", "part"]


def test_gates(tmp_path: Path) -> None:
    met = done(mtu("lengths", SIMULATED, "--fail-if", "nonconforming=1e-9"), 3)
    assert "mtu: gate nonconforming: probability of a nonconforming part above" in met.stderr
    assert met.stdout == done(mtu("lengths", SIMULATED, "--fail-if", "nonconforming=0.5")).stdout
    outputs = ["-o", tmp_path / "out.json", "--csv", tmp_path / "out.csv"]
    drift = done(mtu("fit-components", SIMULATED, "--fail-if", "drift", *outputs), 3)
    assert listing(tmp_path).keys() == {"out.json", "out.csv"}
    assert "mtu: gate drift: drift in dx_x (pass to pass)" in drift.stderr
    steady = DATA / "gilsinn-ling" / "axis_angle.csv"
    done(mtu("fit-components", PAPER, "--lbb", steady, "--fail-if", "drift"))


@pytest.mark.parametrize(
    ("kind", "files"),
    [
        ("machine", [*CONFIGS.glob("*/machine.yaml"), TRUTH]),
        ("part", list(CONFIGS.glob("*/part.yaml"))),
        ("study", list(CONFIGS.glob("*/mtu.yaml"))),
        ("budget", list(CONFIGS.glob("budgets/*.yaml"))),
        ("graph", list(CONFIGS.glob("graphs/*.yaml"))),
        ("effects", [BUILT_IN]),
    ],
)
def test_json_schemas(kind: str, files: list[Path]) -> None:
    """The shipped files pass, also what editors refuse: a misspelt key, another schema."""
    schema = json.loads(done(mtu("schema", kind)).stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    assert schema["$id"] == f"mtu/{kind}/1"
    assert files
    for path in files:
        data: dict[str, Any] = read_yaml(path, kind).data
        validator.validate(data)
        assert not validator.is_valid(data | {"mashine": "m"})
        assert not validator.is_valid(data | {"schema": f"mtu/{kind}/2"})


# Every field of a report and every column of a CSV stands in one declaration, which help shows.


GAUGE, IMPEDANCE = ("gum-h1-end-gauge.yaml", "gum-h2-impedance.yaml")
CALLS = {
    "fit-components": ["gilsinn-ling-simulated", "undeclared", "valdes-ring"],
    "predict-points": ["gilsinn-ling", "undeclared --covariance"],
    "lengths": ["gilsinn-ling", "undeclared"],
    "orthogonality": ["gilsinn-ling --trials 20000"],
    "anova": ["gilsinn-ling-parts", "undeclared"],
    "compare": ["gilsinn-ling-parts", "undeclared"],
    "close-loop": ["undeclared"],
    "thermal-fit": ["valdes-ring --model ridge"],
    "correct": ["valdes-ring -c RIDGE"],
    "budget": [f"budgets/{GAUGE} --trials 20000", f"budgets/{IMPEDANCE} --trials 20000"],
    "iso230": ["undeclared", "undeclared --limit dx_x.A=20"],
    "circular": ["../tests/cli/circular-traces.csv"],
    "compensate": ["valdes-ring --component pos_x --for beckhoff"],
    "graph check": ["graphs/axes-a-and-c.yaml"],
    "graph simulate": ["graphs/rotary-axis-a.yaml --trials 1000"],
    "graph sweep": ["graphs/ball-centre.yaml --of P1.z --vary axis_um=1,2,3 --trials 1000"],
}
SCORES = "rms_um rms_x_um rms_y_um p95_um max_um chi2_per_dof"
COMPARED = "id operation predicted measured bias_um E_n ratio_u ratio_range range_width_um verdict"
PROMISED = {
    "predict-points": {
        "points": "id x_mm y_mm z_mm Ex_um Ey_um u_x_um u_y_um var_x_um2 var_y_um2 U_x_um U_y_um "
        "dof_effective_x dof_effective_y? interval95_x_um interval95_y_um independent"
    },
    "anova": {
        "features": "operation feature axis parts n mean_error_um ms_between_um2 ms_within_um2 "
        "df_between df_within F F_critical_95 p var_part_um2 var_repeat_um2 method s_pooled_um "
        "var_part_interval95_um2 u_mean_um u_future_um U_future_um unusual_parts"
    },
    "compare": {
        "features": f"{COMPARED} axis",
        "features.predicted": "mean_um u_um U_um",
        "features.measured": "mean_um u_um U_um parts",
        "features.range_width_um": "predicted measured",
        "lengths": COMPARED,
    },
    "close-loop": {
        "": "verdict undeclared_effect_found before after floor_um in_sample improvement_percent "
        "effects candidates unexplained",
        **dict.fromkeys(("before", "after", "in_sample.before", "in_sample.after"), SCORES),
        "effects": "name family axis covariate equations parameters searched p_familywise "
        "log_bayes_factor posterior explained_share class aliases experiment?",
        "candidates": "name p_familywise? log_bayes_factor? posterior? minimum_detectable_um?",
        "unexplained": "found checks rms_um",
        "unexplained.checks": "name p",
    },
    "thermal-fit": {
        "components.pos_y": "model positions_mm sensors groups coefficients r2_fit rms_before_um "
        "rms_after_um held_out collinearity residuals of unit degree reference_temperature_degC "
        "time_constants_min covariance coefficient_dof leftover_covariance leftover_dof? "
        "sensor_u_degC temperature_range_degC position_range_mm gradients inseparable",
        "components.yaw_y": "rms_before_arcsec rms_after_arcsec",
    },
    "correct": {
        "": "points circles spheres lengths",
        "points": "part feature measured correction_um corrected",
        "circles": "id diameter_mm error_um u_um reduction_percent n_repeats",
        "circles.diameter_mm": "before after",
        "circles.error_um": "before after",
    },
    "budget": {
        "": "value u second_order dof_effective k U rows monte_carlo",
        "rows": "name value u distribution dof? sensitivity contribution share",
        "monte_carlo": "mean u interval shortest probability trials first_order_valid?",
    },
    "graph simulate": {
        "": "places trials converged budget",
        "places.PA.z": "unit nominal mean u U interval95 first_order_u",
    },
}
"""Names that scripts rely on, by place in the report of the first call; ``?``: may be null."""
LEAF = "a figure"


def tree(fields: Fields) -> dict[str, Any]:
    """The keys of a declaration, with how many lists or objects by name stand between; one that is
    declared twice is a fault.
    """
    found: dict[str, Any] = {}
    for each in fields:
        *outer, last = each.path.split(".")
        inner = found
        for key in outer:
            inner = inner.setdefault(key, {})
        if last:
            assert last not in inner, f"{each.path} is declared twice"
            inner[last] = (
                (int(each.many), tree(fields_of(each.fields))) if isinstance(each, Group) else LEAF
            )
    return found


def undeclared(known: Any, value: Any, at: str = "") -> set[str]:
    """Keys of a document that no declaration has."""
    if known is LEAF or value is None:
        return set()
    depth, inner = known if isinstance(known, tuple) else (0, known)
    if depth:
        items = value.values() if isinstance(value, dict) else value
        return {x for item in items for x in undeclared((depth - 1, inner), item, f"{at}[]")}
    # Of an angle the names of a length stand for its own.
    value = {x if x in inner else x.replace("_arcsec", "_um"): item for x, item in value.items()}
    strays = {f"{at}.{name}" for name in value if name not in inner}
    kept = ((name, item) for name, item in value.items() if name in inner)
    return strays | {
        x for name, item in kept for x in undeclared(inner[name], item, f"{at}.{name}")
    }


@pytest.mark.parametrize("command", REPORTS)
def test_every_field_and_column_is_declared_once(command: str) -> None:
    results, row = declaration(command)
    known = tree(results)
    if command == "budget":
        # Of one output its figures stand where `outputs` does for several.
        known |= known["outputs"][1]
    for call in CALLS[command]:
        made = shared(f"{command} configs/{call}")
        assert undeclared(known, made.report["results"]) == set()
        header = next(csv.reader([made.table.partition("\n")[0]]))
        free = ("share_", "coefficient_", "u_coefficient_")
        columns = [name for name, _ in column_meanings(row)]
        assert len(columns) == len({*columns})
        assert {x for x in header if not x.startswith(free)} <= {*columns}


@pytest.mark.parametrize("command", PROMISED)
def test_reports_have_the_figures_that_scripts_rely_on(command: str) -> None:
    call = f"{command} configs/{CALLS[command][0]}"
    for place, names in PROMISED[command].items():
        items: list[Any] = [shared(call).report["results"]]
        for step in filter(None, place.split(".")):
            inner = [item[step] for item in items]
            items = [x for each in inner for x in (each if isinstance(each, list) else [each])]
        assert items
        for item, name in product(items, names.split()):
            assert item[name.rstrip("?")] is not None or name.endswith("?"), (place, name)


@pytest.mark.parametrize("command", sorted({name.partition(" ")[0] for name in REPORTS}))
def test_help_explains_every_field_and_column(command: str) -> None:
    shown = done(mtu("help", command)).stdout
    for name in (each for each in REPORTS if each.partition(" ")[0] == command):
        results, row = declaration(name)
        for key, meaning in [*meanings(results), *column_meanings(row)]:
            assert meaning
            assert f"| `{key}` | {meaning.replace('|', chr(92) + '|')} |" in shown
