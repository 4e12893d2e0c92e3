"""`mtu correct`: a ring and points that a virtual machine measured, report, table, picture, CSV."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cli_runner import Listing, done, listing, mtu
from report_numbers import numbers

MACHINE = """\
schema: mtu/machine/1
name: warm machine
components:
  px: {of: x, unit: um, coefficients: [2, -0.06], covariance: [[0.04, 0], [0, 1.0e-6]],
       pass_covariance: [[0.2, 0], [0, 4.0e-6]], s_repeat: 0.4, dof: 8}
  py: {of: y, unit: um, coefficients: [1, -0.05], covariance: [[0.04, 0], [0, 1.0e-6]],
       pass_covariance: [[0.3, 0], [0, 4.0e-6]], s_repeat: 0.5, dof: 8}
  grow: {unit: um/m, coefficients: [-11], u_future: 0.5}
equations:
  Ex: px + grow*x*(T_scale_degC - 20)
  Ey: py + grow*y*(T_scale_degC - 20)
"""
PART = """\
schema: mtu/part/1
name: ring on a plate
z_mm: 0
features:
  A: {x_mm: 290, y_mm: 180}
  B: {x_mm: 245, y_mm: 257.942286}
  C: {x_mm: 155, y_mm: 257.942286}
  D: {x_mm: 110, y_mm: 180}
  E: {x_mm: 155, y_mm: 102.057714}
  F: {x_mm: 245, y_mm: 102.057714}
"""
RING = """\
circles:
  - {id: ring, features: [A, B, C, D, E, F], calibrated_mm: {20: 180.0124, 26: 180.0137},
     U_um: 1.0, temperature: T_ring_degC}
"""
LENGTH = "lengths: [{from: A, to: D}]\n"
ROUNDING_UM = 1e-10
"""Doubles of 300 mm round by 5.7e-14 mm."""
OUTPUTS = ("-o", "out.json", "--csv", "out.csv", "--plot", "out.png")
FILES = ("-m", "machine.yaml", "-p", "part.yaml", "--cmm", "cmm.csv")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A machine, a part and what the machine measured of three parts, twice each."""
    work = tmp_path_factory.mktemp("correct")
    (work / "machine.yaml").write_text(MACHINE)
    (work / "part.yaml").write_text(PART + RING + LENGTH)
    made = ("--parts", "3", "--repeats", "2", "--cmm-u-um", "0.2", "--seed", "3")
    warm = ("--covariate", "T_scale_degC: 20 + sequence", "--covariate", "T_ring_degC: 23")
    done(mtu("simulate", *FILES[:4], *made, *warm, "--write-cmm", "cmm.csv", cwd=work))
    return work


@pytest.fixture(scope="module")
def outputs(folder: Path) -> Listing:
    """All outputs of one call, the table under ""."""
    result = done(mtu("correct", *FILES, *OUTPUTS, cwd=folder))
    assert result.stderr == ""
    return listing(folder) | {"": result.stdout.encode()}


@pytest.fixture(scope="module")
def document(outputs: Listing) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(outputs["out.json"] or b"")
    return found


def test_the_report_holds_what_the_contract_names(document: dict[str, Any]) -> None:
    assert document["schema"] == "mtu/correct/1"
    assert [item["role"] for item in document["inputs"]] == ["machine", "part", "cmm"]
    results = document["results"]
    assert [len(results[key]) for key in ("points", "circles", "spheres", "lengths")] == [
        36, 3, 0, 3,
    ]  # fmt: skip
    for point in results["points"]:
        assert set(point) >= {"part", "feature", "measured", "correction_um", "corrected"}
    for ring in results["circles"]:
        assert set(ring) >= {"id", "diameter_mm", "error_um", "u_um", "reduction_percent"}
        assert set(ring["diameter_mm"]) == set(ring["error_um"]) == {"before", "after"}
        assert ring["n_repeats"] == 2
    # Only z, which is not measured here, and unnamed operations are null.
    nulls = {name for name, value in numbers(results) if value is None}
    assert all(name.endswith((".z", ".z_mm", ".operation")) for name in nulls)


def test_the_temperature_of_the_ring_may_be_given(folder: Path, tmp_path: Path) -> None:
    """--at that only the calibration needs is no covariate too many; the rows' own come first."""
    (tmp_path / "part.yaml").write_text(PART + RING.replace("T_ring_degC", "T_room_degC"))
    files = ("-m", folder / "machine.yaml", "-p", "part.yaml", "--cmm", folder / "cmm.csv")
    at = ("--at", "T_room_degC=29", "--at", "T_scale_degC=40", "--at", "load=2")
    result = done(mtu("correct", *files, *at, "-o", "-", cwd=tmp_path))
    found = json.loads(result.stdout)
    codes = [item["code"] for item in found["warnings"]]
    assert codes == ["option-not-used", "not-used", "outside-measured-range"]
    assert "load" in found["warnings"][0]["message"]
    assert found["results"]["circles"][0]["calibrated_mm"] == pytest.approx(180.01435)
