"""Closing the loop on published readings, through the command.

Pontius: NIST StRD, https://www.itl.nist.gov/div898/strd/lls/data/Pontius.shtml (public domain),
a load cell whose deflection is all but a straight line of the load. The ring gauge: Valdes, Di
Giacomo & Paziani, Table 3, diameter errors (calibrated minus measured) at 20 and 26 degC.
"""

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_strd import PONTIUS_Y, REFERENCES, numbers

from mtu_cli.cli.main import exit_code

LOADS_KLB = 150.0 * np.arange(1, 21)
DIGITS = 7.0

TABLE_3 = {20: (12, 9, 16, 13, 9), 26: (32, 32, 34, 28, 16)}
"""Errors in um at positions 1, 2, 3, 4 and 9."""


def report(folder: Path, *args: str) -> dict[str, Any]:
    with contextlib.chdir(folder):
        assert exit_code([*args, "-q", "-o", "report.json"]) == 0
    results: dict[str, Any] = json.loads((folder / "report.json").read_text())["results"]
    return results


@pytest.fixture(scope="module")
def pontius(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Two passes of 20 loads: 1000 lb as 1 mm, one inch as 1 mm; nothing known before them. The
    folder of the extended machine, and what was found.
    """
    folder = tmp_path_factory.mktemp("pontius")
    (folder / "machine.yaml").write_text(
        "schema: mtu/machine/1\nname: load cell\n"
        "components: {load: {of: x, unit: um, degree: 1, says: deflection}}\n"
        "equations: {Ex: load}\n"
    )
    rows = [
        f"load,{LOADS_KLB[i % 20]:g},{y:.5f},mm,{i // 20 + 1}"
        for i, y in enumerate(numbers(PONTIUS_Y))
    ]
    text = "\n".join(["component,position_mm,error,unit,pass", *rows])
    (folder / "readings.csv").write_text(text + "\n")
    extended = ("--write-machine", "extended.yaml", "--write-components", "extended.json")
    call = ("close-loop", "-m", "machine.yaml", "--laser", "readings.csv", *extended)
    return folder, report(folder, *call)


def test_pontius_bends_and_nothing_else(pontius: tuple[Path, dict[str, Any]]) -> None:
    """A load cell's deflection takes a quadratic; a cubic is not certified, nor supported."""
    _, found = pontius
    (effect,) = found["effects"]
    assert effect["name"] == "curvature-x"
    assert list(effect["parameters"]) == ["bend"]
    assert found["verdict"] in ("named", "class")
    assert effect["posterior"] > 0.99
    # um/m^2 are 1e-9 mm/mm^2; the certified coefficient is in inch/lb^2.
    bend = effect["parameters"]["bend"]
    item = REFERENCES["Pontius"]
    assert bend["value"] == pytest.approx(1e15 * item.certified[2], rel=10**-DIGITS)
    assert bend["u"] == pytest.approx(1e15 * item.deviations[2], rel=0.3)
    assert not found["unexplained"]["found"]
    # NIST's residual standard deviation of the quadratic is 0.205 um here.
    s = 1e3 * np.linalg.norm(item.y - item.X @ item.certified) / np.sqrt(37)
    assert found["in_sample"]["after"]["rms_um"] == pytest.approx(s * np.sqrt(37 / 40), rel=0.3)
    assert found["after"]["rms_um"] < 2 * s < 0.5 * found["before"]["rms_um"]


def test_the_extended_load_cell_is_the_certified_quadratic(
    pontius: tuple[Path, dict[str, Any]],
) -> None:
    """Three predictions give the polynomial of the extended machine, to seven digits."""
    folder, _ = pontius
    loads = np.array([150.0, 1500.0, 3000.0])
    places = ", ".join(f"'{i}': {{x_mm: {x}, y_mm: 0}}" for i, x in enumerate(loads))
    (folder / "part.yaml").write_text(f"schema: mtu/part/1\nname: loads\nfeatures: {{{places}}}\n")
    machine = ("-m", "extended.yaml", "-c", "extended.json")
    points = report(folder, "predict-points", *machine, "-p", "part.yaml")["points"]
    deflection = np.array([point["Ex_um"] for point in points]) / 1e3
    found = np.linalg.solve(np.vander(loads, 3, increasing=True), deflection)
    certified = REFERENCES["Pontius"].certified * np.array([1.0, 1e3, 1e6])
    np.testing.assert_allclose(found, certified, rtol=10**-DIGITS)


def test_the_ring_gauge_cannot_tell_temperature_from_session(tmp_path: Path) -> None:
    """Two temperatures are two sessions: the drift is there, its cause is a class.

    By hand: the means differ by 16.6 um over 6 K, Student's t of two means on 8 degrees of
    freedom.
    """
    (tmp_path / "machine.yaml").write_text(
        "schema: mtu/machine/1\nname: ring gauge on a bridge CMM\n"
        "components: {diameter: {unit: um, coefficients: [0], says: diameter error}}\n"
        "equations: {Ex: diameter}\n"
    )
    rows = [
        f"diameter,{-error},um,{session},{degrees}"
        for session, (degrees, errors) in enumerate(TABLE_3.items(), start=1)
        for error in errors
    ]
    (tmp_path / "readings.csv").write_text(
        "\n".join(["component,error,unit,session,T_room_degC", *rows]) + "\n"
    )
    found = report(
        tmp_path, "close-loop", "-m", "machine.yaml", "--laser", "readings.csv", "--seed", "3"
    )
    assert found["verdict"] == "class"
    effects = {effect["name"]: effect for effect in found["effects"]}
    drift = effects["thermal-drift-diameter"]
    assert {"trend-diameter", "step-diameter"} & set(drift["class"])
    cold, warm = (np.array(TABLE_3[degrees], float) for degrees in (20, 26))
    by_hand = -(warm.mean() - cold.mean()) / 6
    u = np.sqrt((cold.var(ddof=1) + warm.var(ddof=1)) / 2 * (2 / 5)) / 6
    value = drift["parameters"]["drift"]
    assert value["value"] == pytest.approx(by_hand, rel=1e-6)
    assert value["u"] == pytest.approx(u, rel=0.1)
    assert found["after"]["rms_um"] < 0.6 * found["before"]["rms_um"]
