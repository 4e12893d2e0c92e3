"""Headers of other programs: what to rename is told, nothing is lost by its spelling."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files import column_words, csv_file
from mtu_cli.files.column_words import may_name, meant_by
from mtu_cli.files.csv_file import read_table
from mtu_cli.files.csv_text import CELL_LIMIT
from mtu_cli.files.points import read_points
from mtu_cli.files.readings import SPEC as READINGS
from mtu_cli.files.readings import read_readings
from mtu_cli.files.readings_stream import stream_readings
from mtu_cli.files.sensor_names import unused_sensor_notes

POINTS = "P1,A,10.001,10.002,1\n"


def refused(tmp_path: Path, header: str, row: str = POINTS) -> list[str]:
    path = tmp_path / "t.csv"
    path.write_text(f"{header}\n{row}", "utf-8")
    with pytest.raises(InputError) as caught:
        read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    return str(caught.value).splitlines()


def test_columns_of_a_measuring_program_are_told_one_by_one(tmp_path: Path) -> None:
    lines = refused(tmp_path, "Serial,Hole,X,Y,Rep")
    pairs = ("Serial", "part"), ("Hole", "feature"), ("X", "x_mm"), ("Y", "y_mm"), ("Rep", "repeat")
    assert len(lines) == len(pairs)
    for line, (other, name) in zip(lines, pairs, strict=True):
        assert f"expected {other!r} renamed to {name!r}" in line


@pytest.mark.parametrize(
    "pairs",
    [
        {"Werkstück": "part", "Merkmal": "feature", "Ist X": "x_mm", "Ist Y": "y_mm",
         "Nennmaß x": "nominal_x_mm", "Nennmaß y": "nominal_y_mm", "Ist Z": "z_mm"},
        {"Part no.": "part", "hole": "feature", "Actual X [mm]": "x_mm", "y_actual": "y_mm",
         "X nominal (mm)": "nominal_x_mm"},
        {"Teil-Nr": "part", "Bohrung": "feature", "IstX": "x_mm", "IstY": "y_mm",
         "SollX": "nominal_x_mm"},
        {"N° pièce": "part", "Caractéristique": "feature", "X mesuré": "x_mm", "Y mesuré": "y_mm",
         "X théorique": "nominal_x_mm"},
        {"Part": "part", "Bore": "feature", "meas_x": "x_mm", "Y meas.": "y_mm"},
        {"Teil": "part", "Merkmal": "feature", "X-Wert": "x_mm", "Y-Wert [mm]": "y_mm",
         "Z-Wert": "z_mm", "Wiederholung": "repeat"},
        {"part": "part", "feature": "feature", "x-value": "x_mm", "Y coord.": "y_mm",
         "z-value": "z_mm"},
        {"Part No": "part", "Hole": "feature", "Run": "repeat", "x": "x_mm", "y": "y_mm"},
        {"pi\u00e8ce": "part", "trou": "feature", "Xmes": "x_mm", "Ymes": "y_mm"},
        {"Teil": "part", "Bohrung": "feature", "Mess_X": "x_mm", "Mess_Y": "y_mm",
         "Soll_X": "nominal_x_mm", "Soll_Y": "nominal_y_mm", "Wdh.-Nr.": "repeat"},
        {"Pieza": "part", "Agujero": "feature", "x medido": "x_mm", "y medido": "y_mm"},
        {"Prüfling": "part", "Merkmalsname": "feature", "Ist X": "x_mm", "Ist Y": "y_mm",
         "Nenn X": "nominal_x_mm", "Nenn Y": "nominal_y_mm", "Sequenz": "sequence",
         "Richtung_x": "dir_x", "Lauf": "repeat"},
        {"Teile-Nr.": "part", "Merkmals-Nr.": "feature", "X": "x_mm", "Y": "y_mm",
         "Xn": "nominal_x_mm", "Yn": "nominal_y_mm", "Zeit [min]": "time_min"},
        {"Teilenummer": "part", "Pos": "feature", "x": "x_mm", "y": "y_mm"},
        {"Serial No": "part", "Char": "feature", "Actual X": "x_mm", "Meas Y": "y_mm",
         "Nominal X": "nominal_x_mm", "Nominal Y": "nominal_y_mm", "Trial": "repeat"},
        {"Sample": "part", "FeatureName": "feature", "X": "x_mm", "Y": "y_mm", "Load": ""},
        {"Part ID": "part", "Char No": "feature", "X": "x_mm", "Y": "y_mm", "Ist X 2": ""},
        {"Part": "part", "Bohrung": "feature", "X [mm]": "x_mm", "Y (mm)": "y_mm"},
        {"Part": "part", "Bohrung": "feature", "x_[mm]": "x_mm", "Y/mm": "y_mm"},
        {"Stücknummer": "part", "Prüfmerkmal": "feature", "X": "x_mm", "Y": "y_mm"},
        {"Ser.Nr": "part", "Loch": "feature", "X_ist": "x_mm", "Y_ist": "y_mm"},
    ],
    ids=["German", "English", "joined", "French", "short", "values", "values too", "runs", "mes",
         "Mess", "Spanish", "names", "numbers", "positions", "characters", "samples", "IDs",
         "units", "units too", "pieces", "serial numbers"],
)  # fmt: skip
def test_common_words_for_columns_are_known(pairs: dict[str, str], tmp_path: Path) -> None:
    lines = refused(tmp_path, ",".join(pairs), ",".join("1" * len(pairs)) + "\n")
    pairs = {other: name for other, name in pairs.items() if name not in (other, "")}
    assert len(lines) == len(pairs)
    for other, name in pairs.items():
        assert sum(f"expected {other!r} renamed to {name!r}" in line for line in lines) == 1


@pytest.mark.parametrize(
    ("header", "name"),
    [("Teil,Auftragsteil-Nr,Seriennummer,feature", "part"), ("part,Name,Pos", "feature"),
     ("part,Bohrung,Merkmal", "feature"), ("part,Temperature,Load", "feature"),
     ("Probe,feature", "part")],
)  # fmt: skip
def test_of_columns_that_are_as_likely_none_is_told(header: str, name: str, tmp_path: Path) -> None:
    row = ",".join("1" * (header.count(",") + 3))
    lines = refused(tmp_path, f"{header},x_mm,y_mm", f"{row}\n")
    wanted = f"expected a column {name!r} (the columns are {', '.join(header.split(','))}, x_mm, y"
    assert wanted in lines[0]


@pytest.mark.parametrize(
    ("header", "name", "other"),
    [("part,ID", "feature", "ID"), ("feature,Name", "part", "Name")],
)
def test_a_bare_name_may_be_what_is_missing(
    header: str, name: str, other: str, tmp_path: Path
) -> None:
    """Of a part or a feature, whichever is not there; of two of them nobody knows."""
    lines = refused(tmp_path, f"{header},x_mm,y_mm", "1,a,9.99,10\n")
    assert f"expected a column {name!r}: {other!r} may be it, renamed" in lines[0]
    both = refused(tmp_path, f"{header},Code,x_mm,y_mm", "1,a,b,9.99,10\n")
    assert f"expected a column {name!r} (the columns are" in both[0]


def test_times_may_be_dates_or_minutes(tmp_path: Path) -> None:
    (line,) = refused(tmp_path, "part,feature,x_mm,y_mm,Zeit")
    assert line.endswith(
        "expected 'Zeit' renamed to 'time' ('time_min' where it counts minutes), or to a name of "
        "its own"
    )


def test_common_words_of_readings_are_known() -> None:
    words = {"Komponente": "component", "Abweichung": "error", "Einheit": "unit", "Écart": "error",
             "Messposition [mm]": "position_mm", "Richtung": "direction"}  # fmt: skip
    assert {word: meant_by(word) for word in words} == words


@pytest.mark.parametrize(
    "other",
    ["Befund", "Werkzeug", "x y ist", "Ist", "mm", "°", "Höhe", "Prüfer", "Wert", "Z-Achse",
     "Z-Wert [µm]", "x ist soll", "xray", "Measurement", "Messung", "nx", "Zeit-Nr.", "Soll X 2",
     "Uhrzeit", "Datum", "Fehlername", "n"],
)  # fmt: skip
def test_other_words_are_columns_of_their_own(other: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"part,feature,x_mm,y_mm,{other}\n{POINTS}", "utf-8")
    read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    assert meant_by(other) is None


@pytest.mark.parametrize(
    ("column", "name"),
    [("Repeat", "repeat"), ("dir_X", "dir_x"), ("Sequence", "sequence"), ("Time", "time"),
     ("Nominal X mm", "nominal_x_mm"), ("TimeMin", "time_min"), ("repeats", "repeat"),
     ("squence", "sequence"), ("opration", "operation"), ("time_mins", "time_min"),
     ("Sequence No", "sequence"), ("repeat_id", "repeat"), ("Z", "z_mm"),
     ("Z [mm]", "z_mm"), ("z (mm)", "z_mm"), ("z_in_mm", "z_mm"), ("Z-Ist [mm]", "z_mm"),
     ("Z/mm", "z_mm"), ("z.mm", "z_mm"),
     ("nominal_x", "nominal_x_mm"), ("Soll X", "nominal_x_mm"), ("Z-Wert", "z_mm"),
     ("z-value", "z_mm"), ("zwert", "z_mm"), ("Z-Maß [mm]", "z_mm"), ("Z-Ist-Wert", "z_mm"),
     ("Z-Soll-Wert", "nominal_z_mm"), ("Wiederholung", "repeat"), ("Répétition", "repeat"),
     ("Opération", "operation"), ("Séquence", "sequence"), ("replicate", "repeat"),
     ("Wdh.", "repeat"), ("Rep No.", "repeat"), ("x_nominal_mm", "nominal_x_mm"),
     ("y_nominal_mm", "nominal_y_mm"), ("nominl_y_mm", "nominal_y_mm"),
     ("X_theo", "nominal_x_mm"), ("Target Y [mm]", "nominal_y_mm"), ("z.cad", "nominal_z_mm"),
     ("THEO X", "nominal_x_mm"), ("Design_Y_mm", "nominal_y_mm")],
)  # fmt: skip
def test_an_optional_column_is_not_lost_by_its_spelling(
    column: str, name: str, tmp_path: Path
) -> None:
    (line,) = refused(tmp_path, f"part,feature,x_mm,y_mm,{column}")
    assert f"column {column!r}" in line
    assert f"expected {column!r} renamed to {name!r}" in line


@pytest.mark.parametrize(
    ("unit", "how"),
    [("_um", "divided by 1000"), (" [\u00b5m]", "divided by 1000"),
     ("_in_um", "divided by 1000"), ("_nm", "divided by 1000000"),
     ("_in", "multiplied by 25.4"), (" (inch)", "multiplied by 25.4"),
     ("_m", "multiplied by 1000"), (" / cm", "multiplied by 10")],
)  # fmt: skip
def test_a_column_in_another_unit_is_to_be_converted(unit: str, how: str, tmp_path: Path) -> None:
    pairs = {"x": "x_mm", "Y": "y_mm", "nominal_x": "nominal_x_mm", "Nominal Y": "nominal_y_mm",
             "Z": "z_mm"}  # fmt: skip
    given = [bare + unit for bare in pairs]
    lines = refused(tmp_path, ",".join(["part", "feature", *given]), "P,A,1,1,1,1,1\n")
    assert len(lines) == len(pairs)
    for other, name in zip(given, pairs.values(), strict=True):
        words = f"expected {other!r} {how} and renamed to {name!r}"
        assert sum(words in line for line in lines) == 1


def test_positions_in_another_unit_too(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    for column in ("position_um", "Position [\u00b5m]"):
        path.write_text(f"component,error,unit,{column}\ndx,1,um,5\n", "utf-8")
        with pytest.raises(
            InputError, match=f"expected {re.escape(repr(column))} divided by 1000 and"
        ):
            read_table(path, "lbb", READINGS)


@pytest.mark.parametrize("name", ["dev_{}", "d{}", "error {}", "{}_dev", "Abweichung {} [mm]",
                                  "delta_{}_um", "{}_deviation_mm", "d{}_mm"])  # fmt: skip
def test_deviations_are_not_the_coordinates_they_are_of(name: str, tmp_path: Path) -> None:
    given = [name.format(axis) for axis in "xy"]
    lines = refused(tmp_path, ",".join(["part", "feature", *given]), "P1,A,1,1\n")
    assert [line.split("missing; ")[1] for line in lines] == [
        f"expected a column '{axis}_mm' with the measured coordinate, nominal plus deviation, in "
        f"mm ({other!r} looks like the deviation)"
        for axis, other in zip("xy", given, strict=True)
    ]


def test_the_columns_that_there_are_are_told_as_such(tmp_path: Path) -> None:
    lines = refused(tmp_path, "part,feature,y_mm,dir_x,vertex", "P1,A,1,1,1\n")
    expected = "a column 'x_mm' (the columns are part, feature, y_mm, dir_x, vertex)"
    assert lines[0].endswith(f"the column 'x_mm' is missing; expected {expected}")


def test_readings_too(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("component,error,unit,Direction,Pass\ndx,1,um,+,1\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_table(path, "lbb", READINGS)
    assert "'Direction'" in str(caught.value)
    assert "'Pass'" in str(caught.value)


@pytest.mark.parametrize(
    "column", ["run", "Runs", "Run No.", "Durchlauf", "measurement no", "Messung Nr."]
)
def test_a_count_that_may_be_of_the_repeats_is_told_of(column: str, tmp_path: Path) -> None:
    """Beside other columns that are to be renamed it is with them; alone it stays a covariate."""
    lines = refused(tmp_path, f"part,Hole,x_mm,y_mm,{column}")
    assert f"expected {column!r} renamed to 'repeat', or to a name of its own" in lines[-1]
    path = tmp_path / "cmm.csv"
    head = f"part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,{column}"
    path.write_text(f"{head}\nP,A,1,1,1,1,1\nQ,A,1,1,1,1,2\n", "utf-8")
    found = read_points([(path, "cmm")], None)
    (note,) = [item for item in found.notes if item.code == "column-not-used"]
    assert note.message == (
        f"cmm.csv, row 1: the column {column!r} is not used as 'repeat': rename it where it "
        "numbers these"
    )
    for name in ("run_id", "measurement_id"):
        path.write_text(f"{head.replace(column, name)}\nP,A,1,1,1,1,1\n", "utf-8")
        assert not [
            item
            for item in read_points([(path, "cmm")], None).notes
            if item.code == "column-not-used"
        ]


@pytest.mark.parametrize(
    ("column", "cells", "own"),
    [("Richtung_x", "1,-1", "'dir_x': rename it where it is the direction along x, -1 or +1"),
     ("Direction Y", ",-1", "'dir_y': rename it where it is the direction along y, -1 or +1"),
     ("Richtung_x", "1,2", None), ("direction_x", ",", None), ("Richtung_x", "+,left", None),
     ("Messung", "1,2", "'repeat': rename it where it numbers these"),
     ("Measurement", "0,1", "'repeat': rename it where it numbers these"),
     ("Messung", "1,1.5", None), ("Messung", "7,8", None), ("Messung", "1,", None),
     ("Trial", "1.5,2", None), ("Sequence name", "drill,mill", None), ("Xn", "0,-1", None),
     ("Xn", "0,50", "'nominal_x_mm': rename it where it is the nominal coordinate"),
     ("Trial", "a,b", "'repeat': rename it where it numbers these"),
     ("Versuch Nr.", "1,2", "'repeat': rename it where it numbers these")],
)  # fmt: skip
def test_what_cells_allow_is_told_of(
    column: str, cells: str, own: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "cmm.csv"
    first, second = cells.split(",")
    path.write_text(
        f"part,feature,x_mm,y_mm,{column}\nP,A,1,1,{first}\nQ,A,1,1,{second}\n", "utf-8"
    )
    found = [n.message for n in read_points([(path, "cmm")], {"A": (1, 1, None)}).notes]
    wanted = f"cmm.csv, row 1: the column {column!r} is not used as {own}"
    assert found == [wanted] * (own is not None)


@pytest.mark.parametrize("column", ["dir", "Dir.", "Sens"])
def test_directions_of_readings_by_other_words(column: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(f"component,error,unit,{column}\ndx,1,um,+\n", "utf-8")
    with pytest.raises(InputError, match=f"{column!r} renamed to 'direction', or to a name"):
        read_table(path, "lbb", READINGS)


@pytest.mark.parametrize(
    ("column", "cells", "own"),
    [("approach", "forward,reverse", "'direction': rename it where it is the direction of travel"),
     ("Anfahrt", "+,-", "'direction': rename it where it is the direction of travel"),
     ("approach", "fast,slow", None), ("setup", "A,B", None),
     ("Set-up", "A,B", "'setup': rename it where it tells set-ups apart"),
     ("Aufspannung", "1,2", "'setup': rename it where it tells set-ups apart")],
)  # fmt: skip
def test_what_may_be_directions_or_set_ups_of_readings_is_told(
    column: str, cells: str, own: str | None, tmp_path: Path
) -> None:
    """Of a drift, whose runs are cycles, neither counts."""
    first, second = cells.split(",")
    path = tmp_path / "r.csv"
    path.write_text(f"component,error,unit,{column}\ndx,1,um,{first}\ndx,2,um,{second}\n", "utf-8")
    found = [n.message for n in read_readings([(path, "laser")], None, for_fit=False).notes]
    wanted = f"r.csv, row 1: the column {column!r} is not used as {own}"
    assert found == [wanted] * (own is not None)
    path.write_text(
        f"component,error,unit,T_01_degC,time_min,{column}\n"
        f"dx,1,um,20,0,{first}\ndx,2,um,21,1,{second}\n",
        "utf-8",
    )
    assert not read_readings([(path, "drift")], None, for_fit=False).notes


@pytest.mark.parametrize("column", ["rep", "Repeat", "Wdh."])
def test_runs_of_readings_are_passes_and_of_drifts_are_not(column: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(f"component,error,unit,{column}\ndx,1,um,1\n", "utf-8")
    with pytest.raises(InputError, match=f"expected '{column}' renamed to 'pass', or to a name"):
        read_table(path, "lbb", READINGS)
    assert read_table(path, "drift", READINGS).covariates == (column,)


@pytest.mark.parametrize(
    "column",
    [
        "direction_x",
        "T_02_degC",
        "operator",
        "time_of_day",
        "load",
        "zz_mm",
        "time_min2",
        "position_mm",
        "time_s",
        "time_id",
        "operation_number",
        "nominal",
        "Nominal_XY",
    ],
)
def test_other_columns_stay_covariates(column: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"part,feature,x_mm,y_mm,{column}\n{POINTS}", "utf-8")
    found = read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    assert column in found.covariates


def test_beside_the_column_itself_another_spelling_may_stay(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    rows = "P1,A,10.001,10.002,1,7,1\n"
    path.write_text(f"part,feature,x_mm,y_mm,repeat,Repeat,X-Wert\n{rows}", "utf-8")
    found = read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    assert list(found.covariates) == ["Repeat", "X-Wert"]


def test_another_spelling_that_stays_is_told(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("\npart,feature,x_mm,y_mm,Part,load\nP1,A,10.001,10.002,1,2\n", "utf-8")
    (note,) = read_points([(path, "cmm")], {"A": (10.0, 10.0, None)}).notes
    assert note.code == "columns-alike"
    assert note.message.startswith("t.csv, row 2: the column 'Part' is not used as 'part', from")
    path.write_text("component,error,unit,time_min,Error\naxy,1,um,0,7\naxy,2,um,1,7\n", "utf-8")
    for role in ("lbb", "drift"):
        whole = read_readings([(path, role)], None, for_fit=False)
        (block,) = stream_readings([(path, role)], None)
        assert block.notes == whole.notes
        (text,) = [n.message for n in whole.notes if n.code == "columns-alike"]
        assert "the column 'Error' is not used as 'error'" in text
        assert whole.error.tolist() == [0.001, 0.002]


def test_a_text_of_the_time_beside_minutes_may_stay(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("part,feature,x_mm,y_mm,time_min,Time\nP1,A,10.001,10.002,1,noon\n", "utf-8")
    read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("component,error,unit\na,1,um\n", "row 1: holds readings of components: 'component,err"),
        ("schema: mtu/part/1\nname: p\n", "row 1: is a YAML file, no table: 'schema: mtu/part/1'"),
        ('{"schema": "mtu/lengths/1"}\n', "row 1: is a JSON document, no table"),
        ("sep=;\npart;feature;x_mm;y_mm\n", "row 1: a line for spreadsheets, no header: 'sep=;'"),
        ("Report 7\n\npart,feature,x_mm,y_mm\n", "row 1: no header: 'Report 7'; expected the "
         "header row first (that of row 3?): lines above it begin with #"),
        ("Report,7,,\npart,feature,x_mm,y_mm\n", "row 1: no header: 'Report,7,,'; expected the "
         "header row first (that of row 2?)"),
        ("Protokoll;Calypso;;\nTeil;Merkmal;X-Wert;Y-Wert;Datum\n", "row 1: no header: "
         "'Protokoll;Calypso;;'; expected the header row first (that of row 2?)"),
        ("P1,A,10.001,10.002\n", "row 1: the file begins without a header: 'P1,A,10.001,10.002'"),
    ],
)  # fmt: skip
def test_what_is_no_table_of_points_is_told_by_what_it_is(
    content: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content, "utf-8")
    with pytest.raises(InputError) as caught:
        read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    (line,) = str(caught.value).splitlines()
    assert words in line


@pytest.mark.parametrize("second", ["P1,A,10.001,10.002", "a,b,c,", "a,b", "a,a,b,c"])
def test_empty_names_above_what_is_no_header_are_told_as_such(second: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"Report,Calypso,,\n{second}\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    assert "columns 3 to 4 have no name" in str(caught.value)


def drift(tmp_path: Path, column: str, cell: str = "20.5") -> list[tuple[Path, str]]:
    path = tmp_path / "d.csv"
    rows = f"a,1,um,20.1,{cell}\na,2,um,20.2,{cell}\n"
    path.write_text(f"component,error,unit,T_01_degC,{column}\n{rows}", "utf-8")
    return [(path, "drift")]


@pytest.mark.parametrize(
    ("column", "name"),
    [("T_02", "T_02_degC"), ("t_02_degC", "T_02_degC"), ("T_02_C", "T_02_degC"),
     ("Temp_02_degC", "T_02_degC"), ("T02", "T_02_degC"), ("t_02_C", "T_02_degC"),
     ("temperature 3", "T_3_degC"), ("T_02 [\u00b0C]", "T_02_degC"), ("T-02", "T_02_degC"),
     ("spindle_degC", "T_spindle_degC"), ("T_02_K", "T_02_degC"), ("Temperature", None)],
)  # fmt: skip
def test_a_sensor_is_not_lost_by_its_name(column: str, name: str | None, tmp_path: Path) -> None:
    """Read as a whole or block by block, the words are the same."""
    files = drift(tmp_path, column)
    found = []
    for read in (lambda: read_readings(files, None, for_fit=False),
                 lambda: list(stream_readings(files, None))):  # fmt: skip
        with pytest.raises(InputError) as caught:
            read()
        found.append(str(caught.value))
    assert found[0] == found[1]
    assert f"column {column!r}: not the name of a temperature" in found[0]
    wanted = f"alone: rename {column!r} to {name!r} (in degC), or" if name else "alone, or, where"
    assert wanted in found[0]


@pytest.mark.parametrize("first", ["Teil,Bohrung,Lage,Rand", "Teil,Bohrung,Lage,"])
def test_a_header_of_other_names_stands_above_no_other(first: str, tmp_path: Path) -> None:
    """Texts below names are cells."""
    path = tmp_path / "t.csv"
    path.write_text(f"{first}\nP1,A,left,upper\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    assert "no header" not in str(caught.value)


BARE = ["Temperatur [\u00b0C]", "Temperature (\u00b0C)", "Temp. [C]", "Temp", "T [\u00b0C]"]


@pytest.mark.parametrize("column", BARE)
def test_what_is_called_a_temperature_alone_is_to_be_named_by_its_place(
    column: str, tmp_path: Path
) -> None:
    path = tmp_path / "p.csv"
    form = "T_<sensor>_degC, such as {} (in degC), with letters a to z, digits and _ alone, or,"
    for more, example in (("", "T_spindle_degC"), (",T_spindle_degC", "T_air_degC")):
        path.write_text(f"part,feature,x_mm,y_mm,{column}{more}\n1,A,1,2,20{more and ',20'}\n")
        with pytest.raises(InputError) as caught:
            read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
        assert f"{column!r}: not the name of a temperature; expected {form.format(example)}" in str(
            caught.value
        )


@pytest.mark.parametrize(("unit", "words"), [("K", "value - 273.15"), ("\u00b0F", "(value - 32)")])
def test_a_bare_temperature_in_another_unit_is_to_be_converted(
    unit: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        read_readings(drift(tmp_path, f"Temperatur [{unit}]"), None, for_fit=False)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("T_02_degF", "like one; values in Fahrenheit become degC: (value - 32) / 1.8"),
        ("spindle [\u00b0F]", None),
        ("T_02_K", "like one; values in kelvin become degC: value - 273.15"),
        ("T_02_C", "a name that does not look like one"),
    ],
)
def test_values_of_another_unit_are_to_be_converted(
    column: str, words: str | None, tmp_path: Path
) -> None:
    files = drift(tmp_path, column)
    if words is None:
        assert len(read_readings(files, None, for_fit=False)) == 2
        return
    with pytest.raises(InputError) as caught:
        read_readings(files, None, for_fit=False)
    assert str(caught.value).endswith(words)


@pytest.mark.parametrize(
    ("column", "cells", "told"),
    [
        ("NTC7", [20.1, 21.5, 20.7, 20.2], "T_NTC7_degC"),
        ("Kanal 2", [20.1, 21.5, 20.7, 20.2], "T_Kanal_2_degC"),
        ("CH1", [20.1, 21.5, 20.7, 20.2], "T_CH1_degC"),
        ("table", [20.1, 20.9, 21.6, 22.1], "T_table_degC"),
        ("sensor_A", [20.1, 21.5, 20.7, 20.2], "T_sensor_A_degC"),
        ("bed_H", [20.1, 20.9, 21.6, 22.1], "T_bed_H_degC"),
        ("spindle_kW", [20.1, 20.9, 21.6, 22.1], None),
        ("air_RH", [20.1, 20.9, 21.6, 22.1], None),
        ("load", [20.1, 20.9, 20.2, 21.0], None),
        ("feed", [1000.1, 1001.2, 1002.1, 1003.3], None),
        ("count", [1, 2, 3, 4], None),
        ("Sensor3", [20.1, 20.2, 20.1, 20.2], None),
        ("Sensor3", ["a", "b", "a", "b"], None),
        ("Sensor3", ["", 20.1, 21.5, 20.7], None),
    ],
)
def test_a_column_that_moves_like_a_temperature_is_not_lost_in_silence(
    column: str, cells: list[object], told: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "d.csv"
    rows = [f"a,{i},um,{20 + i},{cell}\n" for i, cell in enumerate(cells)]
    path.write_text(f"component,error,unit,T_01_degC,{column}\n{''.join(rows)}", "utf-8")
    found = list(unused_sensor_notes(read_readings([(path, "drift")], None, for_fit=False)))
    assert [note.code for note in found] == ["not-a-temperature"] * (told is not None)
    if told is not None:
        assert f"column {column!r} is not used" in found[0].message
        assert found[0].message.endswith(f"such as {told}")


@pytest.mark.parametrize(
    "column", ["T_02_degC", "load", "type", "trial_c", "t_min", "tool", "time_of_day", "template"]
)
def test_other_columns_of_drift_readings_stay(column: str, tmp_path: Path) -> None:
    found = read_readings(drift(tmp_path, column), None, for_fit=False)
    assert column in found.covariates


def test_kelvin_are_told(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"no temperature: '293.5'; expected degC: this looks like k"
    ):
        read_readings(drift(tmp_path, "T_02_degC", "293.5"), None, for_fit=False)


def test_a_text_is_no_temperature_whatever_its_name(tmp_path: Path) -> None:
    assert read_readings(drift(tmp_path, "T_probe", "glued on"), None, for_fit=False).covariates


@pytest.mark.parametrize("small", [0, csv_file.SMALL])
def test_bad_columns_are_told_in_the_order_of_the_header(
    small: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By either reader, whatever the hashes of the names, which differ from run to run."""
    monkeypatch.setattr(csv_file, "SMALL", small)
    sensors = [f"T_{i:02}_degC" for i in range(1, 13)]
    (path, role), *_ = drift(tmp_path, ",".join(sensors[1:]), ",".join(["293.1"] * 11))
    with pytest.raises(InputError) as caught:
        read_readings([(path, role)], None, for_fit=False)
    assert list(dict.fromkeys(item.column for item in caught.value.findings)) == sensors[1:]


def test_a_name_of_megabytes_is_looked_at_in_its_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    """A damaged file may be one long name, which is compared with every known one."""
    seen: list[int] = []

    class Counted:
        def normalize(self, form: str, text: str) -> str:
            seen.append(len(text))
            return text

        def combining(self, sign: str) -> int:
            return 0

    monkeypatch.setattr(column_words, "unicodedata", Counted())
    assert column_words.meant_by("é" * 4_000_000) is None
    assert column_words.plain("É") == "é"
    assert max(seen) <= column_words.LONGEST


def test_of_two_columns_for_one_thing_one_is_offered(tmp_path: Path) -> None:
    lines = refused(tmp_path, "part,feature,x_mm,y_mm,Timestamp,Zeit [min]")
    assert sum("renamed to 'time" in line for line in lines) == 1


def test_no_column_is_offered_that_is_none(tmp_path: Path) -> None:
    """One letter in common, or a unit, is no slip of the fingers."""
    lines = refused(tmp_path, "Pallet,Feature,d_mm,r_mm,max_mm")
    for wanted in ("part", "x_mm", "y_mm"):
        (line,) = (line for line in lines if f"the column {wanted!r} is missing" in line)
        assert "renamed" not in line


def test_columns_by_sight() -> None:
    assert meant_by("min time") is None
    assert not may_name("Teil-Nr.")


def test_a_quote_that_takes_many_lines_into_a_name_is_not_told_whole(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text('component,position_mm,pass,"' + ",error,unit\npitch_x,1,1,1,um" * 40 + '"\n')
    with pytest.raises(InputError) as caught:
        read_table(path, "lbb", READINGS)
    assert all(len(line) < 300 for line in str(caught.value).splitlines())
    assert "(the columns are component, position_mm, pass, ,error,unit" in str(caught.value)


@pytest.mark.parametrize(
    ("cells", "others"),
    [("1,20.1", ["Messung", "Temp. Messraum"]), ("10.0012,20.1", ["Temp. Messraum"]),
     ("1,warm", ["Messung"]), ("7,", ["Temp. Messraum"])],
)  # fmt: skip
def test_all_columns_to_rename_are_told_at_once(
    cells: str, others: list[str], tmp_path: Path
) -> None:
    """Beside a missing column those are told that would be told, or warned of, without it."""
    lines = refused(tmp_path, "Teil,feature,x_mm,y_mm,Messung,Temp. Messraum", f"1,A,1,2,{cells}\n")
    assert "expected 'Teil' renamed to 'part'" in lines[0]
    words = {"Messung": "'Messung' renamed to 'repeat' where it numbers these",
             "Temp. Messraum": "rename 'Temp. Messraum' to 'T_Messraum_degC'"}  # fmt: skip
    for other, line in zip(others, lines[1:], strict=True):
        assert f", column {other!r}: " in line
        assert words[other] in line


@pytest.mark.parametrize(
    ("column", "cells", "told"),
    [
        # A tool, as it may be by itself.
        ("T_12", ["12", "13", "12"], False), ("T12", ["20.5"] * 3, False),
        ("T_12_C", ["20.5"] * 3, True),
        # All the first rows decide.
        ("Temp. 2", ["20.5", "", "20.7"], True), ("Temp. 2", ["", "", "glued on"], False),
        ("Messung", ["1", "2", "1"], True), ("Messung", ["0", "1", "2"], True),
        ("Messung", ["3", "1", "2"], True), ("Messung", ["1", "10.0012", "9.998"], False),
        ("Messung", ["1", "", "2"], False), ("Messung", ["4", "5", "6"], False),
    ],
)  # fmt: skip
def test_what_is_told_beside_other_columns_is_what_all_first_rows_say(
    column: str, cells: list[str], told: bool, tmp_path: Path
) -> None:
    rows = "".join(f"{i},A,1,2,{cell}\n" for i, cell in enumerate(cells))
    lines = refused(tmp_path, f"Teil,feature,x_mm,y_mm,{column}", rows)
    assert [f", column {column!r}: " in line for line in lines] == [False, True][: 1 + told]


def test_rows_that_cannot_be_read_hide_no_fault_of_the_header(tmp_path: Path) -> None:
    header, row = "Teil,feature,x_mm,y_mm,Messung", "1,A,1,2,1\n"
    plain = refused(tmp_path, header, row)
    for place, told in ((0, 1), (1, 2)):
        rows = [row, row]
        rows[place] = f"1,A,1,2,{'1' * (CELL_LIMIT + 1)}\n"
        assert refused(tmp_path, header, "".join(rows)) == plain[:told]


@pytest.mark.parametrize(
    ("error", "words"),
    [("Abweichung [\u00b5m]", "a column 'unit', with 'um' (of 'Abweichung [\u00b5m]') in each row"),
     ("error (arcsec)", "a column 'unit', with 'arcsec' (of 'error (arcsec)') in each row"),
     ("error_um", "a column 'unit', with 'um' (of 'error_um') in each row"),
     ("error [um/m]", "a column 'unit', with 'um/m' (of 'error [um/m]') in each row"),
     ("error", "a column 'unit' (the columns are Achse, position_mm, error)")],
)  # fmt: skip
def test_a_header_that_tells_the_unit_of_readings(error: str, words: str, tmp_path: Path) -> None:
    """As laser programs write it: the axis for the component, no column of units."""
    path = tmp_path / "laser.csv"
    path.write_text(f"Achse,position_mm,{error}\nX,0,1\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_table(path, "laser", READINGS)
    told = [line.partition("expected ")[2] for line in str(caught.value).splitlines()]
    assert told[0].startswith("'Achse' renamed to 'component', its cells being components of")
    assert told[-1] == words


Z = ", and of Z, where it has rows, in 'z_mm'"


@pytest.mark.parametrize(
    ("header", "words"),
    [("part,feature,Axis,Nominal,Actual,Deviation",
      "'Actual' of X in a column 'x_mm', of Y in 'y_mm'" + Z
      + "; 'Nominal' likewise in nominal_x_mm, nominal_y_mm"),
     ("part,feature,Achse,Ist [mm],Abw", "'Ist [mm]' of X in a column 'x_mm', of Y in 'y_mm'" + Z),
     ("part,feature,Axis,Dev", "nominal plus 'Dev' of X in a column 'x_mm', of Y in 'y_mm'" + Z)],
)  # fmt: skip
def test_a_row_for_each_axis_is_told_as_such(header: str, words: str, tmp_path: Path) -> None:
    row = ",".join(["1", "A", "X", "10", "10.001", "0.001"][: header.count(",") + 1])
    (line,) = refused(tmp_path, header, f"{row}\n")
    assert "the table has a row for each axis; expected one row for each feature" in line
    assert line.endswith(words)


def test_an_axis_beside_coordinates_is_a_column_of_its_own(tmp_path: Path) -> None:
    lines = refused(tmp_path, "part,feature,axis,x,y,actual", "1,A,X,1,2,3\n")
    assert [line.partition("expected ")[2] for line in lines] == [
        "'x' renamed to 'x_mm'", "'y' renamed to 'y_mm'"]  # fmt: skip


@pytest.mark.parametrize(
    ("header", "words"),
    [("part,feature,x_mm,y_mm,", "column 5 has no name, as the header ends with ','"),
     ("part,feature,x_mm,y_mm" + "," * 5000, "columns 5 to 5004 have no name"),
     ("part,,feature,x_mm,,,y_mm,", "columns 2, 5 to 6, 8 have no name"),
     ("part" + ",,a".join(map(str, range(10))) + ",feature,x_mm,y_mm",
      "columns 2, 4, 6, 8, 10, 12 and 3 more have no name")],
)  # fmt: skip
def test_columns_without_a_name_are_one_fault(header: str, words: str, tmp_path: Path) -> None:
    lines = refused(tmp_path, header, "1\n")
    assert f"row 1: {words}; expected a name" in lines[0]
    assert "name;" not in "".join(lines[1:])


def test_sensors_in_kelvin_are_one_fault(tmp_path: Path) -> None:
    rows = "".join(f"a,1,um,293.{i},{294 + i},{20 + i}\n" for i in range(5))
    path = tmp_path / "d.csv"
    path.write_text(f"component,error,unit,T_01_degC,T_02_degC,T_03_degC\n{rows}", "utf-8")
    with pytest.raises(InputError) as caught:
        read_readings([(path, "drift")], None, for_fit=False)
    assert str(caught.value) == (
        "d.csv, row 2, column 'T_01_degC': 10 of 10 cells of T_01_degC, T_02_degC are no "
        "temperatures: '293'; expected degC: this looks like kelvin, from which 273.15 is to be "
        "subtracted"
    )


def test_sensors_of_which_not_all_cells_may_be_kelvin_are_told_by_rows(tmp_path: Path) -> None:
    cells = [293.0, 293.5, 999.0, 294.5, 295.0]
    rows = "".join(f"a,1,um,{cell}\n" for cell in cells)
    path = tmp_path / "d.csv"
    path.write_text(f"component,error,unit,T_01_degC\n{rows}", "utf-8")
    with pytest.raises(InputError) as caught:
        read_readings([(path, "drift")], None, for_fit=False)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(cells)
    assert not [line for line in lines if "kelvin" in line]


def test_a_column_that_no_equation_can_name_is_told(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    head = "component,position_mm,error,unit,x,step,pi,shift\n"
    path.write_text(f"{head}a,0,1,um,1,2,3,4\n", "utf-8")
    notes = read_readings([(path, "lbb")], None, for_fit=False).notes
    found = [note.message for note in notes if note.code == "column-name-taken"]
    assert found == [
        f"r.csv, row 1: the column {name!r} cannot be named in an equation, where {name!r} is "
        f"{what}; rename it where one needs it, such as to '{name}_value'"
        for name, what in (("x", "the position"), ("step", "a function"), ("pi", "a number"))
    ]


def test_no_equation_has_columns_of_drifts(tmp_path: Path) -> None:
    notes = read_readings(drift(tmp_path, "step"), None, for_fit=False).notes
    assert not notes


def test_a_comment_below_the_header_hides_nothing(tmp_path: Path) -> None:
    header, row = "Teil,feature,x_mm,y_mm,Messung", "1,A,1,2,1\n"
    plain = refused(tmp_path, header, row)
    assert len(plain) == 2
    assert refused(tmp_path, header, f"# of the second shift\n\n{row}") == plain


@pytest.mark.parametrize(
    "other",
    [
        "Target (mm)",
        "Soll [mm]",
        "Sollposition",
        "target position",
        "Axis position (mm)",
        "nominal",
    ],
)
def test_targets_of_other_programs_are_positions(other: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(f"component,{other},error,unit\ndx,0,1,um\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_table(path, "lbb", READINGS)
    assert f"expected {other!r} renamed to 'position_mm'" in str(caught.value)


def test_a_short_word_for_the_order_is_told(tmp_path: Path) -> None:
    (line,) = refused(tmp_path, "part,feature,x_mm,y_mm,Seq", "1,A,1,2,3\n")
    assert "'Seq' renamed to 'sequence'" in line


@pytest.mark.parametrize(("cells", "told"), [(("1", "-1"), True), (("0.5", "-1"), False)])
def test_differences_that_are_signs_are_directions(
    cells: tuple[str, str], told: bool, tmp_path: Path
) -> None:
    path = tmp_path / "t.csv"
    rows = "".join(f"{part},A,1,2,{cell}\n" for part, cell in enumerate(cells))
    path.write_text(f"part,feature,x_mm,y_mm,dx\n{rows}")
    found = read_points([(path, "cmm")], {"A": (10.0, 10.0, None)})
    said = [item.message for item in found.notes if "'dx'" in item.message]
    assert bool(said) == told
    assert not told or "is not used as 'dir_x': rename it where it is the direction" in said[0]


@pytest.mark.parametrize("column", ["Error type", "error_name", "Error component"])
def test_names_of_errors_are_no_sizes_of_them(column: str, tmp_path: Path) -> None:
    path = tmp_path / "lbb.csv"
    path.write_text(f"{column},position_mm,pass,Value,unit\npx,0,1,2.0,um\n", "utf-8")
    with pytest.raises(InputError) as caught:
        read_readings([(path, "lbb")], None, for_fit=True)
    told = [str(problem.expected) for problem in caught.value.findings]
    assert told == [f"{column!r} renamed to 'component'", "'Value' renamed to 'error'"]
