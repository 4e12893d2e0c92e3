"""Files of instruments: recognised, read with every trap of their grammar, and one clear error
where they are damaged. The files are made (`made_files`).
"""

import io
import random
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import made_files as made
import nptdms
import numpy as np
import pytest
from fuzz.damage import nudged

from mtu_cli.files.readings import read_points, read_readings
from mtu_cli.files.source import Source
from mtu_cli.findings import InputError
from mtu_cli.formats.base import Ask, Import, of_content
from mtu_cli.formats.instruments import converter, read
from mtu_cli.formats.renishaw import features_of, run_file

ASK = Ask(component="dx_x", unit="um")


def raw(content: bytes | str, name: str = "x.txt") -> Any:
    """A file in memory."""
    content = content.encode() if isinstance(content, str) else content
    return of_content(Source(role="laser", path=Path(name), shown=name, sha256=""), content)


def profiled(folder: Path, profile: str, text: str, **asked: Any) -> Import:
    """A table as a profile reads it."""
    (folder / "map.yaml").write_text(profile)
    return read(raw(text), Ask(kind="readings", profile=folder / "map.yaml", **asked))


def rows(found: Import, *names: str) -> list[tuple[Any, ...]]:
    """Some columns of what was read."""
    return list(zip(*(found.columns[name] for name in names), strict=True))


@pytest.mark.parametrize("name", made.FILES)
def test_every_format_is_recognised_by_its_content_alone(name: str) -> None:
    wanted, content = made.FILES[name]
    assert read(raw(content, "no-ending"), ASK).format == wanted


def test_rtl_with_wrapped_negative_targets_and_descending_reverse_runs() -> None:
    found = read(raw(made.RTL.encode("cp1252"), "x.rtl"), ASK)
    got = rows(found, "position_mm", "pass", "direction", "error", "unit")
    assert got[0] == (-150.0, 1, "forward", 0.1, "um")
    assert got[7] == (150.0, 1, "reverse", 4.125, "um")
    assert got[13] == (-150.0, 1, "reverse", 1.1, "um")
    assert found.rows[0] == 19
    assert found.left_out == {"material sensors at -10 degC, that is not connected": 1}
    # Times as they stand: months are English whatever the computer's language.
    assert found.facts["Date Time"].startswith('"10:46 Dec 12 2016"')
    assert "Mat temp 2" not in found.facts
    assert any("20 degC already" in text for text in found.says)


@pytest.mark.parametrize("code_page", ["utf-8", "utf-8-sig", "cp1252", "gbk"])
def test_code_pages_and_broken_degree_signs(code_page: str) -> None:
    # cp1252 accepts most bytes: GBK is tried only where it does not, as of the first of these.
    name = "\u4e02\u5e8a" if code_page == "gbk" else "Fr\u00e4se"
    content = made.RTL.replace("Fr\u00e4szentrum 20\u00b0", name).encode(code_page)
    found = read(raw(content, "x.rtl"), ASK)
    assert found.facts["Machine"].startswith(name)
    assert found.file.encoding == code_page.removesuffix("-sig")
    broken = made.RTL.replace("\u00b0", "\u00c2\u00b0").encode()
    assert "20\u00b0" in read(raw(broken, "x.rtl"), ASK).facts["Machine"]


def test_a_one_way_rtl_padded_with_zeros_and_a_plain_one() -> None:
    one_way = made.RTL.replace("Flags: 0 0", "Flags: 0 1")
    found = read(raw(one_way, "x.rtl"), ASK)
    assert set(found.columns["direction"]) == {"forward"}
    assert found.columns["pass"][-1] == 2
    lines = [f"  2   {line.split()[1]}    0.000000\r" if line.startswith("  2 ") else line
             for line in one_way.split("\n")]  # fmt: skip
    padded = read(raw("\n".join(lines), "x.rtl"), ASK)
    assert len(padded.rows) == 7
    assert padded.left_out["zeros that fill reverse runs of a file flagged as one-way"] == 7
    assert padded.doubts


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("EOF::", "", "the section EOF:: is missing"),
        ("Target-count: 7", "Target-count: 8", "7 targets; expected 8"),
        ("Run-count:2", "Run-count:3", "2 runs with deviations; expected 3"),
        ("  1   2    0.250000", "  1   9    0.250000", "row 20, column 'Target'"),
        ("  1   2    0.250000", "  1   1    0.250000", "the same as row 19"),
        ("0.250000", "0.2x", "row 20"),
        ("-50.000000", "-50.0.0", "row 9, column 'Targets': not a number"),
    ],
)
def test_a_damaged_rtl_is_one_clear_error(old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(raw(made.RTL.replace(old, new), "x.rtl"), ASK)


@pytest.mark.parametrize("kind", ["rtl", "rta"])
def test_what_is_written_is_read_within_half_a_quantum(kind: str) -> None:
    rng = np.random.default_rng(49)
    for _ in range(20):
        targets = np.round(np.sort(rng.uniform(-900, 900, rng.integers(2, 14))), 3)
        ways = ("forward", "reverse") if rng.random() < 0.6 else ("forward",)
        data = Import(format=kind, file=raw(""), ask=ASK)
        for p in range(1, int(rng.integers(2, 5))):
            for way in ways:
                for x in targets[:: 1 if way == "forward" else -1].tolist():
                    data.add(0, position_mm=x, **{"pass": p}, direction=way, error=rng.normal())
        found = read(raw(run_file(kind, data.columns), f"x.{kind}"), ASK)
        key = ("position_mm", "pass", "direction")
        assert rows(found, *key) == rows(data, *key)
        apart = np.subtract(found.columns["error"], data.columns["error"])
        assert np.abs(apart).max() <= 0.5000001e-6


def test_a_matrix_with_either_decimal_sign_and_an_empty_cell() -> None:
    found = read(raw(made.WIDE.encode("cp1252")), Ask(component="dx_x"))
    got = rows(found, "position_mm", "pass", "direction", "error", "unit")
    assert got[0] == (-100.0, 1, "forward", 1.5, "um")
    assert got[3] == (-100.0, 2, "reverse", 2.0, "um")
    assert (len(got), found.left_out) == (11, {"empty cells": 1})
    points = read(raw(made.WIDE.replace(",", ".").replace(";", "\t")), ASK)
    assert points.columns == found.columns


@pytest.mark.parametrize(
    ("header", "ways"),
    [
        ("t;+;-;+", "frf"), ("t;F1;F2;B1", "ffr"), ("t;fwd 1;rev 1;fwd 2", "frf"),
        ("t;1;2;3", "frf"), ("t;r1 vor;r1 r\u00fcck;r2 vor", "frf"),
    ],
)  # fmt: skip
def test_directions_of_runs(header: str, ways: str) -> None:
    text = f"{header}\n0;0.1;0.2;0.3\n5;0.2;0.1;0.3\n"
    found = read(raw(text), ASK)
    assert "".join(way[0] for way in found.columns["direction"][:3]) == ways
    assert bool(found.doubts) == (header == "t;1;2;3")
    given = Ask(component="a", unit="um", directions="forward")
    one_way = read(raw(text.replace(header, "t;1;2;3")), given)
    assert one_way.columns["pass"][:3] == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "ask", "said"),
    [
        ("t;+;-\n0;1,234;2,345\n5;1,300;2,400\n", ASK, r"the decimal sign .*--decimal"),
        ("t;+;-\n0;1,2;2,3\n5;1.3;2,4\n", ASK, "both signs in one column"),
        ("t;+;-\n0;0.001;0.002\n50;50.003;50.1\n99;99.002;99.0\n", ASK, "positions.*subtract"),
        ("t;+;-\n0;0.1;0.2\n5;0.3;x\n9;0.1;0.1\n", ASK, "row 3, column '-': not a number: 'x'"),
        ("t;+;-\n0;0.1;0.2\n5;0.3;0.2\n", Ask(unit="um"), "the component that the file reads"),
        ("hello\nworld\n", ASK, "fits no format .*utf-8"),
    ],
)
def test_what_a_matrix_leaves_open_is_an_error(text: str, ask: Ask, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read(raw(text), ask)
    if "--decimal" in said:
        assert read(raw(text), replace(ask, decimal=",")).columns["error"][0] == 1.234


def test_ecmc_data_and_report() -> None:
    data, report = read(raw(made.ECMC), ASK), read(raw(made.REPORT), ASK)
    assert data.columns["error"][0] == pytest.approx(-0.000099019, abs=1e-12)
    assert data.columns["direction"][4] == "reverse"
    np.testing.assert_allclose(
        np.sort(data.columns["error"]), np.sort(report.columns["error"]), atol=1e-6
    )
    assert not data.doubts
    assert "exchange the directions" in report.doubts[0]
    with pytest.raises(InputError, match="in 2 cycles; expected 20: 2 positions, 5 cycles"):
        read(raw(made.ECMC.replace("CYCLES=2", "CYCLES=5")), ASK)
    for text in (made.ECMC, made.REPORT.partition("## ISO230-2")[0].rstrip() + "\n"):
        for lost in range(1, 6):
            cut = "".join(text.splitlines(keepends=True)[:-lost])
            with pytest.raises(InputError, match=r"readings of 2 positions .* expected 8"):
                read(raw(cut), ASK)


@pytest.mark.parametrize("name", ["p_chr.txt", "r.txt", "c.dfq", "l.dfq", "a.qif", "p.csv"])
def test_points_of_every_vendor(name: str) -> None:
    content = made.FILES[name][1]
    found = read(raw(content, name), Ask(kind="points"))
    assert found.columns["feature"][0] == {"r.txt": "CIR1"}.get(name, "hole1")
    x, y = {"r.txt": (10.0031, 20.0012)}.get(name, (10.0021, 20.0010))
    assert (found.columns["x_mm"][0], found.columns["y_mm"][0]) == (x, y)
    if name != "a.qif":
        assert found.columns["nominal_x_mm"][0] == 10.0
    left = {"c.dfq": 2, "l.dfq": 0, "p.csv": 2}.get(name, 1)
    assert sum(found.left_out.values()) == left
    with pytest.raises(InputError, match="gives points; expected readings"):
        read(raw(content, name), Ask(kind="readings"))


def test_a_ballbar_file_and_a_capture() -> None:
    found = features_of(raw(made.B5R, "\u5ea6.b5r"))
    assert found["test_plane"] == "XY"
    assert found["features"]["AF_SQUARENESS"] == {"value": -12.5, "unit": "um/m"}
    assert found["features"]["AF_CIRCULARITY"] == {"value": 8.4, "unit": "um"}
    capture = read(raw(made.rtx(), "d.rtx"), ASK)
    assert (len(capture.rows), capture.facts["least"], capture.facts["largest"]) == (3, -0.25, 0.5)
    with pytest.raises(InputError, match="bytes of samples"):
        read(raw(made.rtx()[:-12], "d.rtx"), ASK)


def tdms(seconds: float = 30.0) -> bytes:
    """A made TDMS: temperature, probe, and a longer channel, 30 s apart."""
    made_of = {"T spindle": ("degC", [20.0, 20.5, 21.0]), "Probe Z": ("um", [0.0, 0.4, 0.9]),
               "Voltage": ("V", [1.0, 2.0, 3.0, 4.0])}  # fmt: skip
    target = io.BytesIO()
    with nptdms.TdmsWriter(target) as writer:
        writer.write_segment([
            nptdms.ChannelObject("run", name, np.array(values),
                                 {"wf_increment": seconds, "unit_string": unit})
            for name, (unit, values) in made_of.items()
        ])  # fmt: skip
        writer.write_segment([nptdms.ChannelObject("other", "x", np.array([1.0]))])
    return target.getvalue()


def test_a_tdms_gives_drift_readings_with_temperatures() -> None:
    found = read(raw(tdms(), "a.tdms"), Ask(kind="drift", component="dz"))
    assert found.format == "tdms"
    assert found.columns["time_min"] == [0.0, 0.5, 1.0]
    assert found.columns["T_spindle_degC"] == [20.0, 20.5, 21.0]
    assert rows(found, "component", "error", "unit")[2] == ("dz", 0.9, "um")
    assert [*found.left_out.values()] == [1, 1, 1]
    with pytest.raises(InputError, match="wf_increment"):
        read(raw(tdms(0.0), "a.tdms"), ASK)
    rng = random.Random(3)
    for _ in range(150):
        with suppress(InputError):
            read(raw(b"TDSm" + nudged(tdms()[4:], rng), "a.tdms"), ASK)


def test_a_damaged_tdms_or_a_missing_extra_is_one_error() -> None:
    with pytest.raises(InputError, match=r"mtu-cli\[tdms\]|damaged TDMS"):
        read(raw(b"TDSm" + bytes(60), "a.tdms"), Ask(kind="drift", component="dz"))


def test_a_logger_gives_drift_readings_with_temperatures() -> None:
    found = read(raw(made.LOGGER.encode("cp1252")), Ask(kind="drift", component="dz"))
    assert found.columns["time"][1] == "2024-08-13T10:01:00"
    assert found.columns["T_spindle_degC"] == [20.1, 20.25, 20.4]
    assert rows(found, "error", "unit", "cycle")[2] == (0.9, "um", "x.txt")
    with pytest.raises(InputError, match="day or month first"):
        read(raw(made.LOGGER.replace("13.08.", "01/08/")), Ask(component="dz"))


def test_a_profile_reads_any_table(tmp_path: Path) -> None:
    text = made.MAPPED
    found = profiled(tmp_path, made.MAP, text)
    assert rows(found, "component", "cycle") == [("dx_x", x) for x in "11122"]
    np.testing.assert_allclose(found.columns["error"], [0.001, 0.002, 0.001, 0.5, 0.25], atol=1e-12)
    assert rows(found, "pass", "direction")[1] == (1, "reverse")
    assert found.left_out == {"empty cells": 1, "columns (Note)": 1, "lines above the header": 1}
    with pytest.raises(InputError, match="column 'M2': the column is missing"):
        profiled(tmp_path, made.MAP, text.replace("M2", "M3"))
    slip = made.MAP.replace("units: {error: mm}", "units: {position: mm}\nscale: {eror: -1}")
    with pytest.raises(InputError) as refused:
        profiled(tmp_path, slip, text)
    assert [each.value for each in refused.value.findings] == ["position", "eror"]
    twice = made.MAP.replace("constants: {", "constants: {direction: forward, ")
    with pytest.raises(InputError, match="directions of the unpivoted columns and"):
        profiled(tmp_path, twice, text)
    with pytest.raises(InputError, match="furlong"):
        profiled(tmp_path, "schema: mtu/import/1\nunits: {error: furlong}\nfoo: 1\n", text)


def test_targets_may_be_the_headings_of_a_profile(tmp_path: Path) -> None:
    """Read as numbers with the decimal sign of the file, and subtracted once they are rows."""
    profile = """schema: mtu/import/1
columns: {pass: Lauf, direction: Richtung}
unpivot: {into: error, names: position_mm, columns: ["0,0", "50,5"]}
subtract: {error: position_mm}
units: {error: mm}
constants: {component: dx_x}
"""
    text = "Lauf;Richtung;0,0;50,5\n1;+;0,001;50,502\n1;-;0,003;50,504\n"
    table = profiled(tmp_path, profile, text)
    assert table.columns["position_mm"] == [0.0, 50.5, 0.0, 50.5]
    np.testing.assert_allclose(table.columns["error"], [0.001, 0.002, 0.003, 0.004], atol=1e-12)
    named = text.replace("50,5\n", "50 mm\n", 1)
    with pytest.raises(InputError, match="row 1, column '50 mm': not a number"):
        profiled(tmp_path, profile.replace("50,5", "50 mm"), named)


@pytest.mark.parametrize(
    ("measured", "unit", "asked", "error", "made"),
    [
        ("67.00892", "units: {error: mm}", "um", 0.00892, "mm"),
        ("67008.92", "units: {error: um}", None, 8.92, "um"),
        ("67008.92", "", "um", 8.92, "um"),
        ("67.00892", "", None, 0.00892, "mm"),
    ],
)
def test_a_position_is_subtracted_in_the_unit_of_the_error(
    measured: str, unit: str, asked: str | None, error: float, made: str, tmp_path: Path
) -> None:
    """That of the profile or of the call; without one the error is in mm, too."""
    profile = """schema: mtu/import/1
columns: {position_mm: target, error: actual}
subtract: {error: position_mm}
constants: {component: dx_x}
"""
    text = f"target;actual\n67;{measured}\n"
    table = profiled(tmp_path, profile + unit, text, unit=asked)
    assert table.columns["unit"] == [made]
    assert table.columns["error"] == [pytest.approx(error, abs=1e-9)]
    with pytest.raises(InputError, match=r"position_mm is in mm, and .* in arcsec"):
        profiled(tmp_path, profile + "units: {error: arcsec}\n", text)


HEAD = "schema: mtu/import/1\nconstants: {component: c}\nunits: {error: mm}\n"


@pytest.mark.parametrize(
    ("profile", "text", "columns"),
    [
        ("columns: {position_mm: pos}\nunpivot: {into: error, columns: [error, error_2]}",
         "pos;error;error_2\n0;1,5;2,5\n",
         {"error": [1.5, 2.5], "pass": [1, 2]}),
        ("columns: {position_mm: pos, error: M}\ncycles: {from: cycle}",
         "pos;cycle;M\n0;8;1,5\n1;9;2,5\n0;8;1,5\n",
         {"cycle": ["1", "1", "2"]}),
        # Twice, and in inches.
        (
            "columns: {position_mm: Soll, error: Ist, gap: Ist}\nscale: {Soll: 25.4}\n"
            "subtract: {error: Soll, gap: Soll}",
            "Soll;Ist\n1;25,5\n2;50,75\n",
            {"position_mm": [1, 2], "error": [25.5 - 25.4, 50.75 - 50.8]},
        ),
    ],
)  # fmt: skip
def test_headings_that_a_profile_calculates_with(
    profile: str, text: str, columns: dict[str, Any], tmp_path: Path
) -> None:
    """They may be called as the columns that are made of them, and be converted first."""
    table = profiled(tmp_path, HEAD + profile, text)
    for name, values in columns.items():
        assert table.columns[name] == values
    assert "Soll" not in table.columns
    assert table.columns.get("gap") == (columns["error"] if "gap" in profile else None)


def test_headings_in_a_column_of_numbers_are_numbers(tmp_path: Path) -> None:
    """In any that the contract's reader takes for one; sensors may have no reading."""
    text = "T_air_degC;0,0;90,5\n20,5;0,5;91,5\n;0,25;91\n"
    profile = HEAD.replace("error: mm", "error: deg") + (
        "columns: {T_air_degC: T_air_degC}\n"
        "unpivot: {into: error, names: position_deg, columns: ['0,0', '90,5']}\n"
    )
    subtracted = profile + "subtract: {error: position_deg}\n"
    for known, errors in ((profile, [0.5, 91.5, 0.25, 91]), (subtracted, [0.5, 1, 0.25, 0.5])):
        table = profiled(tmp_path, known, text)
        assert table.columns["position_deg"] == [0.0, 90.5] * 2
        assert table.columns["error"] == errors
        assert table.columns["T_air_degC"] == [20.5, 20.5, None, None]
    texts = subtracted.replace("component: c", "component: c, position_mm: '5'")
    with pytest.raises(InputError, match="column 'position_mm': not numbers"):
        profiled(tmp_path, texts.replace(": position_deg}", ": position_mm}"), text)


READINGS = "component,position_mm,pass,direction,error,unit"
CONTRACT = {
    "x.rtl": """
-150 1 + 0.1 um;-100 1 + 0.25 um;-50 1 + -0.5 um;0 1 + 0 um;50 1 + 1.5 um;100 1 + 2.25 um;\
150 1 + 3.125 um;150 1 - 4.125 um;100 1 - 3.25 um;50 1 - 2.5 um;0 1 - 1 um;-50 1 - 0.5 um;\
-100 1 - 1.25 um;-150 1 - 1.1 um""",
    "wide.csv": """
-100 1 + 1.5 um;-100 1 - 2.25 um;-100 2 + 0.125 um;-100 2 - 2 um;0 1 + -1.5 um;0 1 - 2.75 um;\
0 2 + 0.5 um;0 2 - 2.5 um;100 1 + 3 um;100 2 + 4.25 um;100 2 - 1 um""",
    "e.dat": """
-10 1 + -0.000099019 mm;0.24 1 + -0.000086019 mm;-10 2 + -0.000094019 mm;\
0.24 2 + -0.000102019 mm;-10 1 - -0.000081019 mm;0.24 1 - -0.000072019 mm;\
-10 2 - -0.000102019 mm;0.24 2 - -0.000090019 mm""",
    # Its positions have six decimals; the directions are as they are labelled.
    "e.md": """
-10 1 + -0.000099 mm;-10 2 + -0.000094 mm;0.24 1 + -0.000086 mm;0.24 2 + -0.000102 mm;\
-10 1 - -0.000081 mm;-10 2 - -0.000102 mm;0.24 1 - -0.000072 mm;0.24 2 - -0.00009 mm""",
    "laser.txt": """
0 1 + 0.1 um;0 1 - 0.2 um;50 1 + 0.4 um;50 1 - 0.6 um;100 1 + 0.9 um;100 1 - 1 um""",
}
"""What the made files hold, by hand: position, pass, direction, error and unit of each reading."""


def same_readings(content: bytes, name: str, folder: Path) -> None:
    """What a file gives the fit is what its readings, written by hand as a CSV, do."""
    heard = list[Import]()
    convert = converter(lambda path, role: ASK, heard.append)
    path, plain = folder / name, folder / "plain.csv"
    path.write_bytes(content)
    by_hand = [",".join(["dx_x", *row.split()]) for row in CONTRACT[name].strip().split(";")]
    plain.write_text("\n".join([READINGS, *by_hand]).replace("+", "1").replace(",-,", ",-1,"))
    direct, other = (
        read_readings([(each, "laser")], None, for_fit=False, convert=convert)
        for each in (path, plain)
    )
    assert len(heard) == 1
    for field in ("position_mm", "error", "pass_number", "direction", "code"):
        np.testing.assert_allclose(
            getattr(direct, field), getattr(other, field), rtol=0, atol=1e-12
        )
    assert direct.row.tolist() == heard[0].rows


@pytest.mark.parametrize("name", CONTRACT)
def test_an_instruments_file_reads_as_the_contracts_csv(name: str, tmp_path: Path) -> None:
    content = made.FILES[name][1]
    same_readings(content, name, tmp_path)
    if name == "wide.csv":
        points = content.replace(b",", b".").replace(b";", b"\t")
        same_readings(points, name, tmp_path)


@pytest.mark.parametrize("sign", [",", "."])
def test_features_by_parts_read_as_the_contracts_points(sign: str, tmp_path: Path) -> None:
    by_hand = """part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm
P1,hole1,10.0021,20.0010,10,20
P1,hole2,110.0042,19.9990,110,20
P2,hole2,110.0051,20.0030,110,20
"""
    (tmp_path / "wide.csv").write_text(made.WIDE_POINTS.replace(",", sign))
    (tmp_path / "plain.csv").write_text(by_hand)
    convert = converter(lambda path, role: Ask(kind="points"), lambda found: None)
    wide, plain = (
        read_points([(tmp_path / name, "cmm")], None, convert) for name in ("wide.csv", "plain.csv")
    )
    assert (wide.parts, wide.features) == (plain.parts, plain.features)
    for field in ("part", "feature", "measured", "nominal"):
        np.testing.assert_allclose(getattr(wide, field), getattr(plain, field), rtol=0, atol=1e-12)


def test_a_target_without_a_deviation_in_a_run_is_counted() -> None:
    found = read(raw(made.RTL.replace("  2   4    1.000000\r\n", ""), "x.rtl"), ASK)
    assert len(found.rows) == 13
    assert found.left_out["deviations missing in the file"] == 1


@pytest.mark.parametrize("comma", [False, True])
def test_a_csv_of_one_component_leaves_out_what_the_call_says(comma: bool, tmp_path: Path) -> None:
    text = "# after\nposition_mm,pass,direction,error\n0,1,forward,1.25\n50,1,-,-0.5\n"
    text = text.replace(",", ";").replace(".", ",") if comma else text
    (tmp_path / "after.csv").write_text(text, "utf-8")
    files = [(tmp_path / "after.csv", "laser")]
    convert = converter(lambda path, role: ASK, lambda found: None)
    found = read_readings(files, None, for_fit=False, convert=convert)
    assert (found.components, found.error.tolist()) == (("dx_x",), [1.25e-3, -0.5e-3])
    assert (found.direction.tolist(), found.row.tolist()) == ([1, -1], [3, 4])
    nameless = converter(lambda path, role: Ask(unit="um"), lambda found: None)
    with pytest.raises(InputError, match="column 'component': the column is missing"):
        read_readings(files, None, for_fit=False, convert=nameless)


@pytest.mark.parametrize("name", made.FILES)
def test_a_damaged_file_is_read_in_part_or_is_one_error(name: str) -> None:
    rng, content = random.Random(49), made.FILES[name][1]
    whole = len(read(raw(content, name), ASK).rows)
    cuts = range(1, len(content), max(1, len(content) // 40))
    for damaged in [*(content[:cut] for cut in cuts), *(nudged(content, rng) for _ in range(60))]:
        with suppress(InputError):
            found = read(raw(damaged or b"x", name), ASK)
            assert {len(column) for column in found.columns.values()} <= {len(found.rows)}
            assert len(found.rows) <= 2 * whole


def test_a_run_that_is_missing_leaves_the_pairs_of_the_others() -> None:
    """Headings number the runs; where each column has a number of its own they are counted."""
    numbered = {
        "Hin 1;Her 1;Hin 2;Hin 3;Her 3": [1, 1, 2, 3, 3],
        "1 +;2 -;3 +;4 -;5 +": [1, 1, 2, 2, 3],
        "1 + 20.1 C;1 - 20.2 C;2 + 20.2 C;2 - 20.3 C;3 + 20 C": [1, 1, 2, 2, 3],
    }
    for headings, runs in numbered.items():
        text = f"Ziel;{headings}\n0;1;2;3;4;5\n50;1;2;3;4;6\n"
        table = read(raw(text), Ask(kind="readings", component="c", unit="um"))
        assert table.columns["pass"][:5] == runs


def test_a_logger_without_units_has_one_channel_or_is_undecided() -> None:
    text = "Zeit min;T Spindel;Taster\n0;20,1;0\n1;20,3;0,5\n"
    ask = Ask(kind="drift", component="c", unit="um")
    with pytest.raises(InputError, match="which channel is the probe: T Spindel, Taster"):
        read(raw(text), ask)
    assert read(raw(text.replace("T Spindel", "T [degC]")), ask).columns["error"] == [0.0, 0.5]
