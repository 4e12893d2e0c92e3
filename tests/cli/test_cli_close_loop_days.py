"""Closing the loop end to end: days in a shop and on a measuring machine, as a user runs them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from cli_runner import NO_WAVES, TWO_FOLDS, done, machine_file, mtu, report
from shop_day import (
    ShopDay,
    Truth,
    effect,
    measure_repeats,
    outside_effect,
    write_csv,
    write_machine,
    write_part,
)


def shop(
    folder: Path, seed: int, truths: Sequence[tuple[str, float]] = (), outside: str | None = None
) -> tuple[str, ...]:
    """The files of a shop day A in a folder; what `close-loop` is called with."""
    day, rng = ShopDay("A", seed), np.random.default_rng(seed)
    found: list[Truth] = [effect(day, name, rng, size) for name, size in truths]
    if outside is not None:
        found.append(outside_effect(day, outside, rng, 1.0))
    write_machine(folder / "machine.yaml")
    write_part(day, folder / "part.yaml")
    write_csv(day, measure_repeats(day, rng, found), folder / "cmm.csv")
    return ("-m", "machine.yaml", "-p", "part.yaml", "--cmm", "cmm.csv")


def closed(folder: Path, *args: str) -> dict[str, Any]:
    found: dict[str, Any] = report("close-loop", *args, cwd=folder)["results"]
    return found


EXTEND = ("--write-machine", "extended.yaml", "--write-components", "extended.json")
EXTENDED = ("-m", "extended.yaml", "-c", "extended.json", "-p", "part.yaml")


@TWO_FOLDS
def test_an_effect_outside_the_library_gets_no_lone_name(tmp_path: Path) -> None:
    args = shop(tmp_path, 202, outside="random-walk")
    gate = ("--fail-if", "unexplained", "-o", "-")
    found = json.loads(done(mtu("close-loop", *args, *gate, cwd=tmp_path), 3).stdout)["results"]
    assert found["verdict"] == "unexplained"
    assert found["unexplained"]["rms_um"] > 0


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shop day whose backlash and scale were found and written into its machine."""
    folder = tmp_path_factory.mktemp("extended")
    args = shop(folder, 3, [("backlash-x", 2.0), ("scale-y", 2.0)])
    with (folder / "part.yaml").open("a") as file:
        file.write("lengths: [{from: '1', to: '7'}, {from: '7', to: '13'}]\n")
        row, column = ([str(i) for i in range(k, k + 7)] for k in (1, 7))
        file.write(f"orthogonality: [{{id: xy, row: {row}, column: {column}}}]\n")
    before = (folder / "machine.yaml").read_bytes()
    with TWO_FOLDS:
        found = closed(folder, *args, *NO_WAVES, *EXTEND)
    (folder / "found.json").write_text(json.dumps(found))
    assert (folder / "machine.yaml").read_bytes() == before
    return folder


def test_every_command_takes_the_extended_machine(extended: Path) -> None:
    """E of `predict-points` is the effects' own; lengths and squareness follow from it."""
    found = json.loads((extended / "found.json").read_text())
    by_name = {item["name"]: item["parameters"] for item in found["effects"]}
    assert set(by_name) == {"backlash-x", "scale-y"}
    day, at = ShopDay("A", 3), ("--at", "dir_x=1")
    points = report("predict-points", *EXTENDED, *at, cwd=extended)["results"]["points"]
    lost, level = by_name["backlash-x"].values()
    scale = by_name["scale-y"]["scale"]
    written = yaml.safe_load((extended / "extended.yaml").read_text())["effects"]
    (backlash,) = (item for item in written if item["name"] == "backlash-x")
    for point in points:
        assert point["Ex_um"] == pytest.approx(lost["value"] + level["value"], rel=1e-9)
        assert point["u_x_um"] ** 2 == pytest.approx(np.sum(backlash["covariance"]), rel=1e-9)
    low, high = (next(p for p in points if p["id"] == name) for name in ("7", "13"))
    grown = scale["value"] * (high["y_mm"] - low["y_mm"]) / 1e3
    assert high["Ey_um"] - low["Ey_um"] == pytest.approx(grown, rel=1e-9)
    lengths = report("lengths", *EXTENDED, *at, cwd=extended)["results"]["lengths"]
    along_x, along_y = (item["error_um"] for item in lengths)
    assert along_x == pytest.approx(0, abs=1e-3)
    assert along_y == pytest.approx(grown, rel=1e-3)
    (angle,) = report(
        "orthogonality", *EXTENDED, *at, "--trials", "2000", "--seed", "1", cwd=extended
    )["results"]["orthogonality"]
    # Neither a shift nor a scale of Y turns a row or a column.
    assert angle["first_order"]["mean_arcsec"] == pytest.approx(0, abs=1e-6)
    data = (*EXTENDED, "--cmm", "cmm.csv")
    # Measured points tell their own directions.
    signs = dict(zip(day.features, day.full("dir_x")[0].tolist(), strict=True))
    corrected = report("correct", *data, cwd=extended)["results"]["points"]
    assert len(corrected) == day.P * day.H * 3
    for item in corrected:
        added = -lost["value"] * signs[item["feature"]] - level["value"]
        assert item["correction_um"]["x"] == pytest.approx(added, rel=1e-6)
    compared = report("compare", *data, cwd=extended)["results"]["features"]
    for item in compared:
        if item["axis"] == "x":
            expected = lost["value"] * signs[item["id"]] + level["value"]
            assert item["predicted"]["mean_um"] == pytest.approx(expected, rel=1e-6)
            assert not item["biased"]


MILL = "{dx: {of: x, unit: um, coefficients: [0, 0], u_future: 1}, "
MILL += "dy: {of: y, unit: um, coefficients: [0, 0], u_future: 1}}"
PLATE = """schema: mtu/part/1
name: plate
features:
  A: {x_mm: 100, y_mm: 20}
  B: {x_mm: 200, y_mm: 120}
  C: {x_mm: 310, y_mm: 40}
  D: {x_mm: 400, y_mm: 150}
"""


def simulated(folder: Path, parts: int, *effects: str) -> tuple[str, ...]:
    """Parts of a mill whose temperature goes from 20 to 27 degC and back."""
    machine_file(folder, MILL)
    (folder / "plate.yaml").write_text(PLATE)
    warm = ("--covariate", "T_mill_degC: 23.5 + 3.5*sin(time_min/9)")
    made = [word for effect in effects for word in ("--effect", effect)]
    day = ("--parts", parts, "--repeats", 1, "--minutes", 1, "--cmm-u-um", 0.3, "--seed", 4, *warm)
    files = ("-m", "m.yaml", "-p", "plate.yaml")
    done(mtu("simulate", *files, *day, *made, "-q", "--write-cmm", "cmm.csv", cwd=folder))
    return (*files, "--cmm", "cmm.csv")


@TWO_FOLDS
def test_parts_that_grow_from_another_temperature_than_20(tmp_path: Path) -> None:
    """From 22 degC and x = 0: one effect, right there, that the extended machine has with its joint
    covariance.
    """
    args = simulated(tmp_path, 24, "Ex: 23e-6*x*(T_mill_degC - 22)")
    text = done(mtu("close-loop", *args, *NO_WAVES, *EXTEND, "-o", "o.json", cwd=tmp_path)).stdout
    assert "X is right at T_mill_degC = 22." in text or "X is right at T_mill_degC = 21.9" in text
    (growth,) = json.loads((tmp_path / "o.json").read_text())["results"]["effects"]
    assert growth["name"] == "thermal-growth-x"
    assert 0.9 < growth["explained_share"] < 1.05
    for T in (20, 22, 27):
        extended = ("-m", "extended.yaml", "-c", "extended.json", "-p", "plate.yaml")
        at = ("--at", f"T_mill_degC={T}")
        for point in report("predict-points", *extended, *at, cwd=tmp_path)["results"]["points"]:
            true, u = 23e-3 * point["x_mm"] * (T - 22), point["u_x_um"]
            assert abs(point["Ex_um"] - true) < 4 * u < 8


@TWO_FOLDS
@pytest.mark.parametrize("datum", ["none", "offset,rotation"])
def test_few_parts_are_told(tmp_path: Path, datum: str) -> None:
    args = simulated(tmp_path, 4)
    told = done(mtu("close-loop", *args, *NO_WAVES, "--datum", datum, cwd=tmp_path)).stderr
    assert "too few parts (4 parts for all features)" in told


# `mtu close-loop --datum offset,diameter`: points of rings of unknown centres and diameters.


PLANE = "{dx: {of: x, unit: um, coefficients: [0, 0], covariance: [[0.01, 0], [0, 1.0e-6]]}, "
PLANE += "dy: {of: y, unit: um, coefficients: [0, 0], covariance: [[0.01, 0], [0, 1.0e-6]]}}"
NOISE_UM = 0.4


def rings(folder: Path, errors: np.ndarray, several: bool) -> None:
    """Ten set-ups of one ring, or of two, off by 20 um and 5 um larger or smaller at random; of
    each 16 points, unevenly about it. `errors` (2, 2) by x and y: dE/d(x, y).
    """
    rng = np.random.default_rng(4)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 16))
    outward = np.column_stack([np.cos(angle), np.sin(angle)])
    lines = ["part,operation,feature,nominal_x_mm,nominal_y_mm,x_mm,y_mm"]
    for part in range(10):
        for k, centre in enumerate(((150, 120), (420, 260))[: 1 + several]):
            place = centre + 90 * outward
            found = place + place @ errors.T + rng.normal(0, 0.02, 2)
            found += rng.normal(0, 0.005) * outward + NOISE_UM / 1e3 * rng.normal(size=(16, 2))
            for i, row in enumerate(np.hstack([place, found])):
                numbers = ",".join(f"{value:.6f}" for value in row)
                lines.append(f"{part},ring{k},r{k}_{i},{numbers}")
    (folder / "cmm.csv").write_text("\n".join(lines) + "\n", "utf-8")
    machine_file(folder, PLANE)


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize(
    ("errors", "names", "parameter", "size"),
    [
        ([[0, 0], [0, 0]], set(), "", 0.0),
        # The mean of both scales is the diameter.
        ([[20e-6, 0], [0, 0]], {"scale-x", "scale-y"}, "scale", 20.0),
        ([[0, -15e-6], [0, 0]], {"squareness-xy"}, "angle", np.degrees(15e-6) * 3600),
    ],
)
def test_what_is_left_of_a_ring_shows_squareness_and_scale(
    tmp_path: Path, errors: object, names: set[str], parameter: str, size: float, several: bool
) -> None:
    rings(tmp_path, np.array(errors), several)
    call = ("-m", "m.yaml", "--cmm", "cmm.csv", "--datum", "offset,diameter")
    found = report("close-loop", *call, *NO_WAVES, cwd=tmp_path)["results"]
    if not names:
        assert found["verdict"] == "none"
        return
    (effect,) = found["effects"]
    assert set(effect["class"]) == names
    own = effect["parameters"][parameter]
    assert abs(abs(own["value"]) - size) < 3 * own["u"] < 0.3 * size
    assert found["after"]["rms_um"] < 1.1 * NOISE_UM < found["before"]["rms_um"]


# `mtu close-loop` on the readings of an axis whose scale grows from its zero as it warms up.


TARGETS = (0, 50, 110, 170, 240, 300, 345, 400)


def read(folder: Path, seed: int, growth: float, scatter: float = 0.8) -> None:
    """Six passes there and back, a reading a minute, of an axis that grows by `growth` um/m/K from
    x = 0; the line and `scatter` um from pass to pass are not known.
    """
    rng = np.random.default_rng(seed)
    rows, minute = ["component,position_mm,pass,direction,error,unit,time_min,T_x_degC"], 0
    for number in range(1, 7):
        of_pass = rng.normal(0, scatter)
        for x, way in [(x, "forward") for x in TARGETS] + [(x, "reverse") for x in TARGETS[::-1]]:
            minute += 1
            warm = 6 * (1 - np.exp(-minute / 40)) + rng.normal(0, 0.05)
            error = 2 + 0.03 * x + of_pass + 1e-3 * growth * x * warm + rng.normal(0, 0.6)
            rows.append(f"pos,{x},{number},{way},{error:.2f},um,{minute},{20 + warm:.2f}")
    (folder / "laser.csv").write_text("\n".join(rows) + "\n", "utf-8")
    machine_file(folder, "{pos: {of: x, unit: um}}", "{Ex: pos}")


def test_a_scale_that_grows_from_zero_is_named_and_no_scatter_any_more(tmp_path: Path) -> None:
    """The axis with its growth declared is as certain as one that does not grow: neither its
    coefficients nor its passes hold the growth again, by readings or by the report.
    """
    read(tmp_path, 1, 0.0)
    laser = ("--laser", "laser.csv")
    done(mtu("fit-components", "-m", "m.yaml", *laser, "-o", "quiet.json", cwd=tmp_path))
    read(tmp_path, 1, 11.0)
    done(mtu("close-loop", "-m", "m.yaml", *laser, "--write-machine", "e.yaml",
             "--write-components", "c.json", "-o", "o.json", cwd=tmp_path))  # fmt: skip
    # About the middle it is a growth and a drift, of which neither shows without the other.
    found = json.loads((tmp_path / "o.json").read_text("utf-8"))["results"]
    assert found["verdict"] in ("named", "class")
    effect = found["effects"][0]
    assert effect["name"] == "thermal-growth-x"
    growth = effect["parameters"]["growth"]
    assert growth["unit"] == "um/m/K"
    assert abs(growth["value"] - 11.0) < 4 * growth["u"]
    assert growth["u"] < 1.0
    assert found["after"]["rms_um"] < 0.5 * found["before"]["rms_um"]
    done(mtu("fit-components", "-m", "m.yaml", *laser, "-o", "before.json", cwd=tmp_path))
    done(mtu("fit-components", "-m", "e.yaml", *laser, "-o", "after.json", cwd=tmp_path))
    quiet, before, after, written = (
        json.loads((tmp_path / f"{name}.json").read_text("utf-8"))["results"]["components"]["pos"]
        for name in ("quiet", "before", "after", "c")
    )
    assert after == written
    scatter = [item["s_pass"] for item in (quiet, before, after)]
    assert scatter[1] > 5 * scatter[0]
    assert scatter[2] < 1.5 * scatter[0]
